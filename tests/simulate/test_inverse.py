"""From measured motion to needed torque: against convolution, closed forms, and the truth simulator between its samples."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from beltcomm.model import Model, build_model
from beltcomm.simulate.inverse import (
    BRISTLE_M,
    FineMotion,
    _load_torque,
    acting_cells,
    coarse,
    fine_load,
    reconstruct,
    torque_residuals,
    triangular_mean,
)
from truth import Axis, ConstantBelt, TruthPlant

Array = NDArray[np.float64]

T, SUB = 1e-3, 16
LEVER, INERTIA, MASS, STIFFNESS = 0.01242, 71.73e-6, 0.96, 222390.0


def axis(**values: float) -> Model:
    """Rig G_B without friction; own values by ``effect__parameter``."""
    numbers = {
        "motor.inertia": INERTIA, "cart.mass": MASS, "transmission.ratio": LEVER, "belt_stiffness.stiffness": STIFFNESS,
        "belt_damping.damping": 20.0, "viscous.damping": 0.0, "coulomb.level": 0.0, "cart_friction.level": 0.0,
    }  # fmt: skip
    effects = ("belt_stiffness", "belt_damping", "viscous", "coulomb", "cart_friction")
    return build_model("axis", effects, numbers | {name.replace("__", "."): value for name, value in values.items()})


def held_motion(torque: Array, inertia: float, substeps: int = SUB) -> tuple[Array, Array]:
    """Angle and speed of a free inertia under a held torque, exact at every fine step; one sample more than torques."""
    acceleration = np.repeat(torque / inertia, substeps)
    h = T / substeps
    speed = np.concatenate(([1.5], 1.5 + h * np.cumsum(acceleration)))
    angle = np.concatenate(([0.0], np.cumsum(h * speed[:-1] + 0.5 * h * h * acceleration)))
    return angle, speed


@pytest.mark.parametrize("substeps", [2, 4, 16])
def test_triangular_mean_is_a_convolution_with_simpsons_weights(substeps: int) -> None:
    fine = np.random.default_rng(1).normal(size=40 * substeps + 1)
    rising = np.arange(substeps + 1) / substeps
    half = rising * np.array([simpson(row, dx=1.0 / substeps) for row in np.eye(substeps + 1)])
    weight = np.concatenate([half[:-1], [2.0 * half[-1]], half[-2::-1]])
    mean = triangular_mean(fine, substeps)
    whole = np.convolve(fine, weight, mode="same")[::substeps]
    np.testing.assert_allclose(mean[1:-1], whole[1:-1], rtol=1e-12, atol=1e-14)
    assert mean[0] == mean[-1] == 0.0


@pytest.mark.parametrize("substeps", [2, 16])
@pytest.mark.parametrize("freq_hz", [19.6, 134.0, 400.0])
def test_triangular_mean_of_a_second_derivative_is_the_second_difference(substeps: int, freq_hz: float) -> None:
    """<d²cos(ωt)/dt²> = -ω² sinc²(ωT/2) cos(ωt); Simpson's rule over both halves is wrong by 2/(180 m⁴) max|d⁴(weight cos)|."""
    omega, t = 2.0 * np.pi * freq_hz, T / substeps * np.arange(60 * substeps + 1)
    mean = triangular_mean(-(omega**2) * np.cos(omega * t), substeps)
    second_difference = np.diff(np.cos(omega * t[::substeps]), 2) / T**2
    bound = omega**2 * ((omega * T) ** 4 + 4.0 * (omega * T) ** 3) / (90.0 * substeps**4)
    np.testing.assert_allclose(mean[1:-1], second_difference, atol=bound + 1e-6)


def test_reconstruction_of_parabolas_is_exact() -> None:
    torque = np.random.default_rng(2).normal(0.0, 0.5, 200)
    angle, speed = held_motion(torque, INERTIA)
    motion = reconstruct(angle[::SUB], np.append(torque, 0.0), T, INERTIA, start_rad=7.0, substeps=SUB, time_s=3.0)
    np.testing.assert_allclose(motion.theta, 7.0 + angle, atol=1e-12 * np.ptp(angle))
    np.testing.assert_allclose(motion.omega, speed, atol=1e-10 * np.ptp(speed))
    assert (motion.samples, motion.substeps, motion.sample_s, motion.time_s) == (201, SUB, T, 3.0)


