"""Logs of CAN frames in every format that is read, told by their content whatever they are called; CAN FD alone is told as such."""

from __future__ import annotations

import gzip
import sys
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.foreign.framelines import kind_of_log
from beltcomm.foreign.framelog import read_frames

START_S = 1_714_737_600


def frames(remote: bool = True) -> list[can.Message]:
    random = np.random.default_rng(3)
    made = []
    for k in range(300):
        length, extended = int(random.integers(0, 9)), bool(random.random() < 0.2)
        identifier = int(random.integers(1, 1 << 29 if extended else 1 << 11))
        asked = remote and bool(random.random() < 0.1)
        data = b"" if asked else random.integers(0, 256, length, dtype=np.uint8).tobytes()
        made.append(
            can.Message(
                timestamp=START_S + 1e-6 * round(1234.0 * k), arbitration_id=identifier, is_extended_id=extended, is_remote_frame=asked,
                data=data, dlc=0 if asked else length, channel=0, is_rx=True,
            )
        )  # fmt: skip
    return made


def hexed(message: can.Message) -> str:
    return f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"


def candump(messages: list[can.Message], *, absolute: bool = False) -> str:
    lines = []
    for m in messages:
        micros = round((m.timestamp - START_S) * 1e6)
        if absolute:
            stamp = str(np.datetime64(START_S, "s").astype("datetime64[us]") + np.timedelta64(micros, "us")).replace("T", " ")
            content = "remote request" if m.is_remote_frame else " ".join(f"{byte:02X}" for byte in m.data)
            lines.append(f" ({stamp if '.' in stamp else stamp + '.000000'})  can0  {hexed(m)}   [{len(m.data)}]  {content}")
        else:
            lines.append(f"({START_S}.{micros:06d}) can0 {hexed(m)}#{'R' if m.is_remote_frame else m.data.hex().upper()}")
    return "\n".join(lines) + "\n"


def asc(messages: list[can.Message]) -> str:
    lines = [
        "date Fri May  3 12:00:00 2024",
        "base hex  timestamps absolute",
        "internal events logged",
        "// version 9.0.0",
        "Begin Triggerblock",
    ]
    for m in messages:
        kind = "r" if m.is_remote_frame else f"d {len(m.data):x} " + " ".join(f"{byte:02X}" for byte in m.data)
        identifier = f"{m.arbitration_id:X}{'x' if m.is_extended_id else ''}"
        lines.append(f"{m.timestamp - START_S:11.6f} 1  {identifier:15s} Rx   {kind}")
    return "\n".join([*lines, "End TriggerBlock"]) + "\n"


def savvycan(messages: list[can.Message], *, direction: bool) -> str:
    lines = [
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"
        if direction
        else "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"
    ]
    for m in messages:
        bytes_ = "".join(f"{byte:02X}," for byte in m.data)
        way, extended = "Rx," if direction else "", str(m.is_extended_id).lower()
        lines.append(f"{round(m.timestamp * 1e6)},{m.arbitration_id:08X},{extended},{way}0,{len(m.data)},{bytes_}")
    return "\n".join(lines) + "\n"


def by_python_can(name: str) -> Callable[[Path, list[can.Message]], None]:
    def write(path: Path, messages: list[can.Message]) -> None:
        with can.Logger(path.with_suffix(name)) as logger:
            for message in messages:
                logger(message)
        path.with_suffix(name).rename(path)

    return write


def text(content: Callable[[list[can.Message]], str], *, packed: bool = False) -> Callable[[Path, list[can.Message]], None]:
    def write(path: Path, messages: list[can.Message]) -> None:
        made = content(messages).encode()
        path.write_bytes(gzip.compress(made) if packed else made)

    return write


KINDS = {
    "candump -L": ("a.log", text(candump), True),
    "candump -L, packed": ("a.log.gz", text(candump, packed=True), True),
    "candump -t A": ("a.txt", text(lambda m: candump(m, absolute=True)), True),
    "Vector .asc": ("a.asc", text(asc), True),
    "Vector .asc, packed": ("a.asc.gz", text(asc, packed=True), True),
    "Vector .asc called .txt": ("a.txt", text(asc), True),
    "Vector .blf": ("a.blf", by_python_can(".blf"), True),
    "Vector .blf called .dat": ("a.dat", by_python_can(".blf"), True),
    "PEAK .trc": ("a.trc", by_python_can(".trc"), False),
    "PEAK .trc called .log": ("a.log", by_python_can(".trc"), False),
    "SavvyCAN CSV": ("a.csv", text(lambda m: savvycan(m, direction=True)), False),
    "SavvyCAN CSV, first version": ("a.csv", text(lambda m: savvycan(m, direction=False)), False),
    "python-can CSV": ("a.csv", by_python_can(".csv"), True),
    "python-can SQLite": ("a.db", by_python_can(".db"), True),
}


