"""The same frames in every kind of log, and logs that are torn."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest

from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.framelines import kind_of_log
from beltcomm.foreign.framelog import FrameLog, read_frames
from foreign.samples import write

EPOCH = 1_700_000_000.0
FRAMES = [
    can.Message(EPOCH + 1e-3 * k, identifier, extended, remote, data=data if not remote else None, dlc=len(data), channel=0)
    for k, (identifier, extended, remote, data) in enumerate(
        [
            (0x80, False, False, b""),
            (0x181, False, False, bytes(range(8))),
            (0x701, False, True, b""),
            (0x18FF1234, True, False, b"\x01\x80\xff"),
        ]
        * 3
    )
]


def same(log: FrameLog, remote: bool = True) -> None:
    """remote : python-can's reader of .trc files leaves out remote frames."""
    frames = [m for m in FRAMES if remote or not m.is_remote_frame]
    np.testing.assert_allclose(log.t_s, [m.timestamp - EPOCH for m in frames], atol=1.1e-6)
    assert log.identifier.tolist() == [m.arbitration_id | (m.is_extended_id << 31) for m in frames]
    assert log.remote.tolist() == [m.is_remote_frame for m in frames]
    payloads = [b"" if m.is_remote_frame else bytes(m.data) for m in frames]
    assert [d[:n].tobytes() for d, n in zip(log.data, log.length, strict=True)] == payloads


@pytest.mark.parametrize(
    ("ending", "writer"), [("asc", can.ASCWriter), ("blf", can.BLFWriter), ("trc", can.TRCWriter), ("log", can.CanutilsLogWriter)]
)
def test_what_python_can_writes(tmp_path: Path, ending: str, writer: type) -> None:
    path = tmp_path / f"a.{ending}"
    with writer(str(path)) as file:
        for message in FRAMES:
            file.on_message_received(message)
    assert kind_of_log(path)
    same(read_frames(path), remote=ending != "trc")


def shown(stamps: list[str]) -> str:
    """As candump shows frames."""
    lines = []
    for stamp, m in zip(stamps, FRAMES, strict=True):
        name = f"{m.arbitration_id:08X}" if m.is_extended_id else f"{m.arbitration_id:03X}"
        payload = "remote request" if m.is_remote_frame else " ".join(f"{byte:02X}" for byte in m.data)
        lines.append(f" {stamp}  can0  {name}   [{len(m.data)}]  {payload}")
    return "\n".join(lines) + "\n"


def test_candump_as_it_is_shown_with_absolute_difference_and_no_stamps(tmp_path: Path) -> None:
    same(read_frames(write(tmp_path / "a.txt", shown([f"({m.timestamp:.6f})" for m in FRAMES]))))
    steps = [0.0] + [1.5e-3 if k % 2 else 0.5e-3 for k in range(1, len(FRAMES))]
    log = read_frames(write(tmp_path / "d.txt", shown([f"({step:010.6f})" for step in steps])))
    np.testing.assert_allclose(log.t_s, np.cumsum(steps), atol=1e-12)
    assert "times between frames" in log.notes[0]
    assert np.isnan(read_frames(write(tmp_path / "n.txt", shown([""] * len(FRAMES)))).t_s).all()


def test_two_interfaces_are_kept_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "a.log", "".join(f"({k}.5) can{k % 3 == 0:d} {0x100 + k:X}#00\n" for k in range(20)))
    log = read_frames(path)
    assert len(log.t_s) == 13
    assert "only the frames of can0 are taken, not those of can1" in log.notes[0]
    assert read_frames(path, "can1").identifier.tolist() == [0x100 + k for k in range(0, 20, 3)]
    with pytest.raises(UsageError, match="no frames of the interface 'can7'; it has can0, can1"):
        read_frames(path, "can7")


def test_lines_that_are_no_frames_are_counted_and_a_torn_end_is_no_loss(tmp_path: Path) -> None:
    good = [f"(1.{k:06d}) can0 181#{k:016X}" for k in range(50)]
    content = "\n".join([*good[:10], "(1.000010) can0 181##1112233", "interface up", *good[10:], "(1.0000"])
    log = read_frames(write(tmp_path / "a.log", content))
    assert len(log.t_s) == 50
    assert log.notes == ("3 lines that are no classic CAN frames left out, the first is line 11",)
    with pytest.raises(DataError, match="holds no CAN frames"):
        read_frames(write(tmp_path / "b.asc", "date Mon\nbase hex\n"))


def test_stamps_do_not_lose_their_microseconds_nor_turn(tmp_path: Path) -> None:
    lines = [f"({1_699_999_999 + k // 10**6}.{k % 10**6:06d}) can0 080#" for k in range(999_000, 1_003_000, 1000)]
    log = read_frames(write(tmp_path / "a.log", "\n".join(lines)))
    np.testing.assert_array_equal(log.t_s, [0.0, 0.001, 0.002, 0.003])


def test_a_table_is_no_log(tmp_path: Path) -> None:
    assert not kind_of_log(write(tmp_path / "a.csv", "t,x\n1,2\n3,4\n"))
    assert not kind_of_log(write(tmp_path / "b.csv", ""))
