"""Durations of the seven phases of the fastest motion between two states, by enumeration of the possible switching patterns.

Triple integrator  p' = v,  v' = a,  a' = j  with lower and upper bounds on v, a, j that need not be symmetric.  The admissible motions of
a given duration form a convex set, so that their displacements form an interval; the fastest motion lies on its border, or that interval
is a single point.  The motion with the largest displacement (maximum principle; the multiplier of a is a convex parabola in time) has the
jerk pattern

    rise, 0, -fall, 0, -fall, 0, rise        (0 on the bounds a_high, v_high, a_low)

and that with the smallest displacement is its mirror image.  So the fastest motion is the shortest of all solutions of these two patterns
that keep the bounds.  Which bounds are touched gives five cases per pattern; each is one equation in one unknown, a polynomial.  A linear
programme that knows of no pattern finds no faster motion (tests).

Sources: thesis 6.3, (6.27) to (6.33); the cases are derived here.  Units are the caller's; the search works in units in which the motion
is about 1 long.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from beltcomm.arrays import Array

#: Phases of a motion.
PHASES = 7
#: In units in which the motion is about 1 long: how far a rounded solution may miss an end state or exceed a bound, or a duration may lie
#: below zero; and the imaginary part of a root that may belong to a real double root.
MISS, BEYOND, IMAGINARY = 1e-11, 1e-10, 1e-3
#: Share of the longest duration by which a rounded root may make another one negative.
HOPELESS = 1e-2
#: Steps that refine a root of a polynomial; each doubles the digits, at a double root it adds one bit.
REFINEMENTS = 40
#: Constant speeds between which :func:`motion_of_duration` looks for the one that it needs.
SPEEDS = 201
#: Shares of the jerk between which :func:`softer` looks for the one that it needs.
SHARES = (0.999, 0.99, 0.95, 0.8, 0.5)


@dataclass(frozen=True)
class Task:
    """From (0, v0, a0) to (distance, v1, a1).

    Bounds v_low <= v <= v_high, a_low <= a <= a_high, -fall <= j <= rise with a_low < 0 < a_high and rise, fall > 0.
    """

    distance: float
    v0: float
    a0: float
    v1: float
    a1: float
    v_low: float
    v_high: float
    a_low: float
    a_high: float
    rise: float
    fall: float

    def mirrored(self) -> Task:
        """The task with the sign of the position turned round."""
        return Task(
            -self.distance, -self.v0, -self.a0, -self.v1, -self.a1,
            -self.v_high, -self.v_low, -self.a_high, -self.a_low, self.fall, self.rise,
        )  # fmt: skip

    def natural_time(self) -> float:
        """A time in which the distance and the speeds can be covered with the larger jerk; positive."""
        jerk = max(self.rise, self.fall)
        speed, acceleration = max(abs(self.v0), abs(self.v1)), max(abs(self.a0), abs(self.a1))
        return max(math.cbrt(abs(self.distance) / jerk), math.sqrt(speed / jerk), acceleration / jerk)

    def in_units(self, time: float) -> Task:
        """Task with ``time`` as the unit of time and a unit of length that makes the larger jerk 1."""
        length = max(self.rise, self.fall) * time**3
        v, a, j = time / length, time**2 / length, time**3 / length
        return Task(
            self.distance / length, self.v0 * v, self.a0 * a, self.v1 * v, self.a1 * a,
            self.v_low * v, self.v_high * v, self.a_low * a, self.a_high * a, self.rise * j, self.fall * j,
        )  # fmt: skip


def step_phase(state: Array, jerk: float, duration: float) -> Array:
    """State after a time with constant jerk.

    Parameters
    ----------
    state : ndarray (3,)
        p, v, a.
    jerk : float
        Constant.
    duration : float
        In the unit of time of the state.

    Returns
    -------
    ndarray
        (3,) as ``state``.
    """
    p, v, a = state
    t = duration
    return np.array([p + t * (v + t * (a / 2.0 + t * jerk / 6.0)), v + t * (a + t * jerk / 2.0), a + t * jerk])


def states(start: Array, jerks: Sequence[float] | Array, durations: Sequence[float] | Array) -> Array:
    """(p, v, a) at the beginning of each phase and at the end of the last, (n + 1, 3).

    Parameters
    ----------
    start : ndarray (3,)
        p, v, a.
    jerks, durations : sequence of float or ndarray (n,)
        Of the phases.
    """
    found = [start]
    for jerk, duration in zip(jerks, durations, strict=True):
        found.append(step_phase(found[-1], float(jerk), float(duration)))
    return np.array(found)


def fastest(task: Task) -> tuple[Array, Array] | None:
    """Durations and jerks of the fastest motion, (7,) and (7,); None where no motion keeps the bounds.

    The states at both ends must lie inside the bounds, also for the acceleration to come to zero outside the motion.

    Parameters
    ----------
    task : Task
        States at both ends, and bounds.
    """
    time = task.natural_time()
    if time == 0.0:
        return np.zeros(PHASES), _jerks(task)
    scaled = task.in_units(time)
    best: tuple[Array, Array] | None = None
    for sign, own in ((1.0, scaled), (-1.0, scaled.mirrored())):
        for durations in _solutions(own):
            if best is None or durations.sum() < best[0].sum():
                best = durations, sign * _jerks(own)
    if best is None:
        return None
    return best[0] * time, best[1] * max(task.rise, task.fall)  # the unit of the jerk is the larger one


def _to_speed(task: Task, speed: float, *, top: bool = False) -> tuple[list[float], list[float]]:
    """Fastest way from (v0, a0) of the task to (speed, 0): three durations and three jerks.

    ``top``: the speed is the upper bound, so that rounding cannot make it lower than where the acceleration comes to zero.
    """
    up = top or speed >= task.v0 + 0.5 * task.a0 * abs(task.a0) / (task.fall if task.a0 > 0.0 else task.rise)
    first, second = (task.rise, task.fall) if up else (task.fall, task.rise)
    most = task.a_high if up else -task.a_low
    sign = 1.0 if up else -1.0
    a0, gain = sign * task.a0, sign * (speed - task.v0)
    peak = math.sqrt(max(gain + 0.5 * a0 * a0 / first, 0.0) * 2.0 * first * second / (first + second))
    peak = max(min(peak, most), a0)
    held = (gain - 0.5 * (peak * peak - a0 * a0) / first - 0.5 * peak * peak / second) / most if peak == most else 0.0
    return [(peak - a0) / first, max(held, 0.0), peak / second], [sign * first, 0.0, -sign * second]


def _from_speed(task: Task, speed: float, *, top: bool = False) -> tuple[list[float], list[float]]:
    """Fastest way from (speed, 0) to (v1, a1) of the task: the way there with time running backwards."""
    back = Task(0.0, task.v1, -task.a1, 0.0, 0.0, task.v_low, task.v_high, -task.a_high, -task.a_low, task.rise, task.fall)
    durations, jerks = _to_speed(back, speed, top=top)
    return durations[::-1], jerks[::-1]


def motion_of_duration(task: Task, duration: float) -> tuple[Array, Array] | None:
    """A motion of a given duration, longer than the fastest: as fast as possible to a constant speed, and from it to the end.

    None where no constant speed does it (motions so short that the acceleration never comes to zero).

    Parameters
    ----------
    task : Task
        States at both ends, and bounds.
    duration : float
        Longer than that of the fastest.
    """
    begin = np.array([0.0, task.v0, task.a0])

    def made(speed: float) -> tuple[Array, Array]:
        (before, up), (after, down) = _to_speed(task, speed), _from_speed(task, speed)
        return np.array([*before, duration - sum(before) - sum(after), *after]), np.array([*up, 0.0, *down])

    def left(speed: float) -> float:
        """Time that remains for the constant speed."""
        return float(made(speed)[0][3])

    def too_far(speed: float) -> float:
        durations, jerks = made(speed)
        return float(states(begin, jerks, durations)[-1, 0] - task.distance)

    for low, high in itertools.pairwise(np.linspace(task.v_low, task.v_high, SPEEDS)):
        ends = [float(low), float(high)]
        inside = [left(end) >= 0.0 for end in ends]
        if not any(inside):
            continue
        if not all(inside):
            ends[inside.index(False)] = float(brentq(left, low, high, xtol=1e-15 * max(abs(low), abs(high)), rtol=1e-15))
        if too_far(ends[0]) * too_far(ends[1]) <= 0.0:
            durations, jerks = made(float(brentq(too_far, ends[0], ends[1], xtol=1e-300, rtol=1e-15)))
            if durations.min() >= -BEYOND * duration:
                return np.maximum(durations, 0.0), jerks
    return None


def softer(task: Task, duration: float) -> tuple[Array, Array] | None:
    """The fastest motion with less jerk that takes a given duration; None where the duration jumps over it as the jerk falls.

    Parameters
    ----------
    task : Task
        States at both ends, and bounds.
    duration : float
        Longer than that of the fastest.
    """

    def made(share: float) -> tuple[Array, Array] | None:
        return fastest(replace(task, rise=share * task.rise, fall=share * task.fall))

    def too_long(share: float) -> float:
        found = made(share)
        return math.inf if found is None else float(found[0].sum()) - duration

    low = next((share for share in SHARES if too_long(share) > 0.0), None)
    if low is None or not math.isfinite(too_long(low)):
        return None
    found = made(float(brentq(too_long, low, 1.0, xtol=1e-15, rtol=1e-15)))
    return found if found is not None and abs(found[0].sum() - duration) <= BEYOND * duration else None


def _jerks(task: Task) -> Array:
    return np.array([task.rise, 0.0, -task.fall, 0.0, -task.fall, 0.0, task.rise])


def _solutions(task: Task) -> Iterator[Array]:
    """Durations (7,) of every motion with the pattern rise, 0, -fall, 0, -fall, 0, rise that keeps the bounds."""
    jerks = _jerks(task)
    begin, end = np.array([0.0, task.v0, task.a0]), np.array([task.distance, task.v1, task.a1])
    for durations, free in _guesses(task):
        if durations.min() < -HOPELESS * durations.max():
            continue
        refined = _refine_durations(begin, end, jerks, durations, free)
        if refined is None or refined.min() < -BEYOND:
            continue
        if refined.min() < 0.0:  # rounding: that phase lasts no time, the others meet the end without it
            refined = _refine_durations(begin, end, jerks, np.maximum(refined, 0.0), [phase for phase in free if refined[phase] > 0.0])
            if refined is None or refined.min() < 0.0:
                continue
        refined = _with_top(refined, begin, task)
        if _keeps_bounds(states(begin, jerks, refined), task):
            yield refined


def _guesses(task: Task) -> Iterator[tuple[Array, list[int]]]:
    """Durations and which of them are free, by case; all of the fall from the first to the last extreme acceleration stands in phase 3."""
    a0, a1, rise = task.a0, task.a1, task.rise
    for durations, free, weighted in _cases(task):
        for root in _real_roots(_miss(task, durations, weighted)):
            if weighted and root <= 0.0:
                continue
            one, two, three, six, seven = durations @ np.array([1.0, root, root * root]) / (root if weighted else 1.0)
            yield np.array([one, two, three, 0.0, 0.0, six, seven]), free
    # one rise all the way: there the extreme accelerations are not determined
    yield np.array([(a1 - a0) / rise, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), [0]
    if task.v_high != 0.0:
        before, _ = _to_speed(task, task.v_high, top=True)
        after, _ = _from_speed(task, task.v_high, top=True)
        with_top = np.array([*before, 0.0, *after])
        way = states(np.array([0.0, task.v0, a0]), _jerks(task), with_top)[-1, 0]
        with_top[3] = (task.distance - way) / task.v_high
        yield with_top, [3]


def _cases(task: Task) -> Iterator[tuple[Array, list[int], bool]]:
    """The cases without a phase at top speed; of each durations, which are free, and whether it is weighted.

    durations : (5, 3), of phases 1, 2, 3, 6, 7 as polynomials in the case's unknown x, lowest power first; when weighted they are x times
    the durations.  They follow from the accelerations and the speeds at both ends; x from the distance.
    """
    a0, a1, rise, fall, most, least = task.a0, task.a1, task.rise, task.fall, task.a_high, task.a_low
    both = 0.5 / rise + 0.5 / fall
    gain = task.v1 - task.v0 + 0.5 * (a0 * a0 - a1 * a1) / rise  # = both (peak² − dip²) + peak t2 + dip t6
    none, one, x, square = np.zeros(3), *np.eye(3)
    # neither bound is touched: peak − dip = x, peak + dip = c/x, so that everything is rational
    c = gain / both
    peak, dip = 0.5 * (square + c * one), 0.5 * (c * one - square)
    yield np.array([(peak - a0 * x) / rise, none, square / fall, none, (a1 * x - dip) / rise]), [0, 2, 6], True
    # peak at its bound, dip = x
    held = ((gain - both * most**2) * one + both * square) / most
    yield np.array([(most - a0) / rise * one, held, (most * one - x) / fall, none, (a1 * one - x) / rise]), [1, 2, 6], False
    # dip at its bound, peak = x
    held = ((gain + both * least**2) * one - both * square) / least
    yield np.array([(x - a0 * one) / rise, none, (x - least * one) / fall, held, (a1 - least) / rise * one]), [0, 2, 5], False
    # both at their bounds, x = t2
    held = ((gain - both * (most**2 - least**2)) * one - most * x) / least
    yield np.array([(most - a0) / rise * one, x, (most - least) / fall * one, held, (a1 - least) / rise * one]), [1, 5], False


def _miss(task: Task, durations: Array, weighted: bool) -> Array:
    """Displacement too large as a polynomial, lowest power first, (7,); when weighted times x³.

    Accelerations have 3 coefficients, speeds 5, displacements 7, whatever their degree.
    """
    own = int(weighted)
    p, v, a = np.zeros(7), np.zeros(5), np.zeros(3)
    a[own], v[2 * own], p[3 * own] = task.a0, task.v0, -task.distance
    for jerk, t in zip((task.rise, 0.0, -task.fall, 0.0, task.rise), durations, strict=True):
        square = np.convolve(t, t)
        p = p + np.convolve(v, t) + np.convolve(0.5 * a, square) + np.convolve(jerk / 6.0 * t, square)
        v = v + np.convolve(a, t) + 0.5 * jerk * square
        a = a + jerk * t
    return p


def _real_roots(polynomial: Array) -> list[float]:
    """Real roots, and the real part of those that rounding may have made complex."""
    coefficients = np.trim_zeros(polynomial)[::-1]
    if len(coefficients) < 2:
        return []
    return [float(root.real) for root in np.roots(coefficients) if abs(root.imag) <= IMAGINARY * (1.0 + abs(root.real))]


def _refine_durations(begin: Array, end: Array, jerks: Array, durations: Array, free: list[int]) -> Array | None:
    """Durations with which the end state is met, by Newton's method in the free ones; None where it does not converge."""
    found, best, smallest = durations.copy(), durations, math.inf
    for _ in range(REFINEMENTS):
        passed = states(begin, jerks, found)
        miss = passed[-1] - end
        size = float(np.max(np.abs(miss)))
        if not math.isfinite(size) or size >= smallest:
            break
        best, smallest = found.copy(), size
        if size == 0.0:
            break
        slopes = np.empty((3, len(free)))
        for column, phase in enumerate(free):  # a phase that lasts longer: its rate of change at its end, carried to the end of the motion
            _, v, a = passed[phase + 1]
            later = float(found[phase + 1 :].sum())
            slopes[:, column] = v + later * (a + later * jerks[phase] / 2.0), a + later * jerks[phase], jerks[phase]
        found = found - _spread_durations(np.linalg.lstsq(slopes, miss, rcond=1e-12)[0], free, len(found))
    return best if smallest <= MISS else None


