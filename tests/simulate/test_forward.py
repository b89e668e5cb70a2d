"""Forward simulation against closed forms, energy, an independent integrator, and the inverse; exact steps have tests of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model, build_model
from beltcomm.model.statics import equilibrium
from beltcomm.simulate.forward import BodyStates, integrate_torque, simulate_torque
from beltcomm.simulate.inverse import FineMotion, fine_load

IT, INERTIA, MASS, C, D = 0.01242, 71.73e-6, 13.44, 203740.0, 20.0
RIG = ("belt_sections", "coupling", "belt_damping", "viscous", "viscous_cart", "viscous_end_pulley",
       "coulomb", "cart_friction", "coulomb_end_pulley", "tilt")  # fmt: skip
NO_FRICTION = {"coulomb.level": 0.0, "cart_friction.level": 0.0, "coulomb_end_pulley.level": 0.0}


def axis(**values: float) -> Model:
    """The two-mass axis of table A.4 without friction; own values by ``effect__parameter``."""
    numbers = {
        "motor.inertia": INERTIA, "cart.mass": MASS, "transmission.ratio": IT, "belt_stiffness.stiffness": C,
        "belt_damping.damping": D, "viscous.damping": 0.0, "coulomb.level": 0.0, "cart_friction.level": 0.0,
    }  # fmt: skip
    effects = ("belt_stiffness", "belt_damping", "viscous", "coulomb", "cart_friction")
    return build_model("axis", effects, numbers | {name.replace("__", "."): value for name, value in values.items()})


def motor(coulomb: float) -> Model:
    """One inertia with Coulomb friction."""
    values = {"motor.inertia": 1e-3, "coulomb.level": coulomb}
    return build_model("motor", ("coulomb",), values, base_bodies=("motor",))


def test_free_oscillation_has_its_frequency_and_decay() -> None:
    """s(t) = s_0 e^{-ζωt} (cos ω_d t + ζ/√(1-ζ²) sin ω_d t) between two free masses; their common centre rests.

    The Verlet step is wrong in frequency by ω²h²/24, so by s_0 ω³h²t/24 at time t.
    """
    reduced = 1.0 / (IT**2 / INERTIA + 1.0 / MASS)
    omega, zeta = math.sqrt(C / reduced), D / (2.0 * math.sqrt(C * reduced))
    stretch, period, substeps = 1e-3, 1e-3, 100
    start = BodyStates(np.array([stretch / IT, 0.0]), np.zeros(2))
    out = integrate_torque(axis(), np.zeros(100), period, substeps=substeps, state=start)
    t, damped = out.t_s, omega * math.sqrt(1.0 - zeta**2)
    wave = np.cos(damped * t) + zeta / math.sqrt(1.0 - zeta**2) * np.sin(damped * t)
    expected = stretch * np.exp(-zeta * omega * t) * wave
    bound = stretch * omega**3 * (period / substeps) ** 2 * t[-1] / 24.0
    np.testing.assert_allclose(IT * out.position_rad - out.cart_position_m, expected, atol=bound)
    assert bound < 1e-3 * stretch
    centre = INERTIA / IT * out.position_rad + MASS * out.cart_position_m
    np.testing.assert_allclose(centre, centre[0], rtol=1e-12)


def test_coulomb_friction_stops_after_its_distance_and_holds() -> None:
    """θ = J ω²/(2 τ_c) after t = J ω/τ_c; then nothing moves at all."""
    inertia, speed, level = 1e-3, 30.0, 0.4
    start = BodyStates(np.array([5.0]), np.array([speed]))
    out = integrate_torque(motor(level), np.zeros(200), 1e-3, state=start)
    stop = inertia * speed / level
    step = 1e-3 / 20
    assert out.position_rad[-1] - 5.0 == pytest.approx(inertia * speed**2 / (2 * level), abs=level / inertia * step**2)
    after = out.t_s > stop + step
    assert not out.velocity_rad_s[after].any()
    assert np.ptp(out.position_rad[after]) == 0.0
    before = out.t_s < stop - step
    np.testing.assert_allclose(out.velocity_rad_s[before], speed - level / inertia * out.t_s[before], rtol=1e-9)


def test_stiction_holds_below_the_level_and_lets_go_above() -> None:
    """ω = (τ - τ_c) t/J above the level."""
    held = simulate_torque(motor(0.4), np.full(500, -0.399), 1e-3)
    assert not held.position_rad.any()
    assert not held.velocity_rad_s.any()
    moving = simulate_torque(motor(0.4), np.full(500, -0.41), 1e-3)
    np.testing.assert_allclose(moving.velocity_rad_s, -0.01 / 1e-3 * moving.t_s, rtol=1e-9, atol=1e-12)


def test_friction_of_the_cart_hides_its_position_from_the_motor() -> None:
    """A stuck cart: the motor rests where the belt carries the torque, θ = τ/(i_t² c)."""
    model = axis(cart_friction__level=100.0, belt_damping__damping=100.0, viscous__damping=0.01)
    out = simulate_torque(model, np.full(2000, 0.5), 1e-3)
    assert not out.cart_position_m.any()
    assert out.position_rad[-1] == pytest.approx(0.5 / (IT**2 * C), rel=1e-9)
    assert out.belt_force_n[-1] == pytest.approx(0.5 / IT, rel=1e-9)
    assert out.belt_force_n.max() > 1.2 * out.belt_force_n[-1], "the largest force is that of the overshoot"


def test_belt_force_is_the_largest_within_the_interval() -> None:
    """Against the same record with every sub-step as a sample of its own."""
    model, torque = axis(), 0.4 * np.sign(np.sin(np.arange(100) / 5.0))
    coarse = simulate_torque(model, torque, 1e-3, substeps=20)
    fine = simulate_torque(model, np.repeat(torque, 20), 1e-3 / 20, substeps=1)
    largest = fine.belt_force_n.reshape(100, 20).max(axis=1)
    np.testing.assert_allclose(coarse.belt_force_n, largest, rtol=1e-9)
    assert np.any(largest > 1.05 * fine.belt_force_n[19::20]), "some peak must lie inside its interval"


def test_energy_stays_without_losses() -> None:
    """Symplectic: the energy swings by at most (ω h)²/4 of itself and does not drift over 1300 oscillations."""
    stretch, period, substeps = 1e-3, 1e-3, 20
    start = BodyStates(np.array([stretch / IT, 0.0]), np.zeros(2))
    out = integrate_torque(axis(belt_damping__damping=0.0), np.zeros(12_000), period, substeps=substeps, state=start)
    cart_speed = -INERTIA / (IT * MASS) * out.velocity_rad_s  # the momentum of both is zero
    spring = 0.5 * C * (IT * out.position_rad - out.cart_position_m) ** 2
    energy = spring + 0.5 * INERTIA * out.velocity_rad_s**2 + 0.5 * MASS * cart_speed**2
    omega = math.sqrt(C * (IT**2 / INERTIA + 1.0 / MASS))
    swing = (omega * period / substeps) ** 2 / 4.0
    assert np.max(np.abs(energy / energy[0] - 1.0)) < 1.01 * swing
    assert np.mean(energy[-1000:]) == pytest.approx(np.mean(energy[:1000]), rel=0.02 * swing)


def test_torque_work_is_motion_heat_and_nothing_else() -> None:
    """∫ τ ω dt = kinetic energy + friction work, for one inertia sliding in one direction."""
    torque = 0.6 + 0.1 * np.sin(np.arange(800) / 30.0)
    out = simulate_torque(motor(0.4), torque, 1e-3)
    end_position, end_speed = out.end.positions[0], out.end.speeds[0]
    position = np.append(out.position_rad, end_position)
    work = np.sum(torque * np.diff(position))
    assert work == pytest.approx(0.5 * 1e-3 * end_speed**2 + 0.4 * end_position, rel=1e-9)


def test_second_order_against_an_independent_integrator() -> None:
    """Full rig, sliding all the time: the error falls fourfold when the step is halved."""
    p = {"motor.inertia": 46.5e-6, "driving_pulley.inertia": 25.23e-6, "cart.mass": 11.57, "end_pulley.mass": 0.153,
         "transmission.ratio": IT, "belt_sections.specific_stiffness": 106250.0, "belt_sections.specific_damping": 7.17,
         "belt_sections.pulley_distance": 0.79, "belt_sections.offset": 0.05, "coupling.stiffness": 168.75,
         "coupling.damping": 1e-3, "viscous.damping": 2.5e-3, "viscous_cart.damping": 9.0,
         "coulomb.level": 0.0875, "cart_friction.level": 3.0, "coulomb_end_pulley.level": 0.8,
         "viscous_end_pulley.damping": 1.3, "belt_damping.damping": 4.0, "tilt.angle": 0.2}  # fmt: skip
    model = build_model("rig", RIG, p)
    torque, period = np.array([0.9, 0.2, 1.1, 0.7, 0.3, 0.8, 1.0, 0.1]), 1e-3
    start = BodyStates(np.array([0.2 / IT, 0.2, 0.2, 0.2 / IT]), np.array([40.0, 40.0 * IT, 40.0 * IT, 40.0]))

    def derivative(_: float, y: np.ndarray, held: float) -> list[float]:
        # Newton's law for each body, written from (2.11) to (2.14) with the coupling in front of the driving pulley.
        motor, cart, end, pulley, wm, vc, ve, wp = y
        ea, da, l1 = 106250.0, 7.17, 0.05 + cart
        l2, l3 = 0.79 - l1, 0.79
        twist = 168.75 * (motor - pulley) + 1e-3 * (wm - wp)
        front = (ea * (IT * pulley - cart) + da * (IT * wp - vc)) / l1 + 4.0 * (IT * wp - vc)
        back = (ea * (end - cart) + da * (ve - vc)) / l2
        span = (ea * (IT * pulley - end) + da * (IT * wp - ve)) / l3
        return [
            wm, vc, ve, wp,
            (held - twist - 2.5e-3 * wm - 0.0875) / 46.5e-6,
            (front + back - 9.0 * vc - 3.0 - 11.57 * 9.80665 * math.sin(0.2)) / 11.57,
            (span - back - 1.3 * ve - 0.8) / 0.153,
            (twist - IT * front - IT * span) / 25.23e-6,
        ]  # fmt: skip

    y = np.concatenate([start.positions, start.speeds])
    for held in torque:
        y = solve_ivp(derivative, (0.0, period), y, method="DOP853", args=(held,), rtol=1e-12, atol=1e-14).y[:, -1]
    assert min(y[4:]) > 0.0, "the case must slide throughout"
    scale = np.concatenate([np.abs(y[:4] - start.positions), np.abs(y[4:])])
    errors = []
    for substeps in (20, 40, 80, 160):
        end = integrate_torque(model, torque, period, substeps=substeps, state=start).end
        errors.append(np.max(np.abs(np.concatenate([end.positions, end.speeds]) - y) / scale))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert errors[-1] < 1e-3
    assert np.all((ratios > 3.7) & (ratios < 4.3)), ratios


def test_friction_through_reversals_converges_to_the_independent_integrator() -> None:
    """Two masses swinging through rest with Coulomb friction at the motor; the reference finds each reversal as an event.

    Reversals cost nothing beyond the Verlet step's phase error: below A ω³h²t/24, and a quarter for half the step.
    """
    model = axis(coulomb__level=0.05, belt_damping__damping=0.0)
    start = BodyStates(np.array([2e-3 / IT, 0.0]), np.zeros(2))
    end_time = 0.02

    def derivative(_: float, y: np.ndarray, direction: float) -> list[float]:
        force = C * (IT * y[0] - y[1])
        return [y[2], y[3], (-IT * force - direction * 0.05) / INERTIA, force / MASS]

    def reversal(_: float, y: np.ndarray, direction: float) -> float:
        return direction * y[2]

    reversal.terminal, reversal.direction = True, -1.0  # type: ignore[attr-defined]
    t, y, direction, reversals = 0.0, np.array([2e-3 / IT, 0.0, 0.0, 0.0]), -1.0, 0
    while t < end_time:
        solution = solve_ivp(derivative, (t, end_time), y, method="DOP853", args=(direction,), events=reversal, rtol=1e-11, atol=1e-13)
        t, y = float(solution.t[-1]), solution.y[:, -1]
        if solution.status == 1:
            direction, reversals = -direction, reversals + 1
            y[2] = math.copysign(1e-12, direction)  # the belt force is far above the friction at each reversal of this case
    assert reversals >= 3
    omega = math.sqrt(C * (IT**2 / INERTIA + 1.0 / MASS))
    errors = []
    for substeps in (20, 40, 80, 160):
        end = integrate_torque(model, np.zeros(20), 1e-3, substeps=substeps, state=start).end
        errors.append(abs(end.positions[0] - y[0]))
        assert errors[-1] < 2e-3 / IT * omega**3 * (1e-3 / substeps) ** 2 * end_time / 24.0
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all((ratios > 3.7) & (ratios < 4.3)), ratios


def test_a_record_can_be_continued() -> None:
    torque = 0.3 * np.sign(np.sin(np.arange(400) / 7.0))
    model = axis(coulomb__level=0.0875, cart_friction__level=3.0, viscous__damping=2.5e-3)
    whole = simulate_torque(model, torque, 1e-3, position_m=0.2)
    first = simulate_torque(model, torque[:150], 1e-3, position_m=0.2)
    second = simulate_torque(model, torque[150:], 1e-3, time_s=0.15, state=first.end)
    for name in ("position_rad", "velocity_rad_s", "cart_position_m", "belt_force_n"):
        np.testing.assert_array_equal(np.concatenate([getattr(first, name), getattr(second, name)]), getattr(whole, name))
    assert second.t_s[0] == 0.15


def test_same_input_same_bytes() -> None:
    torque = np.random.default_rng(7).normal(0.0, 0.3, 500)
    model = axis(coulomb__level=0.0875, cart_friction__level=3.0)
    first, second = (simulate_torque(model, torque, 1e-3) for _ in range(2))
    assert first.position_rad.tobytes() == second.position_rad.tobytes()
    assert first.belt_force_n.tobytes() == second.belt_force_n.tobytes()


def test_starts_in_equilibrium_where_it_is_told() -> None:
    model = build_model("rig", RIG, {"tilt.angle": 0.5, **NO_FRICTION})
    torque = equilibrium(model, 0.3).torque_nm
    out = simulate_torque(model, np.full(300, torque), 1e-3, position_m=0.3)
    np.testing.assert_allclose(out.cart_position_m, 0.3, rtol=1e-9)
    assert np.max(np.abs(out.velocity_rad_s)) < 1e-6


@pytest.mark.parametrize("friction", [0.0, 1.0], ids=["smooth", "with Coulomb friction"])
def test_inverse_of_the_simulated_motion_is_its_torque(friction: float) -> None:
    """load = torque - J ω'.  The inverse gives the load at a step's beginning, the motion its mean over the step: half a step.

    Below 0.2 rad/s nothing is compared: where the motor sticks, the friction is anything between its two levels.
    """
    model = axis(viscous__damping=2.5e-3, coulomb__level=0.0875 * friction, cart_friction__level=3.0 * friction)
    held = np.repeat([0.5, 0.9, 0.3, 0.8, 0.6], 40)
    errors = []
    for substeps in (20, 40, 80):
        h = 1e-3 / substeps
        torque = np.repeat(held, substeps)
        out = integrate_torque(model, torque, h, substeps=1)
        load, cart = fine_load(model, FineMotion(out.position_rad, out.velocity_rad_s, len(held) + 1, 1e-3, substeps, 0.0, 1e-9))
        speed = np.append(out.velocity_rad_s, out.end.speeds[0])
        expected = torque - INERTIA * np.diff(speed) / h
        moving = np.minimum(np.abs(speed[:-1]), np.abs(speed[1:])) > 0.2
        change = np.max(np.abs(np.diff(expected))[moving[1:]])
        error = np.max(np.abs(load - expected)[moving])
        assert error < 0.51 * change
        assert np.mean(moving) > 0.9
        np.testing.assert_allclose(cart, out.cart_position_m, atol=2.0 * h * np.max(np.abs(out.velocity_rad_s)) * IT)
        errors.append(error)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.05)


def test_too_coarse_steps_are_refused_with_the_number_needed() -> None:
    with pytest.raises(UsageError, match=r"1 sub-steps in 1 ms are too few for model 'axis'; use 2 or more"):
        integrate_torque(axis(), np.zeros(3), 1e-3, substeps=1)
    with pytest.raises(UsageError, match="period above 0 s"):
        integrate_torque(axis(), np.zeros(3), 0.0)


@pytest.mark.parametrize("torque", [np.zeros((2, 2)), [0.0, math.nan]])
def test_a_torque_that_is_not_a_row_of_numbers_is_refused(torque: np.ndarray) -> None:
    with pytest.raises(UsageError, match="one row of finite numbers"):
        simulate_torque(axis(), torque, 1e-3)


def test_leaving_the_travel_of_the_model_is_refused() -> None:
    model = build_model("rig", RIG, NO_FRICTION)
    with pytest.raises(Refused, match=r"ran to -.* m, where model 'rig' has no belt"):
        simulate_torque(model, np.full(300, -3.0), 1e-3, position_m=0.05)
    with pytest.raises(UsageError, match=r"cannot start at -0.2 m"):
        simulate_torque(model, np.zeros(3), 1e-3, position_m=-0.2)
