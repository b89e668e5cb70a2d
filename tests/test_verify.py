"""Tracking errors in closed form, the demand of the thesis's move, and the predicted move against an own loop on the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter

from beltcomm.axis.entries import AxisTargets, TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.experiments import verification
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.trajectory import Trajectory, at_rest, join, plan_trajectory
from beltcomm.verify import RANGE_DRAWS, Loop, PredictedMove, TrackingError, demand, judge, predict_move, predict_range, tracking_error
from identify.records import COUNTS, PERIOD_S, true_model
from truth import TruthPlant, nominal

Array = NDArray[np.float64]
T_A = TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=45.0, speed_m_s=5.0)
RATIO = 0.01242
STRUCTURE = CascadeStructure("thesis", PERIOD_S)


def move() -> Trajectory:
    """0 to 0.5 m with the limits T_A, then rest."""
    there = plan_trajectory(0.0, 0.5, T_A, PERIOD_S)
    return join([there, at_rest(0.5, 1.6, PERIOD_S)])


# ---- demand


def test_demand_of_t_a_on_g_a_is_the_thesis_sheets() -> None:
    """thesis.md 3: only the jerk binds; 7.37 m/s², 1.36 m/s, 99.0 N at the belt and 1.54 N m at the motor.

    Cubic in four equal parts of T = (32 s/j)^(1/3) = 0.7368 s: a = j T/4, v = j T²/16; the grid of 1 ms rounds T up.
    """
    found = demand(move(), true_model(nominal("g_a")))
    duration = (32.0 * 0.5 / 40.0) ** (1.0 / 3.0)
    assert found.acceleration_m_s2 == pytest.approx(40.0 * duration / 4.0, rel=2e-3)
    assert found.acceleration_m_s2 == pytest.approx(7.36, abs=0.02)
    assert found.speed_m_s == pytest.approx(40.0 * duration**2 / 16.0, rel=2e-3)
    assert found.feed_force_n == pytest.approx(99.0, abs=0.3)
    assert 1.53 <= found.torque_nm <= 1.545


def test_demand_takes_gravity_and_every_friction() -> None:
    """At constant speed: F = m g sin α, τ = (b + r² b_c) v/r + τ_c + r F_c + r m g sin α (4.15), (2.22)."""
    values = {
        "motor.inertia": 7e-5, "cart.mass": 3.0, "transmission.ratio": RATIO, "viscous.damping": 2e-3, "viscous_cart.damping": 9.0,
        "coulomb.level": 0.08, "cart_friction.level": 3.0, "tilt.angle": 0.3,
    }  # fmt: skip
    effects = ("belt_stiffness", "viscous", "viscous_cart", "coulomb", "cart_friction", "tilt")
    model = build_model("tilted", effects, values)
    t = PERIOD_S * np.arange(100, dtype=np.float64)
    uphill = Trajectory(t, 0.4 * t, np.full(100, 0.4), np.zeros(100))
    weight = 3.0 * 9.80665 * math.sin(0.3)
    friction = (2e-3 + RATIO**2 * 9.0) * 0.4 / RATIO + 0.08 + RATIO * 3.0
    assert demand(uphill, model).feed_force_n == pytest.approx(weight)
    assert demand(uphill, model).torque_nm == pytest.approx(friction + RATIO * weight)
    downhill = Trajectory(t, -0.4 * t, np.full(100, -0.4), np.zeros(100))
    assert demand(downhill, model).torque_nm == pytest.approx(abs(-friction + RATIO * weight))


# ---- tracking error


def ramp(samples: int = 4000, first: int = 500, last: int = 1500) -> tuple[Array, Array]:
    t = PERIOD_S * np.arange(samples, dtype=np.float64)
    return t, 0.2 * np.clip((t - t[first]) / (t[last] - t[first]), 0.0, 1.0)


def test_tracking_error_of_a_lagging_axis_is_speed_times_lag() -> None:
    """A ramp of 0.2 m/s followed 4 ms late: 0.8 mm while it moves; 30 um left from then on."""
    t, reference = ramp()
    late = np.concatenate([np.zeros(4), reference[:-4]])
    late[1504:] -= 30e-6
    error = tracking_error(t, reference, late)
    assert error.dynamic_m == pytest.approx(0.8e-3, rel=1e-9)
    assert error.static_m == pytest.approx(30e-6, rel=1e-9)


def test_an_axis_that_rests_past_its_goal_has_overshot_by_no_more_than_it_swung_beyond_its_rest() -> None:
    t, reference = ramp()
    beyond = reference + np.where(t >= t[1500], 30e-6, 0.0)
    assert tracking_error(t, reference, beyond).overshoot_m == pytest.approx(0.0, abs=1e-12)
    swung = beyond + np.where((t >= t[1500]) & (t < t[1520]), 50e-6, 0.0)
    assert tracking_error(t, reference, swung).overshoot_m == pytest.approx(50e-6, rel=1e-6)
    short = reference + np.where((t >= t[1500]) & (t < t[1520]), 50e-6, 0.0) - np.where(t >= t[1520], 30e-6, 0.0)
    assert tracking_error(t, reference, short).overshoot_m == pytest.approx(50e-6, rel=1e-6)


SEEN = [
    (0.3, False, False),
    (0.6, True, False),
    (1.5, True, False),
    (1.7, False, False),
    (1.99, False, False),
    (2.01, False, True),
    (2.99, False, True),
    (3.01, False, False),
]


@pytest.mark.parametrize(("at_s", "dynamic", "static"), SEEN)
def test_each_error_looks_at_its_own_time(at_s: float, dynamic: bool, static: bool) -> None:
    """The reference moves from 0.5 to 1.5 s; static is 0.5 to 1.5 s after its end.  One sample off by 1 mm is seen there only."""
    t, reference = ramp()
    position = reference.copy()
    position[round(at_s / PERIOD_S)] -= 1e-3
    error = tracking_error(t, reference, position)
    assert error.dynamic_m == pytest.approx(1e-3 if dynamic else 0.0, abs=1e-12)
    assert error.static_m == pytest.approx(1e-3 if static else 0.0, abs=1e-12)


def test_tracking_error_needs_a_move_and_its_rest() -> None:
    t, reference = ramp()
    with pytest.raises(DataError, match="does not move"):
        tracking_error(t, np.full_like(t, 0.1), reference)
    with pytest.raises(DataError, match=r"ends 1\.00 s after the move; the settled error is read until 1\.5 s"):
        tracking_error(t[:2501], reference[:2501], reference[:2501])
    assert tracking_error(t[:3001], reference[:3001], reference[:3001]).static_m == 0.0


# ---- predicted move


def own_loop(plant: TruthPlant, cascade: Cascade, trajectory: Trajectory, delay_s: float) -> tuple[Array, Array, Array, float]:
    """The cascade of figure 4.1 written down once more, on the truth: motor and carriage in m, torque, largest belt force.

    Velocity by backward difference behind a first-order lag (6.1), the reference averaged over its period behind the same lag,
    Butterworth by the bilinear transform on the error (4.3), P-PI (4.6), forward Euler integrator (6.25), feedforward (4.16).
    """
    reference, speed = trajectory.position_m / RATIO, trajectory.velocity_m_s / RATIO
    forward, lag = cascade.feedforward, cascade.velocity_filter_s
    b, a = np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    if cascade.prefilter.kind == "butterworth":
        b, a = butter(2, cascade.prefilter.omega_rad_s / (2.0 * math.pi), fs=1.0 / PERIOD_S)
    step = 2.0 * math.pi / COUNTS
    measured = filtered = last_angle = last_speed = integral = 0.0
    raw, smooth = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    acting = before = 0.0
    motor, cart, torque, belt = [], [], [], 0.0
    for k in range(len(reference)):
        motor.append(RATIO * plant.position_rad)
        cart.append(plant.cart_position_m)
        angle = round(plant.position_rad / step) * step
        measured = (lag * measured + angle - last_angle) / (lag + PERIOD_S)
        filtered = (lag * filtered + PERIOD_S * 0.5 * (speed[k] + last_speed)) / (lag + PERIOD_S)
        acceleration = (speed[k] - last_speed) / PERIOD_S
        last_angle, last_speed = angle, speed[k]
        raw = [cascade.kpp_1_s * (reference[k] - angle) + filtered - measured, *raw[:2]]
        smooth = [float(b @ raw - a[1:] @ smooth[:2]), *smooth[:2]]
        ahead = forward.inertia_kg_m2 * acceleration + forward.viscous_nm_s_rad * speed[k] + forward.coulomb_nm * np.sign(speed[k])
        torque.append(float(cascade.kp_nm_s_rad * smooth[0] + cascade.ki_nm_rad * integral + ahead))
        integral += PERIOD_S * smooth[0]
        # late by a whole period (asked one sample ago) and a rest
        rest = delay_s - PERIOD_S * math.floor(delay_s / PERIOD_S + 1e-9)
        asked = torque[-1] if delay_s < PERIOD_S else before
        before = torque[-1]
        if rest > 1e-9:
            plant.step(acting, rest)
        plant.step(asked, PERIOD_S - rest)
        acting = asked
        belt = max(belt, abs(plant.belt_force_n))
    return np.array(motor), np.array(cart), np.array(torque), belt


def cascade_for(rig: str, model: Model) -> Cascade:
    """Table A.6's Butterworth gains for G_A, for G_B a tenth, as its inertia; cutoff at -3 dB in the antiresonance of each."""
    share, cutoff = (1.0, 123.24) if rig == "g_a" else (0.1, 481.6)
    feedforward = Feedforward(
        inertia_kg_m2=model["motor.inertia"] + RATIO**2 * model["cart.mass"],
        viscous_nm_s_rad=model["viscous.damping"],
        coulomb_nm=model["coulomb.level"] + RATIO * model["cart_friction.level"],
    )
    return Cascade(0.12 * share, 1.39 * share, 6.29, 0.002, Prefilter("butterworth", cutoff), feedforward)


