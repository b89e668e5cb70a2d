"""A constant torque: tilt, Coulomb friction that differs by direction, or an offset of the current sensor."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, ManualCheck, Parameter, Trial
from beltcomm.effects._records import AGAIN


def _force(position: float, speed: float, t: float, torque: float) -> float:
    """Torque on the motor:  -torque, N m.

    (F_c ± a) sign(v) = F_c sign(v) + a: friction by direction is the same law.

    Parameters
    ----------
    torque : float
        What the axis needs more in positive direction than on average.

    References
    ----------
    (2.22) at one payload; errata 11.
    """
    return -torque


def _slope(position: float, speed: float, t: float, torque: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed): none."""
    return 0.0, 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """One, of a fifth of the Coulomb friction."""
    return [Trial({"torque": 0.2 * ground.coulomb}, signed=True)]


EFFECT = Effect(
    name="constant_offset",
    slot="force",
    title="constant torque: tilt, friction by direction, or current offset",
    parameters=(Parameter("torque", "N m", "motor", 0.0, -5.0, 5.0, "torque needed at any speed and in both directions"),),
    law=_force,
    slope=_slope,
    body="motor",
    trials=_trials,
    twins=("tilt", "coulomb_asymmetry", "current_offset"),
    separate="record slow strokes with a second known payload (tilt grows with the mass), or level the axis and compare",
    apart={
        "tilt": DiscriminatingExperiment(
            "nothing that moves: on one axis with one payload gravity is a constant",
            hands=(
                ManualCheck(
                    "lay a spirit level on the rail, along the travel",
                    "read it",
                    "an axis that rises by the angle that is stated here explains all of it; one that is level nothing",
                ),
                ManualCheck(
                    "put a known payload on, or take it off",
                    AGAIN + " with payload.mass_kg in axis.yaml",
                    "constant_offset.torque that grows as the moved mass is tilt; one that stays is not",
                ),
                ManualCheck(
                    "turn the axis end for end on its mounting",
                    AGAIN,
                    "a tilt of the mounting changes the sign of constant_offset.torque, friction and current sensor keep it",
                ),
            ),
        ),
        "coulomb_asymmetry": DiscriminatingExperiment(
            "nothing that moves: (F_c ± a) sign v is F_c sign v + a",
            hands=(
                ManualCheck(
                    "stage off; push the carriage slowly both ways with a spring balance",
                    "read both forces, at the stroke's middle",
                    "half of their difference is friction by direction or tilt, equal forces leave the current sensor",
                ),
                ManualCheck(
                    "take the wipers of the carriage off, or set it straight",
                    AGAIN,
                    "what is gone of constant_offset.torque was friction by direction",
                ),
            ),
        ),
        "current_offset": DiscriminatingExperiment(
            "nothing that moves: the sensor adds the same to every reading",
            hands=(
                ManualCheck(
                    "stage off, motor at rest",
                    "read torque or current that the drive reports",
                    "what it reports without any current is the sensor's offset",
                ),
                ManualCheck(
                    "take the belt off and let the drive turn the motor slowly both ways",
                    "read the mean of both torques",
                    "a mean that stays is current sensor or motor bearing, one that is gone was behind the belt",
                ),
            ),
        ),
    },
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
