"""Friction that grows with what is transmitted: bearings and gearbox under the pull of the belt."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, Parameter, Trial
from beltcomm.effects._records import moves


def _level(load: float, share: float) -> float:
    """Additional level of friction of the motor:  share |load|, N m.

    Parameters
    ----------
    load : float, N m at the motor shaft
        Pull of the belt on its lever.
    """
    return share * abs(load)


def _slope(load: float, share: float) -> float:
    """d level/d load."""
    return share if load > 0.0 else -share


def _trials(ground: AxisSummary) -> list[Trial]:
    """Five per cent."""
    return [Trial({"share": 0.05})] if ground.belt else []


EFFECT = Effect(
    name="load_friction",
    slot="load_friction",
    title="friction that grows with the load",
    parameters=(Parameter("share", "1", "motor", 0.02, 0.0, 0.9, "friction over the torque that is transmitted"),),
    law=_level,
    slope=_slope,
    body="motor",
    trials=_trials,
    twins=("torque_saturation",),
    separate="drive and brake at the same torque: friction works against the motion both times, a lost torque against the torque",
    apart={
        "torque_saturation": DiscriminatingExperiment(
            "driving and braking at two forces: friction works against the motion, lost torque against the torque", moves()
        ),
    },
    seen="accelerating needs more and braking less torque than the moving mass says",
    causes="gearbox or screw of low efficiency, bearings under load, tooth flanks",
    check="efficiency of the gearbox in its data sheet; bearings of the driving pulley",
    remedy="grease or replace the bearings of the driving pulley, set the pretension right, a gearbox of better efficiency",
    alike={
        "coulomb": "brake and accelerate with two payloads: Coulomb friction stays, this one grows with the torque",
    },
    source="data sheet of the gearbox",
)
