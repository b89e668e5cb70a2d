"""Reference motions of the carriage: jerk-limited moves, strokes at constant speed, a user's own move.

Position, velocity and acceleration at the carriage, sampled at the drive's sample period.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import ruckig
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.errors import DataError, UsageError
from beltcomm.recording.signalfile import read_columns

#: Samples a plateau must have for a mean and a scatter, after its run-in.
FEWEST_PLATEAU_SAMPLES = 10
#: Mean speed over the first and last step of a move file, as a share of its largest, above which it does not rest there.
RESTING_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A reference motion on a uniform grid; arrays (n,), read-only.

    Attributes
    ----------
    t_s : ndarray, s
        From 0.
    position_m : ndarray, m
    velocity_m_s : ndarray, m/s
    acceleration_m_s2 : ndarray, m/s²
        All at the carriage.
    limits : TrajectoryLimits or None
        By which it was planned; None where it follows from others.

    Raises
    ------
    ValueError
        When lengths differ or there are fewer than two samples.
    """

    t_s: Array
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    limits: TrajectoryLimits | None = None

    def __post_init__(self) -> None:
        for name in ("t_s", "position_m", "velocity_m_s", "acceleration_m_s2"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (len(self.t_s),) or len(values) < 2:
                raise ValueError(f"{name} has the shape {values.shape}; the arrays need one equal length of at least 2")
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @property
    def sample_period_s(self) -> float:
        """Step of the grid, s."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def duration_s(self) -> float:
        """From the first to the last sample, s."""
        return float(self.t_s[-1] - self.t_s[0])


@dataclass(frozen=True)
class SteadySpan:
    """A stretch at constant speed, run-in left out.

    Attributes
    ----------
    velocity_m_s : float
        Signed.
    first, last : int
        Samples first <= n < last.
    """

    velocity_m_s: float
    first: int
    last: int


@dataclass(frozen=True)
class Strokes:
    """Strokes to and fro with their plateaus, in the order in which they are driven."""

    trajectory: Trajectory
    plateaus: tuple[SteadySpan, ...]


def plan_trajectory(
    start_m: float,
    end_m: float,
    limits: TrajectoryLimits,
    sample_period_s: float,
    *,
    start_velocity_m_s: float = 0.0,
    start_acceleration_m_s2: float = 0.0,
    end_velocity_m_s: float = 0.0,
    end_acceleration_m_s2: float = 0.0,
) -> Trajectory:
    """The fastest motion between two states with limited speed, acceleration and jerk (6.27) to (6.33).

    |ξ'| ≤ v,  |ξ''| ≤ a,  |ξ'''| ≤ j; the duration is rounded up to whole sample periods, so that the motion ends on a
    sample; its speed is that much lower.

    Parameters
    ----------
    start_m, end_m : float, m
    limits : TrajectoryLimits
        At the carriage.
    sample_period_s : float, s
    start_velocity_m_s, end_velocity_m_s : float, m/s
        Of the carriage.
    start_acceleration_m_s2, end_acceleration_m_s2 : float, m/s²
        Of the carriage.

    Returns
    -------
    Trajectory
        Both end states as first and last sample.

    Raises
    ------
    UsageError
        For values that are not finite, a boundary state outside the limits, or a start that is the end.

    References
    ----------
    Thesis 6.3 (symmetric jerk); solved by the library ruckig.
    """
    states = (start_m, start_velocity_m_s, start_acceleration_m_s2), (end_m, end_velocity_m_s, end_acceleration_m_s2)
    for place, state in zip(("start", "end"), states, strict=True):
        if not all(map(math.isfinite, state)):
            raise UsageError(f"the {place} of the motion is {state}; give finite numbers")
        for value, limit, unit in zip(state[1:], (limits.speed_m_s, limits.acceleration_m_s2), ("m/s", "m/s²"), strict=True):
            if abs(value) > limit:
                raise UsageError(f"the motion has {value:g} {unit} at its {place}, above its limit of {limit:g} {unit}; lower it")
    if states[0] == states[1]:
        raise UsageError(f"the motion starts and ends at {start_m:g} m; give two different positions")
    if not (sample_period_s > 0.0 and math.isfinite(sample_period_s)):
        raise UsageError(f"the sample period is {sample_period_s} s; give a positive number of seconds")
    problem = ruckig.InputParameter(1)
    (problem.current_position, problem.current_velocity, problem.current_acceleration) = ([value] for value in states[0])
    (problem.target_position, problem.target_velocity, problem.target_acceleration) = ([value] for value in states[1])
    problem.max_velocity, problem.max_acceleration = [limits.speed_m_s], [limits.acceleration_m_s2]
    problem.max_jerk = [limits.jerk_m_s3]
    problem.duration_discretization = ruckig.DurationDiscretization.Discrete
    solution = ruckig.Trajectory(1)
    try:
        outcome = ruckig.Ruckig(1, sample_period_s).calculate(problem, solution)
    except (ruckig.RuckigError, ValueError) as error:  # the latter for outcomes that its Python side has no name for
        raise UsageError(f"no motion from {start_m:g} m to {end_m:g} m keeps its limits: {error}") from error
    if outcome is not ruckig.Result.Working:
        raise UsageError(f"no motion from {start_m:g} m to {end_m:g} m keeps its limits ({outcome.name}); widen the limits")
    t_s = _grid(round(solution.duration / sample_period_s) + 1, sample_period_s)
    position, velocity, acceleration = _sampled(solution, t_s)
    for column, value in zip((position, velocity, acceleration), states[1], strict=True):
        column[-1] = value
    return Trajectory(t_s, position, velocity, acceleration, limits)


def _sampled(solution: ruckig.Trajectory, t_s: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration at all instants: the phases of constant jerk, of which ruckig itself gives one instant a call.

    In front of the seven stand two in which a start that would not keep the limits is braked; of no length elsewhere.
    """
    phases = solution.profiles[0][0]
    lengths, j, a, v, p = ([*getattr(phases.brake, name), *getattr(phases, name)] for name in "tjavp")
    ends = np.cumsum(lengths)
    at = np.minimum(np.searchsorted(ends, t_s, side="right"), len(ends) - 1)
    t = np.minimum(t_s, solution.duration) - np.concatenate(([0.0], ends))[at]
    jerk, acceleration, velocity, position = (np.array(column)[at] for column in (j, a, v, p))
    return (
        position + t * (velocity + t * (acceleration / 2.0 + t * jerk / 6.0)),
        velocity + t * (acceleration + t * jerk / 2.0),
        acceleration + t * jerk,
    )


def _stroke(start_m: float, end_m: float, speed_m_s: float, limits: TrajectoryLimits, sample_period_s: float) -> Trajectory:
    """From rest to rest at a constant speed between jerk-limited ramps; slower where the way is too short to reach it.

    Other arguments and errors as for :func:`plan_trajectory`.
    """
    if not 0.0 < speed_m_s <= limits.speed_m_s:
        raise UsageError(f"the speed of a stroke is {speed_m_s:g} m/s; it must be above 0 and at most {limits.speed_m_s:g} m/s")
    return plan_trajectory(start_m, end_m, replace(limits, speed_m_s=speed_m_s), sample_period_s)


def at_rest(position_m: float, duration_s: float, sample_period_s: float) -> Trajectory:
    """Standing still, at least one period.

    Parameters
    ----------
    position_m : float, m
    duration_s, sample_period_s : float, s
    """
    t_s = _grid(max(1, round(duration_s / sample_period_s)) + 1, sample_period_s)
    return Trajectory(t_s, np.full(len(t_s), position_m), np.zeros(len(t_s)), np.zeros(len(t_s)))


def join(parts: Sequence[Trajectory]) -> Trajectory:
    """One motion after the other; the last sample of each is the first of the next.

    Parameters
    ----------
    parts : sequence of Trajectory
        In their order.

    Raises
    ------
    ValueError
        When a part does not begin in the state and with the period of the one before.
    """
    for before, after in itertools.pairwise(parts):
        step = abs(after.position_m[0] - before.position_m[-1])
        jump = abs(after.velocity_m_s[0] - before.velocity_m_s[-1])
        if step > 1e-12 or jump > 1e-9 or not math.isclose(before.sample_period_s, after.sample_period_s, rel_tol=1e-9):
            raise ValueError("a part must begin where, and with the sample period with which, the one before ends")
    position, velocity, acceleration = (
        np.concatenate([getattr(parts[0], name), *(getattr(part, name)[1:] for part in parts[1:])])
        for name in ("position_m", "velocity_m_s", "acceleration_m_s2")
    )
    return Trajectory(_grid(len(position), parts[0].sample_period_s), position, velocity, acceleration)


def constant_speed_strokes(
    start_m: float,
    end_m: float,
    speeds_m_s: Sequence[float],
    limits: TrajectoryLimits,
    sample_period_s: float,
    *,
    run_in_s: float,
    rest_s: float,
    longest_plateau_s: float = math.inf,
) -> Strokes:
    """For each speed one stroke forth and one back with a plateau of constant speed, rests between (friction sweep, 3.6).

    Parameters
    ----------
    start_m, end_m : float, m
        The window; the first stroke leads from start towards end.
    speeds_m_s : sequence of float, m/s
        Positive; the plateau may be slower by up to one sample period in the plateau's length, its own speed stands beside it.
    limits : TrajectoryLimits
        Jerk and acceleration of the ramps.
    sample_period_s : float, s
    run_in_s : float, s
        Left out at the beginning of each plateau.
    rest_s : float, s
    longest_plateau_s : float, s
        Run-in included; shortens the strokes at low speed.

    Raises
    ------
    UsageError
        When the window is too short for a speed, with the length that it needs, or a speed is not positive.
    """
    parts, plateaus, samples = [at_rest(start_m, rest_s, sample_period_s)], [], len(at_rest(start_m, rest_s, sample_period_s).t_s)
    for speed in speeds_m_s:
        if not 0.0 < speed <= limits.speed_m_s:
            raise UsageError(f"a speed of the strokes is {speed:g} m/s; it must be above 0 and at most {limits.speed_m_s:g} m/s")
        ramps = 2.0 * ramp_length_m(speed, limits)
        shortest = ramps + speed * (run_in_s + (FEWEST_PLATEAU_SAMPLES + 1) * sample_period_s)
        if abs(end_m - start_m) < shortest:
            raise UsageError(
                f"a stroke at {speed:g} m/s needs {shortest:.4g} m, the window {start_m:g}..{end_m:g} m has "
                f"{abs(end_m - start_m):.4g} m; lower the speed or widen the window"
            )
        length = min(abs(end_m - start_m), max(shortest, ramps + speed * longest_plateau_s))
        turn = start_m + math.copysign(length, end_m - start_m)
        for origin, goal in ((start_m, turn), (turn, start_m)):
            leg = _stroke(origin, goal, speed, limits, sample_period_s)
            reached = float(np.abs(leg.velocity_m_s).max())
            cruising = np.flatnonzero(np.abs(leg.velocity_m_s) > reached * (1.0 - 1e-9))
            first = int(cruising[0]) + math.ceil(run_in_s / sample_period_s)
            offset = samples - 1
            plateaus.append(SteadySpan(math.copysign(reached, goal - origin), offset + first, offset + int(cruising[-1]) + 1))
            rest = at_rest(goal, rest_s, sample_period_s)
            parts += [leg, rest]
            samples += len(leg.t_s) + len(rest.t_s) - 2
    return Strokes(join(parts), tuple(plateaus))


def ramp_length_m(speed_m_s: float, limits: TrajectoryLimits) -> float:
    """Travel from rest to a speed with limited jerk and acceleration.

    v √(v/j) when the acceleration limit is not reached (a² ≥ v j), else v (v/a + a/j)/2.

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage, 0 or more.
    limits : TrajectoryLimits
        Of the carriage.

    Returns
    -------
    float, m
    """
    v, a, j = speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3
    return v * math.sqrt(v / j) if a * a >= v * j else 0.5 * v * (v / a + a / j)


def load_move(path: Path | str, sample_period_s: float, axis: Axis | None = None) -> Trajectory:
    """A user's own move from CSV: ``t_s``, ``position_m``, any time grid; resampled by a cubic spline at rest at both ends.

    Parameters
    ----------
    path : Path or str
        Of the file.
    sample_period_s : float, s
        Of the result.
    axis : Axis or None
        Its travel, speed and acceleration limits are kept, where it states them.

    Raises
    ------
    DataError
        Naming the file, for an unreadable one, time that does not rise, or a move that is not at rest at its ends.
    UsageError
        With the value and the limit, where the move breaks a limit of the axis.
    """
    path = Path(path)
    columns = read_columns(path, {"t_s", "position_m"})
    missing = [name for name in ("t_s", "position_m") if name not in columns]
    if missing:
        raise DataError(f"{path} has no column {' and '.join(missing)}; a move needs t_s and position_m")
    t_s, position = columns["t_s"] - columns["t_s"][0], columns["position_m"]
    if len(t_s) < 4 or np.ptp(position) == 0.0:
        raise DataError(f"{path} has {len(t_s)} rows over {np.ptp(position):g} m; a move needs at least 4 rows and some travel")
    if np.any(np.diff(t_s) <= 0.0):
        row = int(np.flatnonzero(np.diff(t_s) <= 0.0)[0]) + 2
        raise DataError(f"{path}: t_s in row {row} is not above the row before; time must rise")
    speeds = np.abs(np.diff(position) / np.diff(t_s))
    for place, speed in (("start", speeds[0]), ("end", speeds[-1])):
        if speed > RESTING_SHARE * speeds.max():
            raise DataError(f"{path}: the move does not {place} at rest ({speed:.4g} m/s there); begin and end it at standstill")
    spline = CubicSpline(t_s, position, bc_type="clamped")
    grid = _grid(math.ceil(t_s[-1] / sample_period_s - 1e-6) + 1, sample_period_s)
    held = np.minimum(grid, t_s[-1])  # the last sample may lie up to a period after the file's end
    move = Trajectory(grid, spline(held), spline(held, 1), spline(held, 2))
    if axis is not None:
        _check_limits(path, move, axis)
    return move


def torque_of_move(path: Path | str, sample_period_s: float) -> Array | None:
    """Torque that goes along with a move of a file, its column ``torque_along_nm``, N m at the motor shaft; None where it has none.

    Parameters
    ----------
    path : Path or str
        Of the file.
    sample_period_s : float, s
        Of the result, which ends with a rest as long as :func:`load_move`'s motion is followed by one.
    """
    columns = read_columns(Path(path), {"t_s", "torque_along_nm"})
    if "torque_along_nm" not in columns or "t_s" not in columns:
        return None
    t_s = columns["t_s"] - columns["t_s"][0]
    grid = _grid(math.ceil(t_s[-1] / sample_period_s - 1e-6) + 1, sample_period_s)
    return np.asarray(np.interp(grid, t_s, columns["torque_along_nm"]))


def _grid(samples: int, sample_period_s: float) -> Array:
    return np.asarray(sample_period_s * np.arange(samples), dtype=np.float64)


def _check_limits(path: Path, move: Trajectory, axis: Axis) -> None:
    """Raise UsageError where a move leaves the travel, speed or acceleration that the axis states."""
    low, high = axis.travel.min_m, axis.travel.max_m
    if (low is not None and move.position_m.min() < low) or (high is not None and move.position_m.max() > high):
        raise UsageError(
            f"{path}: the move goes from {move.position_m.min():.6g} to {move.position_m.max():.6g} m, outside the travel "
            f"{low}..{high} m of {axis}; shorten it"
        )
    for values, limit, unit in (
        (move.velocity_m_s, axis.limits.speed_m_s, "m/s"),
        (move.acceleration_m_s2, axis.limits.acceleration_m_s2, "m/s²"),
    ):
        largest = float(np.abs(values).max())
        if limit is not None and largest > limit:
            raise UsageError(f"{path}: the move reaches {largest:.4g} {unit}, the limit of {axis} is {limit:g} {unit}; slow it down")


def with_dwell(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Path with a rest at its end.

    Parameters
    ----------
    trajectory : Trajectory
        Of the carriage.
    seconds : float, s
        How long it rests.

    Returns
    -------
    Trajectory
        On the same grid.
    """
    period = trajectory.sample_period_s
    return join([trajectory, at_rest(float(trajectory.position_m[-1]), seconds, period)])
