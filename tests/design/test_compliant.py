"""A motor that leads the carriage by the stretch of the belt, against the equations of motion solved by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, Feedforward, cascade_step, discrete_coefficients, feedforward_torque, new_state, reset_state
from beltcomm.design.compliant import _centred_mean, _compliance, lead_motion, torque_along, with_rest_before
from beltcomm.errors import UsageError
from beltcomm.model import Model, build_model
from beltcomm.trajectory import Trajectory, plan_trajectory

PERIOD_S = 1e-3
RATIO, INERTIA, MASS, STIFFNESS, DAMPING = 0.01242, 71.73e-6, 13.44, 203.7e3, 20.0
VISCOUS, CART_VISCOUS, COULOMB, CART_COULOMB = 2.53e-3, 5.0, 0.08, 3.0
VALUES = {
    "transmission.ratio": RATIO,
    "motor.inertia": INERTIA,
    "cart.mass": MASS,
    "belt_stiffness.stiffness": STIFFNESS,
    "belt_damping.damping": DAMPING,
    "viscous.damping": VISCOUS,
    "viscous_cart.damping": CART_VISCOUS,
}
#: s: the move with 40 m/s³; standard deviation of two means over 5 samples each.   m: a step of the jerk j, blurred so, leaves the carriage
#: the speed j σ²/2 for as long as half the move, before the next one takes it back.
MOVE_S = 0.737
SMOOTHED_S = PERIOD_S * np.sqrt(2.0 * (5**2 - 1) / 12.0)
BLURRED_M = 0.5 * 40.0 * SMOOTHED_S**2 * 0.5 * MOVE_S


def model(**more: float) -> Model:
    effects = ["belt_stiffness", "belt_damping", "viscous", "viscous_cart"]
    effects += [name.split(".")[0] for name in more if name.split(".")[0] not in effects]
    return build_model("axis", tuple(effects), VALUES | more)


def move(jerk: float = 40.0) -> Trajectory:
    path = plan_trajectory(0.0, 0.5, TrajectoryLimits(jerk, 45.0, 5.0), PERIOD_S)
    still = np.zeros(200)
    return Trajectory(
        PERIOD_S * np.arange(len(path.t_s) + 200),
        np.concatenate((path.position_m, np.full(200, path.position_m[-1]))),
        np.concatenate((path.velocity_m_s, still)),
        np.concatenate((path.acceleration_m_s2, still)),
    )


def driven(torque: np.ndarray, t_s: np.ndarray, coulomb: float = 0.0, cart_coulomb: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Motor, m along the belt, and carriage, m, under a torque that varies linearly between the samples; no loop is closed."""

    def rates(t: float, state: np.ndarray) -> list[float]:
        motor, cart, motor_speed, cart_speed = state
        pull = STIFFNESS * (motor - cart) + DAMPING * (motor_speed - cart_speed)
        push = float(np.interp(t, t_s, torque)) - VISCOUS * motor_speed / RATIO - RATIO * pull - coulomb * np.tanh(motor_speed / 1e-4)
        drag = CART_VISCOUS * cart_speed + cart_coulomb * np.tanh(cart_speed / 1e-4)
        return [motor_speed, cart_speed, RATIO * push / INERTIA, (pull - drag) / MASS]

    found = solve_ivp(rates, (0.0, float(t_s[-1])), [0.0] * 4, t_eval=t_s, method="LSODA", rtol=1e-8, atol=1e-10, max_step=1e-3)
    return found.y[0], found.y[1]


def test_the_torque_alone_brings_the_carriage_along_its_reference() -> None:
    """Open loop, no friction that sticks: what remains is the smoothing."""
    led = lead_motion(model(), move())
    motor, cart = driven(led.torque_nm, led.trajectory.t_s)
    stretch = MASS * 7.3 / STIFFNESS
    assert led.lead_m == pytest.approx(stretch, rel=0.05)
    assert np.max(np.abs(cart - led.carriage.position_m)) < BLURRED_M
    assert np.max(np.abs(motor - led.trajectory.position_m)) < BLURRED_M
    rigid = (INERTIA / RATIO + RATIO * MASS) * led.carriage.acceleration_m_s2
    rigid = rigid + (VISCOUS / RATIO + RATIO * CART_VISCOUS) * led.carriage.velocity_m_s
    motor, cart = driven(rigid, led.trajectory.t_s)
    assert np.max(np.abs(motor - led.carriage.position_m)) > 0.2 * stretch, "a rigid feedforward leaves much of the stretch to the loop"


def test_friction_of_both_bodies_has_its_own_place() -> None:
    sticking = model(**{"coulomb.level": COULOMB, "cart_friction.level": CART_COULOMB})
    led = lead_motion(sticking, move())
    _, cart = driven(led.torque_nm, led.trajectory.t_s, COULOMB, CART_COULOMB)
    assert led.held_m == pytest.approx(CART_COULOMB / STIFFNESS, rel=1e-9)
    assert led.trajectory.position_m[-1] - led.carriage.position_m[-1] == pytest.approx(led.held_m, rel=1e-9)
    # At the start the carriage rests while the smoothed pull grows, and misses F_c σ/√(2π) of momentum from then on.
    missed_m_s = CART_COULOMB * SMOOTHED_S / np.sqrt(2.0 * np.pi) / MASS
    assert np.max(np.abs(cart - led.carriage.position_m)) < BLURRED_M + MOVE_S * missed_m_s
    on_motor = lead_motion(sticking, move(), friction=False)
    assert on_motor.held_m == 0.0
    middle = len(led.torque_nm) // 4  # under way, all friction acts wherever it is thought to be
    assert on_motor.torque_nm[middle] == pytest.approx(led.torque_nm[middle], rel=1e-3)


