"""The torque path of a drive: from setpoint to acting torque, and from acting torque to its reading.

A tick is a list of pieces (torque in N m, share of the tick), one after the other, in which the torque is held.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from beltcomm.arrays import Array
from beltcomm.plant.drive_section import Instruments

Pieces = list[tuple[float, float]]

#: Pieces per tick in which the machine meets a torque that a filter shapes: 0.1 ms; the hold takes 0.8 % of 500 Hz and no time.
PIECES_PER_TICK = 10
_NOISE_BLOCK = 4096
_ROUNDING = 1e-9


class Noise:
    """Gaussian noise of a given rms, one value a tick:  n[k] = a n[k-1] + sqrt(1 - a²) w[k],  a = exp(-T/time).

    Parameters
    ----------
    rms_nm : float
        Standard deviation, N m.
    time_s : float
        Correlation time, s; 0: white.
    generator : numpy.random.Generator
        Source of w.
    """

    def __init__(self, rms_nm: float, time_s: float, generator: np.random.Generator, tick_s: float) -> None:
        self._rms_nm, self._generator = rms_nm, generator
        self._white: list[float] = []
        self._pole = math.exp(-tick_s / time_s) if time_s > 0.0 else 0.0
        self._share = math.sqrt(1.0 - self._pole**2)
        self._last: float | None = None

    def draw(self) -> float:
        """Value of the next tick, N m."""
        if not self._white:
            self._white = (self._rms_nm * self._generator.standard_normal(_NOISE_BLOCK)).tolist()
        white = self._white.pop()
        if self._pole == 0.0:
            return white
        self._last = white if self._last is None else self._pole * self._last + self._share * white
        return self._last


class TorqueDelivery:
    """Slope limit, setpoint filter and current loop, solved exactly for setpoints that are held.

    x' = A x + B u,  y = C x;  u follows the setpoint with a limited slope s.  Mean torques of pieces are exact: y is integrated as one
    more state of the matrix exponential.

    Parameters
    ----------
    instruments : Instruments
        Slope limit, filter and current loop are used.
    current_loop : bool
        False ends the path in front of the current loop: the torque that is asked of it.
    """

    def __init__(self, instruments: Instruments, tick_s: float, current_loop: bool = True) -> None:
        self._slew_nm_tick = instruments.torque_slew_nm_s * tick_s
        self._rates = _rate_matrix(instruments, tick_s, current_loop)
        self._order = len(self._rates) - 3
        self._response = lru_cache(maxsize=64)(self._solve)
        self.reset()

    @property
    def acts(self) -> bool:
        """True if the path changes a held setpoint at all."""
        return self._order > 0 or self._slew_nm_tick > 0.0

    def reset(self) -> None:
        """No torque, no current."""
        self._state = np.zeros(self._order + 1)

    def shape(self, setpoints: Pieces) -> Pieces:
        """The torque of a tick.

        Parameters
        ----------
        setpoints : list of (float, float)
            Setpoints that arrive in this tick, N m, and their shares of it.

        Returns
        -------
        list of (float, float)
            Mean torques, N m, of pieces of at most 1/``PIECES_PER_TICK``; fewer where nothing changes.
        """
        pieces: Pieces = []
        for setpoint_nm, share in setpoints:
            ramp, slope = self._ramp(setpoint_nm, share)
            if ramp > 0.0:
                pieces += self._pass(ramp, slope)
            if share - ramp > 0.0:
                self._state[-1] = setpoint_nm
                pieces += self._pass(share - ramp, 0.0)
        return pieces

    def _ramp(self, setpoint_nm: float, share: float) -> tuple[float, float]:
        """Time for which the slope limit acts, in ticks, and the slope, N m per tick."""
        gap = setpoint_nm - self._state.item(-1)
        left = abs(gap) / self._slew_nm_tick if self._slew_nm_tick > 0.0 else 0.0
        if left <= _ROUNDING:
            return 0.0, 0.0
        return left if left < share - _ROUNDING else share, math.copysign(self._slew_nm_tick, gap)

    def _pass(self, share: float, slope: float) -> Pieces:
        state = self._state
        if slope == 0.0 and self._rests():
            return [(state.item(-1), share)]
        count = max(1, math.ceil(share * PIECES_PER_TICK - _ROUNDING))
        solved = (self._response(share, count) @ np.append(state, slope)).tolist()
        self._state = np.array(solved[count:])
        return [(torque, share / count) for torque in solved[:count]]

    def _rests(self) -> bool:
        """True if every filter has arrived at its input."""
        *inner, asked = self._state.tolist()
        return all(value == asked for value in inner)

    def _solve(self, share: float, count: int) -> Array:
        """Means of ``count`` equal pieces and the state at their end, linear in (x, u, slope).   (count + order + 1, order + 2)."""
        size = self._order + 2
        step = expm(self._rates * (share / count))
        advance = np.eye(size)
        rows = []
        for _ in range(count):
            rows.append(step[size, :size] @ advance * (count / share))
            advance = step[:size, :size] @ advance
        return np.vstack([*rows, advance[:-1]])


def _rate_matrix(instruments: Instruments, tick_s: float, current_loop: bool) -> Array:
    """d/dt of (x, u, slope of u, integral of y), time in ticks."""
    stages: list[tuple[float, ...]] = []
    if instruments.setpoint_filter_s > 0.0:
        stages.append((tick_s / instruments.setpoint_filter_s,))
    if current_loop and instruments.current_loop_s > 0.0:
        stages.append((tick_s / instruments.current_loop_s,))
    if current_loop and instruments.current_loop_hz > 0.0:
        stages.append((math.tau * instruments.current_loop_hz * tick_s, instruments.current_loop_damping))
    order = sum(map(len, stages))
    matrix = np.zeros((order + 3, order + 3))
    matrix[order, order + 1] = 1.0
    source = order
    at = 0
    for stage in stages:
        rate = stage[0]
        if len(stage) == 1:
            matrix[at, at], matrix[at, source] = -rate, rate
            source, at = at, at + 1
        else:
            # y' = w (z - y),  z' = w (in - y) - (2 d - 1) w (z - y): z is where y goes, and in when the loop rests.
            damping = stage[1]
            matrix[at, at], matrix[at, at + 1] = -rate, rate
            matrix[at + 1, source] = rate
            matrix[at + 1, at + 1] = -(2.0 * damping - 1.0) * rate
            matrix[at + 1, at] = (2.0 * damping - 2.0) * rate
            source, at = at, at + 2
    matrix[order + 2, source] = 1.0
    return matrix


class TorqueReading:
    """From the torque of a tick to what stands in 6077h at its end: mean, late, filter and noise, steps.

    r[k] = a r[k-1] + (1 - a) m[k],  a = exp(-T/``reading_filter_s``);  m : mean over a tick that ended ``reading_late_ticks`` ago.

    Parameters
    ----------
    instruments : Instruments
        What belongs to the reading is used.
    noise : Noise or None
        Of the sensor.
    """

    def __init__(self, instruments: Instruments, noise: Noise | None, tick_s: float) -> None:
        self._noise = noise
        self._pole = math.exp(-tick_s / instruments.reading_filter_s) if instruments.reading_filter_s > 0.0 else 0.0
        self._inside = instruments.reading_filters_noise
        self._step_nm = instruments.reading_step_nm
        late_ticks = instruments.reading_late_ticks * (1e-3 / tick_s)
        whole = math.floor(late_ticks + _ROUNDING)
        late = late_ticks - whole
        self._late = late if late > _ROUNDING else 0.0
        self._parts = deque([(0.0, 0.0)] * (whole + 2), maxlen=whole + 2)
        self._is_late = instruments.reading_late_ticks > 0.0
        self._filtered = 0.0

    def sample(self, pieces: Pieces) -> float:
        """The reading at the end of a tick, N m.

        Parameters
        ----------
        pieces : list of (float, float)
            Torque of the tick, N m, and shares.
        """
        value = self._mean(pieces)
        noise = self._noise.draw() if self._noise is not None else 0.0
        if self._inside:
            value += noise
        if self._pole > 0.0:
            value = self._filtered = self._pole * self._filtered + (1.0 - self._pole) * value
        if not self._inside:
            value += noise
        return self._step_nm * math.floor(value / self._step_nm + 0.5) if self._step_nm > 0.0 else value

    def _mean(self, pieces: Pieces) -> float:
        if not self._is_late:
            return mean_torque(pieces)
        begin = mean_torque(_cut(pieces, 1.0 - self._late))
        self._parts.append((begin, mean_torque(pieces) - begin))
        return self._parts[0][1] + self._parts[1][0]


def mean_torque(pieces: Iterable[tuple[float, float]]) -> float:
    """Mean over the tick, N m:  Σ torque · share.

    Parameters
    ----------
    pieces : iterable of tuple of float
        Torque, N m, and its share of the tick.
    """
    total = 0.0
    for torque_nm, share in pieces:
        total += share * torque_nm
    return total


def _cut(pieces: Pieces, end: float) -> Pieces:
    """Pieces in front of ``end``, a share of the tick."""
    found, begin = [], 0.0
    for torque_nm, share in pieces:
        if begin >= end:
            break
        found.append((torque_nm, min(share, end - begin)))
        begin += share
    return found
