"""Viscous friction that differs by direction."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial


def _force(position: float, speed: float, t: float, share: float, damping: float) -> float:
    """Torque on the motor:  -share damping |speed|, N m.

    With ``viscous`` it is damping (1 + share) forward and damping (1 - share) backward: never negative, so it only takes energy.

    Parameters
    ----------
    damping : float, N m s/rad
        Mean of both directions.
    """
    return -share * damping * abs(speed)


def _slope(position: float, speed: float, t: float, share: float, damping: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return 0.0, -share * damping if speed > 0.0 else share * damping


def _trials(ground: AxisSummary) -> list[Trial]:
    """One: the column is linear in the share."""
    return [Trial({"share": 0.1}, signed=True)]


EFFECT = Effect(
    name="viscous_asymmetry",
    slot="force",
    title="viscous friction by direction",
    parameters=(Parameter("share", "1", "motor", 0.0, -1.0, 1.0, "by what share of the mean friction rises with speed faster forward"),),
    law=_force,
    slope=_slope,
    body="motor",
    uses=("viscous.damping",),
    trials=_trials,
    seen="torque of strokes grows faster with speed in one direction than in the other",
    causes="wear of a screw or gearbox on one flank, a seal lip, a guide under a skewed carriage",
    check="strokes at several speeds, forward against backward; flanks of the screw, skew of the carriage",
    remedy="set the carriage and its seals straight, turn or replace a screw that is worn on one flank",
    alike={
        "constant_offset": "strokes at several speeds: an offset is the same at all of them, this one grows with speed",
    },
    source="EMPS: Janot, Gautier, Brunot 2019, friction by direction; data sheet",
)
