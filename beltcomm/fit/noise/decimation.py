"""Every which sample of a coarse encoder is taken: between neighbours rounding follows the motion, and is no white noise.

The second difference over m periods is an exact average of the acceleration, too, so nothing is biased: the torque is known in between.
"""

from __future__ import annotations

import math

import numpy as np

from beltcomm.arrays import Array, row_means
from beltcomm.simulate.imperfect import CELLS, Intersample

#: Differences that are looked at, parts that the smallest may have, deviation from whole multiples of the step, and share that keep to it.
SMALLEST, MOST_PARTS, OFF, ON_STEPS = 60, 4, 0.2, 0.95

#: rad/s that a step of the encoder may make in a sample, so that every sample is taken, and longest period of those that are, s.
FINE_STEP_RAD_S, LONGEST_BELT_S, LONGEST_S = 2.0, 1e-3, 2e-3


def decimation(sample_s: float, step_rad: float, belt: bool) -> int:
    """Every which sample of a coarse encoder's angle is taken, a power of two: then rounding is white, and the torque's mean exact.

    Parameters
    ----------
    sample_s : float, s
    step_rad : float
        Of the encoder, rad at the motor.
    belt : bool
        Whether a carriage swings behind it.
    """
    longest, every = LONGEST_BELT_S if belt else LONGEST_S, 1
    while step_rad > FINE_STEP_RAD_S * every * sample_s and 2 * every * sample_s <= longest * (1.0 + 1e-9):
        every *= 2
    return every


def decimated_noise(every: int) -> float:
    """Factor on white noise of the torque, so that the mean of two decimated ones is as noisy as that with the triangular weight.

    √((4/3 - 1/(3 m²))/m) for every m-th sample; 1 for all of them.

    Parameters
    ----------
    every : int
        m.

    Returns
    -------
    float
        1 at most.
    """
    return math.sqrt((4.0 / 3.0 - 1.0 / (3.0 * every**2)) / every)


def decimate(row: Array, every: int) -> Array:
    """Mean of a row over so many samples each, without the rest at the end.

    Parameters
    ----------
    row : ndarray, (n,)
        Any unit.
    every : int
        Samples.

    Returns
    -------
    ndarray, (n // every,)
        In the unit of the row.
    """
    return row_means(row[: len(row) // every * every].reshape(-1, every))


def decimate_torque(torque: Array, within: Intersample | None, every: int) -> tuple[Array, Intersample]:
    """Mean of the torque over so many periods, (n // every,), N m at the motor, and how it is spread over them.

    Parameters
    ----------
    torque : ndarray
        Mean over each period, (n,), N m at the motor.
    within : Intersample or None
        Its spread inside; None: it is held.
    every : int
        Periods for each mean.
    """
    number = len(torque) // every
    cells = torque[:, None] + (np.zeros((1, CELLS)) if within is None else within.above)
    cells = row_means(cells[: number * every].reshape(number, CELLS, every))
    means = row_means(cells)
    return means, Intersample(cells - means[:, None])


def smallest_step(position: Array) -> float:
    """Step in which an angle is read, rad: that of which its differences are whole multiples, where they are of any.

    Of an angle without steps, as one that the drive interpolates, a small one of the differences, with rounding of the file left aside.

    Parameters
    ----------
    position : ndarray, (n,), rad
        As it was read.

    Returns
    -------
    float, rad
        inf for an angle that never changes.
    """
    gaps = _gaps(position)
    return _step_of(gaps) or (float(np.percentile(gaps, 2)) if len(gaps) else np.inf)


def is_counted(position: Array) -> bool:
    """True for an angle in steps.

    Parameters
    ----------
    position : ndarray, (n,), rad
        As it was read.

    Returns
    -------
    bool
        True for one that never changes.
    """
    gaps = _gaps(position)
    return not len(gaps) or _step_of(gaps) > 0.0


def _gaps(position: Array) -> Array:
    """Differences between neighbouring values of an angle, (n,) rad, without what rounding of numbers makes of none."""
    levels = np.unique(position)
    gaps = np.diff(levels)
    return gaps[gaps > 1e-9 * max(1.0, float(np.abs(levels).max()))] if len(gaps) else gaps


def _step_of(gaps: Array) -> float:
    """Largest step of which the smallest gaps, (n,) rad, are whole multiples; 0 where they are of none.

    A fine encoder that moves on between the samples seldom shows two neighbouring counts: the smallest gaps are some steps wide.
    """
    near = np.sort(gaps)[:SMALLEST]
    for parts in range(1, MOST_PARTS + 1) if len(near) else ():
        step = float(near[0]) / parts
        for reach in (parts, 3 * parts, 10 * parts, np.inf):  # the file has rounded each: the more of them, the better the step is known
            inside = near[near < (reach + 0.5) * step]
            counts = np.round(inside / step)
            step = float(inside @ counts / (counts @ counts))
        off = np.abs(near / step - np.round(near / step))
        if np.mean(off < OFF) > ON_STEPS:
            return step
    return 0.0