def test_reconstruction_between_the_samples_of_the_truth() -> None:
    """Two masses without friction and damper: θ'' less the held torque is -rF/J, whose second derivative is bounded.

    So the bounds of Hall and Meyer (J. Approx. Theory 16, 1976) for cubic splines hold:
    |error| <= 5/384 T⁴ max|θ''''|,  |error of the speed| <= 1/24 T³ max|θ''''|, here with θ'''' from the belt force of the truth.
    """
    plant = TruthPlant(Axis(INERTIA, MASS, LEVER, ConstantBelt(STIFFNESS)), longest_substep_s=1e-6)
    torque = 0.3 * np.sign(np.random.default_rng(3).normal(size=300))
    theta, omega, belt = [plant.position_rad], [plant.velocity_rad_s], [plant.belt_force_n]
    for value in torque.tolist():
        for _ in range(SUB):
            plant.step(value, T / SUB)
            theta.append(plant.position_rad)
            omega.append(plant.velocity_rad_s)
            belt.append(plant.belt_force_n)
    fourth = float(np.max(np.abs(np.diff(belt, 2)))) / (T / SUB) ** 2 * LEVER / INERTIA
    motion = reconstruct(np.array(theta[::SUB]), np.append(torque, 0.0), T, INERTIA, start_rad=0.0, substeps=SUB)
    inner = slice(10 * SUB, -10 * SUB)  # the natural ends of the spline are forgotten by 0.27 per sample
    wrong = np.max(np.abs(motion.theta - theta)[inner])
    assert 0.0 < wrong <= 5.0 / 384.0 * T**4 * fourth
    assert np.max(np.abs(motion.omega - omega)[inner]) <= T**3 * fourth / 24.0
    plain = CubicSpline(np.arange(301), theta[::SUB])(np.arange(len(theta)) / SUB)
    assert wrong < 0.2 * np.max(np.abs(plain - theta)[inner]), "the parabolas must pay"


def test_known_load_keeps_a_reversal_out_of_its_neighbours() -> None:
    """Friction that reverses within a sample bends the angle by a kink no spline follows; with the model's load it does."""
    motor, cart = 0.0805, 2.78
    plant = TruthPlant(Axis(INERTIA, MASS, LEVER, ConstantBelt(STIFFNESS, 20.0), coulomb_motor_nm=motor, coulomb_cart_n=cart))
    model = axis(coulomb__level=motor, cart_friction__level=cart)
    torque = 0.3 * np.sign(np.random.default_rng(5).normal(size=800))
    theta = [plant.position_rad]
    for value in torque.tolist():
        for _ in range(SUB):
            plant.step(value, T / SUB)
            theta.append(plant.position_rad)
    sampled, given = np.array(theta[::SUB]), np.append(torque, 0.0)
    first = reconstruct(sampled, given, T, INERTIA, start_rad=0.0, substeps=SUB)
    load, _ = fine_load(model, first)
    second = reconstruct(sampled, given, T, INERTIA, start_rad=0.0, substeps=SUB, load=load)
    error = np.array([np.sqrt(np.mean((m.theta - theta) ** 2)) for m in (first, second)])
    assert error[1] < 0.5 * error[0]


def test_a_free_inertia_leaves_no_torque_over() -> None:
    torque = np.random.default_rng(4).normal(0.0, 0.5, 500)
    angle, _ = held_motion(torque, INERTIA, substeps=1)
    motion = reconstruct(angle, np.append(torque, 0.0), T, INERTIA, start_rad=float(angle[0]), substeps=SUB)
    free = build_model("free", (), {"motor.inertia": INERTIA}, base_bodies=("motor",))
    left = torque_residuals(free, motion, np.append(torque, 0.0), [free.vector()], [0.0])[0]
    rounding = INERTIA * 4.0 * np.finfo(float).eps * np.max(np.abs(angle)) / T**2
    np.testing.assert_allclose(left, 0.0, atol=4.0 * rounding)
    heavier = free.with_values({"motor.inertia": 1.01 * INERTIA})
    wrong = torque_residuals(heavier, motion, np.append(torque, 0.0), [heavier.vector()], [0.0])[0]
    np.testing.assert_allclose(wrong[1:-1], 0.01 * 0.5 * (torque[:-1] + torque[1:]), atol=1e-6)


