"""SYNC by the kernel's broadcast manager: in step with its frames, and honest about those that the host was late for."""

from __future__ import annotations

from typing import Any

import can
import numpy as np
import pytest

from beltcomm.drive import Limits, Motion
from beltcomm_adapters import sync_source
from beltcomm_adapters.canopen import CanopenDrive, LoggedBus
from beltcomm_adapters.link import Link
from tests.adapters.stub_node import StubBus, StubNode


class Task:
    """What python-can gives back."""

    def __init__(self) -> None:
        self.stopped = False

    def stop(self) -> None:
        self.stopped = True


class SocketcanBus(StubBus):
    """Periodic frames by a timer of its own, seen by the host too.   held_up : SYNCs at which the host sleeps so long, s."""

    def __init__(self, node: StubNode, held_up: dict[int, float] | None = None) -> None:
        super().__init__(node)
        self.tasks: list[Task] = []
        self.held_up = held_up or {}
        self.syncs = 0
        self._due_s, self._period_s = float("inf"), 0.0
        self._own: list[can.Message] = []

    def send_periodic(self, msgs: Any, period: float, *rest: Any, **more: Any) -> Task:
        self.tasks.append(Task())
        self._message, self._period_s, self._due_s = msgs, period, self.clock.now_s + period
        return self.tasks[-1]

    def _kernel(self) -> None:
        while self.tasks and not self.tasks[-1].stopped and self._due_s <= self.clock.now_s + 1e-9:
            self.syncs += 1
            self._own.append(can.Message(timestamp=self._due_s, arbitration_id=0x80, is_extended_id=False))
            (node,) = self.nodes
            node.receive(self._message, self._due_s)
            while node.out:
                cob, data = node.out.popleft()
                self._own.append(can.Message(timestamp=self._due_s, arbitration_id=cob, data=data, is_extended_id=False))
            self._due_s += self._period_s

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._kernel()
        if not self._own:
            end_s = self.clock.now_s + (timeout or 0.0)
            if (message := super().recv(0.0)) is not None:
                return message
            if self.tasks and not self.tasks[-1].stopped and self._due_s <= end_s:
                self.clock.now_s = self._due_s
                self._kernel()
            else:
                self.clock.now_s = end_s
                return None
        message = self._own.pop(0)
        if message.arbitration_id == 0x80:
            self.clock.now_s += self.held_up.pop(self.syncs, 0.0)
            self._kernel()
        return message


def motion(rows: int, period_s: float) -> Motion:
    torque = 0.2 * np.sin(2.0 * np.pi * np.arange(rows) / rows)
    return Motion("torque", period_s, np.zeros(rows), np.zeros(rows), torque)


LIMITS = Limits(-100.0, 100.0, 200.0, 0.9, 1000.0)


@pytest.mark.parametrize("logged", [False, True])
def test_the_kernel_sends_sync_where_there_is_one(logged: bool) -> None:
    bus = SocketcanBus(StubNode())
    frames: list[Any] = []
    opened = LoggedBus(bus, bus.clock, frames.append) if logged else bus
    assert sync_source._broadcast_by_kernel(opened)
    with CanopenDrive(opened, bus.clock, 1, "cia402", None, bus.shutdown) as drive:
        rows: list[Any] = []
        report = drive.record(motion(200, 2e-3), LIMITS, rows.append)
    assert report.rows == len(rows) == 200
    assert report.lost_cycles == 0
    np.testing.assert_allclose(np.diff([row[0] for row in rows]), 2e-3, atol=1e-9)
    assert 0x80 not in {cob for _, cob, _, _ in bus.sent}  # none by the host
    assert bus.tasks
    assert all(task.stopped for task in bus.tasks)
    assert not logged or {source for _, cob, _, source in frames if cob == 0x80} == {"host"}


def test_a_sync_that_the_host_was_late_for_is_a_lost_row_and_setpoints_keep_their_time() -> None:
    plain, late = SocketcanBus(StubNode()), SocketcanBus(StubNode(), {260: 3e-3})
    found = []
    for bus in (plain, late):
        rows: list[Any] = []
        with CanopenDrive(bus, bus.clock, 1, "cia402", None, bus.shutdown) as drive:
            report = drive.record(motion(400, 2e-3), LIMITS, rows.append)
        found.append((report, np.array(rows)))
    (whole, all_rows), (torn, some) = found
    assert whole.lost_cycles == 0
    assert 1 <= torn.lost_cycles <= 2
    at = np.rint(some[:, 0] / 2e-3).astype(int)
    assert len(np.unique(at)) == len(at)
    np.testing.assert_allclose(some[:, 2], all_rows[at, 2], atol=1e-9)  # the setpoint of each row is that of its time


def test_a_bus_without_a_kernel_is_kept_by_the_host() -> None:
    bus = StubBus(StubNode())
    assert not sync_source._broadcast_by_kernel(bus)
    assert isinstance(sync_source.sync_source(Link(bus, bus.clock, 1), 1e-3), sync_source.HostSync)
