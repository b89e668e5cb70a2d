"""A cable chain or hose that pulls the carriage like a soft spring."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial


def _force(position: float, speed: float, t: float, rate: float, offset: float, bend: float, twist: float) -> float:
    """Force on the carriage:  -(offset + rate x + bend x² + twist x³), N,  x : position, m.

    Parameters
    ----------
    offset, rate : float, N, N/m
        At carriage position 0.
    bend, twist : float, N/m², N/m³
        Of a chain that hardens or softens as it rolls.
    """
    return -(offset + position * (rate + position * (bend + position * twist)))


def _slope(position: float, speed: float, t: float, rate: float, offset: float, bend: float, twist: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return -(rate + position * (2.0 * bend + 3.0 * position * twist)), 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """Spring and offset as two columns; a motor alone pulls no chain."""
    if not ground.belt and ground.side != "load":
        return []
    return [Trial({"rate": 8.0, "offset": 2.0}, amplitudes=("rate", "offset"), signed=True)]


EFFECT = Effect(
    name="cable_chain",
    slot="force",
    title="pull of a cable chain",
    parameters=(
        Parameter("rate", "N/m", "cart", 0.0, -500.0, 500.0, "spring rate"),
        Parameter("offset", "N", "cart", 0.0, -400.0, 400.0, "force at carriage position 0, any other constant force included"),
        Parameter("bend", "N/m2", "cart", 0.0, -1e3, 1e3, "how its spring rate changes with the place", fitted=False, form=True),
        Parameter("twist", "N/m3", "cart", 0.0, -1e3, 1e3, "how that changes with the place", fitted=False, form=True),
    ),
    law=_force,
    slope=_slope,
    body="cart",
    trials=_trials,
    seen="torque changes in proportion to the place, the same in both directions",
    causes="bent cable chain, hose, energy chain that stands up",
    check="unhook the chain and repeat the slow strokes",
    remedy="let the chain roll freely: larger bending radius, longer hose, guide trough; what stays is sent along",
    alike={
        "tilt": "slow strokes over the whole travel: a tilt pulls the same everywhere, a chain changes with the place",
        "friction_position": "compare both directions: friction turns its sign with the motion, the pull of a chain does not",
    },
    source="data sheet",
)
