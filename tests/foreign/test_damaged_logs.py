"""Logs of frames that strangers have: damaged lines, two buses, two drives, holes, files that overlap. No move is lost without a word."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from beltcomm.virtual.bus import Frame
from foreign.buslog import Logged, logged
from foreign.test_logclock import ROWS, ascii_log, check_three, imported, line, text
from marks import quick

EPOCH = 1_436_509_052.0
#: A frame in the middle of the first move.
INSIDE = 9001


@pytest.fixture(scope="module")
def three() -> Logged:
    return logged()


def stamps_of(frames: Sequence[Frame]) -> np.ndarray:
    return np.array([frame[0] for frame in frames])


def peak_trace(frames: Sequence[Frame], stamps: np.ndarray) -> str:
    """As PEAK's tools write it, version 1.1."""
    lines = [";$FILEVERSION=1.1", ";$STARTTIME=42195.2621759"]
    for k, (t, (_, identifier, data, source)) in enumerate(zip(stamps, frames, strict=True), start=1):
        shown = "RTR" if "rtr" in source else " ".join(f"{byte:02X}" for byte in data)
        lines.append(f"{k:7d}){1e3 * t:12.1f}  Rx     {identifier:04X}  {len(data)}  {shown}")
    return "\n".join(lines) + "\n"


