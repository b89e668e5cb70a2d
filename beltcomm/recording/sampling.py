"""Sampling as the motion itself tells it: rows that are missing or written twice, time stamps that are not true.

A motor cannot change its speed at once: where the steps before and after agree, the step between them is like them.  A step of two is
a row that is missing, none is a row that was written twice.  Arrays in, numbers out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, rms

#: Steps of the encoder, and times the position's own noise, that a step between two rows must have to be judged.
FAST_STEPS, FAST_NOISE = 8.0, 20.0
#: Largest difference of two steps that agree, as a share of their mean.
AGREEING = 0.2
#: A step above this many times its neighbours holds a missing row, one below that share of them a row written twice.
LONG, SHORT = 1.6, 0.4
#: Times its neighbours above, and below, which a step is unusual.  Lost rows make no step between these and the others: where such steps
#: are as many, the motion itself is as rough.
LONGER, SHORTER = 1.25, 0.75
#: Steps that must have been judged: of fewer, those in the middle of a swing look alike by chance.
FEWEST_JUDGED = 30
#: Times its neighbours that the step beyond them is, a row lost or written twice there too, or none of this; else the motor swings.
SWINGS = (-0.25, 2.25)
#: Largest deviation of a time step from a whole number of periods, in periods, that is no jitter.
EVEN = 0.02
#: Deviation, in periods, below which stamps differ by the rounding of their numbers.
ROUNDING = 1e-5
#: Deviations of a slope that count as proof.
SIGMAS = 3.0
#: Counts that a position must cover for its grid to be told, counts of the first range, and how far its values must gather on the grid.
FEWEST_COUNTS, FIRST_COUNTS, GATHERED = 500.0, 20.0, 0.9
#: Quantile of |x| of a normal x that a quarter stays below.
QUARTER = 0.3186


@dataclass(frozen=True)
class Uneven:
    """Missing and repeated rows of a record.

    Attributes
    ----------
    missing, repeated : ndarray of int
        Rows before which one is missing, and rows that repeat another, as far as the motion shows it.
    judged : int
        Steps that were fast enough to be judged.
    """

    missing: NDArray[np.intp]
    repeated: NDArray[np.intp]
    judged: int

    @property
    def share(self) -> float:
        """Share of the judged steps."""
        return (len(self.missing) + len(self.repeated)) / max(self.judged, 1)


def uneven_rows(t_s: Array, position: Array) -> Uneven:
    """Rows that are missing or repeated although the time stamps are even.

    Parameters
    ----------
    t_s : ndarray (n,), s
    position : ndarray (n,)
        Any unit.
    """
    none = np.zeros(0, dtype=np.intp)
    if len(position) < 8:
        return Uneven(none, none, 0)
    steps, times = np.diff(position), np.diff(t_s)
    fast = max(FAST_STEPS * finest(position), FAST_NOISE * _noise(position))
    missing: list[int] = []
    repeated: list[int] = []
    judged = 0
    # one step between two agreeing ones on either side, then two: a row that shows the values before it makes a step of nothing and one
    # of two
    for width in (1, 2):
        count = len(steps) - width - 3
        sides = np.stack([steps[i : i + count] for i in (0, 1, width + 2, width + 3)])
        mean = sides.mean(axis=0)
        agree = (np.abs(sides).min(axis=0) > fast) & (np.ptp(sides, axis=0) <= AGREEING * np.abs(mean))
        beyond = np.stack([np.append(mean[:1], steps[: count - 1]), np.append(steps[width + 4 :], mean[-1:])])
        turned = beyond / np.where(agree, mean, 1.0)
        agree &= np.all((turned >= SWINGS[0]) & (turned <= SWINGS[1]), axis=0)
        at = np.flatnonzero(agree)
        usual = np.stack([times[i : i + count] for i in (0, 1, width + 2, width + 3)]).mean(axis=0)
        # by rows and by time: a gap that the stamps show is none, stamps that jitter beside even rows make none
        by_row = steps[2:][at] / mean[at]
        by_time = by_row * usual[at] / times[2:][at]
        if width == 1:
            judged = len(at)
            longest, shortest = np.minimum(by_row, by_time), np.maximum(np.abs(by_row), np.abs(by_time))
            long, short = longest > LONG, shortest < SHORT
            if np.count_nonzero(long) > np.count_nonzero((longest > LONGER) & ~long):
                missing += list(at[long] + 3)
            if np.count_nonzero(short) > np.count_nonzero((shortest < SHORTER) & ~short):
                repeated += list(at[short] + 3)
        else:
            none_then_two = (np.abs(by_row) < SHORT) & (np.abs(by_time) < SHORT) & (steps[3:][at] / mean[at] > LONG)
            repeated += list(at[none_then_two] + 3)
    if judged < FEWEST_JUDGED:
        return Uneven(none, none, judged)
    return Uneven(np.unique(np.array(missing, dtype=np.intp)), np.unique(np.array(repeated, dtype=np.intp)), judged)


def finest(position: Array) -> float:
    """Smallest difference between two values of a position: the encoder's step where the record shows it.

    Parameters
    ----------
    position : ndarray, (n,)
        Any unit.

    Returns
    -------
    float
        In the unit of the position; 0 for one that never changes.
    """
    gaps = np.diff(np.unique(position))
    real = gaps[gaps > 1e-9 * max(1.0, float(np.abs(position).max()))]
    return float(np.percentile(real, 2)) if len(real) else 0.0


def encoder_grid(position: Array) -> float | None:
    """Step of which all values of a position are whole multiples, but for a constant, to some 1e-5.

    From the smallest difference, by least squares over ranges that double: each says the step well enough to count the next.

    Parameters
    ----------
    position : ndarray, (n,)
        Any unit.

    Returns
    -------
    float or None
        In the unit of the position; None where they are multiples of none.
    """
    step = finest(position)
    values = np.unique(position)
    values = values - values[0]
    if step <= 0.0 or values[-1] < FEWEST_COUNTS * step:
        return None
    reach = FIRST_COUNTS * step
    while True:
        near = values[values <= reach]
        counts = np.round(near / step)
        if float(counts @ counts) > 0.0:
            step = float(counts @ near) / float(counts @ counts)
        if reach >= values[-1]:
            break
        reach *= 2.0
    gathered = float(np.abs(np.mean(np.exp(2j * math.pi * values / step))))
    return step if gathered > GATHERED else None


def _noise(position: Array) -> float:
    """Noise of a position from its fourth differences, which a smooth motion hardly has; rows that are amiss touch a few only."""
    return float(np.percentile(np.abs(np.diff(position, 4)), 25.0)) / QUARTER / math.sqrt(70.0)


@dataclass(frozen=True)
class Jitter:
    """Jitter of the time stamps.

    Attributes
    ----------
    largest, rms : float
        Deviation of the time steps from even ones, in periods.
    period_s : float, s
        The even one.
    slope : float
        Of the motion's own unevenness over that of the stamps: 1 where the samples were taken when the stamps say, 0 where they were even;
        nan where nobody can tell.
    error : float
        Its standard deviation.
    share : float
        Of the motion's unevenness, its square, that comes from the stamps'.
    bend : float
        rms of the position's second differences that stamps alone make, in the position's unit.
    """

    largest: float
    rms: float
    period_s: float
    slope: float
    error: float
    share: float
    bend: float

    @property
    def real(self) -> bool:
        """True if the samples were taken unevenly: proven."""
        return self.slope > SIGMAS * self.error and abs(self.slope - 1.0) < abs(self.slope)

    @property
    def only_stamps(self) -> bool:
        """True if the samples were even and the stamps alone jitter: proven."""
        return 1.0 - self.slope > SIGMAS * self.error and abs(self.slope) < abs(1.0 - self.slope)


def stamp_jitter(t_s: Array, position: Array, long_steps: NDArray[np.intp]) -> Jitter | None:
    """Jitter of time stamps, and whether the motion followed them; None for even ones.

        x[n+1] - x[n] - its neighbours' mean = slope · speed · (the same of t)

    Lost samples, whole periods long, are no jitter.

    Parameters
    ----------
    t_s : ndarray (n,), s
    position : ndarray (n,)
        Any unit.
    long_steps : ndarray of int
        Samples after which some were lost.
    """
    times = np.diff(t_s)
    period = float(np.median(times))
    whole = np.round(times / period)
    lost = (whole >= 2.0) & (np.abs(times / period - whole) < EVEN)
    lost[long_steps] = True  # with jitter a gap is no whole number of periods
    off = np.where(lost, 0.0, times / period - 1.0)
    largest = float(np.abs(off).max())
    if largest < ROUNDING:
        return None
    period = float(np.delete(times, long_steps).mean()) if len(long_steps) else float(t_s[-1] - t_s[0]) / len(times)
    steps = np.diff(position)
    speed = 0.5 * (steps[:-2] + steps[2:]) / period
    sound = ~(lost[:-2] | lost[1:-1] | lost[2:])
    uneven_t = (times[1:-1] - 0.5 * (times[:-2] + times[2:]))[sound]
    cause, seen = speed[sound] * uneven_t, (steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]))[sound]
    power = float(cause @ cause)
    apart = rms(off)
    if power <= 0.0:
        return Jitter(largest, apart, period, math.nan, math.inf, 0.0, 0.0)
    bend = rms((speed * (times[1:-1] - times[:-2]))[sound])
    slope = float(cause @ seen) / power
    error = math.sqrt(float(np.sum(cause**2 * (seen - slope * cause) ** 2))) / power
    return Jitter(largest, apart, period, slope, error, max(0.0, slope * float(cause @ seen) / float(seen @ seen)), bend)