def test_at_a_reversal_the_stretch_by_friction_changes_its_side_where_the_carriage_turns() -> None:
    """0 to 0.2 m and back without a rest: at the turn the carriage's own law is smooth, so all that jumps is 2 F_c/c."""
    t_s = PERIOD_S * np.arange(1201)
    angle = 2.0 * np.pi * t_s / 1.2
    there_and_back = Trajectory(
        t_s,
        0.1 * (1.0 - np.cos(angle)),
        0.1 * (2.0 * np.pi / 1.2) * np.sin(angle),
        0.1 * (2.0 * np.pi / 1.2) ** 2 * np.cos(angle),
    )
    with_friction, without = (lead_motion(model(**{"cart_friction.level": level}), there_and_back) for level in (CART_COULOMB, 0.0))
    extra = with_friction.trajectory.position_m - without.trajectory.position_m
    turn = len(extra) - len(t_s) + 600
    assert extra[turn - 20] == pytest.approx(CART_COULOMB / STIFFNESS, rel=1e-6)
    assert extra[turn + 20] == pytest.approx(-CART_COULOMB / STIFFNESS, rel=1e-6)
    # The turn falls on a sample, which still counts as before it; two means over 5 samples go from one side to the other with 2/5 a sample.
    assert abs(extra[turn]) < 0.4 * CART_COULOMB / STIFFNESS
    assert with_friction.held_m == pytest.approx(CART_COULOMB / STIFFNESS)
    assert extra[-1] == pytest.approx(-CART_COULOMB / STIFFNESS, rel=1e-6), "at rest it stays as it was in the motion before"


def test_what_is_sent_along_and_the_drives_own_feedforward_make_the_whole_torque() -> None:
    feedforward = Feedforward(2.1e-3, 3e-3, 0.12, 0.05, 1.0, 1.5e-3)
    led = lead_motion(model(), move(), feedforward.advance_s)
    along = torque_along(led, feedforward, RATIO)
    own = feedforward_torque(feedforward, led.trajectory.velocity_m_s / RATIO, PERIOD_S)
    ahead = np.interp(led.trajectory.t_s + 1.5e-3, led.trajectory.t_s, led.torque_nm)
    np.testing.assert_allclose(along + own, ahead, atol=1e-12)


@pytest.mark.parametrize("advance_s", [0.0, 1.5e-3])
def test_the_drives_own_feedforward_is_that_of_the_compiled_step(advance_s: float) -> None:
    feedforward = Feedforward(2.1e-3, 3e-3, 0.12, 0.05, 1.0, advance_s)
    velocity = np.concatenate(([0.0], np.cumsum(np.random.default_rng(4).standard_normal(60))))
    coefficients = discrete_coefficients(Cascade(0.0, 0.0, 0.0, 2e-3, feedforward=feedforward), PERIOD_S, 100.0)
    state, before, stepped = new_state(), 0.0, []
    reset_state(state, 0.0)
    for value in velocity:
        stepped.append(cascade_step(coefficients, state, 0.0, float(value), (float(value) - before) / PERIOD_S, 0.0, 0.0))
        before = float(value)
    np.testing.assert_allclose(feedforward_torque(feedforward, velocity, PERIOD_S), stepped, atol=1e-12)


def test_gravity_stretches_the_belt_all_the_time() -> None:
    led = lead_motion(model(**{"tilt.angle": 0.3}), move())
    weight = MASS * 9.80665 * np.sin(0.3)
    assert led.trajectory.position_m[0] - led.carriage.position_m[0] == pytest.approx(weight / STIFFNESS, rel=1e-3)
    assert led.torque_nm[0] == pytest.approx(RATIO * weight, rel=1e-3)


def test_the_compliance_is_that_of_all_springs_between_motor_and_carriage() -> None:
    assert _compliance(model(), np.array([0.1, 0.3])) == pytest.approx(1.0 / STIFFNESS)
    coupled = model(**{"coupling.stiffness": 168.75})
    expected = 1.0 / STIFFNESS + RATIO**2 / 168.75
    assert _compliance(coupled, np.array([0.2])) == pytest.approx(expected, rel=1e-9)


def test_an_axis_without_a_belt_has_nothing_to_lead() -> None:
    rigid = build_model("motor", ("viscous", "coulomb"), {"transmission.ratio": RATIO, "motor.inertia": 2e-3}, base_bodies=("motor",))
    with pytest.raises(UsageError, match="no belt that could stretch"):
        lead_motion(rigid, move())


def test_smoothing_keeps_the_mean_and_the_ends_and_rest_stands_before_the_motion() -> None:
    values = np.concatenate((np.zeros(20), np.ones(20)))
    assert np.sum(_centred_mean(values, 5)) == pytest.approx(20.0)
    assert _centred_mean(values, 5)[[0, -1]] == pytest.approx([0.0, 1.0])
    path = with_rest_before(move(), 7)
    assert np.all(path.position_m[:8] == 0.0)
    assert path.position_m[8:] == pytest.approx(move().position_m[1:])
    assert path.sample_period_s == pytest.approx(PERIOD_S)