def half(lines: list[str]) -> list[str]:
    return [*lines[:INSIDE], lines[INSIDE][: len(lines[INSIDE]) // 2], *lines[INSIDE + 1 :]]


def glued(lines: list[str]) -> list[str]:
    return [*lines[:INSIDE], lines[INSIDE][: len(lines[INSIDE]) // 2] + lines[INSIDE + 1], *lines[INSIDE + 2 :]]


def other_bytes(lines: list[str]) -> list[str]:
    return [*lines[:INSIDE], "@@%$ \0\1 " + lines[INSIDE][5:20], *lines[INSIDE + 1 :]]


def torn_off(lines: list[str]) -> list[str]:
    return [*lines[:-1], lines[-1][:-7]]


@pytest.mark.parametrize("damage", [half, glued, other_bytes, torn_off])
@pytest.mark.parametrize("ending", ["log", "asc", "trc"])
def test_a_damaged_line_costs_a_row_and_is_counted(
    damage: Callable[[list[str]], list[str]], ending: str, three: Logged, tmp_path: Path
) -> None:
    """Which frame the line held differs with the kind of file; no frame of one row may cost the move."""
    frames, t = three.frames, stamps_of(three.frames)
    if ending == "trc":
        pytest.importorskip("can")
    written = {"log": lambda: text(frames, EPOCH + t), "asc": lambda: ascii_log(frames, t), "trc": lambda: peak_trace(frames, t)}[ending]()
    outcome, run = imported(tmp_path, f"a.{ending}", "\n".join(damage(written.splitlines())) + "\n", "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    found = [len(record.torque) for record in run.recordings()]
    assert len(found) == 3
    assert sum(ROWS) - 3 <= sum(found) <= sum(ROWS)
    assert "no classic CAN frames left out" in outcome.output
    assert run.recordings()[0].sidecar.start_position_m == 0.25


def test_a_signal_missing_in_one_row_costs_that_row(three: Logged, tmp_path: Path) -> None:
    frames = list(three.frames)
    speeds = [k for k, frame in enumerate(frames) if frame[1] == 0x281]
    del frames[speeds[2000]]
    outcome, run = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert outcome.exit_code == 0, outcome.output
    assert [len(record.torque) for record in run.recordings()] == [ROWS[0] - 1, *ROWS[1:]]
    assert "1 rows without" in outcome.output


def test_syncs_without_a_position_are_counted(three: Logged, tmp_path: Path) -> None:
    """As where a damaged set-up leaves a PDO unknown, or the bus was too full."""
    frames = [frame for frame in three.frames if not (frame[1] == 0x181 and 4.4 <= frame[0] < 4.5)]
    gone = sum(frame[1] == 0x181 for frame in three.frames) - sum(frame[1] == 0x181 for frame in frames)
    outcome, _ = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert outcome.exit_code == 0, outcome.output
    assert f"{gone} of {sum(frame[1] == 0x80 for frame in frames)} SYNCs came without a position" in outcome.output


def test_a_hole_in_motion_is_told(three: Logged, tmp_path: Path) -> None:
    frames = [frame for frame in three.frames if not 2.0 <= frame[0] < 2.3]
    outcome, run = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert outcome.exit_code == 0, outcome.output
    assert len(run.recordings()) == 4
    assert "in 1 places no row came while the axis moved, the longest 0.301 s" in outcome.output


def test_a_hole_as_long_as_a_move_is_told(three: Logged, tmp_path: Path) -> None:
    """The second move and the rests beside it are gone; the axis stands elsewhere behind it."""
    frames = [frame for frame in three.frames if not 4.25 <= frame[0] < 4.94]
    outcome, run = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert outcome.exit_code == 0, outcome.output
    assert len(run.recordings()) == 2
    assert "in 1 places no row came while the axis moved, the longest 0.69" in outcome.output


@pytest.mark.parametrize("swapped", [False, True])
def test_two_files_whose_clocks_begin_at_zero(swapped: bool, three: Logged, tmp_path: Path) -> None:
    """In their order the start is the first move's; where the drive boots in the second file, that may be another one."""
    frames, t = three.frames, stamps_of(three.frames)
    cut = int(np.searchsorted(t, 4.31))
    stamps = np.concatenate((t[:cut], t[cut:] - t[cut]))
    order = [*range(cut, len(t)), *range(cut)] if swapped else list(range(len(t)))
    content = text([frames[k] for k in order], stamps[order])
    outcome, run = imported(tmp_path, "a.log", content, "--start-position", "250mm")
    if swapped:
        assert outcome.exit_code == 3
        assert "what stands behind a clock that goes back" in outcome.output
        return
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)


def test_a_log_that_begins_in_a_move_says_so(three: Logged, tmp_path: Path) -> None:
    first = next(frame[0] for frame in three.frames if frame[1] == 0x80)
    frames = [frame for frame in three.frames if frame[0] < first or frame[0] >= 2.0]
    outcome, run = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert outcome.exit_code == 0, outcome.output
    assert len(run.recordings()) == 3
    assert "the first rows are in motion already" in outcome.output


def with_other_bus(frames: Sequence[Frame], size: int) -> str:
    """The drive's bus as can0, and traffic of something else on can1."""
    chance = np.random.default_rng(3)
    lines = [(frame[0], line(EPOCH + frame[0], frame)) for frame in frames]
    for t in chance.uniform(0.0, frames[-1][0], size):
        content = "".join(f"{byte:02X}" for byte in chance.integers(0, 256, 8))
        lines.append((float(t), f"({EPOCH + t:.6f}) can1 {chance.integers(0x100, 0x7FF):03X}#{content}"))
    return "\n".join(text for _, text in sorted(lines, key=lambda item: item[0])) + "\n"


def test_the_drive_s_bus_is_taken_though_another_is_busier(three: Logged, tmp_path: Path) -> None:
    content = with_other_bus(three.frames, 2 * len(three.frames))
    outcome, run = imported(tmp_path, "a.log", content, "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "only the frames of can0 are taken, not those of can1" in outcome.output


def second_drive(frames: Sequence[Frame], shift: int) -> list[Frame]:
    """The traffic of another node that did the same, its identifiers as its own set-up says them."""
    found = []
    for t, identifier, data, source in frames:
        if not (0x80 < identifier < 0x780 and identifier % 0x80 == 1):
            continue
        if identifier in (0x581, 0x601) and data[1:4] in [bytes((low, high, 1)) for low in (0, 1, 2) for high in (0x14, 0x18)]:
            carried = int.from_bytes(data[4:8], "little")
            data = data[:4] + (carried + shift if carried & 0x7FF else carried).to_bytes(4, "little")
        found.append((t + 40e-6, identifier + shift, data, source))
    return found


def test_another_drive_in_the_log_is_told(three: Logged, tmp_path: Path) -> None:
    both = sorted([*three.frames, *second_drive(three.frames, 1)], key=lambda frame: frame[0])
    outcome, run = imported(tmp_path, "a.log", text(both, EPOCH + stamps_of(both)), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "node 2 sends its position, too: its moves are read with --node 2" in outcome.output
    (tmp_path / "again").mkdir()
    outcome, run = imported(tmp_path / "again", "a.log", text(both, EPOCH + stamps_of(both)), "--node", "2")
    assert outcome.exit_code == 0, outcome.output
    assert [len(record.torque) for record in run.recordings()] == ROWS


@pytest.mark.parametrize("overlap", quick([200, 3000, 24_720], 2))
def test_what_stands_in_the_file_before_is_read_once(overlap: int, three: Logged, tmp_path: Path) -> None:
    """Rotated files that overlap, and a file joined to itself."""
    frames, t = three.frames, EPOCH + stamps_of(three.frames)
    at = min(overlap + 5000, len(frames))
    order = [*range(at), *range(at - min(overlap, at), len(frames))]
    content = text([frames[k] for k in order], t[order])
    outcome, run = imported(tmp_path, "a.log", content, "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "frames of 1 parts that stand in the file before left out" in outcome.output


@pytest.mark.parametrize("late_us", [1, 13, 40])
def test_two_sockets_with_stamps_of_their_own(late_us: int, three: Logged, tmp_path: Path) -> None:
    """The same frame some microseconds later, sooner than the bus could carry it again."""
    frames, t = three.frames, EPOCH + stamps_of(three.frames)
    order = np.arange(2 * len(t)).reshape(2, -1).T.ravel()
    stamps = np.concatenate((t, t + 1e-6 * late_us))
    outcome, run = imported(tmp_path, "a.log", text([[*frames, *frames][k] for k in order], stamps[order]), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "sooner than a frame lasts" in outcome.output


def test_stamps_that_change_places_are_no_times_between_frames(three: Logged, tmp_path: Path) -> None:
    """The frames of one SYNC stamped 0.1 ms to and fro: every fourth stamp goes back, as the times between frames do."""
    chance = np.random.default_rng(5)
    stamps = EPOCH + stamps_of(three.frames) + np.abs(chance.normal(0.0, 5e-5, len(three.frames)))
    outcome, run = imported(tmp_path, "a.log", text(three.frames, stamps))
    assert outcome.exit_code == 0, outcome.output
    assert [len(record.torque) for record in run.recordings()] == ROWS
    assert "times between frames" not in outcome.output


@pytest.mark.parametrize("order", quick(["1302", "0213", "3120", "2031"], 2))
def test_four_files_in_any_order(order: str, three: Logged, tmp_path: Path) -> None:
    frames, t = three.frames, EPOCH + stamps_of(three.frames)
    parts = [range(a, b) for a, b in pairwise((0, 4000, 11_000, 19_000, len(frames)))]
    places = [k for part in order for k in parts[int(part)]]
    outcome, run = imported(tmp_path, "a.log", text([frames[k] for k in places], t[places]), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
