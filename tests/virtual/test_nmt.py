"""Network management and error control (CiA 301, 7.2.8), and what the loss of the master does to a moving axis."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from beltcomm.virtual.cia402 import DriveState
from virtual.host import Host

MakeHost = Callable[..., Host]
GUARD = 0x701


def test_boot_up_message_and_pre_operational(host: MakeHost) -> None:
    one = host(node_id=9)
    assert one.frames() == [(0x709, b"\x00")]
    one.send(0x709, rtr=True)
    assert one.frames() == [(0x709, b"\x7f")]


@pytest.mark.parametrize(("command", "state"), [(0x01, 0x05), (0x02, 0x04), (0x80, 0x7F)])
@pytest.mark.parametrize("node", [0, 1])
def test_commands_to_this_node_or_to_all(host: MakeHost, command: int, state: int, node: int) -> None:
    one = host()
    one.frames()
    one.send(0x000, bytes((command, node)))
    one.send(GUARD, rtr=True)
    assert one.frames() == [(GUARD, bytes((state,)))]


def test_commands_to_others_and_short_frames_are_ignored(host: MakeHost) -> None:
    one = host()
    one.frames()
    one.send(0x000, b"\x01\x02")
    one.send(0x000, b"\x01")
    one.send(GUARD, rtr=True)
    assert one.frames() == [(GUARD, b"\x7f")]


@pytest.mark.parametrize("command", [0x81, 0x82])
def test_reset_boots_again_after_a_while_of_silence(host: MakeHost, command: int) -> None:
    one = host()
    one.write(0x1017, 0, 100, "H")
    one.write(0x6071, 0, 77, "h")
    one.frames()
    one.send(0x000, bytes((command, 1)))
    one.send(0x601, bytes.fromhex("4000100000000000"))
    assert one.frames() == []
    message = one.bus.recv(1.0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x701, b"\x00")
    assert 0.01 < message.timestamp < 0.5
    assert one.read(0x1017) == 0
    assert one.read(0x6071) == (0 if command == 0x81 else 77)  # the communication's reset leaves the application alone


def test_heartbeat_is_produced_at_its_period_with_the_state(host: MakeHost) -> None:
    one = host()
    one.frames()
    one.write(0x1017, 0, 20, "H")
    one.run(0.05)
    one.operational()
    assert one.frames() == []
    one.run(0.02)
    assert one.frames() == [(0x701, b"\x05")]
    one.write(0x1017, 0, 0, "H")
    one.run(0.1)
    assert one.frames() == []


def test_guarding_answers_toggle(host: MakeHost) -> None:
    one = host()
    one.frames()
    for _ in range(3):
        one.send(GUARD, rtr=True)
    assert one.of(GUARD) == [b"\x7f", b"\xff", b"\x7f"]
    one.send(0x000, b"\x82\x01")
    one.run(0.1)
    one.frames()
    one.send(GUARD, rtr=True)
    assert one.of(GUARD) == [b"\x7f"]  # the toggle bit starts anew


def test_heartbeat_wins_over_guarding(host: MakeHost) -> None:
    one = host()
    one.frames()
    one.write(0x1017, 0, 500, "H")
    one.send(GUARD, rtr=True)
    assert one.of(GUARD) == []


@pytest.mark.parametrize(("index", "code"), [(0x100C, "H"), (0x100D, "B")])
def test_a_life_time_of_0_ends_guarding_that_has_begun(host: MakeHost, index: int, code: str) -> None:
    one = host()
    one.write(0x100C, 0, 50, "H")
    one.write(0x100D, 0, 1, "B")
    one.send(GUARD, rtr=True)
    one.write(index, 0, 0, code)
    one.run(0.2)
    assert one.of(0x81) == []


def moving(one: Host) -> None:
    """10 rad/s in profile velocity mode."""
    one.gains()
    one.write(0x60FF, 0, round(10 * 65536 / 6.283185), "i")
    one.enable(3)
    one.run(0.5)
    assert one.plant.velocity_rad_s == pytest.approx(10.0, abs=0.1)
    one.frames()


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_loss_of_guarding_stops_a_moving_axis(host: MakeHost, profile: str) -> None:
    one = host(profile=profile)
    if profile == "reference":
        moving(one)
    else:
        one.write(0x6510, 0x10, 2, "H")
        one.write(0x60F9, 1, 2560, "H")  # K_P 0.2 N m s/rad
        one.write(0x60FF, 0, 95, "i")  # 1/min
        one.enable(3)
        one.run(0.5)
        assert one.plant.velocity_rad_s == pytest.approx(10.0, abs=0.2)
    one.write(0x100C, 0, 10, "H")
    one.write(0x100D, 0, 3, "B")
    one.run(0.1)
    assert one.state() == DriveState.OPERATION_ENABLED  # not watched before the first request
    for _ in range(10):
        one.send(GUARD, rtr=True)
        one.run(0.02)
    assert one.state() == DriveState.OPERATION_ENABLED
    one.frames()
    one.run(0.009)
    assert one.state() == DriveState.OPERATION_ENABLED
    one.run(0.001)  # 30 ms after the last request
    assert one.state() == DriveState.FAULT_REACTION_ACTIVE
    (emergency,) = one.of(0x81)
    assert emergency == bytes.fromhex("3081110000000000")  # 8130h, register: generic and communication
    one.run(1.5)
    assert one.state() == DriveState.FAULT
    assert abs(one.plant.velocity_rad_s) < 0.5
    assert one.read(0x603F) == 0x8130


def test_loss_of_the_master_s_heartbeat_stops_a_moving_axis(host: MakeHost) -> None:
    one = host()
    one.write(0x1016, 1, 127 << 16 | 50, "I")
    moving(one)
    assert one.state() == DriveState.OPERATION_ENABLED  # not watched before the first heartbeat
    for _ in range(5):
        one.send(0x77F, b"\x05")
        one.run(0.04)
    one.send(0x77E, b"\x05")  # another node's does not count
    one.run(0.009)
    assert one.state() == DriveState.OPERATION_ENABLED
    one.run(0.001)
    assert one.of(0x81) == [bytes.fromhex("3081110000000000")]
    one.run(1.0)
    assert one.state() == DriveState.FAULT
    assert abs(one.plant.velocity_rad_s) < 0.5


def test_cmmp_has_no_heartbeat_consumer(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    assert one.read(0x1016, 1) == 0
    answer = one.ask(struct.pack("<BHBI", 0x23, 0x1016, 1, 127 << 16 | 50))
    assert answer[4:] == bytes.fromhex("02000106")


def test_loss_of_guarding_at_rest_is_an_emergency_without_a_fault(host: MakeHost) -> None:
    one = host()
    one.write(0x100C, 0, 10, "H")
    one.write(0x100D, 0, 1, "B")
    one.send(GUARD, rtr=True)
    one.frames()
    one.run(0.02)
    assert one.of(0x81) == [bytes.fromhex("3081110000000000")]
    assert one.state() == DriveState.SWITCH_ON_DISABLED
    assert one.read(0x1003, 0) == 1
    assert one.read(0x1003, 1) == 0x8130


def test_stopping_the_node_brakes_a_moving_axis(host: MakeHost) -> None:
    one = host()
    moving(one)
    one.send(0x000, b"\x02\x01")
    assert one.state() == DriveState.FAULT_REACTION_ACTIVE
    one.run(1.0)
    assert one.state() == DriveState.FAULT
    assert abs(one.plant.velocity_rad_s) < 0.5


def test_reset_of_the_node_switches_the_stage_off(host: MakeHost) -> None:
    one = host()
    moving(one)
    one.send(0x000, b"\x81\x01")
    one.plant.steps.clear()
    one.run(0.1)
    assert one.state() == DriveState.SWITCH_ON_DISABLED
    assert {torque for torque, _ in one.plant.steps} == {0.0}  # it coasts
