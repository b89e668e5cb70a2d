"""Reference motions of the closed-loop steps: where each begins, and how it goes on from there.  Nothing moves here."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.errors import Refused
from beltcomm.schedule.orders import Which, fastest_stroke_m_s, sweep_strokes
from beltcomm.schedule.steps import Step
from beltcomm.trajectory import Trajectory, at_rest, constant_speed_strokes, join, plan_trajectory

#: m: half the way of slow strokes around their place; s: run-in, rest and longest plateau of them.
AROUND_M = 0.05
RUN_IN_S, REST_S, LONGEST_S = 0.1, 0.15, 0.7
#: s before and after every motion, and between moves.
REST_BEFORE_S, REST_AFTER_S, BETWEEN_S = 0.25, 0.4, 0.15
#: m/s of the triangles, and how often each size is driven: the small ones more often, they are short.
TRIANGLE_M_S = 4e-3
TRIANGLE_WAY_M, MOST_TRIANGLES = 1.2e-3, 5
#: Where fast moves lead, as shares of the way that strokes have.
FAST_TO = (1.0, 0.25, 0.7, 0.0)
#: Random moves: slowest speed, m/s; seconds that one goes on for at most; share of its reach that a move has at least.
SLOWEST_M_S, LONGEST_MOVE_S, SHORTEST_SHARE = 0.01, 2.0, 0.3


@dataclass(frozen=True)
class Course:
    """Limits of motions.

    Attributes
    ----------
    window_m : tuple of float
        Travel.
    ends_m : tuple of float
        Between which strokes turn.
    gentle, hard : TrajectoryLimits
        Limits of strokes, and of moves with all of the belt's force; hard is slowed down by a step's share.
    """

    window_m: tuple[float, float]
    ends_m: tuple[float, float]
    gentle: TrajectoryLimits
    hard: TrajectoryLimits
    period_s: float

    def place_m(self, step: Step) -> float:
        """Position of a step.

        Returns
        -------
        float, m
            Of the carriage.
        """
        return step.at_m(self.window_m)


def start_of(step: Step, course: Course) -> float:
    """Start position of a closed-loop step, m.

    Parameters
    ----------
    step : Step
    course : Course

    Raises
    ------
    Refused
        Where there is no room.
    """
    low, high = course.ends_m
    if step.kind == "strokes":
        start, end = _around(step, course)
        if end - start < AROUND_M:
            raise Refused(
                f"there is no room for slow strokes around {course.place_m(step):.3f} m: strokes may turn between {low:.3f} m and "
                f"{high:.3f} m"
            )
        return start
    if step.kind == "reversals":
        most = max(step.amplitudes_m)
        return float(np.clip(course.place_m(step), low + most, high - most))
    if step.kind == "moves" and step.seconds:
        return low + float(np.random.default_rng(step.seed).uniform(0.3, 0.7)) * (high - low)
    return low


def path_of(step: Step, course: Course, at_m: float) -> Trajectory:
    """The reference of a closed-loop step from where the carriage stands.

    Parameters
    ----------
    step : Step
    course : Course
    at_m : float, m
        Where the carriage stands.

    Raises
    ------
    UsageError
    Refused
    """
    if step.kind == "sweep":
        which: Which = "again" if step.again else "once"
        return sweep_strokes(at_m, course.ends_m[1], course.gentle, course.period_s, which, step.speeds_m_s).trajectory
    if step.kind == "strokes":
        end = _around(step, course)[1]
        speeds = [min(v, course.gentle.speed_m_s) for v in step.speeds_m_s]
        given = {"run_in_s": RUN_IN_S, "rest_s": REST_S, "longest_plateau_s": LONGEST_S}
        return constant_speed_strokes(at_m, end, speeds, course.gentle, course.period_s, **given).trajectory
    if step.kind == "reversals":
        return _triangles(step, course, at_m)
    return _random_moves(step, course, at_m) if step.seconds else _fast_moves(step, course, at_m)


def _around(step: Step, course: Course) -> tuple[float, float]:
    """Both turns: around the place, or as near to it as strokes may turn."""
    low, high = course.ends_m
    middle = min(max(course.place_m(step), low + AROUND_M), max(high - AROUND_M, low + AROUND_M))
    return max(low, middle - AROUND_M), min(high, middle + AROUND_M)


def _triangles(step: Step, course: Course, at_m: float) -> Trajectory:
    slow = replace(course.gentle, speed_m_s=min(TRIANGLE_M_S, course.gentle.speed_m_s))
    turns = []
    for amplitude in step.amplitudes_m:
        often = int(np.clip(round(TRIANGLE_WAY_M / amplitude), 1, MOST_TRIANGLES))
        turns += [at_m + amplitude, at_m - amplitude] * often
    return _through([*turns, at_m], slow, course, at_m, 0.0)


def _fast_moves(step: Step, course: Course, at_m: float) -> Trajectory:
    (_, high), limits = course.ends_m, course.hard.slower(float(np.sqrt(step.share)))
    return _through([at_m + share * (high - at_m) for share in FAST_TO], limits, course, at_m, BETWEEN_S)


def _random_moves(step: Step, course: Course, at_m: float) -> Trajectory:
    """Random targets at speeds from ``SLOWEST_M_S`` to the fastest, each as likely on a logarithmic scale; slow ones short."""
    random = np.random.default_rng(step.seed)
    limits, (low, high) = course.hard.slower(float(np.sqrt(step.share))), course.ends_m
    top = fastest_stroke_m_s(limits, high - low)
    parts, here = [at_rest(at_m, REST_BEFORE_S, course.period_s)], at_m
    left = step.seconds - REST_BEFORE_S - REST_AFTER_S
    while left > 0.0:
        speed = SLOWEST_M_S * (top / SLOWEST_M_S) ** random.uniform()
        reach = min(LONGEST_MOVE_S * speed, high - low)
        target = here + random.uniform(SHORTEST_SHARE, 1.0) * reach * random.choice([-1.0, 1.0])
        target = float(np.clip(target, low, high))
        if abs(target - here) < 0.5 * SHORTEST_SHARE * reach:
            continue
        share = random.uniform(0.3, 1.0)
        eased = replace(limits, speed_m_s=speed, acceleration_m_s2=share * limits.acceleration_m_s2)
        leg = plan_trajectory(here, target, eased, course.period_s)
        rest = at_rest(target, BETWEEN_S, course.period_s)
        left -= leg.duration_s + rest.duration_s
        if left < 0.0 and len(parts) > 1:
            break
        parts += [leg, rest]
        here = target
    return join([*parts, at_rest(here, REST_AFTER_S, course.period_s)])


def _through(places_m: list[float], limits: TrajectoryLimits, course: Course, at_m: float, rest_s: float) -> Trajectory:
    """From place to place with a rest at each."""
    parts, here = [at_rest(at_m, REST_BEFORE_S, course.period_s)], at_m
    for place in places_m:
        if place == here:
            continue
        parts.append(plan_trajectory(here, place, limits, course.period_s))
        if rest_s:
            parts.append(at_rest(place, rest_s, course.period_s))
        here = place
    return join([*parts, at_rest(here, REST_AFTER_S, course.period_s)])
