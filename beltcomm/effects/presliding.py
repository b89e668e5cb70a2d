"""Friction that turns round over a distance: elastic lips and preload give way before anything slides."""

from __future__ import annotations

import math

from beltcomm.compiled import compiled
from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, Parameter, Trial
from beltcomm.effects._records import reversals, tiny


@compiled
def _friction_share(step: float, z: float, length: float) -> float:
    """Share of the friction level that acts after a small step, -1 to 1 (Dahl, distance driven).

    z' = s + (z - s) exp(-|step|/length),   s = sign(step)

    Parameters
    ----------
    step, length : float, m at the belt

    References
    ----------
    Effects-and-diagnosis sheet, section 2; Dahl 1968.
    """
    side = 1.0 if step > 0.0 else -1.0
    if step == 0.0 or z == side:  # all of it has turned: the same to the last digit, and no exponential
        return z
    return side + (z - side) * math.exp(-abs(step) / length)


def _friction_share_at_carriage(step: float, z: float, length: float, level: float) -> float:
    """Share of the friction level at the carriage; ``level`` : N, the friction that turns round, is not needed for it."""
    return _friction_share(step, z, length)


def _trials(ground: AxisSummary) -> list[Trial]:
    """Three lengths."""
    return [Trial({"length": length}) for length in (1.5e-5, 4e-5, 1e-4)]


def _cart_trials(ground: AxisSummary) -> list[Trial]:
    """Balls and their cage give way by less than lips do."""
    return [Trial({"length": length}) for length in (2e-6, 6e-6, 3e-5)]


MOTOR = Effect(
    name="presliding",
    slot="friction_onset",
    title="friction that builds up over a distance",
    parameters=(Parameter("length", "m", "motor", 3e-5, 2e-7, 2e-3, "travel over which friction turns round"),),
    law=_friction_share,
    body="motor",
    trials=_trials,
    least=3e-6,  # every rolling contact gives way by 1 to 2 um before it rolls: two counts of the encoder
    seen="after a reversal friction does not jump but grows over some tens of micrometres",
    causes="elastic seal lips, bearing preload",
    check="normally nothing; it limits the smallest moves",
    remedy="none needed; seals with less grip where moves below that distance matter",
    alike={
        "backlash": "let the torque turn round slowly: elastic friction holds the motor like a spring, in a gap it turns freely",
        "friction_dip": "strokes at constant low speed: presliding is over within its distance, a dip stays as long as the motion is slow",
    },
    source="data sheet of seals",
)
CART = Effect(
    name="presliding_cart",
    slot="friction_onset",
    title="friction of the carriage that builds up over a distance",
    parameters=(Parameter("length", "m", "cart", 5e-6, 5e-7, 2e-3, "travel over which the carriage's friction turns round"),),
    law=_friction_share_at_carriage,
    uses=("cart_friction.level",),
    body="cart",
    trials=_cart_trials,
    twins=("cart_friction",),
    separate="an excitation so small that the carriage hardly leaves its place",
    apart={
        "cart_friction": DiscriminatingExperiment(
            "excitations hardly above friction: the carriage is held by a spring, or stuck", (*tiny(), *reversals())
        ),
    },
    seen="small excitations find the carriage held by a spring and not stuck",
    causes="preloaded balls of the guide, wipers",
    check="normally nothing; preload class of the guide",
    remedy="none needed; a lower preload class where the smallest moves matter",
    source="data sheet of the guide",
)
EFFECTS = (MOTOR, CART)
