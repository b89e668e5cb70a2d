"""Faults that a recording's numbers betray: clipped torque, wrong units, lost samples.  Arrays in, numbers or a sentence out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray, rms, robust_deviation, runs_of

#: Share of samples at the end of the torque's range from which a record counts as clipped.
CLIPPED_SHARE = 0.02
#: Share of the other samples that stand in runs of equal values from which a torque is one of held levels.
HELD_SHARE = 0.5
#: Fewer samples in a row at the end of the range are chance.
CLIPPED_RUN = 3
#: Chance of so many equal neighbours, under noise, from which a torque counts as cut off: far fewer than there are records.
CHANCE = 1e-6
#: Median deviation of normal noise over its standard deviation.
MEDIAN_DEVIATION = 0.6745
#: Share of a step below which time stamps differ by the rounding of their numbers.
ROUNDING = 1e-5
#: Deviations of a step from the median one that are no jitter.
SPREADS = 6.0
#: Share of a torque, and its median deviations from the setpoint, by which more than it was surely asked for.
BEYOND, SURELY = 0.02, 3.0
#: A torque with no more levels than this is a switched signal (a noise-free PRBS), which rests at its ends by intent.
SWITCHED_LEVELS = 8

#: What the quotient of two velocities (or travels) tells, when it is one of these within 5 %.
UNIT_FACTORS = {
    180.0 / math.pi: "degrees instead of rad",
    1.0 / math.tau: "revolutions instead of rad",
    60.0 / math.tau: "1/min instead of rad/s",
    1000.0: "thousandths (mm, mrad) instead of m or rad",
    -1.0: "the opposite sign",
}
#: Share of a torque's variance that must be slow for its sign to be judged; less is what a triangle lets through of fast shaking.
SLOW_SHARE = 0.01
#: Standard deviations beyond which an inertia is certain; s, width of the means of what moves slowly; share of the work that a friction
#: which drives gives at least.
CERTAIN, SLOW_S, BACKWARDS = 4.0, 0.08, 0.1
#: Rows of a long record on which that is judged.
MOST_JUDGED = 300_000
#: Share of the work, taken out of the axis, that no passive axis gives.
ACTIVE = 0.3
#: Share of the work from which a torque drives, whatever a regression says of springs and of friction that hardly slides.
WORKS = 0.02


def gaps(t_s: Array) -> NDArray[np.intp]:
    """Indices of the samples after which samples were lost: the step exceeds 1.5 periods.

    The period is the 90th percentile of the steps, which on jittering time stamps exceeds the median; where more than a
    tenth of the samples were lost it is the median.

    Parameters
    ----------
    t_s : ndarray, (n,), s
        Time stamps, rising.

    Returns
    -------
    ndarray of int
        Rising.
    """
    steps = np.diff(t_s)
    period, upper = np.percentile(steps, [50.0, 90.0])
    if upper < 1.5 * period:
        period = upper
    return np.flatnonzero(steps > 1.5 * period)


def long_steps(t_s: Array) -> NDArray[np.intp]:
    """Indices of the samples after which samples were lost, however the stamps jitter: steps that jitter alone does not make.

    Parameters
    ----------
    t_s : ndarray, (n,), s
        Time stamps, rising.

    Returns
    -------
    ndarray of int
        Rising.
    """
    steps = np.diff(t_s)
    period = float(np.median(steps))
    spread = robust_deviation(steps - period)
    return np.flatnonzero(steps > max(1.5 * period, period + SPREADS * spread))


def usual_step(t_s: Array) -> float:
    """Time step of the clock that took the samples.

    The mean of the steps at which no sample was lost: stamps that jitter or are rounded coarsely have another median.

    Parameters
    ----------
    t_s : ndarray, (n,), s
        Time stamps, rising.

    Returns
    -------
    float
        s.
    """
    steps = np.diff(t_s)
    median = float(np.median(steps))
    kept = np.delete(steps, long_steps(t_s))
    return median if float(np.abs(kept / median - 1.0).max()) < ROUNDING else float(kept.mean())


def jitter(t_s: Array, lost: NDArray[np.intp]) -> float:
    """Largest deviation of a step from the usual one, as a share of it.

    Parameters
    ----------
    t_s : ndarray (n,), s
        Time stamps, rising.
    lost : ndarray of int
        The gaps, left out.
    """
    kept, period = np.delete(np.diff(t_s), lost), usual_step(t_s)
    return float(np.max(np.abs(kept - period)) / period)


def clipped_share(torque: Array, setpoint: Array | None, amplitude: float | None) -> float:
    """Share of the samples at which the torque was cut off at an end of its range; 0 when it was not.

    Without a setpoint: runs of at least three samples exactly at the largest or smallest value, entered by a jump.

    Parameters
    ----------
    torque : ndarray (n,)
        Of any unit.
    setpoint : ndarray or None
        What was asked; then only samples count where more was asked for.
    amplitude : float or None
        Of a known open-loop excitation.
    """
    at_end = np.zeros(len(torque), dtype=bool)
    for end in (float(torque.max()), float(torque.min())):
        at_end |= _in_runs(torque == end) & (end != 0.0)
    levels = np.unique(torque)
    if setpoint is not None:
        asked = np.minimum.reduce([np.roll(np.abs(setpoint), lag) for lag in range(3)])  # the torque follows 1 to 2 samples late
        noise = _noise(torque, setpoint)
        beyond = float(np.mean(at_end & (asked - np.abs(torque) > np.maximum(BEYOND * np.abs(torque), SURELY * noise))))
        # a setpoint that was cut off with it: noise that is everywhere but at the ends
        step = float(np.min(np.diff(levels))) if len(levels) > 1 else math.inf
        silent = len(levels) > SWITCHED_LEVELS and noise > SURELY * step and not _by_chance(at_end, noise / step)
        return max(beyond, float(np.mean(at_end)) if silent else 0.0)
    if len(levels) <= SWITCHED_LEVELS:
        short = amplitude is not None and np.abs(torque).max() < 0.9 * amplitude
        return float(np.mean(at_end)) if short else 0.0
    # Levels that are held, by a setpoint in steps or a slower signal, are held everywhere in the range and not at its ends alone.
    inside = ~at_end
    if np.any(inside) and float(np.mean(_in_runs_of_one(torque)[inside])) > HELD_SHARE:
        return 0.0
    # A torque that settles at its largest value arrives there by ever smaller steps, a clipped one by a jump.
    entries = np.flatnonzero(at_end[1:] & ~at_end[:-1])
    jumps = np.abs(torque[entries + 1] - torque[entries])
    smallest = float(np.min(np.diff(levels)))
    return float(np.mean(at_end)) if len(entries) and np.median(jumps) > 3.0 * smallest else 0.0


def _by_chance(at_end: BoolArray, noise_steps: float) -> bool:
    """True if noise alone may put that many neighbours at one value.   noise_steps : median deviation, steps of the reading."""
    equal = MEDIAN_DEVIATION / (noise_steps * math.sqrt(2.0 * math.pi))  # most probable value of normal noise, for one neighbour
    return float(equal ** np.count_nonzero(at_end[1:] & at_end[:-1])) > CHANCE


def _noise(torque: Array, setpoint: Array) -> float:
    """Median deviation of the torque from its setpoint, at the delay that suits best."""
    return min(float(np.median(np.abs(torque[2:] - setpoint[2 - lag : len(setpoint) - lag]))) for lag in range(3))


def reference_unit_fault(signal: Array, reference: Array) -> str:
    """Fault in the unit of a signal's reference, in words; "" when they agree or nothing can be told.

    Parameters
    ----------
    signal, reference : ndarray, (n,)
        Measured and asked for.
    """
    measured, asked = signal - signal.mean(), reference - reference.mean()
    return unit_words(_quotient(measured, asked, 0.98), "reference", "signal")


def opposite_signs(t_s: Array, torque: Array, position: Array) -> bool:
    """True if positive torque drives to negative positions: then one of the two columns has the wrong sign.

    Regresses torque on acceleration, direction of motion, place and a constant, all as means under triangles of 0.16 to 0.64 s:
    above the first antiresonance of a drive train torque and acceleration oppose each other by nature.  True when, under some
    triangle, a negative mass or a friction that drives explains most of what the rest leaves, and under none a positive one
    even half as much.

    Parameters
    ----------
    t_s, torque, position : ndarray, (n,)
        s, and any units.

    Returns
    -------
    bool
        False where nothing can be told.
    """
    t_s, torque, position = _livelier(t_s, torque, position)
    works = slow_work_share(t_s, torque, position) > WORKS
    even = np.arange(t_s[0], t_s[-1], usual_step(t_s))
    torque, position = np.interp(even, t_s, torque), np.interp(even, t_s, position)
    period = float(even[1] - even[0])
    widths = [max(2, round(window / period)) for window in (0.08, 0.16, 0.32)]
    found = [share for width in widths if len(torque) >= 12 * width for share in _shares(torque, position, width)]
    return bool(found) and min(found) < -0.5 and max(found) < -0.5 * min(found) and not works


def backwards(t_s: Array, torque: Array, position: Array) -> bool:
    """True if time runs backwards: the mass is positive and the friction drives, in what moves slowly, where no lag of a reading counts.

    Beside a weight that turns, which has the phase of an inertia against the motion, a wrong sign would look so.

    Parameters
    ----------
    t_s, torque, position : ndarray, (n,)
        s, and any units.

    Returns
    -------
    bool
        False where nothing can be told.
    """
    rigid = rigid_inertia(t_s, torque, position, weight=True)
    if rigid is None or rigid.inertia < CERTAIN * rigid.error or rigid.dissipated >= 0.0:
        return False
    return slow_work_share(t_s, torque, position) < -BACKWARDS


def _livelier(t_s: Array, torque: Array, position: Array) -> tuple[Array, Array, Array]:
    """Of a long record the ``MOST_JUDGED`` rows in a row that move most: enough to judge it, and it need not be in memory several times."""
    if len(t_s) <= MOST_JUDGED:
        return t_s, torque, position
    begins = range(0, len(t_s) - MOST_JUDGED + 1, MOST_JUDGED)
    first = max(begins, key=lambda begin: float(np.std(position[begin : begin + MOST_JUDGED])))
    return tuple(signal[first : first + MOST_JUDGED] for signal in (t_s, torque, position))  # type: ignore[return-value]


def slow_work_share(t_s: Array, torque: Array, position: Array) -> float:
    """:func:`_work_share` of what moves slowly; 0 for a record that is too short to tell.

    Parameters
    ----------
    t_s, torque, position : ndarray, (n,)
        s, and any units.

    Returns
    -------
    float
        -1 to 1.
    """
    t_s, torque, position = _livelier(t_s, torque, position)
    even = np.arange(t_s[0], t_s[-1], usual_step(t_s))
    width = max(2, round(SLOW_S / float(even[1] - even[0]))) if len(even) > 1 else 0
    if width == 0 or len(even) < 8 * width:
        return 0.0
    slow = [_running_mean(_running_mean(np.interp(even, t_s, signal), width), width) for signal in (torque, position)]
    return _work_share(*slow)


def _work_share(torque: Array, position: Array) -> float:
    """Work of the torque on the motion, over all that it does back and forth, -1 to 1, but for a constant torque's.

    Friction takes it up, so it is positive in whatever drives; a spring's or a mass's is given back.   0 for a motion that takes none.
    """
    steps = np.diff(position)
    work = 0.5 * (torque[1:] + torque[:-1] - 2.0 * torque.mean()) * steps
    total = float(np.abs(work).sum())
    return float(work.sum()) / total if total > 0.0 else 0.0


@dataclass(frozen=True)
class RigidInertia:
    """Inertia of a rigid axis by one record.

    Attributes
    ----------
    inertia, error : float
        Of everything that the motor turns, and its standard deviation, torque over angular acceleration.
    accelerating, friction : float
        Torque, N m, rms of what accelerates, and Coulomb level.
    dissipated : float
        Mean power of damping and friction, W; negative where the torque drives with the wrong sign.
    """

    inertia: float
    error: float
    accelerating: float
    friction: float
    dissipated: float = 0.0

    @property
    def dynamic(self) -> float:
        """The accelerating torque over the friction."""
        return self.accelerating / max(self.friction, 1e-300)


def rigid_inertia(t_s: Array, torque: Array, position: Array, *, weight: bool = False, spring: bool = False) -> RigidInertia | None:
    """Inertia of the axis as one rigid body, from its slow motion; None for a record that is too short.

        torque = inertia acceleration + damping speed + level sign(speed) + constant,   each under a triangle of 0.16 s.

    below the antiresonance of any drive train this is motor and carriage together.  Neighbouring rows of the regression overlap by
    three quarters: the error counts each eighth row.

    Parameters
    ----------
    t_s : ndarray (n,), s
        Time stamps, rising.
    torque : ndarray (n,)
        N m, N or A, by the side of the record.
    position : ndarray (n,)
        rad or m, by that side.
    weight : bool
        The load turns with the motor and may not be balanced: sine and cosine of the angle count as well.
    spring : bool
        Something draws the axis to one place: the position counts as well.
    """
    t_s, torque, position = _livelier(t_s, torque, position)
    even = np.arange(t_s[0], t_s[-1], usual_step(t_s))
    width = max(2, round(0.08 / float(even[1] - even[0]))) if len(even) > 1 else 0
    if width == 0 or len(even) < 8 * width:
        return None
    torque, position = np.interp(even, t_s, torque), np.interp(even, t_s, position)
    span, every = width * float(even[1] - even[0]), max(1, width // 4)
    before, middle, after = position[: -2 * width], position[width:-width], position[2 * width :]
    force = triangle_mean(torque, width)[::every]
    direction = triangle_mean(np.sign(np.gradient(position)), width)[::every]
    rows = min(len(force), len(direction))
    acceleration, speed = ((after - 2.0 * middle + before)[::every] / span**2)[:rows], ((after - before)[::every] / (2.0 * span))[:rows]
    columns = np.column_stack([acceleration, speed, direction[:rows], np.ones(rows)])
    if weight:
        turned = [triangle_mean(part, width)[::every][:rows] for part in (np.sin(position), np.cos(position))]
        columns = np.column_stack([columns, *turned])
    if spring:
        columns = np.column_stack([columns, (middle[::every] - position[0])[:rows]])
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    found = np.linalg.lstsq(columns / scale, force[:rows], rcond=1e-8)[0] / scale
    left = force[:rows] - columns @ found
    covariance = np.linalg.pinv((columns / scale).T @ (columns / scale)) / np.outer(scale, scale)
    error = math.sqrt(8.0 * float(left @ left) / max(rows - 4, 1) * float(covariance[0, 0]))
    accelerating = abs(float(found[0])) * rms(acceleration)
    dissipated = float(np.mean(found[1] * speed**2 + found[2] * direction[:rows] * speed))
    return RigidInertia(float(found[0]), error, accelerating, abs(float(found[2])), dissipated)


def _shares(torque: Array, position: Array, width: int) -> tuple[float, float]:
    """Shares of the torque that acceleration and friction explain, each of what the rest leaves; negative for a negative factor."""
    # the second difference over the width is the acceleration's mean under a triangle of that width; torque gets the same
    force = triangle_mean(torque, width)
    if force.var() < SLOW_SHARE * torque.var():
        return 0.0, 0.0
    before, middle, after = position[: -2 * width], position[width:-width], position[2 * width :]
    every = max(1, width // 2)
    acceleration, velocity = (after - 2.0 * middle + before)[::every], (after - before)[::every]
    direction, others = np.sign(velocity), np.column_stack([np.ones(len(velocity)), middle[::every]])
    return (
        _partial(force[::every], acceleration, np.column_stack([others, velocity, direction])),
        _partial(force[::every], direction, np.column_stack([others, acceleration])),
    )


def _partial(signal: Array, cause: Array, others: Array) -> float:
    """Squared partial correlation of a signal with one cause, with its sign."""
    rest, pull = (column - others @ np.linalg.lstsq(others, column, rcond=None)[0] for column in (signal, cause))
    # what the other causes explain but for rounding is nothing
    if pull @ pull <= 1e-12 * (cause @ cause) or rest @ rest <= 1e-12 * (signal @ signal):
        return 0.0
    return math.copysign(float(rest @ pull) ** 2 / (float(rest @ rest) * float(pull @ pull)), float(rest @ pull))


def _running_mean(signal: Array, width: int) -> Array:
    """Mean of each ``width`` values in a row, 1 to n, (n - width + 1,)."""
    total = np.concatenate(([0.0], np.cumsum(signal)))
    return (total[width:] - total[:-width]) / width


def triangle_mean(signal: Array, width: int) -> Array:
    """Mean under a triangle, as a second difference over ``width`` sees an acceleration.

    Parameters
    ----------
    signal : ndarray, (n,)
        In any unit.
    width : int
        Half of the triangle's base, 1 to n / 2.

    Returns
    -------
    ndarray, (n - 2 width,)
        In that unit.
    """
    return _running_mean(_running_mean(signal, width), width)[1:-1]


def _in_runs_of_one(signal: Array) -> BoolArray:
    """Samples that stand in a run of CLIPPED_RUN equal ones at least."""
    found = np.zeros(len(signal), dtype=bool)
    for start, end in runs_of(np.diff(signal) == 0.0):
        found[start : end + 1] = end - start + 1 >= CLIPPED_RUN
    return found


def _in_runs(mask: BoolArray) -> BoolArray:
    """The mask without runs shorter than CLIPPED_RUN."""
    kept = np.zeros(len(mask), dtype=bool)
    for start, end in runs_of(mask):
        kept[start:end] = end - start >= CLIPPED_RUN
    return kept


def velocity_unit_fault(t_s: Array, position: Array, velocity: Array) -> str:
    """Fault in the units of position and velocity, in words; "" when they agree or nothing can be told.

    Compares travel with the integral of the velocity over 100 windows, so that a filtered velocity passes.

    Parameters
    ----------
    t_s, position, velocity : ndarray, (n,)
        s, and any units.
    """
    cuts = np.unique(np.linspace(0, len(t_s) - 1, 101).astype(int))
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(t_s))))
    travel, by_velocity = np.diff(position[cuts]), np.diff(integral[cuts])
    return unit_words(_quotient(travel, by_velocity, 0.9), "velocity", "position")


def _quotient(lower: Array, upper: Array, alike: float) -> float:
    """Quotient of two signals by their powers, with the sign of their correlation; 0 where this is less than ``alike``."""
    power = float(lower @ lower), float(upper @ upper)
    if min(power) <= 0.0 or abs(lower @ upper) < alike * math.sqrt(power[0] * power[1]):
        return 0.0
    return math.copysign(math.sqrt(power[1] / power[0]), float(lower @ upper))


def unit_words(quotient: float, upper: str, lower: str) -> str:
    """Units that a quotient of two signals tells, in words.

    Parameters
    ----------
    quotient : float
        Upper over lower, 1 where their units agree.
    upper, lower : str
        What the two are called.

    Returns
    -------
    str
        "" where it is within 5 % of none of ``UNIT_FACTORS`` and no inverse of one.
    """
    for factor, words in UNIT_FACTORS.items():
        if abs(quotient / factor - 1.0) < 0.05:
            return f"the {upper} has {words}"
        if abs(quotient * factor - 1.0) < 0.05:
            return f"the {lower} has {words}"
    return ""