@pytest.mark.parametrize("delay_s", [0.3e-3, 1.0e-3, 1.4e-3])
@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_predicted_move_is_an_own_loop_on_the_truth(rig: str, delay_s: float) -> None:
    """Two programs of one cascade on two simulators: within a third of an encoder step, 0.4 um, through stick and slip."""
    plant = nominal(rig)
    model = true_model(plant)
    cascade, trajectory = cascade_for(rig, model), join([at_rest(0.0, 0.05, PERIOD_S), move()])
    found = predict_move(model, cascade, trajectory, Loop(STRUCTURE, delay_s, 3.1, COUNTS))
    motor, cart, torque, belt = own_loop(plant, cascade, trajectory, delay_s)
    np.testing.assert_allclose(found.motor_m, motor, atol=0.4e-6)
    np.testing.assert_allclose(found.cart_m, cart, atol=0.4e-6)
    np.testing.assert_allclose(found.torque_nm, torque, atol=5e-3)
    assert found.belt_force_n == pytest.approx(belt, rel=0.01)
    np.testing.assert_allclose(found.t_s, trajectory.t_s, atol=1e-12)
    error = np.max(np.abs(motor - trajectory.position_m))
    assert 20e-6 < error < 1e-3, "the move must be followed, and not by the feedforward alone"