@pytest.mark.parametrize("name", KINDS)
def test_frames_are_the_same_whatever_wrote_them(name: str, tmp_path: Path) -> None:
    file, write, remote = KINDS[name]
    messages = frames(remote)
    write(tmp_path / file, messages)
    assert kind_of_log(tmp_path / file) is not None
    log = read_frames(tmp_path / file)
    sys.stdout.write(f"{name:30s} {len(log.t_s)} of {len(messages)} frames\n")
    assert [int(i) & 0x7FFFFFFF for i in log.identifier] == [m.arbitration_id for m in messages]
    assert [bool(i & 1 << 31) for i in log.identifier] == [m.is_extended_id for m in messages]
    assert [bytes(d[:n]) for d, n in zip(log.data, log.length, strict=True)] == [bytes(m.data) for m in messages]
    assert log.remote.tolist() == [m.is_remote_frame for m in messages]
    np.testing.assert_allclose(log.t_s, [m.timestamp - messages[0].timestamp for m in messages], atol=2e-6 if "trc" not in name else 1e-4)


def shown(messages: list[can.Message], flags: str = "", colour: str = "") -> str:
    """As ``candump -t d`` shows frames: the time since the one before."""
    lines, last = [], messages[0].timestamp
    for m in messages:
        since, last = m.timestamp - last, m.timestamp
        lines.append(f"{colour} ({since:010.6f})  can0  {flags}{hexed(m)}   [{len(m.data)}]  " + " ".join(f"{b:02X}" for b in m.data))
    return "\n".join(lines) + "\n"


ODD = {
    "even times between frames": (shown, "utf-8"),
    "candump -x": (lambda m: shown(m, flags="RX - -  "), "utf-8"),
    "in colours": (lambda m: shown(m, colour="\x1b[34m"), "utf-8"),
    "candump -L with a mark of UTF-8": (candump, "utf-8-sig"),
    "candump -L redirected by PowerShell": (candump, "utf-16"),
    "Vector .asc with a mark of UTF-8": (asc, "utf-8-sig"),
    "SavvyCAN with a mark of UTF-8": (lambda m: savvycan(m, direction=True), "utf-8-sig"),
}


@pytest.mark.parametrize("name", ODD)
def test_an_odd_way_of_writing_costs_no_frame(name: str, tmp_path: Path) -> None:
    content, encoding = ODD[name]
    messages = frames(remote=False)
    (tmp_path / "a.log").write_bytes(content(messages).encode(encoding))
    assert kind_of_log(tmp_path / "a.log") is not None
    log = read_frames(tmp_path / "a.log")
    assert [int(i) & 0x7FFFFFFF for i in log.identifier] == [m.arbitration_id for m in messages]
    assert [bytes(d[:n]) for d, n in zip(log.data, log.length, strict=True)] == [bytes(m.data) for m in messages]
    np.testing.assert_allclose(log.t_s, [m.timestamp - messages[0].timestamp for m in messages], atol=2e-6 * len(messages))


FD = {
    "candump": "\n".join(f"({START_S}.{k:06d}) can0 181##1{'00' * 12}" for k in range(50)),
    "asc": "date Fri May  3 12:00:00 2024\nbase hex  timestamps absolute\n"
    + "\n".join(
        f" {0.001 * k:.6f} CANFD   1 Rx        181                                   1 0 9 12 {'00 ' * 12}    0    0" for k in range(50)
    ),
}


@pytest.mark.parametrize("kind", FD)
def test_a_log_of_can_fd_alone_is_told_as_such(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(FD[kind], encoding="utf-8")
    assert kind_of_log(tmp_path / "a.log") is not None
    with pytest.raises(DataError, match="holds 50 CAN FD frames and no classic one"):
        read_frames(tmp_path / "a.log")


def test_a_damaged_line_costs_that_line(tmp_path: Path) -> None:
    lines = candump(frames()).splitlines()
    lines[40], lines[41] = lines[40][:25], "\x00\x01" + lines[41]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n", encoding="utf-8")
    log = read_frames(tmp_path / "a.log")
    assert (len(log.t_s), log.in_file) == (298, 300)
    assert any("2 lines that are no classic CAN frames left out, the first is line 41" in note for note in log.notes)


def test_a_table_called_asc_is_a_table(tmp_path: Path) -> None:
    (tmp_path / "a.asc").write_text("t torque position\n" + "\n".join(f"{0.001 * k:.3f} 0.5 {k}" for k in range(50)), encoding="utf-8")
    assert kind_of_log(tmp_path / "a.asc") is None
