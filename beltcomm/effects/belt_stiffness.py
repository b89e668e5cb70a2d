"""The belt as one spring between the driving end and the carriage, with constant stiffness."""

from __future__ import annotations

from beltcomm.effects._effect import BELT_SPRING, DRIVING_END, Effect, Element, Parameter


def _force(stretch: float, rate: float, x: float, stiffness: float) -> float:
    """Force in the spring:  force = c stretch, N.

    Parameters
    ----------
    stretch : float, m
    stiffness : float
        N/m at the belt line.

    References
    ----------
    (2.25).
    """
    return stiffness * stretch


def _slope(x: float, stiffness: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return stiffness, 0.0


EFFECT = Effect(
    name="belt_stiffness",
    slot="element",
    title="belt stiffness",
    parameters=(Parameter("stiffness", "N/m", "belt", 2e5, 1e3, 1e8, "stiffness between driving pulley and carriage"),),
    elements=(Element((DRIVING_END, "cart"), _force, _slope),),
    group=BELT_SPRING,
    seen="antiresonance and resonance in the frequency response",
    causes="the belt itself, its clamp and its teeth: every belt axis has it",
    check="belt tension, clamp at the carriage; compare with the data sheet",
    remedy="pretension by the belt's data sheet, tighten the clamp; a wider or stiffer belt moves the resonance up",
    alike={
        "coupling": "excite near both ends of the travel: the stiffness of a belt changes with the place, that of a coupling does not",
    },
    linear=True,
    source="(2.25)",
)
