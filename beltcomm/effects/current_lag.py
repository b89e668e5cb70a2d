"""Torque that follows the reported one with a first-order lag."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.effects._effect import TORQUE_LAG, AxisSummary, Effect, Parameter, Trial


@compiled
def _lag_torque(cells: Array, h: float, time: float) -> Array:
    """Torque averaged over cells of ``h`` seconds, behind a lag 1/(1 + time s).

    y' = (u - y)/time;   mean of y over a cell = u + (y_0 - u) (1 - e^{-h/time}) time/h.

    Parameters
    ----------
    cells : ndarray (n,), N m
        Constant in each cell.
    """
    out = np.empty_like(cells)
    if time < 1e-9:
        for k in range(cells.shape[0]):  # assigned as a whole it would take ten times as long to compile
            out[k] = cells[k]
        return out
    decay = np.exp(-h / time)
    share = (1.0 - decay) * time / h
    y = cells[0]
    for k in range(cells.shape[0]):
        out[k] = cells[k] + (y - cells[k]) * share
        y = cells[k] + (y - cells[k]) * decay
    return out


def response(omega: Array, time: float) -> NDArray[np.complex128]:
    """Response of a first-order lag: 1/(1 + j ω time).

    Parameters
    ----------
    omega : ndarray (n,), rad/s
        ω.
    time : float, s
        Time constant.
    """
    return np.asarray(1.0 / (1.0 + 1j * omega * time))


def _trials(ground: AxisSummary) -> list[Trial]:
    """A quarter of a millisecond."""
    return [Trial({"time": 2.5e-4})]


EFFECT = Effect(
    name="current_lag",
    slot="torque_delay",
    title="lag of the current loop",
    parameters=(Parameter("time", "s", "drive", 0.0, 0.0, 2e-2, "time constant from reported to acting torque"),),
    law=_lag_torque,
    slope=response,
    group=TORQUE_LAG,
    trials=_trials,
    twins=("dead_time",),
    separate="record an excitation up to 250 Hz with more torque: the lag lowers the magnitude, a dead time does not",
    seen="phase of the frequency response falls, and its magnitude with the square of frequency",
    causes="slow current loop, torque filter",
    check="gains of the current loop, torque filter of the drive",
    remedy="raise the gains of the current loop by the maker's procedure, take the torque filter out",
    alike={
        "measurement_lag": (
            "look at a step of the current at standstill with the drive's own scope: does the current lag, or only its report?"
        ),
    },
    source="data sheet of the drive",
)
