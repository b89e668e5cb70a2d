"""From a setpoint to the torque that acts, and from that to its reading: a delay and filters each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from beltcomm.arrays import Array, later, row_means
from beltcomm.compiled import compiled
from beltcomm.fit.torque.lag import Lag
from beltcomm.simulate.imperfect import CELLS


@dataclass(frozen=True)
class DriveLaw:
    """Law from torque setpoint to acting torque.

    Attributes
    ----------
    delay : float
        Sampling periods, any number.
    lags : tuple of Lag
        One behind the other.
    gain : float, N m/(N m)
    delay_interval : float
        Half width at 95 %, periods; 0 for a whole delay, and where it is not known.
    """

    delay: float = 1.0
    lags: tuple[Lag, ...] = ()
    gain: float = 1.0
    delay_interval: float = field(default=0.0, compare=False)

    def cells(self, setpoint: Array, sample_s: float, number: int = CELLS) -> Array:
        """Mean acting torque in each of ``number`` cells of every period, N m, (n, number); a setpoint is held until the next one."""
        whole = math.floor(self.delay)
        # A limited slew rate does not see where within a cell its command changes; it may as well act ahead of the delay.
        ahead = any(lag.kind == "slew rate" for lag in self.lags)
        old = np.clip((0.0 if ahead else self.delay - whole) * number - np.arange(number), 0.0, 1.0)
        cells = _held(setpoint, whole, old, self.gain)
        for lag in self.lags:
            cells = lag.answer(cells, sample_s)
        if ahead:
            cells = _late(cells, self.delay - whole)
        return np.asarray(cells)

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque."""
        return self.delay * sample_s + sum(lag.delay_s(sample_s) for lag in self.lags)


@dataclass(frozen=True)
class ReadingLaw:
    """Law from acting torque to reading.

    Attributes
    ----------
    late : float
        Sampling periods, 0 and more; of an instantaneous one also a part of one before the angle.
    lags : tuple of Lag
        One behind the other.
    at_end : bool
        Whether it is the torque at the end of the period, else its mean over the period.
    """

    late: float = 0.0
    lags: tuple[Lag, ...] = ()
    at_end: bool = False

    @property
    def faithful(self) -> bool:
        """True if the reading is the mean of the torque that acted from its sample to the next."""
        return self.late == 0.0 and not self.lags and not self.at_end

    def read(self, cells: Array, sample_s: float) -> Array:
        """The reading, N m, (n,), without noise, that the mean torque in each cell of every period gives, (n, cells)."""
        for lag in self.lags:
            cells = lag.answer(cells, sample_s)
        if self.at_end:
            whole = math.floor(self.late)
            return later(torque_at(cells, 1.0 - (self.late - whole)), whole)
        return row_means(_late(cells, self.late))

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque."""
        return self.late * sample_s + sum(lag.delay_s(sample_s) for lag in self.lags)


def torque_at(cells: Array, share: float) -> Array:
    """Torque at a share of every period, by the parabola through the means of three cells.

    Between two beginnings of a cell it is linear.

    Parameters
    ----------
    cells : ndarray (n, cells), N m
        Mean over each cell.
    share : float
        Of the period, 0 to 1.

    Returns
    -------
    ndarray (n,), N m
    """
    row, number = cells.reshape(-1), cells.shape[1]
    whole = math.floor(share * number)
    part = share * number - whole

    def beginning(cell: int) -> Array:
        last = np.clip(np.arange(len(cells)) * number + cell - 1, 0, len(row) - 1)
        return np.asarray((11.0 * row[last] - 7.0 * row[np.maximum(last - 1, 0)] + 2.0 * row[np.maximum(last - 2, 0)]) / 6.0)

    here = beginning(whole)
    return here if part == 0.0 else here + part * (beginning(whole + 1) - here)


def _late(cells: Array, periods: float) -> Array:
    """Cells of a torque so many periods later, (n, cells); it was held before the first one."""
    row, steps = cells.reshape(-1), periods * cells.shape[1]
    whole = math.floor(steps)
    now, before = later(row, whole), later(row, whole + 1)
    return np.asarray((now + (steps - whole) * (before - now)).reshape(cells.shape))


@compiled
def _held(setpoint: Array, late: int, old: Array, gain: float) -> Array:
    """Cells of a setpoint that is held for a period, so many later; old : share of each cell in which the one before acts."""
    out = np.empty((len(setpoint), len(old)))
    for i in range(len(setpoint)):
        now, before = setpoint[max(i - late, 0)], setpoint[max(i - late - 1, 0)]
        for j in range(len(old)):
            out[i, j] = gain * (now + (before - now) * old[j])
    return out
