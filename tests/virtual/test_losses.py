"""What a loss of the master and an ordered end do: 1029h, 6007h, 605Ah to 605Eh, 1019h, mode 0."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import pytest

from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.loops import STANDSTILL_RAD_S
from virtual.host import SYNC, Abort, Host

MakeHost = Callable[..., Host]
OPERATIONAL, PRE_OPERATIONAL, STOPPED = 0x05, 0x7F, 0x04


def lose(one: Host) -> None:
    """A heartbeat of node 100 that falls silent after 20 ms."""
    one.write(0x1016, 1, 100 << 16 | 20, "I")
    one.send(0x764, b"\x05")
    one.run(0.03)


def nmt_state(one: Host) -> int:
    one.frames()
    one.send(0x701, rtr=True)
    return one.of(0x701)[0][0] & 0x7F


@pytest.mark.parametrize(("behaviour", "state"), [(0, PRE_OPERATIONAL), (1, OPERATIONAL), (2, STOPPED)])
def test_state_after_a_loss(host: MakeHost, behaviour: int, state: int) -> None:
    one = host()
    one.write(0x1029, 1, behaviour, "B")
    one.operational()
    lose(one)
    assert struct.pack("<H", 0x8130) in [data[:2] for data in one.of(0x81)]
    assert nmt_state(one) == state


@pytest.mark.parametrize(
    ("option", "state"),
    [
        (0, DriveState.OPERATION_ENABLED),
        (1, DriveState.FAULT),
        (2, DriveState.SWITCH_ON_DISABLED),
        (3, DriveState.SWITCH_ON_DISABLED),
    ],
)
def test_reaction_to_a_loss(host: MakeHost, option: int, state: DriveState) -> None:
    one = host()
    one.write(0x6007, 0, option, "h")
    one.enable(10)
    lose(one)
    one.run(0.1)
    assert one.state() == state


def test_quick_stop_that_holds_after_a_loss_stays_stopped(host: MakeHost) -> None:
    one = host()
    one.write(0x6007, 0, 3, "h")
    one.write(0x605A, 0, 6, "h")
    one.enable(10)
    lose(one)
    one.run(0.1)
    assert one.state() == DriveState.QUICK_STOP_ACTIVE


@pytest.mark.parametrize(("index", "word"), [(0x605B, 0x06), (0x605C, 0x07)])
@pytest.mark.parametrize("ramp", [False, True])
def test_an_ordered_end_coasts_or_brakes_first(host: MakeHost, index: int, word: int, ramp: bool) -> None:
    one = host()
    one.gains()
    one.write(index, 0, ramp, "h")
    one.enable(3)
    one.write(0x60FF, 0, 65536, "i")
    one.run(0.5)
    speed = one.plant.velocity_rad_s
    assert speed == pytest.approx(math.tau, rel=0.05)
    one.control(word)
    assert (one.state() == DriveState.OPERATION_ENABLED) is ramp
    one.run(0.3)
    assert one.state() == (DriveState.READY if word == 0x06 else DriveState.SWITCHED_ON)
    assert one.plant.velocity_rad_s == (pytest.approx(0.0, abs=STANDSTILL_RAD_S) if ramp else pytest.approx(speed, rel=0.05))


@pytest.mark.parametrize(("code", "ends_in"), [(0, DriveState.SWITCH_ON_DISABLED), (5, DriveState.QUICK_STOP_ACTIVE)])
def test_quick_stops(host: MakeHost, code: int, ends_in: DriveState) -> None:
    one = host()
    one.gains()
    one.write(0x605A, 0, code, "h")
    one.enable(3)
    one.write(0x60FF, 0, 65536, "i")
    one.run(0.5)
    speed = one.plant.velocity_rad_s
    one.control(0x02)
    one.run(0.3)
    assert one.state() == ends_in
    assert one.plant.velocity_rad_s == (pytest.approx(speed, rel=0.05) if code == 0 else pytest.approx(0.0, abs=STANDSTILL_RAD_S))


def test_a_sync_without_the_counter_that_is_asked_for(host: MakeHost) -> None:
    one = host()
    one.write(0x1006, 0, 1000, "I")
    with pytest.raises(Abort, match=str(0x08000022)):
        one.write(0x1019, 0, 10, "B")
    one.write(0x1006, 0, 0, "I")
    one.write(0x1019, 0, 10, "B")
    one.frames()
    one.send(SYNC, b"\x01")
    assert one.of(0x81) == []
    one.send(SYNC)
    assert [data[:2] for data in one.of(0x81)] == [struct.pack("<H", 0x8240)]


def test_mode_0_changes_nothing(host: MakeHost) -> None:
    one = host()
    one.write(0x6060, 0, 3, "b")
    one.write(0x6060, 0, 0, "b")
    assert (one.read(0x6060), one.read(0x6061)) == (0, 3)


@pytest.mark.parametrize(("method", "turns"), [(33, 1.0), (34, 2.0)])
def test_homing_on_the_index_pulse(host: MakeHost, method: int, turns: float) -> None:
    one = host()
    one.gains()
    one.place(1.25 * math.tau)
    one.write(0x6098, 0, method, "b")
    one.enable(6)
    one.control(0x1F)
    one.run(10.0)
    assert one.status & 0x3400 == 0x1400
    position = one.read(0x6064, code="i") / 65536
    assert one.plant.position_rad / math.tau - position == pytest.approx(turns, abs=1e-4)


def test_a_faster_cycle_is_the_same_drive(host: MakeHost) -> None:
    ends = []
    for per_second in (1000, 2000, 2500):
        one = host(bus=LockstepBus(ticks_per_second=per_second))
        one.gains()
        one.enable(1)
        one.write(0x607A, 0, 65536, "i")
        one.control(0x1F)
        one.run(1.5)
        assert one.status & 0x1400 == 0x1400
        ends.append(one.plant.position_rad)
        assert one.plant.time_s == pytest.approx(one.bus.clock.now())
    assert ends == pytest.approx([math.tau] * 3, abs=1e-3)