def test_a_prediction_tells_a_delay_and_a_torque_limit() -> None:
    """The 0.4 um above would mean little if nothing changed the motion by more."""
    model = true_model(nominal("g_a"))
    cascade = cascade_for("g_a", model)
    moves = [
        predict_move(model, cascade, move(), Loop(STRUCTURE, delay, limit, COUNTS))
        for delay, limit in ((1.0e-3, 3.1), (2.0e-3, 3.1), (1.0e-3, 1.24))
    ]
    for other in moves[1:]:
        assert np.max(np.abs(other.motor_m - moves[0].motor_m)) > 20e-6
    assert np.max(np.abs(moves[2].torque_nm)) == 1.24


def test_a_prediction_runs_into_the_bounds_of_the_drive_and_names_them() -> None:
    """Without velocity feedforward the speed is the output of the position controller: at most its bound of 30 rad/s, 0.373 m/s."""
    model = true_model(nominal("g_b"))
    cascade = replace(cascade_for("g_b", model), feedforward=Feedforward(velocity=0.0))
    free, bounded = (
        predict_move(model, cascade, move(), Loop(structure, 1e-3, 3.1, COUNTS))
        for structure in (STRUCTURE, replace(STRUCTURE, output_limit_rad_s=30.0))
    )
    assert free.saturated == ()
    assert bounded.saturated == ("the bound of the position controller's output, 0.373 m/s",)
    fastest = [float(np.max(np.diff(path.motor_m))) / PERIOD_S for path in (free, bounded)]
    assert fastest[0] > 0.7
    assert fastest[1] == pytest.approx(30.0 * RATIO, rel=0.05)  # the velocity loop overshoots a little
    clamped = predict_move(model, cascade_for("g_b", model), move(), Loop(STRUCTURE, 1e-3, 0.3, COUNTS))
    assert clamped.saturated == ("the torque limit of 0.3 N m",)


