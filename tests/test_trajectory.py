"""Reference motions against closed forms and the thesis's move T_A."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import ruckig
from scipy.optimize import brentq

from beltcomm.axis import TrajectoryLimits, load_axis
from beltcomm.errors import DataError, UsageError
from beltcomm.trajectory import Trajectory, at_rest, constant_speed_strokes, join, load_move, plan_trajectory

T_A = TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=45.0, speed_m_s=5.0)
PERIOD_S = 1e-3


def jerk(motion: Trajectory) -> np.ndarray:
    return np.diff(motion.acceleration_m_s2) / motion.sample_period_s


def test_move_t_a_is_bound_by_its_jerk_alone() -> None:
    # Four phases of jerk ±j, each a quarter of the time: s = 2 j (T/4)³, so T = 4 (s/(2 j))^(1/3).
    quarter_s = (0.5 / (2.0 * 40.0)) ** (1.0 / 3.0)
    move = plan_trajectory(0.0, 0.5, T_A, 1e-5)
    assert move.duration_s == pytest.approx(4.0 * quarter_s, abs=1e-5)
    assert move.velocity_m_s.max() == pytest.approx(40.0 * quarter_s**2, rel=1e-4)
    assert move.acceleration_m_s2.max() == pytest.approx(40.0 * quarter_s, rel=1e-3)
    # thesis.md, 3: "only the jerk binds (0.737 s, 7.37 m/s2, 1.36 m/s)"
    peaks = move.duration_s, move.acceleration_m_s2.max(), move.velocity_m_s.max()
    assert [round(float(value), digits) for value, digits in zip(peaks, (3, 2, 2), strict=True)] == [0.737, 7.37, 1.36]


def test_move_t_a_ends_on_a_sample_of_the_drive() -> None:
    # 0.7368 s become 737 periods; the rest is a plateau: s = v (T − 2 √(v/j)).
    move = plan_trajectory(0.0, 0.5, T_A, PERIOD_S)
    speed = brentq(lambda v: v * (0.737 - 2.0 * math.sqrt(v / 40.0)) - 0.5, 1.3, 1.357)
    assert move.t_s[-1] == pytest.approx(0.737, abs=1e-12)
    assert move.velocity_m_s.max() == pytest.approx(speed, rel=1e-4)
    assert np.abs(jerk(move)).max() <= 40.0 * (1 + 1e-6)
    assert (move.position_m[0], move.position_m[-1]) == (0.0, 0.5)
    assert (move.velocity_m_s[-1], move.acceleration_m_s2[-1]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("limits", "duration_s"),
    [
        (TrajectoryLimits(jerk_m_s3=1e3, acceleration_m_s2=2.0, speed_m_s=10.0), 2 * math.sqrt(0.25 + 1e-6) + 2e-3),
        (TrajectoryLimits(jerk_m_s3=1e3, acceleration_m_s2=10.0, speed_m_s=0.5), 0.5 / 0.5 + 0.5 / 10.0 + 10.0 / 1e3),
    ],
    ids=["acceleration binds", "speed binds"],
)
def test_duration_when_another_limit_binds(limits: TrajectoryLimits, duration_s: float) -> None:
    # With v/a + a/j of ramp time: T = s/v + v/a + a/j; without plateau v follows from s = v (v/a + a/j).
    if limits.speed_m_s == 10.0:
        a, j = limits.acceleration_m_s2, limits.jerk_m_s3
        speed = a * (-a / j + math.sqrt((a / j) ** 2 + 4 * 0.5 / a)) / 2
        duration_s = 2 * (speed / a + a / j)
    move = plan_trajectory(0.5, 0.0, limits, 1e-4)
    assert duration_s <= move.duration_s <= duration_s + 1e-4 + 1e-9
    assert np.abs(move.velocity_m_s).max() <= limits.speed_m_s * (1 + 1e-9)
    assert np.abs(move.acceleration_m_s2).max() <= limits.acceleration_m_s2 * (1 + 1e-9)


def test_general_boundary_conditions_are_met_and_the_derivatives_belong_together() -> None:
    motion = plan_trajectory(
        0.1, 0.4, T_A, PERIOD_S,
        start_velocity_m_s=-0.2, start_acceleration_m_s2=1.0, end_velocity_m_s=0.3, end_acceleration_m_s2=-2.0,
    )  # fmt: skip
    first = (motion.position_m[0], motion.velocity_m_s[0], motion.acceleration_m_s2[0])
    last = (motion.position_m[-1], motion.velocity_m_s[-1], motion.acceleration_m_s2[-1])
    assert first == pytest.approx((0.1, -0.2, 1.0), abs=1e-12)
    assert last == (0.4, 0.3, -2.0)
    assert np.abs(jerk(motion)).max() <= 40.0 * (1 + 1e-6)
    middle = 0.5 * (motion.velocity_m_s[1:] + motion.velocity_m_s[:-1])
    # the trapezium rule errs by at most T² j/12 here
    assert np.abs(np.diff(motion.position_m) / PERIOD_S - middle).max() < PERIOD_S**2 * 40.0 / 12 + 1e-9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"end_m": 0.1}, "two different positions"),
        ({"end_m": math.nan}, "finite"),
        ({"start_velocity_m_s": 6.0}, "6 m/s at its start, above its limit of 5 m/s"),
        ({"sample_period_s": 0.0}, "sample period is 0.0 s"),
    ],
)
def test_impossible_motions_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        plan_trajectory(**({"start_m": 0.1, "end_m": 0.5, "limits": T_A, "sample_period_s": PERIOD_S} | change))  # type: ignore[arg-type]


def test_strokes_have_a_plateau_in_both_directions() -> None:
    strokes = constant_speed_strokes(0.05, 0.5, [0.5, 0.1], T_A, PERIOD_S, run_in_s=0.1, rest_s=0.2, longest_plateau_s=0.6)
    motion = strokes.trajectory
    assert [math.copysign(1, p.velocity_m_s) for p in strokes.plateaus] == [1, -1, 1, -1]
    assert [abs(p.velocity_m_s) for p in strokes.plateaus] == pytest.approx([0.5, 0.5, 0.1, 0.1], rel=3e-3)
    for plateau in strokes.plateaus:
        window = slice(plateau.first, plateau.last)
        assert motion.velocity_m_s[window] == pytest.approx(plateau.velocity_m_s, rel=1e-8)
        assert np.abs(motion.acceleration_m_s2[window][1:-1]).max() < 1e-6
        run_in = motion.velocity_m_s[plateau.first - 100 : plateau.first]
        assert run_in == pytest.approx(plateau.velocity_m_s, rel=1e-8)
    # 0.5 s remain of 0.6 s after the run-in where the window does not bind: (0.45 - 2 · 0.0559)/0.5 = 0.676 s > 0.6 s
    assert [(p.last - p.first) * PERIOD_S for p in strokes.plateaus] == pytest.approx([0.5] * 4, abs=0.005)
    assert (motion.position_m.min(), motion.position_m[0], motion.position_m[-1]) == pytest.approx((0.05,) * 3)
    assert np.abs(np.diff(motion.position_m) - 0.5 * PERIOD_S * (motion.velocity_m_s[1:] + motion.velocity_m_s[:-1])).max() < 1e-8


def test_a_window_too_short_for_the_speed_is_refused_with_the_length_needed() -> None:
    # each ramp v √(v/j) = 1.5 √(1.5/40) = 0.2905 m; plateau 1.5 · (0.1 + 0.011) = 0.1665 m
    with pytest.raises(UsageError, match=r"1.5 m/s needs 0\.7474 m, the window 0\.\.0\.5 m has 0\.5 m"):
        constant_speed_strokes(0.0, 0.5, [1.5], T_A, PERIOD_S, run_in_s=0.1, rest_s=0.1)


def test_shortest_admissible_window_still_gives_a_plateau() -> None:
    for limits in (T_A, replace(T_A, acceleration_m_s2=2.0)):
        ramp_m = 0.4 * math.sqrt(0.4 / 40.0) if limits is T_A else 0.5 * 0.4 * (0.4 / 2.0 + 2.0 / 40.0)
        length_m = 2 * ramp_m + 0.4 * (0.05 + 0.011) + 1e-9
        strokes = constant_speed_strokes(0.0, length_m, [0.4], limits, PERIOD_S, run_in_s=0.05, rest_s=0.1)
        assert all(p.last - p.first >= 10 for p in strokes.plateaus)


def test_parts_that_do_not_meet_are_not_joined() -> None:
    with pytest.raises(ValueError, match="must begin where"):
        join([at_rest(0.0, 0.1, PERIOD_S), at_rest(0.1, 0.1, PERIOD_S)])


def write_move(path: Path, t_s: np.ndarray, position: np.ndarray) -> Path:
    rows = "\n".join(f"{t!r},{x!r}" for t, x in zip(t_s.tolist(), position.tolist(), strict=True))
    path.write_text(f"t_s,position_m\n{rows}\n", encoding="utf-8")
    return path


def test_a_move_file_is_resampled_with_its_derivatives(tmp_path: Path) -> None:
    # x = s (10 u³ − 15 u⁴ + 6 u⁵), u = t/T: rest at both ends; x' and x'' known in closed form
    t, end_s = np.linspace(0.0, 0.8, 81), 0.8
    path = write_move(tmp_path / "move.csv", t, 0.4 * ((t / end_s) ** 3 * (10 - 15 * t / end_s + 6 * (t / end_s) ** 2)))
    move = load_move(path, PERIOD_S, load_axis("egc-70-600"))
    u = move.t_s / end_s
    assert len(move.t_s) == 801
    assert move.position_m == pytest.approx(0.4 * u**3 * (10 - 15 * u + 6 * u**2), abs=2e-7)
    assert move.velocity_m_s == pytest.approx(0.4 / end_s * 30 * u**2 * (1 - u) ** 2, abs=2e-4)
    assert move.acceleration_m_s2[5:-5] == pytest.approx((0.4 / end_s**2 * 60 * u * (1 - u) * (1 - 2 * u))[5:-5], abs=0.02)


@pytest.mark.parametrize(
    ("t_s", "position", "failure", "words"),
    [
        ([0, 0.1, 0.2, 0.3, 0.4], [0, 0.01, 0.02, 0.03, 0.04], DataError, "not start at rest"),
        ([0, 0.1, 0.1, 0.3, 0.4], [0, 0, 0.02, 0.03, 0.03], DataError, "t_s in row 3"),
        ([0, 0.1, 0.2, 0.3, 0.4], [0.1] * 5, DataError, "some travel"),
        ([0, 0.1, 0.2, 0.3, 0.4, 0.5], [0, 0, 0.4, 0.8, 0.8, 0.8], UsageError, "outside the travel"),
        ([0, 0.01, 0.02, 0.03, 0.04, 0.05], [0.1, 0.1, 0.2, 0.3, 0.3, 0.3], UsageError, "the limit of axis 'EGC-70-600'"),
    ],
)
def test_unusable_moves_are_refused(tmp_path: Path, t_s: list[float], position: list[float], failure: type, words: str) -> None:
    path = write_move(tmp_path / "move.csv", np.array(t_s, dtype=float), np.array(position, dtype=float))
    with pytest.raises(failure, match=words):
        load_move(path, PERIOD_S, load_axis("egc-70-600"))


@pytest.mark.parametrize(("velocity", "acceleration"), [(0.0, 0.0), (0.3, -2.0), (0.495, 4.9)])
def test_the_samples_are_those_of_the_library(velocity: float, acceleration: float) -> None:
    """Also where a start that is not able to keep the limits is braked first: the last one reaches 0.5 m/s at full acceleration."""
    limits = TrajectoryLimits(speed_m_s=0.5, acceleration_m_s2=5.0, jerk_m_s3=100.0)
    problem = ruckig.InputParameter(1)
    problem.current_position, problem.current_velocity, problem.current_acceleration = [0.1], [velocity], [acceleration]
    problem.target_position, problem.max_velocity, problem.max_acceleration, problem.max_jerk = [0.45], [0.5], [5.0], [100.0]
    problem.duration_discretization = ruckig.DurationDiscretization.Discrete
    solution = ruckig.Trajectory(1)
    ruckig.Ruckig(1, PERIOD_S).calculate(problem, solution)
    move = plan_trajectory(0.1, 0.45, limits, PERIOD_S, start_velocity_m_s=velocity, start_acceleration_m_s2=acceleration)
    expected = np.array([solution.at_time(t) for t in move.t_s[:-1]])[:, :, 0]
    assert (solution.profiles[0][0].brake.duration > 0.0) == (velocity > 0.4)
    for column, wanted in zip((move.position_m, move.velocity_m_s, move.acceleration_m_s2), expected.T, strict=True):
        assert column[:-1] == pytest.approx(wanted, abs=1e-12)
