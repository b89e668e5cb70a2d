"""What can go wrong between host and drive: single frames, the controller, the cable, the clock, the host itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import can
import pytest

from beltcomm.virtual.bus import Frame, LockstepBus
from beltcomm.virtual.faults import BusFaults, Faults, FrameFault, HostDied, kind_of
from virtual.host import Host

MakeHost = Callable[..., Host]
SDO: Any = frozenset({"sdo request", "sdo answer"})
READ_TYPE = b"\x40\x00\x10\x00\x00\x00\x00\x00"


def faulty(host: MakeHost, **faults: Any) -> Host:
    made = host(bus=LockstepBus(faults=BusFaults(**faults)))
    made.frames()  # its boot-up
    return made


def answers(host: Host, seconds: float = 0.0) -> list[tuple[float, int]]:
    """Stamps and identifiers of what comes within a time."""
    found, end = [], host.bus.clock.now() + seconds
    while (message := host.bus.recv(max(0.0, end - host.bus.clock.now()))) is not None:
        found.append((message.timestamp, message.arbitration_id))
    return found


@pytest.mark.parametrize(
    ("identifier", "kind"),
    [
        *((0x000, "nmt"), (0x080, "sync"), (0x081, "emcy"), (0x0FF, "emcy"), (0x100, "other"), (0x181, "tpdo"), (0x201, "rpdo")),
        *((0x4FF, "tpdo"), (0x57F, "rpdo"), (0x581, "sdo answer"), (0x601, "sdo request"), (0x701, "life"), (0x7FF, "other")),
    ],
)
def test_frames_are_told_apart_by_the_predefined_connection_set(identifier: int, kind: str) -> None:
    """CiA 301, tables 38 and 39."""
    assert kind_of(identifier) == kind


def test_a_lost_request_is_never_heard_and_a_lost_answer_never_seen(host: MakeHost) -> None:
    for direction in ("to node", "to host"):
        one = faulty(host, frames=(FrameFault("lost", direction=direction, numbers=frozenset({1}), kinds=SDO),))
        one.send(0x601, READ_TYPE)
        assert answers(one) == []
        one.send(0x601, READ_TYPE)
        assert [i for _, i in answers(one)] == [0x581]


def test_a_late_frame_comes_after_its_delay_and_a_doubled_one_twice(host: MakeHost) -> None:
    late = faulty(host, frames=(FrameFault("late", direction="to host", kinds=SDO, rate=1.0, delay_s=0.004),))
    sent_s = late.bus.clock.now()
    late.send(0x601, READ_TYPE)
    assert answers(late) == []
    ((stamp_s, identifier),) = answers(late, 0.01)
    assert identifier == 0x581
    assert stamp_s == pytest.approx(sent_s + 0.004)
    twice = faulty(host, frames=(FrameFault("doubled", direction="to host", kinds=SDO, rate=1.0),))
    twice.send(0x601, READ_TYPE)
    assert [i for _, i in answers(twice)] == [0x581, 0x581]


def test_a_frame_is_overtaken_by_the_next_of_its_direction(host: MakeHost) -> None:
    one = faulty(host, frames=(FrameFault("swapped", direction="to host", kinds=SDO, numbers=frozenset({1})),))
    one.send(0x601, READ_TYPE)
    assert answers(one) == []
    one.send(0x701, rtr=True)
    assert [i for _, i in answers(one)] == [0x701, 0x581]


def test_a_rate_is_kept_and_one_seed_is_one_sequence(host: MakeHost) -> None:
    """2000 requests of which 10 % get lost: 200 ± 4 √180."""

    def seen(seed: int) -> list[bool]:
        one = faulty(host, frames=(FrameFault("lost", direction="to host", rate=0.1),), seed=seed)
        found = []
        for _ in range(2000):
            one.send(0x601, READ_TYPE)
            found.append(bool(answers(one)))
        return found

    first = seen(1)
    assert abs(first.count(False) - 200) < 54
    assert first == seen(1)
    assert first != seen(2)


def test_bus_off_raises_as_python_can_does_and_passes(host: MakeHost) -> None:
    one = faulty(host, off_from_s=0.005, off_until_s=0.010)
    one.bus.clock.sleep_until(0.004)
    one.send(0x601, READ_TYPE)
    assert len(answers(one)) == 1
    with pytest.raises(can.CanOperationError, match="bus-off"):
        one.bus.recv(0.01)
    with pytest.raises(can.CanOperationError, match="bus-off"):
        one.send(0x601, READ_TYPE)
    one.bus.clock.sleep_until(0.015)  # waiting needs no interface
    one.send(0x601, READ_TYPE)
    assert len(answers(one)) == 1


def test_a_pulled_cable_is_silence_both_ways(host: MakeHost) -> None:
    heard: list[Frame] = []
    one = faulty(host, silent_from_s=0.005)
    one.bus.on_frame = heard.append
    one.bus.clock.sleep_until(0.006)
    one.send(0x601, READ_TYPE)
    assert answers(one, 0.01) == []
    assert [source for *_, source in heard] == ["host"]  # the drive has not answered


@pytest.mark.parametrize("jump_s", [5.0, -5.0])
def test_the_hosts_clock_jumps(host: MakeHost, jump_s: float) -> None:
    one = faulty(host, clock_jump_at_s=0.010, clock_jump_s=jump_s)
    clock = one.bus.clock
    clock.sleep_until(0.009)
    assert clock.now() == pytest.approx(0.009)
    clock.sleep_until(0.012)
    # forward the sleep is over with the jump, backward it lasts until the clock shows that time again
    assert one.bus.tick == (10 if jump_s > 0.0 else 5012)
    assert clock.now() >= 0.012
    one.send(0x601, READ_TYPE)
    ((stamp_s, _),) = answers(one)
    assert stamp_s == pytest.approx(clock.now())


def test_only_the_stamps_jump(host: MakeHost) -> None:
    one = faulty(host, clock_jump_at_s=0.010, clock_jump_s=-3.0, stamps_only=True)
    one.bus.clock.sleep_until(0.020)
    assert one.bus.tick == 20
    one.send(0x601, READ_TYPE)
    ((stamp_s, _),) = answers(one)
    assert stamp_s == pytest.approx(0.020 - 3.0)


def test_a_killed_host_does_nothing_more_whatever_catches_its_end(host: MakeHost) -> None:
    heard: list[Frame] = []
    one = faulty(host, host_dies_at_s=0.005)
    with pytest.raises(HostDied):
        one.bus.clock.sleep_until(1.0)
    one.bus.on_frame = heard.append
    for call in (lambda: one.send(0x601, READ_TYPE), lambda: one.bus.recv(0.1), lambda: one.bus.clock.sleep_until(2.0)):
        with pytest.raises(HostDied):
            call()
    assert not issubclass(HostDied, Exception)  # no handler of errors has it
    assert heard == []
    assert one.bus.tick == 5


def test_the_nodes_alone_run_on_without_their_host(host: MakeHost) -> None:
    one = faulty(host, host_dies_at_s=0.001)
    for _ in range(100):
        one.bus.advance()
    assert one.bus.tick == 100


# -- of the drive ----------------------------------------------------------------------------------------------------------


def test_transfers_are_counted_and_each_can_be_refused_or_ignored(host: MakeHost) -> None:
    one = host(faults=Faults(sdo_abort={2: 0x08000021}, sdo_silent=frozenset({3})))
    assert one.ask(READ_TYPE)[0] == 0x43
    assert one.ask(READ_TYPE) == b"\x80\x00\x10\x00\x21\x00\x00\x08"
    one.frames()
    one.send(0x601, READ_TYPE)
    assert one.frames() == []
    assert one.ask(READ_TYPE)[0] == 0x43


def test_a_refused_write_changes_nothing(host: MakeHost) -> None:
    one = host(faults=Faults(sdo_abort={1: 0x08000020}))
    one.ask(b"\x2b\x17\x10\x00\x64\x00\x00\x00")
    assert one.ask(b"\x40\x17\x10\x00\x00\x00\x00\x00")[4:6] == b"\x00\x00"


def test_an_object_reads_as_something_else_and_is_what_it_was(host: MakeHost) -> None:
    one = host(faults=Faults(misread={(0x6092, 1): 131072}))
    assert int.from_bytes(one.ask(b"\x40\x92\x60\x01\x00\x00\x00\x00")[4:], "little") == 131072
    assert one.drive._dictionary.entry(0x6092, 1).value == 65536


def test_a_node_that_restarts_says_so_and_has_forgotten(host: MakeHost) -> None:
    one = host(faults=Faults(reset_at_s=0.1))
    one.ask(b"\x2b\x17\x10\x00\x64\x00\x00\x00")  # a heartbeat every 100 ms
    one.bus.clock.sleep_until(0.09)
    one.frames()
    one.bus.clock.sleep_until(0.3)
    assert one.of(0x701) == [b"\x00"]
    assert one.ask(b"\x40\x17\x10\x00\x00\x00\x00\x00")[4:6] == b"\x00\x00"


def test_too_warm_is_a_warning_first(host: MakeHost) -> None:
    one = host(faults=Faults(warm_from_s=0.1, warm_for_s=0.05))

    def status() -> int:
        return int.from_bytes(one.ask(b"\x40\x41\x60\x00\x00\x00\x00\x00")[4:6], "little")

    one.bus.clock.sleep_until(0.09)
    assert status() & 0x88 == 0
    one.bus.clock.sleep_until(0.11)
    assert status() & 0x88 == 0x80
    one.frames()
    one.bus.clock.sleep_until(0.16)
    assert [data[:3] for data in one.of(0x81)] == [b"\x10\x43\x09"]  # 4310h; 1001h: generic and temperature
    assert status() & 0x88 == 0x88


def test_an_end_switch_reads_as_pressed(host: MakeHost) -> None:
    one = host(faults=Faults(end_switch_from_s=0.01, end_switch=1))
    one.bus.clock.sleep_until(0.02)
    assert one.ask(b"\x40\xfd\x60\x00\x00\x00\x00\x00")[4] & 3 == 2
