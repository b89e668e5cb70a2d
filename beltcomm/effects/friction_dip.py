"""Friction that is lower at low speed: the opposite of Stribeck's."""

from __future__ import annotations

import math

from beltcomm.effects._effect import DiscriminatingExperiment, Effect, Parameter
from beltcomm.effects._records import ENDS, MIDDLE, reversals, slow, wide
from beltcomm.effects.stribeck import trials


def _level(speed: float, position: float, t: float, amount: float, speed_scale: float) -> float:
    """Additional level of friction:  amount (1 - exp(-(speed/speed_scale)²)), N m at the motor; the Coulomb level is that at standstill."""
    x = speed / speed_scale
    return amount * (1.0 - math.exp(-(x * x)))


def _slope(speed: float, position: float, t: float, amount: float, speed_scale: float) -> float:
    """d level/d speed."""
    return 2.0 * amount * speed / speed_scale**2 * math.exp(-((speed / speed_scale) ** 2))


EFFECT = Effect(
    name="friction_dip",
    slot="friction_level",
    title="friction lowered at low speed",
    parameters=(
        Parameter("amount", "N m", "motor", 0.02, 0.0, 5.0, "friction in motion above that at standstill"),
        # A larger scale would imitate viscous friction.
        Parameter("speed_scale", "rad/s", "motor", 2.5, 0.2, 10.0, "speed at which all but 1/e of it is there"),
    ),
    law=_level,
    slope=_slope,
    body="motor",
    trials=trials,
    twins=("presliding", "dead_time"),
    separate="strokes at constant low speed: the dip stays as long as the motion is slow, presliding is over within its distance",
    apart={
        "presliding": DiscriminatingExperiment(
            "constant low speed: a dip stays as long as it is slow, presliding ends within its way", (*slow(*ENDS), *reversals())
        ),
        "dead_time": DiscriminatingExperiment("constant low speed, where no delay shows: the dip stays", (*slow(*ENDS), *wide(MIDDLE))),
    },
    seen="around a reversal, before it and after it, the axis needs less torque than the friction of slow strokes says",
    causes="rolling elements and preload that give way before they slide, thin grease, friction that needs speed to build up",
    check="slow strokes at 1, 2, 5, 10, 20 mm/s both ways",
    remedy="less preload or a thinner grease where slow moves matter; else it is sent along",
    alike={
        "stribeck": "slow strokes at 1 to 20 mm/s: with a dip the slowest need least torque, with Stribeck friction most",
    },
    source="(2.21) with a term of its own; effects-and-diagnosis sheet, section 12",
)
