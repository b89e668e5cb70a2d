"""Motions with friction that have a solution on paper."""

from __future__ import annotations

import math

import pytest

from truth import Axis, ConstantBelt, EndStops, TruthPlant

INERTIA, MASS, LEVER, STIFFNESS = 71.73e-6, 0.96, 0.01242, 222.39e3
GRAVITY = 9.80665
OMEGA_Z = math.sqrt(STIFFNESS / MASS)  # (2.45)
HELD = 1e3  # N m, a motor friction that nothing here overcomes


def axis(belt_damping: float = 0.0, **more: object) -> Axis:
    return Axis(INERTIA, MASS, LEVER, ConstantBelt(STIFFNESS, belt_damping), **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_rigid_axis_coasts_to_its_stopping_distance_and_time(rate: float) -> None:
    # Friction shared in proportion to inertia leaves the belt without force, so the axis is one rigid mass:
    # v' = -rate v - a  stops after  t = ln(1 + rate v0/a)/rate  and  x = (v0 - a t)/rate.
    a, v0 = 40.0, 1.3
    plant = TruthPlant(
        axis(
            belt_damping=20.0,
            coulomb_motor_nm=INERTIA * a / LEVER,
            coulomb_cart_n=MASS * a,
            viscous_motor_nm_s_rad=INERTIA * rate,
            viscous_cart_n_s_m=MASS * rate,
        )
    )
    time = math.log(1.0 + rate * v0 / a) / rate if rate else v0 / a
    distance = (v0 - a * time) / rate if rate else v0**2 / (2.0 * a)
    plant.place((0.0,) * 4, (v0 / LEVER, v0, 0.0, 0.0))
    early = 1e-12  # s
    for _ in range(int(time / 1e-3)):
        plant.step(0.0, 1e-3)
    plant.step(0.0, time - int(time / 1e-3) * 1e-3 - early)
    assert 0.0 < plant.velocity_rad_s < 3.0 * a / LEVER * early
    plant.step(0.0, 2.0 * early)
    assert plant.velocity_rad_s == 0.0
    plant.step(0.0, 0.1)
    assert plant.stuck[:2] == (True, True)
    assert plant.cart_position_m == pytest.approx(distance, rel=1e-11)
    assert plant.position_rad == pytest.approx(distance / LEVER, rel=1e-11)


def test_belt_mode_rings_at_the_resonance_and_decays() -> None:
    damping = 20.0
    reduced = INERTIA * MASS / (INERTIA + LEVER**2 * MASS)
    omega_r = math.sqrt(STIFFNESS * (INERTIA + LEVER**2 * MASS) / (INERTIA * MASS))  # (2.44)
    decay = damping / (2.0 * reduced)
    omega_d = math.sqrt(omega_r**2 - decay**2)
    plant, stretch = TruthPlant(axis(damping)), 1e-4
    plant.place((stretch / LEVER, 0.0, 0.0, 0.0), (0.0,) * 4)
    for i in range(1, 101):
        plant.step(0.0, 1e-3)
        t = 1e-3 * i
        expected = stretch * math.exp(-decay * t) * (math.cos(omega_d * t) + decay / omega_d * math.sin(omega_d * t))
        assert LEVER * plant.position_rad - plant.cart_position_m == pytest.approx(expected, abs=1e-5 * stretch)
        centre = INERTIA / LEVER * plant.position_rad + MASS * plant.cart_position_m
        assert centre == pytest.approx(INERTIA / LEVER**2 * stretch, rel=1e-12)  # nothing pushes from outside


def test_carriage_rings_at_the_antiresonance_while_the_motor_is_held() -> None:
    plant, amplitude = TruthPlant(axis(coulomb_motor_nm=HELD)), 1e-4
    plant.place((0.0, amplitude, 0.0, 0.0), (0.0,) * 4)
    for i in range(1, 101):
        plant.step(0.0, 1e-3)
        assert plant.cart_position_m == pytest.approx(amplitude * math.cos(OMEGA_Z * 1e-3 * i), abs=1e-6 * amplitude)
        assert plant.belt_force_n == pytest.approx(-STIFFNESS * plant.cart_position_m, rel=1e-12)
    assert (plant.position_rad, plant.velocity_rad_s) == (0.0, 0.0)


def test_dry_friction_takes_a_fixed_share_of_every_swing_until_the_carriage_sticks() -> None:
    # Each half swing turns about the point where the spring balances friction: amplitude falls by 2 level/stiffness.
    level = 2.8
    dead_zone = level / STIFFNESS
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, coulomb_cart_n=level), longest_substep_s=2e-6)
    plant.place((0.0, 9.3 * dead_zone, 0.0, 0.0), (0.0,) * 4)
    half_period = math.pi / OMEGA_Z
    for turning_point in (-7.3, 5.3, -3.3, 1.3):
        plant.step(0.0, half_period)
        assert plant.cart_position_m == pytest.approx(turning_point * dead_zone, rel=1e-9)
    plant.step(0.0, half_period * (1.0 - 1e-4))
    assert plant.speeds[1] < 0.0
    plant.step(0.0, half_period * 2e-4)
    for _ in range(3):
        assert plant.stuck[1]
        assert plant.cart_position_m == pytest.approx(0.7 * dead_zone, rel=1e-9)  # inside the dead zone: it stays
        plant.step(0.0, 0.3)


