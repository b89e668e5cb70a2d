"""The seven-phase motion of the thesis with bounds of its own in each direction, and any speed and acceleration at both ends.

    P1 jerk up · P2 largest acceleration · P3 jerk down · P4 top speed · P5 jerk down · P6 largest deceleration · P7 jerk up

for a motion upwards; mirrored for one downwards (figure 6.11).  Phases that are not needed last 0 s.  ``trajectory.plan_trajectory`` solves
the symmetric case on the drive's grid; here a higher deceleration than acceleration, a softer end or one-way speeds are possible.

All at the carriage, SI.   Sources: thesis 6.3, (6.27) to (6.33); how the durations are found: :mod:`beltcomm.trajectory.phase_search`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import Refused, UsageError
from beltcomm.trajectory import Trajectory, phase_search
from beltcomm.trajectory.phase_search import PHASES, Task

#: Share of a bound by which rounding may exceed it.
ROUNDING = 1e-9
#: Share of a sample period by which a duration may miss a whole number of them.  Where no motion of the next whole number exists, by which
#: factor more are tried, and how often.
WHOLE, MORE, TRIES = 1e-6, 1.1, 60


@dataclass(frozen=True)
class MotionState:
    """State in which a motion begins or ends.   m, m/s, m/s²; (6.27) to (6.32)."""

    position_m: float
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0


@dataclass(frozen=True)
class MotionBounds:
    """velocity_min <= v <= velocity_max and so on; all signed, m/s, m/s², m/s³ (6.33).

    Raises
    ------
    UsageError
        For a number that is not finite, an acceleration or jerk range without zero inside, a speed range without zero, or one that is
        empty.
    """

    velocity_min_m_s: float
    velocity_max_m_s: float
    acceleration_min_m_s2: float
    acceleration_max_m_s2: float
    jerk_min_m_s3: float
    jerk_max_m_s3: float

    def __post_init__(self) -> None:
        for name, value in ((field.name, getattr(self, field.name)) for field in fields(self)):
            if not math.isfinite(value):
                raise UsageError(f"{name} is {value}; give a finite number")
            outside = value < 0.0 if "_max_" in name else value > 0.0
            if outside or (value == 0.0 and not name.startswith("velocity")):
                raise UsageError(f"{name} is {value:g}; it must be {'above' if '_max_' in name else 'below'} 0")
        if self.velocity_min_m_s == self.velocity_max_m_s:
            raise UsageError("velocity_min_m_s and velocity_max_m_s are both 0; nothing could move")

    def mirrored(self) -> MotionBounds:
        """Those of the same motion the other way."""
        return MotionBounds(
            -self.velocity_max_m_s, -self.velocity_min_m_s, -self.acceleration_max_m_s2, -self.acceleration_min_m_s2,
            -self.jerk_max_m_s3, -self.jerk_min_m_s3,
        )  # fmt: skip


@dataclass(frozen=True)
class Extremes:
    """Smallest and largest value of each quantity along a motion, (low, high); between the samples too."""

    position_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    acceleration_m_s2: tuple[float, float]
    jerk_m_s3: tuple[float, float]


@dataclass(frozen=True, eq=False)
class SevenPhases:
    """A motion with constant jerk in each of seven phases.

    Arrays are read-only.

    Attributes
    ----------
    start, end : MotionState
        Its states.
    durations_s : ndarray (7,), s
        Not negative.
    jerks_m_s3 : ndarray (7,), m/s³

    Raises
    ------
    ValueError
        When durations are negative, or the phases do not lead from start to end.
    """

    start: MotionState
    end: MotionState
    durations_s: Array
    jerks_m_s3: Array

    def __post_init__(self) -> None:
        for name in ("durations_s", "jerks_m_s3"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (PHASES,) or not np.all(np.isfinite(values)) or (name == "durations_s" and values.min() < 0.0):
                raise ValueError(f"{name} is {values}; seven finite numbers are needed, durations not negative")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        own = np.array([self.end.position_m, self.end.velocity_m_s, self.end.acceleration_m_s2])
        scale = float(np.abs(self.jerks_m_s3).max()) * self.duration_s ** np.array([3, 2, 1]) + np.abs(own) + abs(self.start.position_m)
        if np.any(np.abs(self._states()[-1] - own) > ROUNDING * scale):
            raise ValueError(f"the phases lead to {self._states()[-1]}, not to {self.end}")

    @property
    def duration_s(self) -> float:
        """T_trj, s."""
        return float(self.durations_s.sum())

    def at(self, t_s: Array) -> tuple[Array, Array, Array, Array]:
        """Motion at given times.

        At the very moment at which the jerk switches, the new one; outside the motion, the state at the end that is nearer.

        Parameters
        ----------
        t_s : ndarray, s
            From the beginning of the motion.

        Returns
        -------
        tuple of ndarray
            Position m, velocity m/s, acceleration m/s², jerk m/s³, each of the shape of ``t_s``.
        """
        begins = np.concatenate([[0.0], np.cumsum(self.durations_s)])
        t = np.clip(np.asarray(t_s, dtype=np.float64), 0.0, begins[-1])
        lasting = np.flatnonzero(self.durations_s > 0.0)
        last = int(lasting[-1]) if len(lasting) else 0
        phase = np.minimum(np.searchsorted(begins, t, side="right") - 1, last)
        after, jerk = t - begins[phase], self.jerks_m_s3[phase]
        p, v, a = self._states()[phase].T
        return (
            np.asarray(p + after * (v + after * (a / 2.0 + after * jerk / 6.0))),
            np.asarray(v + after * (a + after * jerk / 2.0)),
            np.asarray(a + after * jerk),
            np.asarray(jerk),
        )

    def extremes(self) -> Extremes:
        """Extremes reached, exactly: at the ends of phases, and where acceleration or speed pass zero inside one."""
        states, found = self._states(), []
        for state, jerk, duration in zip(states, self.jerks_m_s3, self.durations_s, strict=False):
            _, v, a = state
            turns = [-a / jerk] if jerk else []
            turns += [root.real for root in np.roots(np.trim_zeros(np.array([jerk / 2.0, a, v]), "f")) if root.imag == 0.0]
            found += [phase_search.step_phase(state, jerk, t) for t in turns if 0.0 < t < duration]
        every = np.array([*states, *found])
        jerks = self.jerks_m_s3[self.durations_s > 0.0]
        ranges = [(float(column.min()), float(column.max())) for column in (*every.T, jerks if len(jerks) else np.zeros(1))]
        return Extremes(*ranges)

    def mirrored(self) -> SevenPhases:
        """Motion the other way: every sign turned round."""
        return SevenPhases(_mirrored(self.start), _mirrored(self.end), self.durations_s, -self.jerks_m_s3)

    def sampled(self, sample_period_s: float) -> Trajectory:
        """On a uniform grid; first and last sample are the two states exactly.

        Raises
        ------
        ValueError
            When the motion does not last a whole number of periods; see :func:`on_grid`.
        """
        periods = self.duration_s / sample_period_s
        count = round(periods)
        if count < 1 or abs(periods - count) > WHOLE:
            raise ValueError(f"the motion lasts {periods:.6g} periods of {sample_period_s:g} s, not a whole number of them")
        t_s = np.asarray(sample_period_s * np.arange(count + 1))
        position, velocity, acceleration = columns = self.at(t_s)[:3]
        for column, name in zip(columns, ("position_m", "velocity_m_s", "acceleration_m_s2"), strict=True):
            column[0], column[-1] = getattr(self.start, name), getattr(self.end, name)
        return Trajectory(t_s, position, velocity, acceleration)

    def _states(self) -> Array:
        """(p, v, a) at the beginning of each phase and at the end, (8, 3)."""
        begin = np.array([self.start.position_m, self.start.velocity_m_s, self.start.acceleration_m_s2])
        return phase_search.states(begin, self.jerks_m_s3, self.durations_s)


def fastest_motion(start: MotionState, end: MotionState, bounds: MotionBounds) -> SevenPhases:
    """The fastest motion between two states, (6.27) to (6.33).

    Parameters
    ----------
    start, end : MotionState
        At the carriage; inside the bounds, also while their acceleration comes to zero before the start or after the end.
    bounds : MotionBounds
        Each way.

    Raises
    ------
    UsageError
        For values that are not finite, a state beyond a bound (with the bound), or a start that is the end.
    Refused
        Where no motion exists, because a way is forbidden.
    """
    _check_states(start, end, bounds)
    found = phase_search.fastest(_task(start, end, bounds))
    if found is None:
        raise Refused(_no_motion(start, end, bounds))
    return SevenPhases(start, end, *found)


def on_grid(start: MotionState, end: MotionState, bounds: MotionBounds, sample_period_s: float) -> SevenPhases:
    """The fastest motion made a little slower, so that it lasts a whole number of sample periods and ends on a sample.

    It gets a constant speed that is lower; where its acceleration never comes to zero, less jerk; where that leads to no motion of the next
    whole number of periods, it takes more of them.

    Parameters
    ----------
    start, end : MotionState
        Of the carriage.
    bounds : MotionBounds
        Of each way.
    sample_period_s : float, s

    Returns
    -------
    SevenPhases

    Raises
    ------
    UsageError
        As :func:`fastest_motion`, and for a period that is not positive.
    Refused
        As :func:`fastest_motion`, and where no such duration is found.
    """
    if not (sample_period_s > 0.0 and math.isfinite(sample_period_s)):
        raise UsageError(f"the sample period is {sample_period_s} s; give a positive number of seconds")
    motion = fastest_motion(start, end, bounds)
    periods = motion.duration_s / sample_period_s
    count = max(1, math.ceil(periods - WHOLE))
    if abs(periods - count) <= WHOLE:
        return motion
    task = _task(start, end, bounds)
    for _ in range(TRIES):
        for slower in (phase_search.motion_of_duration, phase_search.softer):
            found = slower(task, count * sample_period_s)
            if found is not None:
                return SevenPhases(start, end, *found)
        count = math.ceil(MORE * count)
    raise Refused(
        f"the fastest motion takes {motion.duration_s:.6g} s, and none was found that takes a whole number of periods of "
        f"{sample_period_s:g} s; choose another sample period, or end at rest"
    )


def bounds_reached(motion: SevenPhases, bounds: MotionBounds) -> tuple[str, ...]:
    """Names of the bounds that a motion comes to: what makes it no faster.

    Parameters
    ----------
    motion : SevenPhases
        Made within these bounds.
    bounds : MotionBounds
        Of each way.

    Returns
    -------
    tuple of str
        In the order of :class:`MotionBounds`.
    """
    extremes, found = motion.extremes(), []
    for field in fields(MotionBounds):
        bound = getattr(bounds, field.name)
        low, high = getattr(extremes, field.name.replace("_min", "").replace("_max", ""))
        # standing still is no speed limit
        if bound != 0.0 and (high >= bound * (1.0 - ROUNDING) if bound > 0.0 else low <= bound * (1.0 - ROUNDING)):
            found.append(field.name)
    return tuple(found)


def _mirrored(state: MotionState) -> MotionState:
    return MotionState(-state.position_m, -state.velocity_m_s, -state.acceleration_m_s2)


def _task(start: MotionState, end: MotionState, bounds: MotionBounds) -> Task:
    return Task(
        end.position_m - start.position_m, start.velocity_m_s, start.acceleration_m_s2, end.velocity_m_s, end.acceleration_m_s2,
        bounds.velocity_min_m_s, bounds.velocity_max_m_s, bounds.acceleration_min_m_s2, bounds.acceleration_max_m_s2,
        bounds.jerk_max_m_s3, -bounds.jerk_min_m_s3,
    )  # fmt: skip


def _check_states(start: MotionState, end: MotionState, bounds: MotionBounds) -> None:
    """Raise UsageError for a state beyond a bound, or one from which or to which no motion keeps the speed bounds."""
    for place, state in (("start", start), ("end", end)):
        for field in fields(state):
            if not math.isfinite(getattr(state, field.name)):
                raise UsageError(f"{field.name} at the {place} is {getattr(state, field.name)}; give a finite number")
        for value, low, high, unit in (
            (state.velocity_m_s, bounds.velocity_min_m_s, bounds.velocity_max_m_s, "m/s"),
            (state.acceleration_m_s2, bounds.acceleration_min_m_s2, bounds.acceleration_max_m_s2, "m/s²"),
        ):
            if not low <= value <= high:
                raise UsageError(
                    f"the motion has {value:g} {unit} at its {place}, outside its bounds {low:g} to {high:g} {unit}; change it or the bound"
                )
        _check_way_out(place, state, bounds)
    if start == end:
        raise UsageError(f"the motion starts and ends in the same state at {start.position_m:g} m; give two different ones")


def _check_way_out(place: str, state: MotionState, bounds: MotionBounds) -> None:
    """Raise UsageError where the speed must pass its bound while the acceleration comes to zero, v - a²/(2j)."""
    at_start, acceleration = place == "start", state.acceleration_m_s2
    if acceleration == 0.0:
        return
    # after the start a positive acceleration is brought to zero by the falling jerk, before the end it was built up by the rising one
    falls = (acceleration > 0.0) == at_start
    jerk = bounds.jerk_min_m_s3 if falls else bounds.jerk_max_m_s3
    bound = bounds.velocity_max_m_s if falls else bounds.velocity_min_m_s
    speed = state.velocity_m_s - 0.5 * acceleration * acceleration / jerk
    beyond = speed - bound if falls else bound - speed
    if beyond > ROUNDING * max(abs(bound), abs(state.velocity_m_s)):
        when, until = ("after it", "it comes to zero") if at_start else ("before it", "it is built up")
        raise UsageError(
            f"the acceleration of {acceleration:g} m/s² at the {place} of the motion forces the speed to {speed:.6g} m/s {when}, beyond "
            f"its bound of {bound:g} m/s, for {until} with a jerk of {jerk:g} m/s³; lower it, or give more jerk or speed"
        )


def _no_motion(start: MotionState, end: MotionState, bounds: MotionBounds) -> str:
    way = f"no motion leads from {start.position_m:g} m to {end.position_m:g} m"
    for bound, name, direction in (
        (bounds.velocity_min_m_s, "velocity_min_m_s", "backward"),
        (bounds.velocity_max_m_s, "velocity_max_m_s", "forward"),
    ):
        if bound == 0.0:
            return f"{way} with these speeds at its ends: {name} is 0, so that nothing may move {direction}; allow some speed that way"
    return f"{way} within its bounds; widen the bounds of acceleration and jerk"
