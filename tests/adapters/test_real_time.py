"""The same drive on a bus of python-can and on the monotonic clock, with the node in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import can
import numpy as np
import pytest

from adapters.stub_node import INERTIA_KG_M2, StubNode
from beltcomm.drive import Limits, Motion, Row, open_drive
from beltcomm.errors import BusError

#: Long enough for the scheduling of a busy machine: medians are 0.2 ms, tails several ms.
T = 0.02


@pytest.fixture
def node() -> Iterator[StubNode]:
    """A node on the channel ``stub`` of python-can's virtual interface."""
    node, running = StubNode(), True

    def serve() -> None:
        with can.Bus(interface="virtual", channel="stub") as bus:
            while running:
                frame = bus.recv(0.01)
                if frame is not None:
                    node.receive(frame, time.monotonic())
                while node.out:
                    cob_id, data = node.out.popleft()
                    bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    thread = threading.Thread(target=serve)
    thread.start()
    yield node
    running = False
    thread.join()


def test_a_record_in_real_time(node):
    rows: list[Row] = []
    n = 25
    torque = np.where(np.arange(n) < 12, 0.01, -0.01)
    with open_drive("can:virtual:stub", {"node": 1, "sample_period": T}) as drive:
        began_s = drive.clock.now()
        motion = Motion("torque", T, np.zeros(n), np.zeros(n), torque)
        report = drive.record(motion, Limits(-10, 10, 50, 0.5), rows.append)
        assert drive.clock.now() - began_s >= n * T
    table = np.array(rows)
    assert report.rows == len(rows) >= n - 2 * report.lost_cycles
    assert np.median(np.diff(table[:, 0])) == pytest.approx(T, rel=0.1)
    # Newton over the whole record, with the stamps as they came; to one period of the acceleration of 10 rad/s²
    gained = float((table[:-1, 1] * np.diff(table[:, 0])).sum()) / INERTIA_KG_M2
    if report.lost_cycles == 0:
        assert table[-1, 4] - table[0, 4] == pytest.approx(gained, abs=10.0 * T)


def test_nobody_there_is_noticed_in_a_second():
    began_s = time.monotonic()
    with pytest.raises(BusError, match="no node answers"):
        open_drive("can:virtual:empty")
    assert time.monotonic() - began_s < 3.0
