"""Listening: nothing that is sent writes to a drive or moves it, whatever the drive; its process data are asked for."""

from __future__ import annotations

from typing import Any

import can
import pytest

from beltcomm.drive import find_adapters
from beltcomm.drive.access import listen_to
from beltcomm.errors import BusError, UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.listening import BusListening, HeardBus
from beltcomm_adapters.virtual_node import attached

#: First bytes of an SDO request that reads: upload, its segments, and an abort (CiA 301, 7.2.4.3).
READS = (0x40, 0x60, 0x70, 0x80)
DRIVES: tuple[dict[str, Any], ...] = (
    {"profile": "reference"},
    {"profile": "cmmp-as"},
    {"as": "epos4"},
    {"as": "akd"},
    {"as": "faulhaber-mcbl"},
    {"as": "bare"},
)


def held(drive: VirtualDrive) -> dict[tuple[int, int], Any]:
    """What a drive keeps that a host could have written."""
    entries = drive._dictionary._entries
    return {place: entry.value for place, entry in entries.items() if entry.row.access in ("rw", "wo")}


@pytest.mark.parametrize("options", DRIVES, ids=str)
@pytest.mark.parametrize("node", [1, None])
def test_only_reads_are_sent_and_the_drive_is_as_it_was(options: dict[str, Any], node: int | None) -> None:
    bus = LockstepBus()
    seen: list[tuple[float, int, bytes, str]] = []
    drive, _ = attached(bus, "", options)
    before = held(drive)
    bus.on_frame = seen.append
    with BusListening(bus, [], bus.clock, node, bus.shutdown, ask=True) as listening:
        listening.frames(0.5)
    sent = [frame for frame in seen if frame[3].startswith("host")]
    assert sent
    assert all(frame[1] & ~0x7F == 0x600 and frame[3] == "host" and frame[2][0] in READS for frame in sent)
    assert any(frame[2][1:3] == b"\x00\x1a" for frame in sent)  # what its first process data hold is asked for
    assert len(before) > 20
    assert held(drive) == before


def test_who_is_silent_sends_nothing() -> None:
    seen: list[Any] = []
    bus = LockstepBus()
    attached(bus, "", {})
    bus.on_frame = seen.append
    with BusListening(bus, [], bus.clock, 1, bus.shutdown, ask=False) as listening:
        listening.frames(0.5)
    assert [frame for frame in seen if frame[3].startswith("host")] == []


def test_over_an_interface_of_python_can_another_is_heard() -> None:
    """Frames of somebody else, and their order."""
    other = can.Bus(interface="virtual", channel="listening")
    try:
        with listen_to("can:virtual:listening", {"node": 5, "silent": True}) as listening:
            for number in range(4):
                other.send(can.Message(arbitration_id=0x185, data=bytes((number,)), is_extended_id=False))
            other.send(can.Message(arbitration_id=0x705, is_remote_frame=True, is_extended_id=False))
            heard = listening.frames(0.3)
        assert [frame[2] for frame in heard if frame[1] == 0x185] == [b"\0", b"\1", b"\2", b"\3"]
        assert [frame[3] for frame in heard] == [False] * 4 + [True]
    finally:
        other.shutdown()


def test_nobody_there() -> None:
    bus = can.Bus(interface="virtual", channel="nobody")
    heard = HeardBus(bus, MonotonicClock())
    with pytest.raises(BusError, match="nobody is heard"):
        BusListening(heard, heard.heard, MonotonicClock(), None, heard.shutdown, ask=False)
    with pytest.raises(UsageError, match="no bus that can be listened to"):
        listen_to("serial:virtual")


def test_the_virtual_adapter_hears_the_answers_of_its_drive() -> None:
    adapter = next(item.adapter for item in find_adapters() if item.adapter and item.adapter.name == "virtual")
    assert adapter.listen is not None
    with adapter.listen("g_a", {"seed": 1}) as listening:
        heard = listening.frames(0.2)
    assert {frame[1] for frame in heard} >= {0x581, 0x601}
