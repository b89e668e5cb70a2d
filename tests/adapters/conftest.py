"""Drives on a stub bus, closed after each test."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from adapters.stub_node import StubBus, StubNode
from beltcomm_adapters.canopen import CanopenDrive, connect


@pytest.fixture
def opened() -> Iterator[Callable[..., CanopenDrive]]:
    """``opened(node, profile=None)``: the drive on a stub bus of its own."""
    drives = []

    def open_one(node: StubNode, profile: str | None = None) -> CanopenDrive:
        bus = StubBus(node)
        drives.append(connect(bus, bus.clock, 1, profile, None, bus.shutdown))
        return drives[-1]

    yield open_one
    for drive in drives:
        drive.close()
