"""Lock-step bus: order, time, several nodes, real time with an injected clock."""

from __future__ import annotations

import can
import pytest

from beltcomm.virtual.bus import DataFrame, LockstepBus
from frames import FrameHash


class Echo:
    """Answers every frame with its own under the next identifier, and sends its tick when asked to."""

    def __init__(self, bus: LockstepBus, speak_at: int = -1) -> None:
        self.bus, self.speak_at = bus, speak_at
        self.calls: list[object] = []
        bus.attach(self)

    def receive(self, identifier: int, data: bytes, remote: bool) -> None:
        self.calls.append((identifier, data, remote))
        if identifier < 0x200:
            self.bus.transmit(self, identifier + 0x200, data)

    def begin_tick(self, tick: int) -> None:
        self.calls.append(f"begin {tick}")
        if tick == self.speak_at:
            self.bus.transmit(self, 0x700, bytes((tick,)))

    def finish_tick(self) -> None:
        self.calls.append("finish")


@pytest.fixture
def bus():  # type: ignore[no-untyped-def]
    made = LockstepBus()
    yield made
    made.shutdown()


def message(identifier: int, data: bytes = b"", **options: bool) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=options.pop("extended", False), data=data, **options)


def test_answer_is_there_when_send_returns_and_no_time_has_passed(bus: LockstepBus) -> None:
    Echo(bus)
    bus.send(message(0x101, b"\x05"))
    answer = bus.recv(0.0)
    assert answer is not None
    assert (answer.arbitration_id, bytes(answer.data), answer.timestamp) == (0x301, b"\x05", 0.0)
    assert bus.clock.now() == 0.0


def test_order_of_a_tick(bus: LockstepBus) -> None:
    node = Echo(bus)
    bus.clock.sleep_until(0.001)
    bus.send(message(0x300))
    bus.clock.sleep_until(0.002)
    assert node.calls == ["begin 0", "finish", "begin 1", (0x300, b"", False), "finish", "begin 2"]


def test_recv_runs_time_until_a_frame_comes_or_the_timeout_has_passed(bus: LockstepBus) -> None:
    Echo(bus, speak_at=7)
    assert bus.recv(0.005) is None
    assert bus.clock.now() == 0.005
    found = bus.recv(None)
    assert found is not None
    assert found.timestamp == bus.clock.now() == 0.007


def test_recv_timeout_is_rounded_up_to_whole_ticks(bus: LockstepBus) -> None:
    assert bus.recv(0.0011) is None
    assert bus.clock.now() == 0.002


def test_sleeping_to_a_rounded_sum_stays_on_its_tick(bus: LockstepBus) -> None:
    asked = 0.1 + 0.2  # 0.30000000000000004
    bus.clock.sleep_until(asked)
    assert bus.tick == 300
    assert bus.clock.now() >= asked
    bus.clock.sleep_until(0.301)
    assert bus.clock.now() == 0.301


def test_a_frame_of_one_node_reaches_the_others_and_the_host(bus: LockstepBus) -> None:
    first, second = Echo(bus), Echo(bus)
    bus.send(message(0x110, b"\x01"))
    assert (0x310, b"\x01", False) in second.calls
    assert (0x310, b"\x01", False) in first.calls
    assert [bus.recv(0.0).arbitration_id for _ in range(2)] == [0x310, 0x310]  # type: ignore[union-attr]


def test_extended_frames_are_not_heard_and_remote_frames_are_marked(bus: LockstepBus) -> None:
    node = Echo(bus)
    bus.send(message(0x101, extended=True))
    bus.send(message(0x701, is_remote_frame=True))
    assert node.calls == ["begin 0", (0x701, b"", True)]


def test_filters_of_python_can_apply(bus: LockstepBus) -> None:
    Echo(bus)
    bus.set_filters([{"can_id": 0x302, "can_mask": 0x7FF}])
    bus.send(message(0x101))
    bus.send(message(0x102))
    found = bus.recv(0.0)
    assert found is not None
    assert found.arbitration_id == 0x302
    assert bus.recv(0.0) is None


def test_send_after_shutdown_is_refused(bus: LockstepBus) -> None:
    bus.shutdown()
    with pytest.raises(can.CanOperationError):
        bus.send(message(0x101))


def test_frame_hook_sees_both_directions(bus: LockstepBus) -> None:
    log: list[object] = []
    bus.on_frame = log.append
    Echo(bus)
    bus.clock.sleep_until(0.002)
    bus.send(message(0x101, b"\x09"))
    bus.send(message(0x701, is_remote_frame=True))
    assert log == [(0.002, 0x101, b"\x09", "host"), (0.002, 0x301, b"\x09", "node"), (0.002, 0x701, b"", "host rtr")]


def test_hash_tells_frames_apart() -> None:
    def digest(*frames: tuple[float, int, bytes, str]) -> str:
        hash_ = FrameHash()
        for frame in frames:
            hash_(frame)
        return hash_.hexdigest()

    frame = (0.001, 0x181, b"\x01\x02", "node")
    assert digest(frame) == digest(frame)
    others = [(0.002, *frame[1:]), (0.001, 0x182, *frame[2:]), (0.001, 0x181, b"\x01\x03", "node"), (*frame[:3], "host")]
    assert len({digest(frame), *(digest(other) for other in others)}) == 5


class WallClock:
    """A wall clock of the test: sleeping is punctual, ``lose`` lets time pass."""

    def __init__(self) -> None:
        self.time_s, self.slept = 100.0, []  # type: float, list[float]

    def now(self) -> float:
        return self.time_s

    def sleep_until(self, t_s: float) -> None:
        self.slept.append(t_s)
        self.time_s = max(self.time_s, t_s)


def test_real_time_waits_for_each_tick() -> None:
    wall = WallClock()
    bus = LockstepBus(wall_clock=wall)
    bus.clock.sleep_until(0.003)
    assert wall.slept == pytest.approx([100.001, 100.002, 100.003])
    assert bus.missed_cycles == 0
    bus.shutdown()


def test_real_time_counts_missed_cycles_and_does_not_catch_up() -> None:
    wall = WallClock()
    bus = LockstepBus(wall_clock=wall)
    bus.clock.sleep_until(0.002)
    wall.time_s += 0.0055  # the host was away: ticks 3 to 6 are over when tick 3 is taken
    bus.clock.sleep_until(0.004)
    assert bus.missed_cycles == 4
    assert wall.time_s == pytest.approx(100.008)  # tick 3 was due at 100.003, is taken at 100.0075, tick 4 at 100.008
    bus.shutdown()


def test_a_frame_that_comes_in_is_what_python_can_would_make_of_it() -> None:
    own, theirs = DataFrame(1.5, 0x181, b"\x01\x02"), can.Message(1.5, 0x181, False, data=b"\x01\x02")
    assert all(getattr(own, name) == getattr(theirs, name) for name in can.Message.__slots__ if name != "__weakref__")
    own.is_error_frame = True  # whoever listens may change it
