"""The slcan text protocol, on the adapter's side: the LAWICEL CAN232 manual's commands, python-can's client, and whatever else comes in."""

from __future__ import annotations

import random

import can
import pytest

from beltcomm.errors import BusError
from beltcomm.virtual.slcan import LocalSocket, SlcanAdapter, SlcanTerminal


class Memory:
    """A line to nowhere: what is put in is read, what is written is kept, ``room`` bytes of it."""

    def __init__(self) -> None:
        self._there, self._here = LocalSocket(0), None
        self.address = "memory"
        self.coming: list[bytes | None] = []
        self.gone = b""
        self.room = 1 << 20

    def fileno(self) -> int:
        return self._there.fileno()

    def read(self) -> bytes | None:
        return self.coming.pop(0)

    def write(self, data: bytes) -> int:
        taken = data[: self.room]
        self.room -= len(taken)
        self.gone += taken
        return len(taken)

    def forget(self) -> None:
        self.gone = b""

    def close(self) -> None:
        self._there.close()


@pytest.fixture
def line(monkeypatch):
    memory = Memory()
    monkeypatch.setattr("select.select", lambda *_: ([memory], [], []) if memory.coming else ([], [], []))
    yield memory
    memory.close()


def say(adapter: SlcanAdapter, line: Memory, *chunks: bytes | None) -> bytes:
    """What the adapter answers to bytes that come in these chunks."""
    line.gone = b""
    line.coming += chunks
    frames = []
    while line.coming:
        frames.append(adapter.recv(0.0))
    return line.gone


def test_commands_are_answered_as_the_manual_says(line):
    adapter = SlcanAdapter(line)
    assert say(adapter, line, b"C\rS8\rV\rN\rF\rZ0\rO\r") == b"\r\rV1013\rNBC01\rF00\r\r\r"
    assert say(adapter, line, b"O\r") == b"\a"  # open already
    assert say(adapter, line, b"Z1\r", b"Q\r", b"hello\r") == b"\a\a\a"  # no stamps, no such commands


def test_a_frame_in_pieces_and_two_at_once(line):
    adapter = SlcanAdapter(line)
    line.coming += [b"O\r", b"t60", b"1840001000", b"00000000\rt08", b"00\rr7011\r"]
    frames = [frame for _ in range(8) if (frame := adapter.recv(0.0)) is not None]
    assert [(f.arbitration_id, bytes(f.data), f.is_remote_frame, f.dlc) for f in frames] == [
        (0x601, bytes.fromhex("4000100000000000"), False, 8),
        (0x080, b"", False, 0),
        (0x701, b"", True, 1),
    ]


def test_frames_go_out_while_the_channel_is_open_only(line):
    adapter = SlcanAdapter(line)
    message = can.Message(arbitration_id=0x181, data=b"\x01\xff", is_extended_id=False)
    adapter.send(message)
    assert line.gone == b""
    say(adapter, line, b"O\r")
    line.gone = b""
    adapter.send(message)
    assert line.gone == b"t181201FF\r"
    say(adapter, line, b"C\r")
    adapter.send(message)
    assert line.gone == b"\r"
    assert say(adapter, line, b"L\rt0800\r") == b"\r\a"  # listening only
    say(adapter, line, None)  # the host has gone
    line.gone = b""
    adapter.send(message)
    assert line.gone == b""


def test_a_host_that_does_not_read_loses_frames_and_none_is_cut(line):
    adapter = SlcanAdapter(line)
    say(adapter, line, b"O\r")
    line.gone, line.room = b"", 25
    message = can.Message(arbitration_id=0x181, data=bytes(8), is_extended_id=False)
    for _ in range(4000):
        adapter.send(message)
    assert adapter.lost > 0
    line.room = 1 << 20
    adapter.send(message)
    adapter.recv(0.0)
    text = line.gone.split(b"\r")
    assert set(text) == {b"t1818" + b"0" * 16, b""}
    assert len(text) - 1 + adapter.lost in (4000, 4001)


@pytest.mark.parametrize(
    "wrong",
    ["t", "t6", "t601", "t6018", "t60189", "t8000", "t60180102", "t601Z", "T12345", "tXYZ1AA", "r", "R123456789", "t6019" + "00" * 9],
)
def test_a_wrong_frame_is_refused(line, wrong):
    adapter = SlcanAdapter(line)
    assert say(adapter, line, b"O\r") == b"\r"
    assert say(adapter, line, wrong.encode() + b"\r") == b"\a"


def test_no_bytes_raise_anything(line):
    """20000 lines of noise, half of them near to what is right."""
    adapter = SlcanAdapter(line)
    random_ = random.Random(1)
    for _ in range(20000):
        length = random_.randrange(40)
        noise = bytes(random_.choice(b"tTrROCSVNFLZ0123456789ABCDEFabcdef\r\r\n\a\x00\xff") for _ in range(length))
        line.coming.append(noise if random_.random() < 0.99 else None)
        frame = adapter.recv(0.0)
        if frame is not None:
            assert frame.arbitration_id < 1 << 29
            assert len(frame.data) <= 8


def pty() -> SlcanTerminal:
    try:
        return SlcanTerminal()
    except BusError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("make", [pty, lambda: LocalSocket(0)], ids=["pseudo-terminal", "tcp"])
def test_the_stock_client_and_another_one_after_it(make):
    line = make()
    adapter = SlcanAdapter(line)
    for _ in range(2):
        with can.Bus(interface="slcan", channel=line.address, bitrate=1_000_000, sleep_after_open=0.0) as host:
            host.send(can.Message(arbitration_id=0x601, data=b"\x40\x00\x10\x00\0\0\0\0", is_extended_id=False))
            host.send(can.Message(arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False))
            got = [frame for _ in range(30) if (frame := adapter.recv(0.05)) is not None]
            assert [(frame.arbitration_id, frame.is_remote_frame) for frame in got] == [(0x601, False), (0x701, True)]
            adapter.send(can.Message(arbitration_id=0x701, data=b"\x7f", is_extended_id=False))
            answer = host.recv(5.0)
            assert (answer.arbitration_id, bytes(answer.data)) == (0x701, b"\x7f")
        assert adapter.recv(0.1) is None
    adapter.shutdown()


def test_a_port_in_use_is_said_so():
    first = LocalSocket(0)
    with pytest.raises(BusError, match="choose another one"):
        LocalSocket(int(first.address.rpartition(":")[2]))
    first.close()