def test_the_range_of_a_prediction_holds_what_friction_may_have_left_in_the_belt() -> None:
    """The truth begins with its belt stretched as far as friction holds it, either way, unseen by the motor's encoder."""
    trajectory = move()
    model = true_model(nominal("g_b"))
    cascade = cascade_for("g_b", model)
    held = 2.777778 / 222.39e3  # the carriage's friction over the stiffness; the motor's would hold 6.5 N

    def path(other: Model, stretch_m: float) -> PredictedMove:
        return predict_move(other, cascade, trajectory, Loop(STRUCTURE, 1e-3, 3.1, COUNTS), belt_stretch_m=stretch_m)

    def error(other: Model, stretch_m: float) -> TrackingError:
        return tracking_error(trajectory.t_s, trajectory.position_m, path(other, stretch_m).motor_m)

    spread = predict_range(model, error)
    assert spread is not None
    assert predict_range(model, error) == spread  # the draws are always the same
    low, high = spread
    for share in (-0.99, 0.99):
        plant = nominal("g_b")
        plant.place((0.0, -share * held, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
        motor, cart, *_ = own_loop(plant, cascade, trajectory, 1e-3)
        np.testing.assert_allclose(path(model, share * held).motor_m, motor, atol=0.4e-6)
        assert np.max(np.abs(path(model, 0.0).motor_m - motor)) > 3e-6
        seen = tracking_error(trajectory.t_s, trajectory.position_m, motor)
        assert 0.99 * low.dynamic_m < seen.dynamic_m < 1.01 * high.dynamic_m
        assert cart[0] == pytest.approx(-share * held)


def test_the_range_of_a_prediction_follows_the_intervals_of_the_model() -> None:
    """Without belt and intervals there is nothing unknown; with an interval the drawn values fill it and keep to the bounds."""
    rigid = build_model("rigid", ("viscous",), {"motor.inertia": 1e-3, "viscous.damping": 2e-3}, base_bodies=("motor",))
    seen: list[float] = []

    def error(other: Model, stretch_m: float) -> TrackingError:
        assert stretch_m == 0.0
        seen.append(other["viscous.damping"])
        return TrackingError(other["viscous.damping"], 0.0)

    none_open = predict_range(rigid, error)
    assert none_open is not None
    low, high = none_open
    assert low.dynamic_m == high.dynamic_m == 2e-3
    item = replace(rigid.parameters["viscous.damping"], interval=1e-3)
    seen.clear()
    unsure = replace(rigid, parameters={**rigid.parameters, "viscous.damping": item})
    spread = predict_range(unsure, error)
    assert spread is not None
    low, high = spread
    assert 1.96 * np.std(seen) == pytest.approx(1e-3, rel=0.5)
    assert low.dynamic_m < 1.7e-3
    assert high.dynamic_m > 2.3e-3
    assert min(seen) >= 0.0
    seen.clear()
    unknown = replace(item, interval=0.5 * (item.high - item.low))  # alone it says nothing, so it is not drawn alone
    predict_range(replace(rigid, parameters={**rigid.parameters, "viscous.damping": unknown}), error)
    assert set(seen) == {2e-3}


@pytest.mark.parametrize(
    ("share", "told", "problem"),
    [(0.4, True, ZeroDivisionError()), (0.8, False, ZeroDivisionError()), (0.4, True, UsageError("-1 N/m")), (0.4, True, Refused("nan m"))],
)
def test_draws_that_are_no_machine_leave_the_range_or_end_it(share: float, told: bool, problem: Exception) -> None:
    """A belt law that is hardly known holds nothing at the place of the move for some draws."""
    rigid = build_model("rigid", ("viscous",), {"motor.inertia": 1e-3, "viscous.damping": 2e-3}, base_bodies=("motor",))
    tried = iter(np.arange(RANGE_DRAWS) < share * RANGE_DRAWS)

    def error(other: Model, _stretch_m: float) -> TrackingError:
        if next(tried, False):  # the model itself comes after the draws
            raise problem
        return TrackingError(other["viscous.damping"], 0.0)

    assert (predict_range(rigid, error) is not None) == told


# ---- verdict


def test_what_is_predicted_lies_within_its_own_range() -> None:
    """Draws may all miss it, as where the error is smallest for the model itself."""
    model = true_model(nominal("g_a"))

    def error(other: Model, stretch_m: float) -> TrackingError:
        off = 0.0 if other is model and stretch_m == 0.0 else 1e-4
        return TrackingError(1e-4 + off, 1e-5)

    spread = predict_range(model, error)
    assert spread is not None
    assert (spread[0].dynamic_m, spread[1].dynamic_m) == (1e-4, 2e-4)


def test_setpoints_and_what_is_read_are_whole_counts() -> None:
    """A coarse encoder: the drive is sent counts and tells counts, so that an error of a move is a whole number of them."""
    model, trajectory, count_m = true_model(nominal("g_a")), move(), 2.0 * np.pi / 4096 * RATIO
    path = predict_move(model, cascade_for("g_a", model), trajectory, Loop(STRUCTURE, 1e-3, 3.1, 4096))
    for counted, exact in ((path.reference_m, trajectory.position_m), (path.read_m, path.motor_m)):
        assert np.max(np.abs(np.remainder((counted - counted[0]) / count_m + 0.5, 1.0) - 0.5)) < 1e-6
        assert np.max(np.abs(counted - exact)) == pytest.approx(0.5 * count_m, rel=0.02)
    assert path.error == tracking_error(path.t_s, path.reference_m, path.read_m)


def recorded(reference_m: Array, motor_m: Array, cart_m: Array | None = None) -> Recording:
    samples = len(reference_m)
    return Recording(
        name="move",
        t_s=PERIOD_S * np.arange(samples, dtype=np.float64),
        torque=np.random.default_rng(1).normal(0.0, 0.1, samples),
        position=3.0 + motor_m / RATIO,
        reference_position=3.0 + reference_m / RATIO,
        cart_position_m=cart_m,
        sidecar=Sidecar("trajectory"),
    )


def predicted(reference_m: Array, motor_m: Array, cart_m: Array) -> PredictedMove:
    return PredictedMove(PERIOD_S * np.arange(float(len(motor_m))), reference_m, motor_m, motor_m, cart_m, np.zeros_like(motor_m), 0.0)


def behind(reference: Array, dynamic_m: float, static_m: float) -> Array:
    """A motion that trails the ramp of 0.2 m by these errors."""
    return np.where((reference > 0.0) & (reference < 0.2), reference - dynamic_m, np.where(reference >= 0.2, 0.2 - static_m, 0.0))


def test_a_move_within_its_targets_passes_and_says_so() -> None:
    _, reference = ramp()
    measured, expected = (
        behind(reference, 0.5e-3, 40e-6),
        predicted(reference, behind(reference, 0.4e-3, 10e-6), behind(reference, 0.6e-3, 20e-6)),
    )
    verdict = judge(recorded(reference, measured), RATIO, expected)
    assert verdict.passed
    assert verdict.measured.dynamic_m == pytest.approx(0.5e-3, rel=1e-6)
    assert verdict.measured.static_m == pytest.approx(40e-6, rel=1e-6)
    assert verdict.predicted.dynamic_m == pytest.approx(0.4e-3)
    assert verdict.predicted_cart.dynamic_m == pytest.approx(0.6e-3)
    assert verdict.measured_cart is None
    first, second, third = verdict.reasons
    assert first == "following error at the motor: 0.5 mm, meets the target of 1 mm"
    assert second == "position error after 0.5 s at the motor: 0.04 mm, meets the target of 0.1 mm"
    assert "0.4 mm" in third
    assert "reaches" not in "".join(verdict.reasons)
    at_the_limit = judge(recorded(reference, measured), RATIO, replace(expected, saturated=("the torque limit of 1 N m",)))
    assert "the controller reaches the torque limit of 1 N m" in at_the_limit.reasons
    assert "25 % more" in third


@pytest.mark.parametrize(("dynamic", "static", "missed"), [(1.2e-3, 40e-6, 0), (0.5e-3, 140e-6, 1)])
def test_a_missed_target_fails_and_is_named(dynamic: float, static: float, missed: int) -> None:
    _, reference = ramp()
    same = behind(reference, dynamic, static)
    record, expected = recorded(reference, same), predicted(reference, same, same)
    verdict = judge(record, RATIO, expected)
    assert not verdict.passed
    assert ["misses" in reason for reason in verdict.reasons[:2]] == [missed == 0, missed == 1]
    assert judge(record, RATIO, expected, targets=AxisTargets(following_error_m=2e-3, settled_error_m=2e-4)).passed


def test_a_second_sensor_is_judged_from_where_it_started() -> None:
    """Its zero is its own: the first sample is taken to be on the reference."""
    _, reference = ramp()
    motor, cart = behind(reference, 0.1e-3, 10e-6), 0.137 + behind(reference, 0.7e-3, 60e-6)
    verdict = judge(recorded(reference, motor, cart), RATIO, predicted(reference, motor, motor))
    assert verdict.measured_cart is not None
    assert verdict.measured_cart.dynamic_m == pytest.approx(0.7e-3, rel=1e-6)
    assert verdict.measured_cart.static_m == pytest.approx(60e-6, rel=1e-6)


def test_a_record_without_reference_cannot_be_judged() -> None:
    _, reference = ramp()
    motor = behind(reference, 0.1e-3, 10e-6)
    bare = Recording("bare", PERIOD_S * np.arange(len(motor), dtype=np.float64), np.linspace(0.0, 1.0, len(motor)), motor / RATIO)
    with pytest.raises(DataError, match="'bare' has no reference_position_rad"):
        judge(bare, RATIO, predicted(reference, motor, motor))


@pytest.mark.parametrize(("chosen", "helps", "slower"), [(True, True, True), (True, False, False), (False, True, False)])
def test_a_move_that_friction_may_hold_beside_its_target_is_driven_slower(
    chosen: bool, helps: bool, slower: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only one whose limits nobody stated, and only where it helps: a flywheel on its coupling stuck 0.064 of 0.05 degrees beside it."""
    limits = TrajectoryLimits(jerk_m_s3=200.0, acceleration_m_s2=5.0, speed_m_s=1.0)
    standard = verification.StandardMove(0.0, 0.5, limits, "", chosen=chosen)
    whole = standard.at(1.0, PERIOD_S)
    own = SimpleNamespace(sample_period_s=PERIOD_S)
    machine: Any = SimpleNamespace(drive=SimpleNamespace(capabilities=own), axis=SimpleNamespace(targets=AxisTargets()))
    monkeypatch.setattr(verification, "_rests_m", lambda *of: 2e-4 * (whole.duration_s / of[-1].duration_s) ** (2 if helps else 0))
    monkeypatch.setattr(verification, "uses_led_reference", lambda *_: False)
    found = verification._settling(machine, None, None, 0.0, standard)  # type: ignore[arg-type]
    assert (found.at(1.0, PERIOD_S).duration_s > whole.duration_s) == slower
    assert ("friction may hold it 0.2 mm off after 0.5 s" in found.remark) == slower
