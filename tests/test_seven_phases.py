"""Motions with bounds of their own each way: against ruckig, a linear programme, closed forms, and what must hold by symmetry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import ruckig
from scipy import sparse
from scipy.optimize import linprog

from beltcomm.axis import TrajectoryLimits
from beltcomm.errors import Refused, UsageError
from beltcomm.trajectory import plan_trajectory
from beltcomm.trajectory.seven_phases import MotionBounds, MotionState, SevenPhases, bounds_reached, fastest_motion, on_grid

T_A = MotionBounds(-5.0, 5.0, -45.0, 45.0, -40.0, 40.0)
T_B = MotionBounds(-5.0, 5.0, -50.0, 50.0, -50.0, 50.0)
#: Braking twice as hard as accelerating, a soft end, slow on the way back.
ODD = MotionBounds(-0.3, 0.8, -6.0, 3.0, -20.0, 45.0)
PERIOD_S = 1e-3

Case = tuple[MotionState, MotionState, MotionBounds]


def viable(state: MotionState, bounds: MotionBounds, *, end: bool) -> bool:
    """The speed while the acceleration comes to zero after the start, or was built up before the end, by v² = a²/2j."""
    a = state.acceleration_m_s2
    jerk = {(True, False): bounds.jerk_min_m_s3, (False, False): bounds.jerk_max_m_s3,
            (True, True): bounds.jerk_max_m_s3, (False, True): bounds.jerk_min_m_s3}[a > 0.0, end]  # fmt: skip
    return bounds.velocity_min_m_s <= state.velocity_m_s - 0.5 * a * a / jerk <= bounds.velocity_max_m_s


def random_cases(seed: int, count: int, *, symmetric_jerk: bool, rest_share: float = 0.2) -> list[Case]:
    """Cases over four decades of distance; a fifth from rest to rest, a fifth with speeds only."""
    rng, cases = np.random.default_rng(seed), []
    while len(cases) < count:
        rise = 10 ** rng.uniform(0.0, 2.5)
        fall = rise if symmetric_jerk else rise * 10 ** rng.uniform(-0.7, 0.7)
        v, a = rng.uniform(0.2, 3.0, 2), rng.uniform(0.5, 10.0, 2)
        bounds = MotionBounds(-v[0], v[1], -a[0], a[1], -fall, rise)
        kind = rng.random()
        speeds = rng.uniform(-v[0], v[1], 2) if kind > rest_share else np.zeros(2)
        accelerations = rng.uniform(-a[0], a[1], 2) if kind > 2 * rest_share else np.zeros(2)
        distance = rng.normal() * 10 ** rng.uniform(-4.0, 1.0)
        start = MotionState(0.1, float(speeds[0]), float(accelerations[0]))
        end = MotionState(0.1 + distance, float(speeds[1]), float(accelerations[1]))
        if viable(start, bounds, end=False) and viable(end, bounds, end=True):
            cases.append((start, end, bounds))
    return cases


def ruckig_duration(start: MotionState, end: MotionState, bounds: MotionBounds) -> float:
    problem = ruckig.InputParameter(1)
    problem.current_position, problem.target_position = [start.position_m], [end.position_m]
    problem.current_velocity, problem.target_velocity = [start.velocity_m_s], [end.velocity_m_s]
    problem.current_acceleration, problem.target_acceleration = [start.acceleration_m_s2], [end.acceleration_m_s2]
    problem.min_velocity, problem.max_velocity = [bounds.velocity_min_m_s], [bounds.velocity_max_m_s]
    problem.min_acceleration, problem.max_acceleration = [bounds.acceleration_min_m_s2], [bounds.acceleration_max_m_s2]
    problem.max_jerk = [bounds.jerk_max_m_s3]
    solution = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(problem, solution) is ruckig.Result.Working
    return float(solution.duration)


def check_kept(motion: SevenPhases, bounds: MotionBounds) -> None:
    """Bounds by dense sampling, to 1e-8 of their size; each quantity is the integral of the next; both ends are met."""
    t = np.linspace(0.0, motion.duration_s, 4001)
    p, v, a, j = motion.at(t)
    for values, low, high in (
        (v, bounds.velocity_min_m_s, bounds.velocity_max_m_s),
        (a, bounds.acceleration_min_m_s2, bounds.acceleration_max_m_s2),
        (j, bounds.jerk_min_m_s3, bounds.jerk_max_m_s3),
    ):
        slack = 1e-8 * max(abs(low), abs(high))
        assert low - slack <= values.min()
        assert values.max() <= high + slack
    step, jerk = float(t[1] - t[0]), max(-bounds.jerk_min_m_s3, bounds.jerk_max_m_s3)
    # errors of the trapezium rule: h² j/12 for the speed as a slope, h j where the jerk switches inside a step
    assert np.abs(np.diff(p) / step - 0.5 * (v[1:] + v[:-1])).max() <= step**2 * jerk / 6.0 + 1e-12 / step
    assert np.abs(np.diff(v) - 0.5 * step * (a[1:] + a[:-1])).max() <= step**2 * jerk / 4.0 + 1e-12
    assert np.abs(np.diff(a)).max() <= step * jerk * (1.0 + 1e-9) + 1e-12
    assert (p[0], v[0], a[0]) == (motion.start.position_m, motion.start.velocity_m_s, motion.start.acceleration_m_s2)
    end, time = motion.end, motion.duration_s
    assert abs(p[-1] - end.position_m) <= 1e-11 * (jerk * time**3 + 1.0)
    assert abs(v[-1] - end.velocity_m_s) <= 1e-11 * (jerk * time**2 + 1.0)
    assert abs(a[-1] - end.acceleration_m_s2) <= 1e-11 * (jerk * time + 1.0)


def test_durations_are_ruckigs_where_the_jerk_is_symmetric() -> None:
    """400 random cases, speeds and accelerations with bounds of their own each way: equal to 1e-9."""
    for start, end, bounds in random_cases(1, 400, symmetric_jerk=True):
        motion = fastest_motion(start, end, bounds)
        assert motion.duration_s == pytest.approx(ruckig_duration(start, end, bounds), rel=1e-9), (start, end, bounds)


def test_bounds_and_both_ends_are_kept_also_with_asymmetric_jerk() -> None:
    for start, end, bounds in random_cases(2, 120, symmetric_jerk=False):
        check_kept(fastest_motion(start, end, bounds), bounds)


def test_the_negated_task_gives_the_negated_motion() -> None:
    for start, end, bounds in random_cases(3, 40, symmetric_jerk=False):
        motion = fastest_motion(start, end, bounds)
        other = fastest_motion(mirror(start), mirror(end), bounds.mirrored())
        assert other.duration_s == pytest.approx(motion.duration_s, rel=1e-12)
        np.testing.assert_allclose(other.durations_s, motion.mirrored().durations_s, atol=1e-9 * motion.duration_s)
        t = np.linspace(0.0, motion.duration_s, 50)
        np.testing.assert_allclose(other.at(t)[0], motion.mirrored().at(t)[0], atol=1e-9)


def mirror(state: MotionState) -> MotionState:
    return MotionState(-state.position_m, -state.velocity_m_s, -state.acceleration_m_s2)


def test_backwards_in_time_it_is_as_fast() -> None:
    """p(T - t) has the speed -v, the acceleration a, the jerk -j: its bounds change sides for speed and jerk."""
    for start, end, bounds in random_cases(4, 40, symmetric_jerk=False):
        back = MotionBounds(
            -bounds.velocity_max_m_s, -bounds.velocity_min_m_s, bounds.acceleration_min_m_s2, bounds.acceleration_max_m_s2,
            -bounds.jerk_max_m_s3, -bounds.jerk_min_m_s3,
        )  # fmt: skip
        motion = fastest_motion(start, end, bounds)
        other = fastest_motion(replace(end, velocity_m_s=-end.velocity_m_s), replace(start, velocity_m_s=-start.velocity_m_s), back)
        assert other.duration_s == pytest.approx(motion.duration_s, rel=1e-9)
        t = np.linspace(0.0, motion.duration_s, 50)
        np.testing.assert_allclose(other.at(motion.duration_s - t)[0], motion.at(t)[0], atol=1e-8)


class Programme:
    """Whether some motion with a jerk that is constant in each of n equal parts takes a time T: a linear programme without any phases.

    Its acceleration is exact at the nodes.  Its speed is bounded at the nodes only, so that it may pass a bound between them by h² j/8; and
    its jerk switches at the nodes only, but it may take any value between the bounds in the part where the true one switches.  Both move
    the shortest time by some 1/n² per switch: for n = 100 and at most eight switches by less than 0.1 %.
    """

    PARTS = 100

    def __init__(self, start: MotionState, end: MotionState, bounds: MotionBounds) -> None:
        self.ends = [(s.position_m, s.velocity_m_s, s.acceleration_m_s2) for s in (start, end)]
        self.bounds = bounds

    def feasible(self, time: float) -> bool:
        n, h = self.PARTS, time / self.PARTS
        # unknowns: p, v, a at n + 1 nodes, j in n parts
        size = 4 * n + 3
        place = {"p": 0, "v": n + 1, "a": 2 * n + 2, "j": 3 * n + 3}
        rows = np.arange(n)
        blocks = []
        for left, terms in (
            ("p", (("p", 1.0), ("v", h), ("a", h * h / 2), ("j", h**3 / 6))),
            ("v", (("v", 1.0), ("a", h), ("j", h * h / 2))),
            ("a", (("a", 1.0), ("j", h))),
        ):
            entries = [(rows, place[left] + 1 + rows, np.ones(n))]
            entries += [(rows, place[name] + rows, np.full(n, -factor)) for name, factor in terms]
            r, c, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
            blocks.append(sparse.coo_matrix((values, (r, c)), shape=(n, size)))
        b = self.bounds
        limits = [(None, None)] * (n + 1) + [(b.velocity_min_m_s, b.velocity_max_m_s)] * (n + 1)
        limits += [(b.acceleration_min_m_s2, b.acceleration_max_m_s2)] * (n + 1) + [(b.jerk_min_m_s3, b.jerk_max_m_s3)] * n
        for node, values in zip((0, n), self.ends, strict=True):
            for name, value in zip("pva", values, strict=True):
                limits[place[name] + node] = (value, value)
        answer = linprog(np.zeros(size), A_eq=sparse.vstack(blocks).tocsr(), b_eq=np.zeros(3 * n), bounds=limits, method="highs")
        return bool(answer.status == 0)


ASYMMETRIC = [
    (MotionState(0.0), MotionState(0.5), ODD),
    (MotionState(0.5), MotionState(0.0), ODD),
    (MotionState(0.0), MotionState(0.01), ODD),
    (MotionState(0.0, 0.5), MotionState(0.3, -0.2), ODD),
    (MotionState(0.0, -0.2, -0.5), MotionState(0.4, 0.6, 1.0), ODD),
    (MotionState(0.0, 0.1), MotionState(0.0, 0.6), ODD),
    (MotionState(0.0, 0.0, 2.0), MotionState(0.05, 0.1, -3.0), ODD),
    # the acceleration stays above zero: less way than the direct change of speed needs would have to go through zero
    (MotionState(0.0, 0.0, 1.0), MotionState(0.004, 0.075, 1.5), ODD),
    (MotionState(0.0), MotionState(1.0), MotionBounds(0.0, 1.0, -8.0, 2.0, -10.0, 60.0)),
    (MotionState(0.0), MotionState(0.5), MotionBounds(-5.0, 5.0, -45.0, 45.0, -10.0, 40.0)),
    (MotionState(0.0, 0.3, -1.0), MotionState(-0.2, 0.2, 1.0), MotionBounds(-0.5, 0.5, -2.0, 5.0, -30.0, 9.0)),
    (MotionState(0.0, -0.3, 1.0), MotionState(-0.05, -0.3, 1.0), MotionBounds(-0.5, 0.5, -2.0, 5.0, -30.0, 9.0)),
]


@pytest.mark.parametrize("case", ASYMMETRIC, ids=range(len(ASYMMETRIC)))
def test_no_motion_of_any_other_shape_is_faster(case: Case) -> None:
    """A time just above ours is feasible in a linear programme that knows of no phases; none of a dozen shorter ones is."""
    motion, programme = fastest_motion(*case), Programme(*case)
    check_kept(motion, case[2])
    assert programme.feasible(1.001 * motion.duration_s)
    assert not [share for share in (*np.linspace(0.08, 0.96, 12), 0.999) if programme.feasible(share * motion.duration_s)]


def test_moves_of_the_thesis() -> None:
    """Four quarters of ±j: s = 2 j (T/4)³.   thesis.md, 3: T_A takes 0.737 s, 7.37 m/s², 1.36 m/s, and only the jerk binds."""
    for bounds in (T_A, T_B):
        quarter = math.cbrt(0.5 / (2.0 * bounds.jerk_max_m_s3))
        motion = fastest_motion(MotionState(0.0), MotionState(0.5), bounds)
        assert motion.durations_s == pytest.approx([quarter, 0.0, quarter, 0.0, quarter, 0.0, quarter], abs=1e-14)
        assert bounds_reached(motion, bounds) == ("jerk_min_m_s3", "jerk_max_m_s3")
    extremes = fastest_motion(MotionState(0.0), MotionState(0.5), T_A).extremes()
    assert [round(v, 2) for v in (extremes.velocity_m_s[1], extremes.acceleration_m_s2[1])] == [1.36, 7.37]


def test_jerk_in_closed_form_when_only_it_binds_and_is_asymmetric() -> None:
    """Rise r to the peak a, fall f to zero: speed a²(1/r + 1/f)/2, way a³ (1/(6r²) + 1/(2rf) + 1/(3f²)) by integrating twice.

    The second half is the first one backwards in time: the same speed, the same way.
    """
    rise, fall = 40.0, 10.0
    motion = fastest_motion(MotionState(0.0), MotionState(0.5), MotionBounds(-5.0, 5.0, -45.0, 45.0, -fall, rise))
    up = 1.0 / (6.0 * rise**2) + 1.0 / (2.0 * rise * fall) + 1.0 / (3.0 * fall**2)
    peak = math.cbrt(0.5 / (2.0 * up))
    assert motion.durations_s == pytest.approx([peak / rise, 0, peak / fall, 0, peak / fall, 0, peak / rise], abs=1e-12)


def test_every_phase_in_closed_form() -> None:
    """All bounds reached: v/a + a/j times per ramp, with its own a and j each way."""
    bounds = MotionBounds(-1.0, 1.0, -8.0, 4.0, -100.0, 50.0)
    motion = fastest_motion(MotionState(0.0), MotionState(2.0), bounds)
    up = [4.0 / 50.0, 0.0, 4.0 / 100.0]
    up[1] = (1.0 - 0.5 * 4.0 * (up[0] + up[2])) / 4.0
    down = [8.0 / 100.0, 0.0, 8.0 / 50.0]
    down[1] = (1.0 - 0.5 * 8.0 * (down[0] + down[2])) / 8.0
    np.testing.assert_allclose(motion.durations_s[[0, 1, 2, 4, 5, 6]], [*up, *down], atol=1e-12)
    assert bounds_reached(motion, bounds) == (
        "velocity_max_m_s", "acceleration_min_m_s2", "acceleration_max_m_s2", "jerk_min_m_s3", "jerk_max_m_s3",
    )  # fmt: skip
    assert motion.at(np.array([motion.duration_s]))[0][0] == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_any_chain_of_phases_is_found_again_when_some_last_no_time(seed: int) -> None:
    """Phases of 0 s and of round lengths, where roots are double and bounds are met exactly: never slower than the chain."""
    rng, tried = np.random.default_rng(seed), 0
    while tried < 12:
        bounds = MotionBounds(-1.0, 1.0, -2.0, 1.0, -2.0, 4.0)
        sign = rng.choice([-1.0, 1.0])
        pattern = [4.0, 0.0, -2.0, 0.0, -2.0, 0.0, 4.0] if sign > 0 else [-2.0, 0.0, 4.0, 0.0, 4.0, 0.0, -2.0]
        durations = rng.choice([0.0, 0.0, 0.125, 0.25, 0.5], 7)
        start = MotionState(0.0, float(rng.integers(-4, 5)) / 4, float(rng.choice([0.0, 0.0, 0.5, -0.5, 1.0, -2.0])))
        state = [start.position_m, start.velocity_m_s, start.acceleration_m_s2]
        inside = True
        for jerk, time in zip(pattern, durations, strict=True):
            for part in np.linspace(0.0, time, 9)[1:]:
                v, a = state[1] + part * state[2] + part * part * jerk / 2, state[2] + part * jerk
                inside &= bool(-1.0 <= v <= 1.0 and -2.0 <= a <= 1.0)
            p, v, a = state
            state = [p + time * v + time**2 * a / 2 + time**3 * jerk / 6, v + time * a + time**2 * jerk / 2, a + time * jerk]
        end = MotionState(*map(float, state))
        if not inside or end == start or not viable(start, bounds, end=False) or not viable(end, bounds, end=True):
            continue
        tried += 1
        motion = fastest_motion(start, end, bounds)
        assert motion.duration_s <= durations.sum() * (1.0 + 1e-9)
        check_kept(motion, bounds)


def test_very_short_and_very_long_moves() -> None:
    for distance in (1e-12, 1e-9, 1e-6, 1e3, 1e6):
        motion = fastest_motion(MotionState(0.0), MotionState(distance), ODD)
        check_kept(motion, ODD)
        if distance < 1e-5:  # jerk alone
            up = 1.0 / (6.0 * 45.0**2) + 1.0 / (2.0 * 45.0 * 20.0) + 1.0 / (3.0 * 20.0**2)
            assert motion.duration_s == pytest.approx(2.0 * math.cbrt(distance / (2.0 * up)) * (1 / 45.0 + 1 / 20.0), rel=1e-9)
        if distance >= 1e3:  # speed alone, but for the ramps
            assert motion.duration_s == pytest.approx(distance / 0.8, rel=1e-3)


@pytest.mark.parametrize("bounds", [T_A, T_B, MotionBounds(-0.4, 0.4, -2.0, 2.0, -40.0, 40.0)], ids=["T_A", "T_B", "all bind"])
def test_on_the_grid_it_is_the_motion_that_ruckig_makes(bounds: MotionBounds) -> None:
    limits = TrajectoryLimits(bounds.jerk_max_m_s3, bounds.acceleration_max_m_s2, bounds.velocity_max_m_s)
    for end in (0.5, -0.2):
        own = on_grid(MotionState(0.0), MotionState(end), bounds, PERIOD_S).sampled(PERIOD_S)
        other = plan_trajectory(0.0, end, limits, PERIOD_S)
        assert len(own.t_s) == len(other.t_s)
        np.testing.assert_allclose(own.position_m, other.position_m, atol=1e-9)
        np.testing.assert_allclose(own.velocity_m_s, other.velocity_m_s, atol=1e-8)


def test_on_the_grid_ends_are_exact_bounds_kept_and_not_a_whole_period_is_lost() -> None:
    for start, end, bounds in random_cases(5, 60, symmetric_jerk=False):
        fastest = fastest_motion(start, end, bounds).duration_s
        motion = on_grid(start, end, bounds, PERIOD_S)
        check_kept(motion, bounds)
        sampled = motion.sampled(PERIOD_S)
        assert sampled.duration_s == pytest.approx(motion.duration_s, rel=1e-9)
        last = sampled.position_m[-1], sampled.velocity_m_s[-1], sampled.acceleration_m_s2[-1]
        assert last == (end.position_m, end.velocity_m_s, end.acceleration_m_s2)
        assert motion.duration_s >= fastest * (1.0 - 1e-9)
        assert motion.duration_s <= fastest + PERIOD_S * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("start", "end", "bounds", "words"),
    [
        (MotionState(0.1), MotionState(0.1), ODD, "same state at 0.1 m"),
        (MotionState(0.1), MotionState(math.nan), ODD, "position_m at the end is nan"),
        (MotionState(0.0, 0.9), MotionState(0.5), ODD, r"0.9 m/s at its start, outside its bounds -0.3 to 0.8 m/s"),
        (MotionState(0.0), MotionState(0.5, -0.31), ODD, r"-0.31 m/s at its end, outside its bounds -0.3 to 0.8"),
        (MotionState(0.0, 0.0, 4.0), MotionState(0.5), ODD, r"4 m/s² at its start, outside its bounds -6 to 3 m/s²"),
        # 0.75 + 3²/(2·20) = 0.975 m/s;   -0.25 - 4²/(2·45) = -0.428 m/s
        (
            MotionState(0.0, 0.75, 3.0),
            MotionState(0.5),
            ODD,
            r"3 m/s² at the start .* forces the speed to 0.975 m/s after it, beyond .* 0.8",
        ),
        (MotionState(0.0, -0.25, -4.0), MotionState(0.5), ODD, r"forces the speed to -0.427778 m/s after it, beyond its bound of -0.3"),
        # backwards in time: -0.29 - 2²/(2·45) = -0.334 m/s;   0.7 + 3²/(2·20) = 0.925 m/s
        (MotionState(0.0), MotionState(0.5, -0.29, 2.0), ODD, r"2 m/s² at the end .* to -0.334444 m/s before it"),
        (MotionState(0.0), MotionState(0.5, 0.7, -3.0), ODD, r"-3 m/s² at the end .* to 0.925 m/s before it, beyond its bound of 0.8"),
    ],
)
def test_impossible_ends_are_refused_with_the_bound(start: MotionState, end: MotionState, bounds: MotionBounds, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        fastest_motion(start, end, bounds)


def test_a_forbidden_way_is_refused() -> None:
    forward = replace(ODD, velocity_min_m_s=0.0)
    with pytest.raises(Refused, match=r"from 0.5 m to 0 m .* velocity_min_m_s is 0, so that nothing may move backward"):
        fastest_motion(MotionState(0.5), MotionState(0.0), forward)
    with pytest.raises(Refused, match="nothing may move backward"):  # the stop takes 0.095 m
        fastest_motion(MotionState(0.0, 0.5), MotionState(0.05), forward)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"jerk_max_m_s3": 0.0}, "jerk_max_m_s3 is 0; it must be above 0"),
        ({"acceleration_min_m_s2": 1.0}, "acceleration_min_m_s2 is 1; it must be below 0"),
        ({"velocity_max_m_s": math.inf}, "velocity_max_m_s is inf"),
        ({"velocity_min_m_s": 0.0, "velocity_max_m_s": 0.0}, "nothing could move"),
    ],
)
def test_impossible_bounds_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        replace(ODD, **change)


def test_a_period_must_be_positive_and_phases_must_lead_to_the_end() -> None:
    with pytest.raises(UsageError, match=r"sample period is 0\.0 s"):
        on_grid(MotionState(0.0), MotionState(0.5), ODD, 0.0)
    motion = fastest_motion(MotionState(0.0), MotionState(0.5), ODD)
    with pytest.raises(ValueError, match="not a whole number"):
        motion.sampled(PERIOD_S)
    with pytest.raises(ValueError, match="the phases lead to"):
        SevenPhases(motion.start, MotionState(0.6), motion.durations_s, motion.jerks_m_s3)
