"""Modes of operation on a rigid machine."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from beltcomm.virtual.faults import Faults
from virtual.host import COUNTS, INERTIA, UNIT_NM, Host, RigidPlant

MakeHost = Callable[..., Host]
PER_RAD = COUNTS / (2 * math.pi)
REACHED, LIMIT, BIT_12, BIT_13 = 0x0400, 0x0800, 0x1000, 0x2000


def trace(one: Host, seconds: float) -> np.ndarray:
    """True motor angle, every millisecond."""
    got = []
    for _ in range(round(1000 * seconds)):
        one.run(0.001)
        got.append(one.plant.position_rad)
    return np.array(got)


def test_profile_position_moves_along_the_trapezoid(host: MakeHost) -> None:
    one = host()
    one.gains()
    for index, value in ((0x6081, 4.0), (0x6083, 20.0), (0x6084, 40.0)):
        one.write(index, 0, round(value * PER_RAD), "I")
    one.enable(1)
    one.write(0x607A, 0, round(2.0 * PER_RAD), "i")
    assert one.control(0x1F) & BIT_12
    assert one.status & REACHED == 0
    assert one.control(0x0F) & BIT_12 == 0  # ready for the next
    angle = trace(one, 1.0)
    # 1.4 rad at 4 rad/s between ramps; the loop lags by little because of its feedforward.
    assert angle[399] == pytest.approx(0.4 + 4.0 * 0.2, abs=0.02)
    assert angle[-1] == pytest.approx(2.0, abs=2e-3)
    assert np.max(np.diff(angle)) * 1000 == pytest.approx(4.0, rel=0.03)
    assert one.status & REACHED


def test_profile_position_relative_and_second_setpoint_in_the_queue(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(1)
    one.write(0x607A, 0, round(1.0 * PER_RAD), "i")
    one.control(0x5F)
    one.control(0x4F)
    assert one.control(0x5F) & BIT_12  # the second waits
    assert one.control(0x4F) & BIT_12  # and keeps the acknowledge until it is taken
    one.control(0x5F)  # a third is not taken
    one.control(0x4F)
    one.run(1.5)
    assert one.status & (BIT_12 | REACHED) == REACHED
    assert one.plant.position_rad == pytest.approx(2.0, abs=2e-3)


def test_profile_position_change_at_once(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(1)
    one.write(0x607A, 0, round(20.0 * PER_RAD), "i")
    one.control(0x1F)
    one.control(0x0F)
    one.run(0.1)
    one.write(0x607A, 0, round(-1.0 * PER_RAD), "i")
    one.control(0x3F)
    one.control(0x0F)
    top = trace(one, 1.5)
    assert np.max(top) < 10.0
    assert top[-1] == pytest.approx(-1.0, abs=2e-3)


def test_profile_position_halt_and_resume(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(1)
    one.write(0x607A, 0, round(10.0 * PER_RAD), "i")
    one.control(0x1F)
    one.run(0.1)
    one.control(0x11F)
    one.run(0.5)
    assert one.status & REACHED  # halted and at rest
    assert abs(one.plant.velocity_rad_s) < 0.05
    assert 1.0 < one.plant.position_rad < 9.0
    one.control(0x1F)
    one.run(1.0)
    assert one.plant.position_rad == pytest.approx(10.0, abs=5e-3)


def test_profile_position_is_cut_to_the_software_limits(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.write(0x607D, 1, round(-1.0 * PER_RAD), "i")
    one.write(0x607D, 2, round(1.0 * PER_RAD), "i")
    one.enable(1)
    one.write(0x607A, 0, round(0.5 * PER_RAD), "i")
    one.control(0x1F)
    one.run(0.01)
    assert one.status & LIMIT == 0
    one.control(0x0F)
    one.write(0x607A, 0, round(-30.0 * PER_RAD), "i")
    one.control(0x3F)
    one.write(0x607D, 1, round(-1.1 * PER_RAD), "i")  # room for the overshoot of the loop
    one.run(2.0)
    assert one.status & LIMIT
    assert one.plant.position_rad == pytest.approx(-1.0, abs=5e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_profile_velocity_ramps(host: MakeHost, sign: int) -> None:
    one = host()
    one.gains()
    one.write(0x6083, 0, round(50.0 * PER_RAD), "I")
    one.write(0x6084, 0, round(100.0 * PER_RAD), "I")
    one.enable(3)
    one.write(0x60FF, 0, sign * round(10.0 * PER_RAD), "i")
    one.run(0.1)
    assert one.status & (REACHED | BIT_12) == 0
    assert sign * one.plant.velocity_rad_s == pytest.approx(5.0, abs=0.3)
    one.run(0.4)
    assert one.status & (REACHED | BIT_12) == REACHED
    assert sign * one.plant.velocity_rad_s == pytest.approx(10.0, abs=0.1)
    one.control(0x10F)  # halt
    one.run(0.05)
    assert sign * one.plant.velocity_rad_s == pytest.approx(5.0, abs=0.5)
    one.run(0.5)
    assert one.status & (REACHED | BIT_12) == REACHED | BIT_12
    assert one.plant.velocity_rad_s == pytest.approx(0.0, abs=0.1)


def test_profile_torque_follows_its_slope_and_halt(host: MakeHost) -> None:
    one = host(plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6087, 0, 1000, "I")  # 1 per tick
    one.enable(4)
    one.write(0x6071, 0, 100, "h")
    one.run(0.05)
    assert one.read(0x6074, code="h") == pytest.approx(50, abs=1)
    assert one.status & REACHED == 0
    one.run(0.1)
    assert one.read(0x6077, code="h") == 100
    assert one.status & REACHED
    one.control(0x10F)
    one.run(0.05)
    assert one.read(0x6074, code="h") == pytest.approx(50, abs=1)
    one.run(0.06)
    assert one.read(0x6077, code="h") == 0


def test_interpolated_position_needs_bit_4(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(7)
    one.write(0x60C1, 1, 10, "i")
    one.run(0.2)
    assert one.status & BIT_12 == 0
    assert one.plant.position_rad == 0.0
    assert one.control(0x1F) & BIT_12
    for setpoint in range(10, 1001, 10):
        one.write(0x60C1, 1, setpoint, "i")
        one.run(0.001)
    one.run(0.5)
    assert one.read(0x6064, code="i") == pytest.approx(1000, abs=20)
    assert one.status & REACHED


@pytest.mark.parametrize("mode", [7, 8])
def test_setpoints_are_interpolated_over_60c2(host: MakeHost, mode: int) -> None:
    one = host(plant=RigidPlant(inertia_kg_m2=1e3))  # nothing moves: the demand is what is looked at
    one.write(0x60C2, 1, 4, "B")
    one.write(0x6065, 0, 0xFFFFFFFF, "I")
    one.enable(mode)
    one.control(0x1F)
    one.write(0x607A, 0, 400, "i")
    one.write(0x60C1, 1, 400, "i")
    demand = []
    for _ in range(6):
        one.run(0.001)
        demand.append(one.read(0x6062, code="i"))
    assert demand == [100, 200, 300, 400, 400, 400]


def test_cyclic_position_adds_offsets_and_passes_velocity_and_torque(host: MakeHost) -> None:
    """One loop from rest, by hand: e = K_PP φ_d + K_v ω_d - 0, τ = K_P e + J dω_d/dt + d ω_d + c + τ_off."""
    one = host()
    kp, kpp, velocity_factor, viscous, coulomb, offset = 0.05, 3.0, 0.5, 1e-3, 0.02, 0.01
    for subindex, value in ((1, kp), (2, 0.0), (3, kpp), (9, INERTIA), (10, viscous), (11, coulomb), (12, offset)):
        one.write(0x2100, subindex, value, "f")
    one.write(0x2100, 13, velocity_factor, "f")
    one.enable(8)
    one.write(0x607A, 0, 300, "i")
    one.write(0x60B0, 0, 200, "i")
    one.write(0x60B1, 0, 1000, "i")
    one.write(0x60B2, 0, 40, "h")
    one.run(0.001)
    omega = 1000 / PER_RAD
    expected = kp * (kpp * 500 / PER_RAD + velocity_factor * omega)
    expected += INERTIA * omega / 1e-3 + viscous * omega + coulomb + offset + 40 * UNIT_NM
    assert one.read(0x6074, code="h") * UNIT_NM == pytest.approx(expected, abs=0.51 * UNIT_NM)
    assert one.read(0x6062, code="i") == 500
    assert one.read(0x60F4, code="i") == 500
    assert one.status & BIT_12


def test_cyclic_position_tracks_a_moving_reference(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(8)
    errors = []
    for k in range(1, 1001):
        t = k * 1e-3
        one.write(0x607A, 0, round((1 - math.cos(2 * math.pi * t)) * PER_RAD), "i")
        one.write(0x60B1, 0, round(2 * math.pi * math.sin(2 * math.pi * t) * PER_RAD), "i")
        one.run(0.001)
        errors.append(one.read(0x60F4, code="i") / PER_RAD)
    assert max(map(abs, errors)) < 0.05


def test_cyclic_velocity(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(9)
    one.write(0x60FF, 0, round(5.0 * PER_RAD), "i")
    one.write(0x60B1, 0, round(2.0 * PER_RAD), "i")
    one.run(1.0)
    assert one.plant.velocity_rad_s == pytest.approx(7.0, abs=0.05)
    one.control(0x10F)
    one.run(1.0)
    assert one.plant.velocity_rad_s == pytest.approx(0.0, abs=0.05)
    assert one.status & BIT_12 == 0


def test_prefilter_acts_in_the_loop(host: MakeHost) -> None:
    """A Butterworth prefilter at 50 rad/s leaves of a first error step only its first sample b0."""
    one = host()
    for subindex, value in ((1, 0.05), (2, 0.0), (3, 1.0)):
        one.write(0x2100, subindex, value, "f")
    one.write(0x2100, 5, 2, "B")
    one.enable(8)
    one.write(0x607A, 0, 65536, "i")
    one.run(0.001)
    plain = 0.05 * 2 * math.pi
    assert one.read(0x6074, code="h") * UNIT_NM == pytest.approx(plain, abs=UNIT_NM)  # no cutoff given yet: none
    one.control(0x00)
    one.write(0x607A, 0, 0, "i")
    one.write(0x2100, 6, 50.0, "f")
    one.plant.position_rad = one.plant.velocity_rad_s = 0.0
    one.run(0.05)
    one.enable(8)
    one.write(0x607A, 0, 65536, "i")
    one.run(0.001)
    k = math.tan(0.5 * 50.0 * 1e-3)
    b0 = k * k / (1.0 + math.sqrt(2.0) * k + k * k)
    assert b0 * plain < 0.5 * UNIT_NM
    assert one.read(0x6074, code="h") == 0
    one.run(0.05)
    assert one.read(0x6074, code="h") * UNIT_NM > 0.5 * plain  # it lets slow errors pass


@pytest.mark.parametrize("kind", [0, 1])
def test_additional_low_pass_acts_behind_any_prefilter(host: MakeHost, kind: int) -> None:
    """2100h:15 at 50 rad/s leaves of a first error step only its first sample b0, with a notch before it and alone."""
    one = host()
    for subindex, value in ((1, 0.05), (2, 0.0), (3, 1.0), (6, 600.0), (7, 2.0), (15, 50.0)):
        one.write(0x2100, subindex, value, "f")
    one.write(0x2100, 5, kind, "B")
    one.enable(8)
    one.write(0x607A, 0, 65536, "i")
    one.run(0.001)
    assert one.read(0x6074, code="h") == 0
    one.run(0.05)
    assert one.read(0x6074, code="h") * UNIT_NM > 0.5 * 0.05 * 2 * math.pi  # it lets slow errors pass


def test_mode_change_while_moving_brakes_instead_of_jumping(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(3)
    one.write(0x60FF, 0, round(10.0 * PER_RAD), "i")
    one.run(0.5)
    one.write(0x6060, 0, 1, "b")
    assert one.read(0x6061) == 1
    before = one.plant.position_rad
    one.run(1.0)
    assert one.plant.velocity_rad_s == pytest.approx(0.0, abs=0.05)
    # 6084h = 100 rev/s²: v²/2a of the reference is 0.08 rad.
    assert 0.0 < one.plant.position_rad - before < 0.5


def test_polarity_turns_positions_and_velocities(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.write(0x607E, 0, 0xC0, "B")
    one.enable(1)
    one.write(0x607A, 0, round(1.0 * PER_RAD), "i")
    one.control(0x1F)
    one.run(0.03)
    assert one.read(0x606C, code="i") > 0
    one.run(1.0)
    assert one.plant.position_rad == pytest.approx(-1.0, abs=2e-3)
    assert one.read(0x6064, code="i") == pytest.approx(PER_RAD, abs=30)


def braked(one: Host, feedforward: float) -> tuple[float, list[float]]:
    """Way, rad, and torque of every tick, N m, of a quick stop from 10 rad/s out of the torque mode, at 50 rad/s²."""
    one.gains(forward=feedforward)
    one.write(0x6085, 0, round(50.0 * PER_RAD), "I")
    one.enable(10)
    one.plant.velocity_rad_s = 10.0
    one.run(0.02)
    start, furthest = one.plant.position_rad, 0.0
    one.plant.steps.clear()
    one.control(0x02)
    for _ in range(500):
        one.run(0.001)
        furthest = max(furthest, one.plant.position_rad - start)
    assert one.status & 0x4F == 0x40
    return furthest, [torque for torque, _ in one.plant.steps]


def test_quick_stop_brakes_along_6085h(host: MakeHost) -> None:
    way, torque = braked(host(), 0.0)
    # v²/2a = 1 rad.  Speed control alone lags behind the ramp by a J/K_P = 0.5 rad/s, at most for as long as the ramp lasts.
    assert 1.0 <= way <= 1.0 + 10.0 * INERTIA / 0.2
    # From the first tick on it brakes: the speed was known before the loop closed.  J a = 0.1 N m and the loop's overshoot.
    assert max(torque[:200]) <= 1e-3
    assert -0.15 <= min(torque) <= -0.1


def test_quick_stop_ignores_the_feedforward_of_the_acceleration(host: MakeHost) -> None:
    """Twice the inertia as feedforward, 0.2 N m here, changes nothing."""
    assert braked(host(), 2.0) == braked(host(), 0.0)


@pytest.mark.parametrize("asked_rad_s", [0.0, 10.0])
@pytest.mark.parametrize("jump", [20000, -20000])
def test_quick_stop_out_of_a_closed_loop_asks_for_no_more_than_was_asked_before(host: MakeHost, asked_rad_s: float, jump: int) -> None:
    """The encoder jumps by 1.9 rad, which an 8 ms filter of the speed calls 213 rad/s: a ramp that began there would be the motion.

    The torque is limited to 50 rad/s²: the loop itself takes the jump for a speed, and for some time constants of the filter it drives.
    """
    faults = Faults(encoder_step_counts=jump)
    one = host(faults=faults)
    one.gains(forward=0.0)
    one.write(0x2100, 4, 0.008, "f")
    one.write(0x6072, 0, round(50.0 * INERTIA / UNIT_NM), "H")
    one.write(0x6085, 0, round(25.0 * PER_RAD), "I")
    one.enable(9)
    one.write(0x60FF, 0, round(asked_rad_s * PER_RAD), "i")
    one.run(1.0)
    assert one.plant.velocity_rad_s == pytest.approx(asked_rad_s, abs=0.1)
    faults.encoder_step_at_s = one.bus.clock.now()
    one.run(0.002)
    start = one.plant.position_rad
    one.control(0x02)
    speeds = np.diff(trace(one, 3.0)) * 1000
    assert one.status & 0x4F == 0x40
    assert speeds.min() > -3.0
    assert speeds.max() < asked_rad_s + 3.0
    assert abs(one.plant.position_rad - start) < asked_rad_s**2 / 50.0 + 2.0  # the integral part undoes what jumped
    assert abs(speeds[-1]) < 0.5  # what the drive calls standing, and nothing brakes this machine after it
