"""Weight of a load that turns with the motor: an arm, a pendulum, an eccentric drum."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial
from beltcomm.effects.cogging import slope

#: Share of the largest torque that a weight is tried with.
_SHARE = 0.2
#: rad that a load turns at least: over less its weight is a constant and a spring, which other causes make.
_FEWEST_RAD = 1.0


def _force(position: float, speed: float, t: float, order: float, sine: float, cosine: float) -> float:
    """Torque on the motor:  -(sine sin(order θ) + cosine cos(order θ)), N m.   θ : rad, absolute motor angle.

    m g l over the gear ratio is sqrt(sine² + cosine²); the arm hangs where sine sin(order θ) + cosine cos(order θ) is 0 and rises.

    Parameters
    ----------
    order : float
        Turns of the load per turn of the motor.

    References
    ----------
    m g l sin(φ), the moment of a weight about its axis.
    """
    return -(sine * math.sin(order * position) + cosine * math.cos(order * position))


def _trials(ground: AxisSummary) -> list[Trial]:
    """A weight on the motor's shaft, and one behind the gearbox, that turned far enough; a belt axis has its weight on the carriage."""
    if ground.belt or ground.side == "load":
        return []
    size, turned = _SHARE * ground.peak_nm, (ground.high_m - ground.low_m) / ground.ratio
    orders = sorted({1.0, 1.0 / ground.gear}) if ground.gear > 0.0 else [1.0]
    orders = [order for order in orders if order * turned > _FEWEST_RAD]
    return [Trial({"order": order, "sine": size, "cosine": size}, amplitudes=("sine", "cosine"), signed=True) for order in orders]


EFFECT = Effect(
    name="unbalance",
    slot="force",
    title="weight of a load that turns",
    parameters=(
        Parameter("order", "1", "motor", 1.0, 1e-3, 10.0, "turns of the load per turn of the motor", fitted=False),
        Parameter("sine", "N m", "motor", 0.0, -500.0, 500.0, "amplitude of the sine"),
        Parameter("cosine", "N m", "motor", 0.0, -500.0, 500.0, "amplitude of the cosine"),
    ),
    law=_force,
    slope=slope,
    body="motor",
    trials=_trials,
    seen="the torque that holds the axis goes up and down once per turn of the load, at any speed",
    causes="an arm, a pendulum, a drum or a table that is not balanced, on an axis that does not stand upright",
    check="let the axis go at standstill: it swings to where the weight hangs",
    remedy="balance the load, or send the torque of its weight along",
    alike={
        "cogging": "cogging has the motor's poles and slots per turn; a weight once per turn of the load",
        "constant_offset": "turn the load by half a turn: a weight pulls the other way, an offset does not",
    },
    source="data sheet of the load",
)
