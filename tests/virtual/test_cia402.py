"""State machine against IEC 61800-7-201, figures and tables of 5.3; statusword patterns of its table 30."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from beltcomm.virtual.faults import Faults
from virtual.host import Abort, Host

MakeHost = Callable[..., Host]

# State -> (mask, value), and controlwords that lead there from power-on.
PATTERNS = {
    "switch on disabled": (0x4F, 0x40),
    "ready": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault reaction active": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}
WAY = {
    "switch on disabled": (),
    "ready": (0x06,),
    "switched on": (0x06, 0x07),
    "operation enabled": (0x06, 0x07, 0x0F),
    "quick stop active": (0x06, 0x07, 0x0F, 0x02),
}
COMMANDS = {"disable voltage": 0x00, "quick stop": 0x02, "shutdown": 0x06, "switch on": 0x07, "enable": 0x0F}


def state(one: Host) -> str:
    word = one.status
    (name,) = (name for name, (mask, value) in PATTERNS.items() if word & mask == value)
    return name


# Every state with every command; what the standard's figure does not draw changes nothing.  605Ah = 6.
EXPECTED = {
    ("switch on disabled", "shutdown"): "ready",  # 2
    ("ready", "switch on"): "switched on",  # 3
    ("ready", "enable"): "operation enabled",  # 3 and 4
    ("switched on", "enable"): "operation enabled",  # 4
    ("operation enabled", "switch on"): "switched on",  # 5
    ("switched on", "shutdown"): "ready",  # 6
    ("ready", "disable voltage"): "switch on disabled",  # 7
    ("ready", "quick stop"): "switch on disabled",  # 7
    ("operation enabled", "shutdown"): "ready",  # 8
    ("operation enabled", "disable voltage"): "switch on disabled",  # 9
    ("switched on", "disable voltage"): "switch on disabled",  # 10
    ("switched on", "quick stop"): "switch on disabled",  # 10
    ("operation enabled", "quick stop"): "quick stop active",  # 11
    ("quick stop active", "disable voltage"): "switch on disabled",  # 12
    ("quick stop active", "enable"): "operation enabled",  # 16
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("start", WAY)
def test_every_command_in_every_state(host: MakeHost, start: str, command: str) -> None:
    one = host()
    one.write(0x605A, 0, 6, "h")
    for word in WAY[start]:
        one.control(word)
    assert state(one) == start
    one.control(COMMANDS[command])
    assert state(one) == EXPECTED.get((start, command), start)


def test_quick_stop_with_option_2_ends_in_switch_on_disabled(host: MakeHost) -> None:
    one = host()
    for word in WAY["quick stop active"]:
        one.control(word)
    one.control(0x0F)
    assert state(one) == "quick stop active"  # 16 only with an option that holds
    one.run(0.05)
    assert state(one) == "switch on disabled"  # 12
    one.control(0x0F)
    assert state(one) == "switch on disabled"


def test_quick_stop_with_option_6_stays(host: MakeHost) -> None:
    one = host()
    one.write(0x605A, 0, 6, "h")
    for word in WAY["quick stop active"]:
        one.control(word)
    one.run(2.0)
    assert state(one) == "quick stop active"


@pytest.mark.parametrize("start", [name for name in WAY if name != "operation enabled"])
def test_fault_without_motion_13_14_and_reset_15(host: MakeHost, start: str) -> None:
    one = host(faults=Faults(emergency_at_s=0.001, emergency_code=0x3220))
    one.write(0x605A, 0, 6, "h")
    for word in WAY[start]:
        one.control(word)
    one.run(0.001)
    assert state(one) == "fault"
    assert one.of(0x81) == [bytes.fromhex("2032050000000000")]
    one.control(0x0F)
    assert state(one) == "fault"
    one.control(0x80)
    assert state(one) == "switch on disabled"
    assert one.of(0x81) == [bytes(8)]  # error reset


def test_fault_reset_is_an_edge_and_clears_the_register(host: MakeHost) -> None:
    faults = Faults(emergency_at_s=0.001)
    one = host(faults=faults)
    one.write(0x6040, 0, 0x80, "H")
    one.run(0.001)
    one.frames()
    one.control(0x80)  # still set: no edge
    assert state(one) == "fault"
    one.write(0x6040, 0, 0x00, "H")
    assert (one.read(0x1001), one.read(0x603F), one.read(0x1003, 1)) == (0x05, 0x3220, 0x3220)
    one.control(0x80)
    assert one.of(0x81) == [bytes(8)]  # error reset
    assert state(one) == "switch on disabled"
    assert (one.read(0x1001), one.read(0x603F), one.read(0x1003, 0), one.read(0x1003, 1)) == (0, 0, 1, 0x3220)
    one.write(0x1003, 0, 0, "B")
    assert (one.read(0x1003, 0), one.read(0x1003, 1)) == (0, 0)
    faults.emergency_at_s = 0.0
    one.run(0.001)
    assert state(one) == "fault"


def test_braking_fault_shows_fault_reaction_active(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.write(0x6085, 0, 10 * 65536, "I")
    one.enable(3)
    one.write(0x60FF, 0, 65536, "i")
    one.run(0.2)
    one.write(0x607D, 2, one.read(0x6064, code="i") + 100, "i")  # just ahead
    one.run(0.01)
    assert state(one) == "fault reaction active"
    one.run(0.3)
    assert state(one) == "fault"


def test_both_patterns_of_the_fault_state(host: MakeHost) -> None:
    assert host_fault_bits(host, {}) == 0x08
    assert host_fault_bits(host, {"fault_bits": 0x0F}) == 0x0F


def host_fault_bits(host: MakeHost, options: dict[str, int]) -> int:
    one = host(faults=Faults(emergency_at_s=0.0), **options)
    one.run(0.001)
    return one.status & 0x4F


def test_the_level_of_the_controlword_counts_after_a_stop(host: MakeHost) -> None:
    one = host()
    for word in WAY["quick stop active"]:
        one.control(word)
    one.control(0x06)
    assert state(one) == "quick stop active"
    one.run(0.05)
    assert state(one) == "ready"  # 12 and, with the word still there, 2


def test_stage_off_means_no_torque(host: MakeHost) -> None:
    one = host()
    one.write(0x6071, 0, 500, "h")
    for word in (0x06, 0x07):
        one.control(word)
    one.write(0x6060, 0, 10, "b")
    one.run(0.01)
    assert {torque for torque, _ in one.plant.steps} == {0.0}
    one.control(0x0F)
    one.run(0.01)
    assert one.plant.steps[-1][0] == pytest.approx(0.715)
    one.control(0x07)  # 5: stage blocked, motor free
    one.plant.steps.clear()
    one.run(0.01)
    assert {torque for torque, _ in one.plant.steps} == {0.0}


def test_supported_modes_and_mode_display(host: MakeHost) -> None:
    one = host()
    assert one.read(0x6502) == 0x3ED  # 1 3 4 6 7 8 9 10
    for mode in (1, 3, 4, 6, 7, 8, 9, 10):
        one.write(0x6060, 0, mode, "b")
        assert one.read(0x6061) == mode
    other = host(profile="cmmp-as")
    assert other.read(0x6502) == 0x6D  # 1 3 4 6 7
    with pytest.raises(Abort, match="101253168"):  # 06090030h
        other.write(0x6060, 0, 8, "b")
