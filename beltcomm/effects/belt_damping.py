"""Damping of the belt, parallel to its spring."""

from __future__ import annotations

import math

from beltcomm.effects._effect import DRIVING_END, AxisSummary, Effect, Element, Parameter, Trial


def _force(stretch: float, rate: float, x: float, damping: float) -> float:
    """Force in the damper:  force = d rate, N.

    Parameters
    ----------
    rate : float, m/s
    damping : float
        N s/m at the belt line.

    References
    ----------
    (2.25).
    """
    return damping * rate


def _slope(x: float, damping: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return 0.0, damping


def _trials(ground: AxisSummary) -> list[Trial]:
    """Damping ratios of the resonance from hardly any to a soft belt's."""
    swinging = 1.0 / (ground.ratio**2 / ground.inertia + 1.0 / ground.mass)
    return [Trial({"damping": 2.0 * ratio * math.sqrt(ground.stiffness * swinging)}) for ratio in (0.005, 0.02, 0.06)]


EFFECT = Effect(
    name="belt_damping",
    slot="element",
    title="belt damping",
    parameters=(Parameter("damping", "N s/m", "belt", 15.0, 0.0, 2000.0, "losses in the belt"),),
    elements=(Element((DRIVING_END, "cart"), _force, _slope),),
    trials=_trials,
    seen="width of the resonance",
    causes="losses in rubber and cords: every belt has them",
    check="nothing; every belt has it",
    remedy="none needed",
    alike={
        "cart_friction": (
            "excite while the carriage travels (identify --loop direct): friction no longer poses as damping, the belt's stays"
        ),
    },
    linear=True,
    source="(2.25), (2.27)",
)
