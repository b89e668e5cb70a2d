"""Waits that follow the drive: servers that take 300 ms, adapters that lose frames, answers that come after nobody waits for them."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from typing import Literal

import can
import numpy as np
import pytest

from beltcomm.errors import BusError
from beltcomm.virtual.bus import TimedLine
from beltcomm.virtual.faults import BusFaults, FrameFault
from beltcomm_adapters.link import Link
from beltcomm_adapters.sdo import SdoObjects
from tests.adapters.stub_node import StubBus, StubNode


class SlowBus(StubBus):
    """Answers come after ``late_s``; each frame either way is lost with probability ``lost``."""

    def __init__(self, node: StubNode, late_s: float, lost: float = 0.0, seed: int = 0) -> None:
        super().__init__(node)
        self.late_s, self.lost, self.random = late_s, lost, np.random.default_rng(seed)
        self.under_way: list[tuple[float, int, can.Message]] = []
        self.number = itertools.count()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.random.random() < self.lost:
            return
        super().send(msg, timeout)
        (node,) = self.nodes
        while node.out:
            cob, data = node.out.popleft()
            if self.random.random() >= self.lost:
                at_s = self.clock.now_s + self.late_s
                answer = can.Message(timestamp=at_s, arbitration_id=cob, data=data, is_extended_id=False)
                heapq.heappush(self.under_way, (at_s, next(self.number), answer))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        end_s = self.clock.now_s + (timeout or 0.0)
        if self.under_way and self.under_way[0][0] <= end_s:
            at_s, _, message = heapq.heappop(self.under_way)
            self.clock.now_s = max(self.clock.now_s, at_s)
            return message
        self.clock.now_s = end_s
        return None


class SwappingBus(StubBus):
    """A share of the frames of a direction is held back until the next one of it has passed."""

    def __init__(self, node: StubNode, way: Literal["to node", "to host", "both"], share: float) -> None:
        super().__init__(node)
        fault = FrameFault("swapped", direction=way, kinds=frozenset({"sdo request", "sdo answer"}), rate=share)
        self.line: TimedLine[can.Message] = TimedLine(BusFaults(frames=(fault,), seed=3), 1000)
        self.waiting: deque[can.Message] = deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        (node,) = self.nodes
        for passed in self.line.carry("to node", msg.arbitration_id, msg, 0):
            super().send(passed, timeout)
            while node.out:
                cob, data = node.out.popleft()
                answer = can.Message(timestamp=self.clock.now_s, arbitration_id=cob, data=data, is_extended_id=False)
                self.waiting += self.line.carry("to host", cob, answer, 0)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.waiting:
            return self.waiting.popleft()
        self.clock.now_s += timeout or 0.0
        return None


def many(bus: StubBus, count: int) -> SdoObjects:
    """Reads and writes in turn; every answer must be of what was asked."""
    objects, (node,) = SdoObjects(Link(bus, bus.clock, 1)), bus.nodes
    for k in range(count):
        assert objects.read_int(0x6076, 0, "uint32") == 1000
        objects.write(0x60FF, 0, "int32", k)
        assert node.get(0x60FF) == k
        assert objects.read_int(0x6080, 0, "uint32") == 6000
        assert objects.read_int(0x60FF, 0, "int32") == k
    return objects


@pytest.mark.parametrize("late_s", [0.001, 0.02, 0.29, 0.31, 0.6, 1.1])
def test_a_slow_server_is_waited_for_and_no_late_answer_passes_for_another(late_s: float) -> None:
    bus = SlowBus(StubNode(), late_s)
    many(bus, 15)
    assert bus.clock.now_s < 15 * 4 * late_s + 4.0  # it is known after some transfers how long that takes


@pytest.mark.parametrize("seed", range(5))
def test_an_adapter_that_loses_one_frame_of_forty_loses_no_transfer(seed: int) -> None:
    bus = SlowBus(StubNode(), 0.004, 1 / 40, seed)
    many(bus, 150)
    assert bus.clock.now_s < 600 * 0.004 + 600 / 20 * 0.3 * 3.0


@pytest.mark.parametrize("seed", range(3))
def test_a_bus_that_drops_one_request_of_ten_costs_one_usual_wait_for_each(seed: int) -> None:
    """Two transfers in a row that are begun anew make one wait longer: not for good, or every further one takes seconds."""
    bus = SlowBus(StubNode(), 0.001, 1 / 20, seed)  # either way
    many(bus, 200)
    assert bus.clock.now_s < 800 / 10 * 0.3 * 2.0


@pytest.mark.parametrize("way", ["to node", "to host", "both"])
def test_requests_and_answers_that_change_places_are_told_apart(way: Literal["to node", "to host", "both"]) -> None:
    bus = SwappingBus(StubNode(), way, 1 / 10)
    many(bus, 150)
    assert bus.clock.now_s < 600 / 5 * 0.3 * 2.0


def test_a_drive_that_was_there_is_not_blamed_on_its_cable_first() -> None:
    bus = SlowBus(StubNode(), 0.001)
    objects = many(bus, 1)
    bus.lost = 1.1
    with pytest.raises(BusError, match=r"in 5 attempts over .* it has answered before: look whether it is still on"):
        objects.read_int(0x6076, 0, "uint32")
    with pytest.raises(BusError, match=r"in 3 attempts .* check that the drive is on, its node number"):
        SdoObjects(Link(bus, bus.clock, 2)).read_int(0x6076, 0, "uint32")