@pytest.mark.parametrize("late_s", [0.28e-3, 0.5e-3, 1.63e-3])
def test_a_torque_that_comes_late_is_known_between_the_samples(late_s: float) -> None:
    """A free inertia under a late torque, in closed form: the residual is nothing, the angle between the samples is the true one."""
    torque = np.random.default_rng(6).normal(0.0, 0.5, 400)
    t = T / 200 * np.arange(400 * 200 + 1)
    jumps = np.diff(torque, prepend=0.0)
    angle = np.zeros_like(t)
    for n, jump in enumerate(jumps.tolist()):
        angle += 0.5 * jump / INERTIA * np.maximum(t - (T * n + late_s), 0.0) ** 2
    given = np.append(torque, 0.0)
    late = build_model("late", ("dead_time",), {"motor.inertia": INERTIA, "dead_time.time": late_s}, base_bodies=("motor",))
    plain = reconstruct(angle[::200], given, T, INERTIA, start_rad=0.0, substeps=4)
    left = torque_residuals(late, plain, given, [late.vector()], [0.0])[0][10:-10]
    # A step within a cell of T/32 counts as spread over it: T/(8 32²) of time, at most that share of a jump over two samples.
    assert np.max(np.abs(left)) < 2.0 * np.max(np.abs(jumps)) / (8.0 * 32.0**2)
    push = coarse(acting_cells(late, plain, given), 8)
    known = reconstruct(angle[::200], push, T, INERTIA, start_rad=0.0, substeps=4)
    errors = [float(np.std((m.theta - angle[::50])[40:-40])) for m in (plain, known)]
    assert errors[1] < 0.1 * errors[0]


def cruise(speed: float, acceleration: float = 0.0, samples: int = 2000) -> FineMotion:
    t = T / SUB * np.arange((samples - 1) * SUB + 1, dtype=np.float64)
    return FineMotion(5.0 + speed * t + 0.5 * acceleration * t * t, speed + acceleration * t, samples, T, SUB, 0.0)


@pytest.mark.parametrize("speed", [20.0, -20.0])
def test_load_at_constant_speed_is_all_friction(speed: float) -> None:
    """load = (τ_c + r F_c) sign(ω) + b ω;  the carriage trails by F_c/c."""
    model = axis(coulomb__level=0.08, cart_friction__level=2.8, viscous__damping=2e-3, belt_damping__damping=300.0)
    motion = cruise(speed)
    load, cart = _load_torque(model, motion)
    expected = np.sign(speed) * (0.08 + LEVER * 2.8) + 2e-3 * speed
    np.testing.assert_allclose(load[1000:-1], expected, rtol=1e-9)
    trailing = (LEVER * motion.theta - cart)[1000 * SUB :]
    np.testing.assert_allclose(trailing, np.sign(speed) * 2.8 / STIFFNESS, rtol=1e-6)


def test_load_at_constant_acceleration_is_the_carriage() -> None:
    """load = r² m α at ω' = α:  the motor's own inertia is not part of the load."""
    load, _ = _load_torque(axis(belt_damping__damping=300.0), cruise(0.0, 200.0))
    np.testing.assert_allclose(load[1000:-1], LEVER**2 * MASS * 200.0, rtol=1e-6)


def test_vector_replaces_the_model() -> None:
    model = axis(coulomb__level=0.08)
    other = model.with_values({"coulomb.level": 0.11})
    here, _ = _load_torque(model, cruise(20.0), other.vector())
    np.testing.assert_array_equal(here, _load_torque(other, cruise(20.0))[0])


@pytest.mark.parametrize(("bristles", "share"), [(0.5, 0.5), (1.0, 0.0), (3.0, -1.0)])
def test_motor_friction_turns_round_within_two_bristles(bristles: float, share: float) -> None:
    """After a reversal the friction falls from +level to -level in proportion to the way back, and stays where the motor rests."""
    level, bristle = 0.08, BRISTLE_M / LEVER  # rad
    vector = axis(coulomb__level=level, belt_damping__damping=0.0).vector()
    model = axis(coulomb__level=level)
    vector[model.index("belt_stiffness.stiffness")] = 0.0  # friction alone
    vector[model.index("belt_damping.damping")] = 0.0
    there = np.linspace(0.0, 1.0, 8 * SUB + 1)
    back = 1.0 - bristles * bristle * there[1:]
    theta = np.concatenate([there, back, np.full(8 * SUB, back[-1])])
    load, _ = _load_torque(model, FineMotion(theta, np.zeros_like(theta), 25, T, SUB, 0.0), vector)
    assert load[5] == pytest.approx(level, rel=1e-9)
    np.testing.assert_allclose(load[18:24], share * level, atol=1e-6 * level)


def test_a_carriage_held_off_by_friction_starts_off() -> None:
    """Offset o: the belt pushes back with c o until the carriage moves; a resting motor carries r c o."""
    model = axis(cart_friction__level=10.0)
    motion = FineMotion(np.full(50 * SUB + 1, 3.0), np.zeros(50 * SUB + 1), 51, T, SUB, 0.0)
    load, cart = _load_torque(model, motion, offset_m=4e-5)
    np.testing.assert_allclose(cart, LEVER * 3.0 + 4e-5, rtol=1e-12)
    np.testing.assert_allclose(load[1:-1], -LEVER * STIFFNESS * 4e-5, rtol=1e-9)
