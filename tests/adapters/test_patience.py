"""Waits that follow the drive: servers that take 300 ms, adapters that lose frames, answers that come after nobody waits for them."""

from __future__ import annotations

import heapq
import itertools

import can
import numpy as np
import pytest

from beltcomm.errors import BusError
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


def many(bus: SlowBus, count: int) -> SdoObjects:
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


def test_a_drive_that_was_there_is_not_blamed_on_its_cable_first() -> None:
    bus = SlowBus(StubNode(), 0.001)
    objects = many(bus, 1)
    bus.lost = 1.1
    with pytest.raises(BusError, match=r"in 5 attempts over .* it has answered before: look whether it is still on"):
        objects.read_int(0x6076, 0, "uint32")
    with pytest.raises(BusError, match=r"in 3 attempts .* check that the drive is on, its node number"):
        SdoObjects(Link(bus, bus.clock, 2)).read_int(0x6076, 0, "uint32")
