"""Loggers that lose SYNCs, exchange frames, or whose clock goes elsewhere and comes back: each row keeps its position, torque and time."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.foreign.timestamps import joined_counter
from beltcomm.runfolder import RunFolder
from marks import quick

Frame = tuple[float, int, bytes]
NODE, COUNTS, RATED_NM = 9, 10_000, 2.0
PERIOD, ROWS, REST = 2e-3, 1500, 60


def download(index: int, subindex: int, value: int, size: int) -> list[Frame]:
    command = {4: 0x23, 2: 0x2B, 1: 0x2F}[size]
    asked = struct.pack("<BHB", command, index, subindex) + value.to_bytes(size, "little").ljust(4, b"\0")
    return [(0.0, 0x600 + NODE, asked), (0.0, 0x580 + NODE, struct.pack("<BHBI", 0x60, index, subindex, 0))]


def upload(index: int, subindex: int, value: int) -> list[Frame]:
    asked = struct.pack("<BHBI", 0x40, index, subindex, 0)
    return [(0.0, 0x600 + NODE, asked), (0.0, 0x580 + NODE, struct.pack("<BHBI", 0x43, index, subindex, value))]


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Position in counts and torque in thousandths by row, of a mass on which a multisine acts."""
    t = PERIOD * np.arange(ROWS)
    phases = [(3, 0.0), (5, 1.3), (8, 2.9), (13, 4.2)]
    torque = np.round(sum(60.0 * np.sin(2 * np.pi * f * t / 0.5 / 2 + p) for f, p in phases))
    speed = np.cumsum(torque * 1e-3 * RATED_NM * PERIOD / 2e-4)
    speed -= np.linspace(speed[0], speed[-1], ROWS) - 30.0
    return np.round(COUNTS / (2 * np.pi) * np.cumsum(speed) * PERIOD).astype(int), torque.astype(int)


def frames(counts_in_one: int = 1) -> list[Frame]:
    """A log of one move; of a coarse encoder when several counts are one."""
    made = upload(0x608F, 1, COUNTS) + upload(0x608F, 2, 1) + upload(0x6076, 0, round(1000 * RATED_NM))
    for number, entries in ((0, [(0x6041, 16), (0x6064, 32)]), (1, [(0x6077, 16)])):
        for k, (index, bits) in enumerate(entries, start=1):
            made += download(0x1A00 + number, k, index << 16 | bits, 4)
        made += download(0x1A00 + number, 0, len(entries), 1)
    made += download(0x6060, 0, 4, 1)
    made = [(1e-4 * k, *frame[1:]) for k, frame in enumerate(made)]
    position, torque = truth()
    begin = 0.02
    for row in range(-REST, ROWS + REST):
        k, on = min(max(row, 0), ROWS - 1), 0 <= row < ROWS
        t = begin + PERIOD * (row + REST)
        status = 0x1237 if on else 0x1231
        # the torque that is reported at a SYNC is that of the period just ended
        reported = int(torque[k - 1]) if 0 < row < ROWS else 0
        made += [
            (t, 0x80, b""),
            (t + 2e-4, 0x180 + NODE, struct.pack("<Hi", status, int(position[k]) // counts_in_one)),
            (t + 4e-4, 0x280 + NODE, struct.pack("<h", reported)),
        ]
    return made


def imported(folder: Path, log: list[Frame]) -> tuple[str, list[Any]]:
    path = folder / "a.log"
    path.write_text("".join(f"({t:.6f}) can0 {i:03X}#{d.hex().upper()}\n" for t, i, d in log), encoding="utf-8")
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(folder / "run"), "--set", "name=stranger"])
    assert outcome.exit_code == 0, outcome.output
    return outcome.output, RunFolder.open(folder / "run").recordings()


def check(record: Any, fewest: float, slack: float = 0.1) -> None:
    """Each row has the position and the torque of its time, and most rows are there."""
    position, torque = truth()
    found = np.round(record.position * COUNTS / (2 * np.pi)).astype(int)
    first = int(np.flatnonzero(position == found[0])[0])
    rows = (record.t_s - record.t_s[0]) / PERIOD + first
    assert np.abs(rows - np.round(rows)).max() < slack
    at = np.round(rows).astype(int)
    np.testing.assert_array_equal(found, position[at])
    inner = slice(0, -1)
    np.testing.assert_array_equal(np.round(record.torque * 1000 / RATED_NM)[inner].astype(int), torque[at][inner])
    assert len(found) >= fewest * ROWS


def is_sync(frame: Frame) -> bool:
    return frame[1] == 0x80


def test_as_it_is(tmp_path: Path) -> None:
    output, records = imported(tmp_path, frames())
    assert len(records) == 1
    check(records[0], 0.99)
    assert "SYNCs are not" not in output


@pytest.mark.parametrize("every", quick([37, 301], 1))
def test_a_lost_sync_gives_its_row_to_none_other(every: int, tmp_path: Path) -> None:
    kept = [f for k, f in enumerate(frames()) if not (is_sync(f) and k % every == 0)]
    lost = len(frames()) - len(kept)
    output, records = imported(tmp_path, kept)
    assert len(records) == 1
    check(records[0], 0.99, 0.2)
    assert f"{lost} SYNCs are not in the log" in output