def _spread_durations(values: Array, places: list[int], length: int) -> Array:
    spread = np.zeros(length)
    spread[places] = values
    return spread


def _with_top(durations: Array, begin: Array, task: Task) -> Array:
    """The fall of the acceleration split where it passes zero, so that phase 4 lies at the top speed."""
    if durations[3] > 0.0 or durations[4] > 0.0:
        return durations
    split = durations.copy()
    peak = begin[2] + task.rise * durations[0]
    split[2] = min(max(peak / task.fall, 0.0), durations[2])
    split[4] = durations[2] - split[2]
    return split


def _keeps_bounds(passed: Array, task: Task) -> bool:
    """True if speed and acceleration keep their bounds; the speed is largest or smallest where the acceleration passes zero."""
    speeds, accelerations = passed[:, 1], passed[:, 2]
    if accelerations.max() > task.a_high + BEYOND or accelerations.min() < task.a_low - BEYOND:
        return False
    turning = [
        speeds[k] - 0.5 * accelerations[k] ** 2 / jerk
        for k, jerk in enumerate(_jerks(task))
        if jerk != 0.0 and accelerations[k] * accelerations[k + 1] < 0.0
    ]
    every = np.array([*speeds, *turning])
    return bool(every.max() <= task.v_high + BEYOND and every.min() >= task.v_low - BEYOND)
