"""A place on the rail where the carriage runs tight: as friction of the motor, and what of it acts on the carriage behind the belt."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: m: distance of the places tried, and the width; widths at a place where the base leaves most.
_SPACING_M, _WIDTHS_M, _NARROW_M = 0.04, (0.045,), (0.008, 0.02)


def _level(speed: float, position: float, t: float, amount: float, place: float, width: float, flatness: float) -> float:
    """Additional level of friction:  amount exp(-|(position - place)/width|^flatness), N m at the motor or N at the carriage.

    Parameters
    ----------
    position, place, width : float, m
    """
    return amount * math.exp(-math.pow(abs((position - place) / width), flatness))


def _slope(speed: float, position: float, t: float, amount: float, place: float, width: float, flatness: float) -> float:
    """d level/d speed: none."""
    return 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """A tight spot at every 4 cm of the way covered, and a narrow one where most is left; a motor alone has no way."""
    if not ground.belt and ground.side != "load":
        return []
    count = max(2, math.ceil((ground.high_m - ground.low_m) / _SPACING_M) + 1)
    step = (ground.high_m - ground.low_m) / (count - 1)
    spots = [(ground.low_m + i * step, width) for width in _WIDTHS_M for i in range(count)]
    spots += [(place, width) for width in _NARROW_M for place in ground.rough_m]
    return [Trial({"amount": 0.4 * ground.coulomb, "place": place, "width": width}, signed=True) for place, width in spots]


MOTOR = Effect(
    name="friction_position",
    slot="friction_level",
    title="tight spot on the rail",
    parameters=(
        Parameter("amount", "N m", "motor", 0.02, -5.0, 5.0, "friction at the spot above that elsewhere"),
        Parameter("place", "m", "cart", 0.3, -50.0, 50.0, "carriage position of the spot"),
        Parameter("width", "m", "cart", 0.05, 0.005, 1.0, "distance at which 1/e of it is left"),
        Parameter("flatness", "1", "cart", 2.0, 1.0, 40.0, "2: bell; more: flat top and steep flanks", fitted=False, form=True),
    ),
    law=_level,
    slope=_slope,
    body="motor",
    trials=_trials,
    completed_by=("friction_position_cart",),
    seen="torque of slow strokes rises at one place, in both directions",
    causes="bent rail, dirt, tight carriage",
    check="rail around the place: wipe it, look at its straightness and at the joints",
    remedy="clean, grease and straighten the rail there, set its joint even, replace a damaged carriage",
    alike={
        "cable_chain": "compare both directions: friction turns its sign with the motion, the pull of a chain does not",
        "holding_brake": "look at the distance: a tight spot stands at one place, a brake rubs again after every turn of the motor",
    },
    source="data sheet",
)
CART = Effect(
    name="friction_position_cart",
    slot="friction_level",
    title="tight spot, what of it acts on the carriage",
    parameters=(Parameter("amount", "N", "cart", 3.0, -400.0, 400.0, "friction of the carriage at the spot above that elsewhere"),),
    law=_level,
    slope=_slope,
    body="cart",
    uses=tuple(f"friction_position.{p.name}" for p in MOTOR.parameters[1:]),
    seen="beside the tight spot excitations find the carriage free, at it they find it held",
    causes=MOTOR.causes,
    check=MOTOR.check,
    remedy=MOTOR.remedy,
    alike={"friction_position": "excite at the spot: friction of the carriage fills the notch of the antiresonance, the motor's does not"},
    source="data sheet",
)
EFFECTS = (MOTOR, CART)
