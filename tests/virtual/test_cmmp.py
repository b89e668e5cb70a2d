"""The profile cmmp-as against docs/reference-drive.md and the fact sheet it names."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from beltcomm.virtual.cia402 import DriveState
from virtual.host import UNIT_NM, Abort, Host, RigidPlant

MakeHost = Callable[..., Host]


def refused(one: Host, index: int, subindex: int, value: int, code: str) -> int:
    with pytest.raises(Abort) as caught:
        one.write(index, subindex, value, code)
    return int(caught.value.args[0])


def controlled(host: MakeHost, **options: object) -> Host:
    one = host(profile="cmmp-as", **options)
    one.write(0x6510, 0x10, 2, "H")
    return one


def test_identity_and_what_is_missing(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert one.read(0x1018, 1) == 0x1D
    answer = one.ask(bytes.fromhex("4008100000000000"))
    assert answer[4] == 7
    assert one.ask(bytes((0x60, *(0,) * 7)))[1:] == b"CMMP-AS"
    for index in (0x2100, 0x60B0, 0x60B1, 0x60B2, 0x608F, 0x6091, 0x6092):
        with pytest.raises(Abort, match=str(0x06020000)):
            one.read(index)
    assert one.read(0x1800, 0) == 3  # no event timer


def test_enable_logic_must_be_2(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert one.read(0x6510, 0x10) == 0
    assert one.control(0x06) & 0x024F == 0x0040  # not remote, and nothing follows the word
    one.write(0x6510, 0x10, 2, "H")
    one.run(0.001)
    assert one.status & 0x026F == 0x0221  # its level counts now
    one.write(0x6510, 0x10, 0, "H")
    assert one.status & 0x0200 == 0


def test_never_write(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    for index, subindex, code in ((0x60F6, 1, "H"), (0x6410, 3, "H"), (0x6410, 0x11, "h"), (0x604D, 0, "B"), (0x2026, 0, "I")):
        assert refused(one, index, subindex, 1, code) == 0x06010002


def test_max_current_only_after_the_rated_current(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert refused(one, 0x6073, 0, 500, "H") == 0x08000022
    one.write(0x6075, 0, 2200, "I")
    one.write(0x6073, 0, 500, "H")
    assert refused(one, 0x6072, 0, 999, "H") == 0x06090032


def test_default_units(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert [one.read(0x6093, sub) for sub in (1, 2)] == [1, 1]
    assert [one.read(0x6094, sub) for sub in (1, 2)] == [0x1000, 1]
    assert [one.read(0x6097, sub) for sub in (1, 2)] == [0x100, 1]
    one.plant.velocity_rad_s = 2 * math.pi * 5
    one.run(0.1)
    assert one.read(0x606C, code="i") == pytest.approx(300, abs=1)  # 1/min
    assert one.read(0x6064, code="i") == pytest.approx(65536 * 0.5, abs=2)


def test_finest_velocity_and_other_position_units(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    one.write(0x6094, 1, 1, "I")  # 1/4096 per minute
    one.write(0x6093, 1, 16, "I")  # 16 increments of 1/65536 rev are one unit
    one.plant.velocity_rad_s = 2 * math.pi * 5
    one.run(0.1)
    assert one.read(0x606C, code="i") == pytest.approx(300 * 4096, abs=4096 * 60000 / 65536)  # one count per tick
    assert one.read(0x6064, code="i") == pytest.approx(4096 * 0.5, abs=1)


def test_values_keep_their_meaning_when_the_factor_group_changes(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    one.write(0x6065, 0, 3200, "I")
    one.write(0x607D, 2, 32000, "i")
    one.write(0x6094, 1, 1, "I")
    one.write(0x6093, 1, 16, "I")
    one.write(0x6097, 2, 2, "I")
    assert one.read(0x60FB, 4) == 500 * 4096
    assert one.read(0x6081) == 600 * 4096
    assert one.read(0x6065) == 200
    assert one.read(0x6083) == 12000
    assert [one.read(0x607D, sub, "i") for sub in (1, 2)] == [-(2**31), 2000]  # an end of the range is off and stays
    one.write(0x6094, 1, 4096, "I")
    assert one.read(0x60FB, 4) == 500


def test_factor_group_needs_the_stage_off(host: MakeHost) -> None:
    one = controlled(host)
    one.enable(4)
    assert refused(one, 0x6094, 1, 1, "I") == 0x08000022


def test_velocity_gain_1_is_0_02(host: MakeHost) -> None:
    """The calibration of drive-protocols.md 2.6: step 60FFh, read the first step of the torque."""
    one = controlled(host, plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x60F9, 1, 256, "H")
    one.write(0x60F9, 2, 32000, "H")
    for index in (0x6083, 0x6084):
        one.write(index, 0, 10**9, "I")
    one.enable(3)
    one.write(0x60FF, 0, 100, "i")
    one.run(0.001)
    step = 0.02 * 100 * math.pi / 30
    assert one.read(0x6074, code="h") * UNIT_NM == pytest.approx(step, abs=UNIT_NM)
    one.run(0.032)  # one integral time later the torque has doubled
    assert one.read(0x6074, code="h") * UNIT_NM == pytest.approx(2 * step, abs=2 * UNIT_NM)


def test_position_gain_1_is_10_per_second_with_dead_zone_and_bound(host: MakeHost) -> None:
    one = controlled(host, plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x60FB, 1, 256, "H")
    one.write(0x6094, 1, 1, "I")  # finest speed unit
    one.write(0x60FB, 5, 100, "I")
    one.write(0x60FB, 4, 20 * 4096, "I")  # 20 1/min
    one.enable(7)
    one.control(0x1F)

    def output(error: int) -> float:
        one.write(0x60C1, 1, error, "i")
        one.run(0.002)
        return float(one.read(0x60FA, code="i")) / 4096  # 1/min

    assert output(100) == 0.0
    assert output(1100) == pytest.approx(10 * 1000 / 65536 * 60, rel=1e-3)
    assert output(10000) == pytest.approx(20.0, rel=1e-3)
    assert output(-1100) == pytest.approx(-10 * 1000 / 65536 * 60, rel=1e-3)


def test_interpolation_period_is_active_after_save_and_reset(host: MakeHost) -> None:
    one = controlled(host, plant=RigidPlant(inertia_kg_m2=1e3))

    def demand_after_a_step() -> list[int]:
        one.enable(7)
        one.control(0x1F)
        one.write(0x60C1, 1, one.read(0x6064, code="i") + 400, "i")
        start, found = one.read(0x6064, code="i"), []
        for _ in range(4):
            one.run(0.001)
            found.append(one.read(0x6062, code="i") - start)
        one.control(0x00)
        return found

    one.write(0x60C2, 1, 4, "B")
    assert demand_after_a_step() == [400, 400, 400, 400]
    one.write(0x1010, 1, 0x65766173, "I")
    assert demand_after_a_step() == [400, 400, 400, 400]
    one.send(0x000, b"\x81\x01")
    one.run(0.1)
    one.write(0x6510, 0x10, 2, "H")
    assert demand_after_a_step() == [100, 200, 300, 400]
    assert refused(one, 0x60C2, 2, -4, "b") == 0x06090032


def test_following_error_shows_in_bit_13_and_6510_22h_lets_the_axis_coast(host: MakeHost) -> None:
    one = controlled(host, plant=RigidPlant(inertia_kg_m2=1e3))
    one.write(0x6065, 0, 100, "I")
    one.write(0x6066, 0, 5, "H")
    one.enable(7)
    one.control(0x1F)
    one.write(0x60C1, 1, 500, "i")
    one.run(0.05)
    assert one.status & 0x2000
    assert one.state() == DriveState.OPERATION_ENABLED
    one.write(0x6510, 0x22, 400, "I")
    one.run(0.001)
    assert one.state() == DriveState.FAULT  # without a ramp
    assert one.of(0x81)[0][:2] == bytes.fromhex("1186")


def test_quick_stop_option_2_only_and_vendor_bits(host: MakeHost) -> None:
    one = controlled(host)
    assert refused(one, 0x605A, 0, 6, "h") == 0x06090031
    assert one.read(0x2000, 1) == 0b110  # commutation valid, ready for enable
    one.plant.velocity_rad_s = 5.0
    one.run(0.02)
    assert one.status & 0x0100  # drive is moving
    one.plant.velocity_rad_s = 0.0
    one.run(0.05)
    assert one.status & 0x0100 == 0
    one.enable(6)
    one.control(0x1F)
    one.run(0.001)
    assert one.status & 0x8000
    assert one.read(0x2000, 1) == 0b111


def test_cycle_times_are_readable(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert [one.read(0x6510, sub) for sub in range(0xB0, 0xB4)] == [1000] * 4
