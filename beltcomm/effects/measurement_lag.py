"""A torque reading that lags behind the torque: the report filter of a drive, a slow logger."""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.effects._effect import TORQUE_LAG, AxisSummary, DiscriminatingExperiment, Effect, ManualCheck, Parameter, Trial
from beltcomm.effects._records import MIDDLE, sweep, wide
from beltcomm.effects.current_lag import response


@compiled
def _read(torque: Array, start: float, h: float, time: float) -> Array:
    """Reading of a torque, behind a lag 1/(1 + time s).

    time y' = u - y,   y_0 = start.   Exact for a torque that is straight between the samples.

    Parameters
    ----------
    torque : ndarray (n,), N m
        Every ``h`` seconds, straight between.
    """
    out = np.empty_like(torque)
    if time < 1e-9:
        for k in range(torque.shape[0]):  # assigned as a whole it would take ten times as long to compile
            out[k] = torque[k]
        return out
    decay = np.exp(-h / time)
    share = (1.0 - decay) * time / h
    y = start
    for k in range(torque.shape[0]):
        if k > 0:
            y = decay * y + (share - decay) * torque[k - 1] + (1.0 - share) * torque[k]
        out[k] = y
    return out


def _trials(ground: AxisSummary) -> list[Trial]:
    """Six times over the whole range."""
    return [Trial({"time": time}) for time in (3e-4, 1e-3, 4e-3, 1.5e-2, 5e-2, 1.2e-1)]


EFFECT = Effect(
    name="measurement_lag",
    slot="torque_reading",
    title="lag of the torque reading",
    parameters=(Parameter("time", "s", "drive", 1e-3, 0.0, 0.2, "time constant from the torque to its reading"),),
    law=_read,
    slope=response,
    group=TORQUE_LAG,
    trials=_trials,
    twins=("dead_time", "current_lag"),
    separate="record the same way at another speed: a lag moves and flattens a ripple with speed; a repeat at one speed cannot show it",
    apart={
        "dead_time": DiscriminatingExperiment(
            "ripples of slow and fast strokes: a lag flattens the fast ones, a dead time only moves them", sweep(0.05, 0.5, 1.0)
        ),
        "current_lag": DiscriminatingExperiment(
            "fast changes of the torque: the reading is smooth where the motion is not, or both are",
            (*wide(MIDDLE), *sweep(0.05, 0.5, 1.0)),
            (
                ManualCheck(
                    "block the motor and step the current at standstill",
                    "look at it with the drive's own scope beside the reported torque",
                    "a current that rises late is a current_lag, a report that rises behind it a measurement_lag",
                ),
            ),
        ),
    },
    seen="ripples come late by a time, not by a way; fast changes of the torque are read too small",
    causes="report filter of the drive, a slow logger, a filter of the current sensor",
    check="filter constants of the reported current or torque; step of the current at standstill",
    remedy="shorten or remove the report filter of the drive or logger",
    source="effects-and-diagnosis sheet, section 12; data sheet of the drive",
)
