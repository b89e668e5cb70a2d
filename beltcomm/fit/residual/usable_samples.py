"""Samples of which the equation of motion says something: the motor moves, and the carriage has forgotten where it stuck."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from beltcomm.arrays import Array, BoolArray
from beltcomm.compiled import compiled
from beltcomm.simulate.inverse import FineMotion

#: s, and steps of the encoder: a motor that gets on by so many steps in so long, before and after, is not at rest.
CREEP_S, CREEP_STEPS = 0.05, 3.0
#: Parts of both spans together, in each of which it gets on: one that stands in one of them may be stuck.
PARTS, LEAST_STEPS, LEAST_SHARE = 4, 0.5, 0.25
#: Steps of the encoder by which it may be off an even motion there, for its speed to be taken as even.
EVEN_STEPS = 1.1
#: Share of the speed of a creeping motor by which its setpoint may change that from sample to sample: more shakes it to and fro.
SHAKEN = 0.4
#: Share of the samples of a creeping motor that must count for any of them to count.
DENSE = 0.8
#: Samples around one in which an angle may go so many times the way that is counted and a step.
AROUND, MOST_WAY = 17, 1.5
#: m the carriage must have travelled before a segment counts: until then its belt stretch at the start is unknown.
RUN_IN_TRAVEL_M = 1e-4
#: s after that travel, for the free oscillation of the carriage to die out.
RUN_IN_S = 0.2


def resting_samples(motion: FineMotion, stick_speed: float) -> BoolArray:
    """Samples whose triangular weight (one period before and after) touches a reversal or a speed below the stick speed.

    Parameters
    ----------
    motion : FineMotion
    stick_speed : float, rad/s
        Of the motor.

    Returns
    -------
    ndarray, (n,) of bool
        True at the ends.
    """
    n, m = motion.samples, motion.substeps
    omega = motion.omega if motion.creep is None else motion.creep[1]
    inside = np.lib.stride_tricks.sliding_window_view(omega, m + 1)[::m]
    low, high = inside.min(axis=1), inside.max(axis=1)
    slow = (np.minimum(np.abs(low), np.abs(high)) < stick_speed) | ((low < 0.0) & (high > 0.0))
    touched = np.ones(n, dtype=bool)
    touched[1:-1] = slow[:-1] | slow[1:]
    return touched


def creeping_samples(position: Array, sample_s: float, step_rad: float) -> tuple[BoolArray, BoolArray]:
    """Samples around which the motor goes on in one direction, however slowly, and those of them where it does so evenly.

    In each of the two spans of time before and after it, it gets on by several steps of the encoder, nowhere there back by one, and
    nowhere stops for half of one, as if stuck: then friction is known to act against it.   A motor that cogs goes on unevenly; what its
    speed is there the samples must say.

    Parameters
    ----------
    position : ndarray, (n,), rad
        Motor.
    sample_s : float, s
    step_rad : float, rad

    Returns
    -------
    tuple of ndarray, (n,) of bool
        Both without any for a record that is too short.
    """
    n, w = len(position), max(2, round(CREEP_S / sample_s))
    found, even = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    if n <= 2 * w + 2:
        return found, even
    edges, starts = np.linspace(0, 2 * w, PARTS + 1).round().astype(np.intp), n - 2 * w
    for side in (1.0, -1.0):
        path = side * position
        gets_on = np.minimum(path[w : n - w] - path[:starts], path[2 * w :] - path[w : n - w]) > CREEP_STEPS * step_rad
        parts = np.stack([path[b : b + starts] - path[a : a + starts] for a, b in itertools.pairwise(edges)])
        least = np.maximum(LEAST_STEPS * step_rad, LEAST_SHARE * parts.mean(axis=0))
        begins = np.flatnonzero(gets_on & (parts.min(axis=0) > least) & ~_goes_back(path, 2 * w, step_rad))
        found[begins + w] = True
        even[begins[_goes_evenly(path, begins, 2 * w, EVEN_STEPS * step_rad)] + w] = True
    found[[0, -1]] = even[[0, -1]] = False
    return found, even


def shaken_samples(position: Array, setpoint: Array, inertia: float, sample_s: float) -> BoolArray:
    """Samples around which a torque setpoint jumps by as much as stops or turns a creeping motor within a count, (n,).

    Then friction never builds up against its way: it gets on under less torque than the level of the friction.

    Parameters
    ----------
    position : ndarray (n,)
        rad at the motor.
    setpoint : ndarray (n,)
        N m at the motor.
    inertia : float
        That follows it at once, kg m² at the motor.
    sample_s : float
    """
    width = 2 * max(2, round(CREEP_S / sample_s)) + 1
    jump = maximum_filter1d(np.abs(np.diff(setpoint, prepend=setpoint[:1])), width, mode="nearest") * sample_s / inertia
    speed = np.abs(np.gradient(uniform_filter1d(position, width, mode="nearest"), sample_s))
    return np.asarray(jump > SHAKEN * speed)


def sparse_creep(even: BoolArray, keep: BoolArray, sample_s: float) -> BoolArray:
    """Samples of a motor that creeps evenly in one direction, of which but a part counts, (n,).

    Which of them count there the steps of the encoder say, and a controller that answers to each of these makes their torque another one
    than that of the rest.

    Parameters
    ----------
    even : ndarray (n,) of bool
        Samples around which it creeps evenly.
    keep : ndarray (n,) of bool
        Those that count.
    sample_s : float
    """
    width = 2 * max(2, round(CREEP_S / sample_s)) + 1
    return np.asarray(even & (uniform_filter1d(keep.astype(np.float64), width, mode="nearest") < DENSE))


@compiled
def _goes_back(path: Array, span: int, step: float) -> BoolArray:
    """Beginnings of a span of samples in which a path falls from some sample to a later one by more than a step, (n - span,)."""
    n = len(path)
    found = np.zeros(max(n - span, 0), dtype=np.bool_)
    done = 0  # beginnings before it are known
    ahead = np.empty(n, dtype=np.int64)  # samples of the span before each, highest first, each later than those above it
    first, end = 0, 0
    for k in range(n):
        while first < end and ahead[first] < k - span:
            first += 1
        last = -1  # the last one that stands so much higher: the highest do as long as they do
        for i in range(first, end):
            if path[ahead[i]] - path[k] <= step:
                break
            last = ahead[i]
        for begin in range(max(done, k - span), min(last + 1, len(found))):
            found[begin] = True
        done = max(done, min(last + 1, len(found)))
        while end > first and path[ahead[end - 1]] <= path[k]:
            end -= 1
        ahead[end] = k
        end += 1
    return found


@compiled
def _goes_evenly(path: Array, begins: NDArray[np.intp], span: int, limit: float) -> BoolArray:
    """Which of the spans that begin there are nowhere further than a limit from the straight line through their ends, (len(begins),)."""
    found, part = np.ones(len(begins), dtype=np.bool_), 1.0 / span
    for i in range(len(begins)):
        start = path[begins[i]]
        rise = path[begins[i] + span] - start
        for number in range(1, span):
            if abs(path[begins[i] + number] - start - rise * (number * part)) > limit:
                found[i] = False
                break
    return found


def creep_motion(motion: FineMotion, position: Array, creeps: BoolArray) -> tuple[Array, Array] | None:
    """Motion on the fine grid, even over the span of time in which the motor creeps.

    Between two steps of the encoder the angle stands, and friction would seem to turn with every step.

    Parameters
    ----------
    motion : FineMotion
    position : ndarray, (n,), rad
        As it was read.
    creeps : ndarray, (n,) of bool
        Where it creeps.

    Returns
    -------
    tuple of ndarray (fine,), or None
        rad and rad/s; None where it creeps nowhere.
    """
    if not creeps.any():
        return None
    width = 2 * max(2, round(CREEP_S / motion.sample_s)) + 1
    even = uniform_filter1d(position, width, mode="nearest")
    place = np.arange(len(motion.theta)) / motion.substeps
    number = np.arange(len(position))
    here = np.interp(place, number, creeps.astype(np.float64)) > 0.5
    start = float(motion.theta[0] - position[0])
    theta = np.where(here, np.interp(place, number, even) + start, motion.theta)
    omega = np.where(here, np.interp(place, number, np.gradient(even, motion.sample_s)), motion.omega)
    return theta, omega


def samples_between_counts(angle: Array, position: Array, step_rad: float) -> BoolArray:
    """Samples around which an angle swings further than its counts tell, (n,): a slow motion that steps now and then looks so.

    Parameters
    ----------
    angle : ndarray
        The likeliest, rad, (n,).
    position : ndarray
        As it was counted, rad, (n,).
    step_rad : float, rad
    """
    ways = [uniform_filter1d(np.abs(np.diff(row, prepend=row[0])), AROUND, mode="nearest") * AROUND for row in (angle, position)]
    return np.asarray(ways[0] > MOST_WAY * (ways[1] + step_rad))


def run_in_samples(motion: FineMotion, ratio: float) -> BoolArray:
    """Samples after the carriage has first moved far enough to have forgotten where it stuck.

    Parameters
    ----------
    motion : FineMotion
    ratio : float, m/rad
        Of the transmission.

    Returns
    -------
    ndarray, (n,) of bool
        All False for a motion that is too short.
    """
    travel = np.abs(motion.theta[:: motion.substeps] - motion.theta[0]) * ratio
    moved = np.flatnonzero(travel > RUN_IN_TRAVEL_M)
    done = np.zeros(motion.samples, dtype=bool)
    if len(moved):
        done[moved[0] + int(RUN_IN_S / motion.sample_s) :] = True
    return done