def test_motor_breaks_away_above_its_level_and_not_below() -> None:
    # The carriage holds; the belt is the motor's spring i_t² c.  It swings once to 2 (torque - level)/(i_t² c) and sticks.
    level = 0.08
    plant = TruthPlant(axis(coulomb_motor_nm=level, coulomb_cart_n=100.0))
    for _ in range(200):
        plant.step(level * (1.0 - 1e-12), 1e-3)
        assert (plant.position_rad, plant.velocity_rad_s) == (0.0, 0.0)
    half_period = math.pi / math.sqrt(LEVER**2 * STIFFNESS / INERTIA)
    torque = 1.5 * level
    plant.step(torque, 0.9 * half_period)
    assert plant.velocity_rad_s > 0.0
    plant.step(torque, 0.5)
    assert plant.stuck[:2] == (True, True)
    assert plant.position_rad == pytest.approx(2.0 * (torque - level) / (LEVER**2 * STIFFNESS), rel=1e-6)


def test_whole_axis_breaks_away_at_the_sum_of_both_levels() -> None:
    level, cart_level = 0.08, 2.8
    total = level + LEVER * cart_level
    for factor, moves in ((0.995, False), (1.005, True)):
        plant = TruthPlant(axis(belt_damping=200.0, coulomb_motor_nm=level, coulomb_cart_n=cart_level))
        for i in range(2000):  # so slowly that the belt does not swing
            plant.step(factor * total * min(1.0, i / 1900), 1e-3)
        assert (plant.cart_position_m > 0.0) is moves


def test_tilt_is_held_by_friction_just_above_the_weight() -> None:
    tilt = 0.3
    weight = MASS * GRAVITY * math.sin(tilt)
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, coulomb_cart_n=weight * (1.0 + 1e-12), tilt_rad=tilt))
    plant.step(0.0, 1.0)
    assert (plant.cart_position_m, plant.belt_force_n) == (0.0, 0.0)
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, coulomb_cart_n=weight * (1.0 - 1e-6), tilt_rad=tilt))
    plant.step(0.0, 1e-3)
    assert plant.cart_position_m < 0.0


def test_tilted_carriage_hangs_and_swings_on_the_belt_of_a_held_motor() -> None:
    tilt = 0.3
    sag = MASS * GRAVITY * math.sin(tilt) / STIFFNESS
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, tilt_rad=tilt))
    for i in range(1, 51):
        plant.step(0.0, 1e-3)
        assert plant.cart_position_m == pytest.approx(-sag * (1.0 - math.cos(OMEGA_Z * 1e-3 * i)), abs=1e-6 * sag)


@pytest.mark.parametrize("torque", [0.0, 0.1])
def test_centre_of_mass_falls_freely_on_a_tilted_axis(torque: float) -> None:
    # (Theta_e/i_t² + m) x'' = torque/i_t - m g sin(tilt); zero at torque = + i_t m g sin(tilt).
    tilt = 0.3
    plant, drive_mass = TruthPlant(axis(tilt_rad=tilt)), INERTIA / LEVER**2
    plant.step(torque, 0.1)
    acceleration = (torque / LEVER - MASS * GRAVITY * math.sin(tilt)) / (drive_mass + MASS)
    centre = (drive_mass * LEVER * plant.position_rad + MASS * plant.cart_position_m) / (drive_mass + MASS)
    assert centre == pytest.approx(0.5 * acceleration * 0.1**2, rel=1e-9)


