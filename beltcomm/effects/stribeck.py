"""Friction that falls as the axis gets faster: boundary lubrication at low speed, of the motor and of the carriage behind the belt."""

from __future__ import annotations

import math
from collections.abc import Mapping

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Exponents that have been measured, and how near to the smallest one a fit has met it.
LEAST, MOST, MET = 0.5, 4.0, 0.005


def _level(speed: float, position: float, t: float, amount: float, speed_scale: float, exponent: float) -> float:
    """Additional level of friction:  amount exp(-|speed/speed_scale|^exponent), N m at the motor.

    Source: thesis (2.21) with Stribeck's term; exponent 2 after Armstrong-Hélouvry, 0.5 to 4 have been measured.
    """
    return amount * math.exp(-math.pow(abs(speed / speed_scale), exponent))


def _slope(speed: float, position: float, t: float, amount: float, speed_scale: float, exponent: float) -> float:
    """d level/d speed; at standstill 0, between the slopes of both directions."""
    if speed == 0.0:
        return 0.0
    share = exponent / speed * math.pow(abs(speed / speed_scale), exponent)
    return -share * _level(speed, position, t, amount, speed_scale, exponent)


def _level_at_carriage(speed: float, position: float, t: float, amount: float, speed_scale: float, exponent: float, ratio: float) -> float:
    """Additional level of friction at the carriage, N.

    Parameters
    ----------
    speed : float, m/s
    speed_scale : float, rad/s of the motor
    ratio : float, m/rad
    """
    return amount * math.exp(-math.pow(abs(speed / (ratio * speed_scale)), exponent))


def _slope_at_carriage(speed: float, position: float, t: float, amount: float, speed_scale: float, exponent: float, ratio: float) -> float:
    """d level/d speed, N s/m."""
    return _slope(speed / ratio, position, t, amount, speed_scale, exponent) / ratio


def trials(ground: AxisSummary) -> list[Trial]:
    """Half the Coulomb friction more at standstill, or less, at three speed scales.

    Parameters
    ----------
    ground : AxisSummary
        Of the axis that is searched.
    """
    return [Trial({"amount": 0.4 * ground.coulomb, "speed_scale": v / ground.ratio}) for v in (0.012, 0.03, 0.07)]


def _implausible(values: Mapping[str, float]) -> str:
    """True if it falls more slowly than any that was measured: so does friction that grows with the logarithm of the time of contact."""
    return "friction that falls with the logarithm of the speed" if values["exponent"] < LEAST + MET else ""


MOTOR = Effect(
    name="stribeck",
    slot="friction_level",
    title="Stribeck friction",
    parameters=(
        Parameter("amount", "N m", "motor", 0.02, 0.0, 5.0, "friction at standstill above that in motion"),
        # A larger scale would imitate viscous friction or drag.
        Parameter("speed_scale", "rad/s", "motor", 2.5, 0.2, 10.0, "speed at which 1/e of it is left"),
        Parameter("exponent", "1", "motor", 2.0, LEAST, MOST, "how suddenly it falls with speed", fitted=False, form=True),
    ),
    law=_level,
    slope=_slope,
    body="motor",
    trials=trials,
    completed_by=("stribeck_cart",),
    unlikely=_implausible,
    seen="slow strokes need more torque than the friction of faster ones says; stick-slip at creeping speed",
    causes="boundary lubrication, new seals, carriage preload",
    check="grease, seals, preload of the carriage",
    remedy="grease of the right viscosity, run in new seals, less preload of the carriage",
    alike={
        "friction_dip": "slow strokes at 1 to 20 mm/s: with Stribeck friction the slowest need most torque, with a dip least",
        "presliding": (
            "strokes at constant low speed: Stribeck friction stays as long as the motion is slow, presliding is over within its distance"
        ),
    },
    source="(2.21)",
)
CART = Effect(
    name="stribeck_cart",
    slot="friction_level",
    title="Stribeck friction, what of it acts on the carriage",
    parameters=(Parameter("amount", "N", "cart", 3.0, 0.0, 400.0, "friction of the carriage at standstill above that in motion"),),
    law=_level_at_carriage,
    slope=_slope_at_carriage,
    body="cart",
    uses=("stribeck.speed_scale", "stribeck.exponent", "transmission.ratio"),
    seen="slow strokes need more torque, and small excitations find the carriage held more than large ones do",
    causes="guide and its seals, preload of the carriage",
    check="grease and seals of the guide, preload of the carriage; push it by hand with the belt slack",
    remedy="grease of the right viscosity, run in new seals, less preload of the carriage",
    alike={"stribeck": "take the belt off and turn the motor slowly: what is left of it is the motor's"},
    source="(2.21)",
)
EFFECTS = (MOTOR, CART)
