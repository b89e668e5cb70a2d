"""The belt as one spring whose stiffness follows the carriage position, end pulley without mass."""

from __future__ import annotations

from beltcomm.compiled import compiled
from beltcomm.effects._effect import BELT_SPRING, DRIVING_END, Effect, Element, Parameter

BELT_PARAMETERS = (
    Parameter("specific_stiffness", "N", "belt", 1e5, 1e3, 1e7, "tensile stiffness EA of the belt"),
    Parameter("pulley_distance", "m", "belt", 1.0, 0.05, 50.0, "distance l3 between the pulley centres"),
    Parameter("offset", "m", "belt", 0.1, 1e-3, 10.0, "free belt length l1 at carriage position 0"),
)


@compiled
def stiffness(x: float, specific_stiffness: float, pulley_distance: float, offset: float) -> float:
    """Stiffness seen by the carriage, N/m.

    c(x) = EA/l1 + EA/(2 l3 - l1),   l1 = offset + x

    Parameters
    ----------
    x : float, m
        Carriage position.
    specific_stiffness : float, N
        EA of the belt.
    pulley_distance : float, m
        l3.
    offset : float, m
        From the driving pulley to the carriage at x = 0.

    References
    ----------
    (2.10), (2.26) with the end pulley taken as massless.
    """
    l1 = offset + x
    return specific_stiffness * (1.0 / l1 + 1.0 / (2.0 * pulley_distance - l1))


def _force(stretch: float, rate: float, x: float, specific_stiffness: float, pulley_distance: float, offset: float) -> float:
    """Force in the spring:  force = c(x) stretch, N.   Source: (2.25), (2.26)."""
    l1 = offset + x
    return specific_stiffness * (1.0 / l1 + 1.0 / (2.0 * pulley_distance - l1)) * stretch


def _slope(x: float, specific_stiffness: float, pulley_distance: float, offset: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return stiffness(x, specific_stiffness, pulley_distance, offset), 0.0


EFFECT = Effect(
    name="belt_spans",
    slot="element",
    of_belt=True,
    title="belt as two spans of known geometry",
    parameters=BELT_PARAMETERS,
    elements=(Element((DRIVING_END, "cart"), _force, _slope),),
    group=BELT_SPRING,
    seen="antiresonance and resonance move with the carriage position",
    causes="free belt lengths change with the place: every belt axis has it",
    check="belt path, position of the clamp",
    remedy="none needed: the design must hold at both ends of the travel",
    alike={
        "stiffness_position": "the same law for a belt whose lengths are not known well; the data sheet of the axis decides",
    },
    source="(2.26)",
)
