"""A cable chain or hose that pulls the carriage like a soft spring."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def force(position: float, speed: float, t: float, rate: float, offset: float) -> float:
    """Force on the carriage:  -(rate position + offset), N.   rate : N/m.   offset : N, at carriage position 0."""
    return -(rate * position + offset)


def slope(position: float, speed: float, t: float, rate: float, offset: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return -rate, 0.0


def trials(ground: Ground) -> list[Trial]:
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
    ),
    law=force,
    slope=slope,
    body="cart",
    trials=trials,
    seen="torque changes in proportion to the place, the same in both directions",
    causes="bent cable chain, hose, energy chain that stands up",
    check="unhook the chain and repeat the slow strokes",
    remedy="let the chain roll freely: larger bending radius, longer hose, guide trough; what stays is sent along",
    alike={
        "tilt": "slow strokes over the whole travel: a tilt pulls the same everywhere, a chain changes with the place",
        "friction_position": "compare both directions: friction turns its sign with the motion, the pull of a chain does not",
    },
    linear=True,
    source="data sheet",
)