def test_lost_pdos_cost_their_rows_alone(tmp_path: Path) -> None:
    kept = [f for k, f in enumerate(frames()) if k < 100 or k % 53]
    output, records = imported(tmp_path, kept)
    assert len(records) == 1
    check(records[0], 0.94, 0.2)
    assert "not in the log" in output
    assert "left out" in output


@pytest.mark.parametrize("coarse", [1e-6, 1e-3])
def test_frames_that_changed_places(coarse: float, tmp_path: Path) -> None:
    """With their stamps, that a controller gave before its queues exchanged them, or with stamps too coarse to tell."""
    log = frames()
    for k in range(120, len(log) - 1, 40):  # a SYNC and the frame before it, or a PDO and the next one
        log[k], log[k + 1] = log[k + 1], log[k]
    _, records = imported(tmp_path, [(np.floor(t / coarse + 1e-6) * coarse, *f) for t, *f in log])  # type: ignore[misc]
    assert len(records) == 1
    check(records[0], 0.97, 0.6)


def test_a_drive_that_answers_every_second_sync(tmp_path: Path) -> None:
    """Rows are the SYNCs that it answers; the torque that it reports had no row, and the record none."""
    log = frames()
    begin = next(k for k, f in enumerate(log) if is_sync(f))
    kept = [f for k, f in enumerate(log) if k < begin or is_sync(f) or (k - begin) // 3 % 2 == 0]
    _, records = imported(tmp_path, kept)
    assert len(records) == 1
    record, (position, torque) = records[0], truth()
    np.testing.assert_allclose(np.diff(record.t_s), 2.0 * PERIOD, atol=1e-6)
    found = np.round(record.position * COUNTS / (2 * np.pi)).astype(int)
    first = int(np.flatnonzero(position == found[0])[0])
    np.testing.assert_array_equal(found, position[first::2][: len(found)])
    reported = np.round(record.torque * 1000 / RATED_NM).astype(int)
    np.testing.assert_array_equal(reported[:-2], torque[first + 1 :: 2][: len(reported) - 2])
    assert len(found) > 0.49 * ROWS


def elsewhere_at_zero(t: np.ndarray) -> np.ndarray:
    return np.where((t > 0.8) & (t < 1.6), 0.0, t)


def backwards(t: np.ndarray) -> np.ndarray:
    return np.where((t > 0.8) & (t < 1.6), 1.6 - t, t)


def another_hour(t: np.ndarray) -> np.ndarray:
    return np.where((t > 0.8) & (t < 1.6), t + 3600.0, t)


def stood_before_the_first_row(t: np.ndarray) -> np.ndarray:
    return np.where(t < 1.6, 0.0, t + 0.09)


def lost_part_of_a_period(t: np.ndarray) -> np.ndarray:
    return np.where(t < 0.9004, t, np.where(t < 1.6013, 0.9004, t - 0.7009))


CLOCKS = [elsewhere_at_zero, backwards, another_hour, stood_before_the_first_row, lost_part_of_a_period]


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_clock_that_comes_back_cuts_no_move(clock: Any, tmp_path: Path) -> None:
    log = frames()
    stamps = clock(np.array([t for t, *_ in log]))
    output, records = imported(tmp_path, [(float(s), i, d) for s, (_, i, d) in zip(stamps, log, strict=True)])
    assert len(records) == 1, output
    check(records[0], 0.99, 0.45)
    assert "no row came while the axis moved" not in output


def test_single_rows_of_a_motion_are_not_told_as_rest(tmp_path: Path) -> None:
    """A clock that goes back again and again without ever coming back: what that cuts away is counted as short stretches."""
    log = frames(counts_in_one=80)  # too coarse to show that the motion goes on evenly
    stamps = np.array([t for t, *_ in log])
    torn = np.flatnonzero((stamps > 0.8) & (stamps < 1.0))
    for k in torn[::9].tolist():
        stamps[k:] -= 0.7
    output, records = imported(tmp_path, [(float(s), i, d) for s, (_, i, d) in zip(stamps, log, strict=True)])
    taken = sum(len(r.torque) for r in records)
    balance = re.search(r"(\d+) with the stage off or at rest, (\d+) in stretches that are shorter", output)
    assert balance is not None
    assert int(balance[2]) == pytest.approx(ROWS - taken, abs=5)
    assert int(balance[1]) == pytest.approx(2 * REST, abs=5)


@pytest.mark.parametrize(("unit", "ticks"), [(1e-6, 1.0), (1e-3, 1e-3), (1.0, 1e-6)])
def test_a_counter_of_microseconds_in_any_unit_is_joined(unit: float, ticks: float) -> None:
    """A table's time in s or ms that a 32-bit counter of microseconds made went back by 4294.97 s, "another record begins there"."""
    span = 2.0**32 * ticks
    true = np.arange(3000) * 1e-3 / unit
    joined, words = joined_counter((true + span - true[2000]) % span)
    np.testing.assert_allclose(np.diff(joined), 1e-3 / unit, rtol=1e-4)
    assert "32 bits" in words


@pytest.mark.parametrize("back_s", [0.4, 3600.0, 4294.0])
def test_a_clock_that_was_set_is_no_counter(back_s: float) -> None:
    stamps = np.arange(3000) * 1e-3 + 5000.0
    stamps[1500:] -= back_s
    assert joined_counter(stamps)[1] == ""
