"""Supervision: every limit that leads to a fault, its code and its reaction."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from beltcomm.virtual.cia402 import DriveState
from virtual.host import COUNTS, UNIT_NM, Host, RigidPlant

MakeHost = Callable[..., Host]
PER_RAD = COUNTS / (2 * math.pi)


def emergencies(one: Host) -> list[int]:
    """Error codes of the emergency messages so far."""
    return [int.from_bytes(data[:2], "little") for data in one.of(0x81)]


def test_overspeed_switches_the_stage_off(host: MakeHost) -> None:
    one = host()
    one.write(0x6080, 0, 100, "I")  # 10.47 rad/s
    one.enable(10)
    one.write(0x6071, 0, 100, "h")
    one.run(1.0)
    assert emergencies(one) == [0x8400]
    assert one.state() == DriveState.FAULT
    # 0.143 N m on 2e-3 kg m² is 71.5 rad/s²: the limit is passed by what the filter and the delay let through, 4 ticks.
    assert one.plant.velocity_rad_s == pytest.approx(100 * math.pi / 30, abs=71.5 * 0.005)


@pytest.mark.parametrize("side", [1, -1])
def test_software_limits_brake_and_fault(host: MakeHost, side: int) -> None:
    one = host()
    one.gains()
    one.write(0x6085, 0, round(100 * PER_RAD), "I")
    one.write(0x607D, 1, round(-2 * PER_RAD), "i")
    one.write(0x607D, 2, round(2 * PER_RAD), "i")
    one.write(0x60FF, 0, side * round(10 * PER_RAD), "i")
    one.enable(3)
    furthest = 0.0
    for _ in range(500):
        one.run(0.001)
        furthest = max(furthest, side * one.plant.position_rad)
    assert emergencies(one) == [0x8612]
    assert one.state() == DriveState.FAULT
    # Braking way v²/2a = 0.5 rad behind the limit, and what speed control lags behind the ramp: v J/K_P = 0.1 rad at most.
    assert 2.5 <= furthest <= 2.61


def test_the_way_back_from_beyond_a_limit_is_free_and_further_out_is_not(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.place(3.0)
    one.write(0x607D, 2, round(2 * PER_RAD), "i")
    one.write(0x60FF, 0, round(-5 * PER_RAD), "i")
    one.enable(3)
    one.run(0.1)
    assert emergencies(one) == []
    one.write(0x60FF, 0, round(5 * PER_RAD), "i")
    one.run(0.5)
    assert emergencies(one) == [0x8612]


def test_equal_software_limits_are_off(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.write(0x607D, 1, 0, "i")
    one.write(0x607D, 2, 0, "i")
    one.write(0x60FF, 0, round(5 * PER_RAD), "i")
    one.enable(3)
    one.run(0.5)
    assert emergencies(one) == []


@pytest.mark.parametrize(("side", "code", "bit"), [(-1, 0x8081, 1), (1, 0x8082, 2)])
def test_end_switches(host: MakeHost, side: int, code: int, bit: int) -> None:
    one = host(end_switches_rad=(-1.0, 1.0))
    one.gains()
    one.write(0x6085, 0, round(50 * PER_RAD), "I")  # so soft that it stops well behind the switch
    one.write(0x60FF, 0, side * round(5 * PER_RAD), "i")
    one.enable(3)
    one.run(0.1)
    assert one.read(0x60FD) == 0
    one.run(0.9)
    assert emergencies(one) == [code]
    assert one.state() == DriveState.FAULT
    assert one.read(0x60FD) == bit
    one.control(0x80)
    one.write(0x60FF, 0, -side * round(5 * PER_RAD), "i")
    one.enable(3)
    one.run(0.3)
    assert one.state() == DriveState.OPERATION_ENABLED
    assert one.read(0x60FD) == 0


def test_following_error_of_the_reference_profile(host: MakeHost) -> None:
    one = host(plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6065, 0, 1000, "I")
    one.write(0x6066, 0, 20, "H")
    one.enable(8)
    one.write(0x607A, 0, 1001, "i")
    one.run(0.020)
    assert one.state() == DriveState.OPERATION_ENABLED
    one.run(0.002)
    assert emergencies(one) == [0x8611]
    one.run(1.5)
    assert one.state() == DriveState.FAULT


def test_following_error_can_be_off_and_short_ones_pass(host: MakeHost) -> None:
    one = host(plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6065, 0, 1000, "I")
    one.write(0x6066, 0, 20, "H")
    one.enable(8)
    for _ in range(5):
        one.write(0x607A, 0, 1001, "i")
        one.run(0.015)
        one.write(0x607A, 0, 0, "i")
        one.run(0.002)
    one.write(0x6065, 0, 0xFFFFFFFF, "I")
    one.write(0x607A, 0, 10**6, "i")
    one.run(1.0)
    assert emergencies(one) == []


def overload(one: Host, permille: int) -> float:
    """Torque held in mode 10 or 4 until something happens; seconds."""
    one.write(0x6071, 0, permille, "h")
    one.enable(4)
    for k in range(10000):
        one.run(0.001)
        if one.state() != DriveState.OPERATION_ENABLED or one.status & 0x80:
            return k * 1e-3
    raise AssertionError("10 s and nothing happened")


def test_i2t_faults_on_the_reference_profile(host: MakeHost) -> None:
    peak = host(plant=RigidPlant(inertia_kg_m2=1e3))
    assert overload(peak, 2168) == pytest.approx(2.0, abs=0.01)  # peak current for two seconds
    assert emergencies(peak) == [0x2312]
    half = host(plant=RigidPlant(inertia_kg_m2=1e3))
    # ((peak/rated)² - 1) 2 s = (1.5² - 1) t
    assert overload(half, 1500) == pytest.approx(2.0 * ((3.10 / 1.43) ** 2 - 1) / (1.5**2 - 1), rel=0.01)


def test_rated_torque_can_be_held_for_ever(host: MakeHost) -> None:
    one = host(plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6071, 0, 1000, "h")
    one.enable(10)
    one.run(10.0)
    assert emergencies(one) == []


def test_i2t_limits_the_current_on_the_cmmp(host: MakeHost) -> None:
    one = host(profile="cmmp-as", plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6510, 0x10, 2, "H")
    assert overload(one, 2168) == pytest.approx(2.0, abs=0.01)
    one.run(0.01)
    assert one.state() == DriveState.OPERATION_ENABLED
    assert emergencies(one) == []
    assert one.status & 0x0880 == 0x0880  # internal limit and warning
    assert one.read(0x6077, code="h") == 1000
    assert one.plant.steps[-1][0] == pytest.approx(1000 * UNIT_NM)


def test_one_emergency_per_new_error_and_the_youngest_first_in_the_list(host: MakeHost) -> None:
    one = host()
    for code in (0x3210, 0x4310, 0x7380, 0x2320, 0x3220):
        one.drive.faults.emergency_at_s, one.drive.faults.emergency_code = 0.0, code
        one.run(0.002)
        if code != 0x3220:
            one.control(0x00)
            one.control(0x80)
    assert emergencies(one) == [0x3210, 0, 0x4310, 0, 0x7380, 0, 0x2320, 0, 0x3220]
    assert one.read(0x1003, 0) == 4
    assert [one.read(0x1003, sub) for sub in range(1, 5)] == [0x3220, 0x2320, 0x7380, 0x4310]
    assert one.read(0x1001) == 0x05
