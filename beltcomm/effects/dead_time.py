"""Torque that acts later than it is reported, or an angle that is read late: a dead time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, Parameter, Trial
from beltcomm.effects._records import MIDDLE, wide


@compiled
def _delay_torque(cells: Array, h: float, time: float) -> Array:
    """Torque averaged over cells of ``h`` seconds, ``time`` seconds later (earlier when negative).

    Before the first cell the torque is taken as that of the first.

    Parameters
    ----------
    cells : ndarray (n,), N m
        Mean over each cell.
    """
    whole = math.floor(time / h)
    part, last = time / h - whole, cells.shape[0] - 1
    out = np.empty_like(cells)
    for k in range(cells.shape[0]):
        out[k] = (1.0 - part) * cells[min(max(k - whole, 0), last)] + part * cells[min(max(k - whole - 1, 0), last)]
    return out


def _response(omega: Array, time: float) -> NDArray[np.complex128]:
    """exp(-j ω time)."""
    return np.asarray(np.exp(-1j * omega * time))


def _trials(ground: AxisSummary) -> list[Trial]:
    """A quarter of a millisecond."""
    return [Trial({"time": 2.5e-4}, signed=True)]


EFFECT = Effect(
    name="dead_time",
    slot="torque_delay",
    title="dead time between reported and acting torque",
    parameters=(Parameter("time", "s", "drive", 0.0, -5e-3, 0.2, "time by which torque acts later than it is reported"),),
    law=_delay_torque,
    slope=_response,
    trials=_trials,
    twins=("current_lag",),
    separate="record an excitation up to 250 Hz with more torque: the dead time leaves the magnitude alone, the lag lowers it",
    apart={
        "current_lag": DiscriminatingExperiment(
            "magnitude and phase up to 250 Hz: a dead time leaves the magnitude alone, a lag lowers it", wide(MIDDLE)
        ),
    },
    seen="phase of the frequency response falls in proportion to frequency, at all amplitudes",
    causes="bus cycle, time stamps, filters, an angle that is read late; a recording whose torque is a sample off",
    check="PDO mapping, synchronous mode, time stamps",
    remedy="synchronous mode with setpoint and position on the same SYNC, shorter bus cycle, fewer filters",
    alike={
        "end_pulley": (
            "excite up to 250 Hz at another place: the phase of a second resonance moves with the carriage, that of a dead time stays"
        ),
    },
    source="(3.27)",
)