def test_energy_put_in_is_stored_or_lost_to_friction() -> None:
    levels, viscous, damping = (0.08, 2.8), (2.23e-3, 1.5), 20.0
    plant = TruthPlant(
        axis(
            belt_damping=damping,
            coulomb_motor_nm=levels[0],
            coulomb_cart_n=levels[1],
            viscous_motor_nm_s_rad=viscous[0],
            viscous_cart_n_s_m=viscous[1],
        )
    )
    step = 10e-6
    put_in = lost = 0.0
    before = [*plant.coordinates[:2], *plant.speeds[:2]]
    for i in range(40_000):
        torque = 0.3 * math.copysign(1.0, math.sin(2.0 * math.pi * 7.0 * step * i))
        plant.step(torque, step)
        after = [*plant.coordinates[:2], *plant.speeds[:2]]
        put_in += torque * (after[0] - before[0])
        for body in range(2):
            lost += levels[body] * abs(after[body] - before[body])
            lost += viscous[body] * step * (after[2 + body] ** 2 + before[2 + body] ** 2) / 2.0
        rates = [LEVER * s[2] - s[3] for s in (before, after)]
        lost += damping * step * (rates[0] ** 2 + rates[1] ** 2) / 2.0
        before = after
    stretch = LEVER * before[0] - before[1]
    stored = 0.5 * (INERTIA * before[2] ** 2 + MASS * before[3] ** 2 + STIFFNESS * stretch**2)
    assert lost > 0.5 * put_in
    # The trapezoidal rule above errs by (omega step)²/12, 6e-6 at the resonance of 134 Hz.
    assert stored + lost == pytest.approx(put_in, rel=1e-5)


def test_carriage_turns_round_in_the_buffer_where_its_energy_is_spent() -> None:
    # Held motor, frictionless: c A² = c x² + k (x - gap)² at the turning point.
    amplitude, gap, buffer = 1e-3, 0.6e-3, 1e6
    stops = EndStops(low_m=-1.0, high_m=0.3 + gap, stiffness_n_m=buffer)
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, stops=stops), start_position_m=0.3, longest_substep_s=1e-6)
    plant.place((0.0, -amplitude, 0.0, 0.0), (0.0,) * 4)
    c, k = STIFFNESS, buffer
    root = math.sqrt((k * gap) ** 2 - (c + k) * (k * gap**2 - c * amplitude**2))
    turning_point = (k * gap + root) / (c + k)
    farthest = 0.0
    for _ in range(5000):
        plant.step(0.0, 2e-6)
        farthest = max(farthest, plant.cart_position_m)
    assert farthest == pytest.approx(turning_point, rel=1e-6)
    energy = c * plant.cart_position_m**2 + MASS * plant.speeds[1] ** 2
    assert energy == pytest.approx(c * amplitude**2, rel=1e-6)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_lossy_buffer_takes_energy_and_never_pulls(side: float) -> None:
    stops = EndStops(low_m=-0.6e-3, high_m=0.6e-3, loss_s_m=1.0)
    plant = TruthPlant(axis(coulomb_motor_nm=HELD, stops=stops))
    plant.place((0.0, -0.6e-3 * side, 0.0, 0.0), (0.0, 0.4 * side, 0.0, 0.0))
    before = STIFFNESS * 0.6e-3**2 + MASS * 0.4**2
    plant.step(0.0, math.pi / OMEGA_Z)
    after = STIFFNESS * plant.cart_position_m**2 + MASS * plant.speeds[1] ** 2
    assert 0.1 * before < after < 0.9 * before
    # Leaving faster than 1/loss the force would be negative: there the belt alone acts.
    x, v, t = 1e-3 * side, -2.0 * side, 50e-6
    plant.place((0.0, x, 0.0, 0.0), (0.0, v, 0.0, 0.0))
    plant.step(0.0, t)
    assert plant.cart_position_m == pytest.approx(x * math.cos(OMEGA_Z * t) + v / OMEGA_Z * math.sin(OMEGA_Z * t), rel=1e-9)
