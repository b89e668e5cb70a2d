"""A constant torque: tilt, Coulomb friction that differs by direction, or an offset of the current sensor."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def force(position: float, speed: float, t: float, torque: float) -> float:
    """Torque on the motor:  -torque, N m.   torque : what the axis needs more in positive direction than on average.

    (F_c ± a) sign(v) = F_c sign(v) + a: friction by direction is the same law.   Source: (2.22) at one payload; errata 11.
    """
    return -torque


def slope(position: float, speed: float, t: float, torque: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed): none."""
    return 0.0, 0.0


def trials(ground: Ground) -> list[Trial]:
    """One, of a fifth of the Coulomb friction."""
    return [Trial({"torque": 0.2 * ground.coulomb}, signed=True)]


EFFECT = Effect(
    name="constant_offset",
    slot="force",
    title="constant torque: tilt, friction by direction, or current offset",
    parameters=(Parameter("torque", "N m", "motor", 0.0, -5.0, 5.0, "torque needed at any speed and in both directions"),),
    law=force,
    slope=slope,
    body="motor",
    trials=trials,
    twins=("tilt", "coulomb_asymmetry", "current_offset"),
    separate="record slow strokes with a second known payload (tilt grows with the mass), or level the axis and compare",
    seen="more torque in one direction than in the other, at every speed",
    causes="axis not level, seal lip or skewed carriage, offset of the current sensor",
    check="spirit level; push the carriage both ways with a spring balance; torque reading with the stage off",
    remedy="level the axis, set the carriage and its seals straight, let the drive calibrate its current sensors",
    alike={
        "cable_chain": "slow strokes over the whole travel: the pull of a chain changes with the place, an offset does not",
    },
    linear=True,
    source="(2.22)",
)
