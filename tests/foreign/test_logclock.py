"""Loggers whose clock cannot be trusted: every move is found, or what was not read is counted; the start belongs to the right move."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.foreign.busrecords import readable
from beltcomm.foreign.framelog import read_frames
from beltcomm.foreign.logclock import in_order
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.bus import Frame
from foreign.buslog import Logged, logged
from marks import quick

CASE = Path(__file__).parents[2].parent / "shared" / "cases" / "log-lost-moves"
AXIS = load_axis("egc-70-600")
ROWS = [4200, 604, 604]
#: s since 1970.
EPOCH = 1_436_509_052.0


@pytest.fixture(scope="module")
def three() -> Logged:
    return logged()


def line(t_s: float, frame: Frame) -> str:
    _, identifier, data, source = frame
    return f"({t_s:.6f}) can0 {identifier:03X}#{'R' if 'rtr' in source else data.hex().upper()}"


def text(frames: Sequence[Frame], stamps: Any) -> str:
    return "\n".join(line(t, f) for t, f in zip(stamps, frames, strict=True)) + "\n"


def ascii_log(frames: Sequence[Frame], stamps: Any, relative: bool = False) -> str:
    """As Vector's tools write it."""
    if relative:
        stamps = np.diff(stamps, prepend=0.0)
    lines = [
        "date Fri Jul 10 06:17:32.000 am 2015",
        f"base hex  timestamps {'relative' if relative else 'absolute'}",
        "internal events logged",
    ]
    for t, (_, identifier, data, source) in zip(stamps, frames, strict=True):
        shown = "r" if "rtr" in source else f"d {len(data)} {' '.join(f'{b:02X}' for b in data)}"
        lines.append(f"{t:12.6f} 1  {identifier:<15X} Rx   {shown}")
    others = ["   9.000000 1  ErrorFrame", "   9.000000 CANFD   1 Rx  181 1 0 8 8 00 00 00 00 00 00 00 00"]
    return "\n".join([*lines, *others, "End TriggerBlock"]) + "\n"


def imported(folder: Path, name: str, content: str, *more: str) -> tuple[Any, RunFolder]:
    path = folder / name
    path.write_text(content, encoding="utf-8")
    words = ["import", str(path), "--run", str(folder / "run"), "--axis", "egc-70-600", *more]
    outcome = CliRunner().invoke(cli, words)
    return outcome, RunFolder.open(folder / "run") if outcome.exit_code == 0 else None  # type: ignore[return-value]


def check_three(run: RunFolder, own: Logged) -> None:
    """All moves, with the adapter's own positions, evenly timed, and the start at the first."""
    records = run.recordings()
    assert [len(r.torque) for r in records] == ROWS
    for record, mine in zip(records, own.own, strict=True):
        np.testing.assert_allclose(np.diff(record.t_s), 1e-3, atol=1e-6)
        first = mine["position_rad"][:500]
        places = range(len(record.torque) - len(first) + 1)
        assert any(np.abs(record.position[k : k + len(first)] - first).max() < 1e-5 for k in places)
    start = [r.sidecar.start_position_m for r in records]
    assert start[0] == 0.25
    assert start[2] == pytest.approx(0.25 + AXIS.transmission_m_rad * (records[2].position[0] - records[0].position[0]))
    clock = [r.sidecar.session_time_s for r in records]
    assert clock == sorted(clock)  # type: ignore[type-var]


def of(three: Logged) -> tuple[list[Frame], np.ndarray]:
    return three.frames, np.array([frame[0] for frame in three.frames])


def standing(t: np.ndarray) -> np.ndarray:
    return np.where(t < 5.0, 0.0, t - 5.0)


def caught_up(t: np.ndarray) -> np.ndarray:
    return np.where((t > 1.0) & (t < 3.0), 1.0, t)


def hiccup(t: np.ndarray) -> np.ndarray:
    """Now and then a SYNC has the stamp of the one before."""
    rows = np.round(t / 1e-3).astype(int)
    return np.where(rows % 50 == 7, t - 1e-3, t)


def set_back(t: np.ndarray) -> np.ndarray:
    return np.where(t > 4.85, t - 3600.0, t)


def set_ahead(t: np.ndarray) -> np.ndarray:
    return np.where(t > 4.85, t + 3600.0, t)


def little_back(t: np.ndarray) -> np.ndarray:
    return np.where(t > 4.85, t - 0.2, t)


CLOCKS = [standing, caught_up, hiccup, set_back, set_ahead, little_back]


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("epoch", quick([EPOCH, 0.0], 1))
def test_every_move_whatever_the_clock_does(clock: Any, epoch: float, three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, run = imported(tmp_path, "a.log", text(frames, epoch + clock(t)), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "stamps" in outcome.output or "clock" in outcome.output
    assert f"all {len(frames)} frames of the file were read" in outcome.output
    assert "3 of 3 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(tmp_path / "run")]).stdout


@pytest.mark.parametrize("span", quick([2.0**32 * 1e-9, 65.536, 2.0**32 * 1e-6, 86_400.0], 2))
def test_a_counter_that_begins_anew(span: float, three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, run = imported(tmp_path, "a.log", text(frames, (t + span - 3.0) % span), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "counter begins anew" in outcome.output


@pytest.mark.parametrize("relative", quick([True, False], 1))
@pytest.mark.parametrize("shift", [0.0, -5.0, -1000.0])
def test_asc_stamps_below_zero_and_a_balance(relative: bool, shift: float, three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, run = imported(tmp_path, "a.asc", ascii_log(frames, t + shift, relative), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert f"{len(frames)} of {len(frames) + 2} frames of the file were read" in outcome.output
    assert "2 lines that are no classic CAN frames left out" in outcome.output


def test_candump_stamps_below_zero(three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, run = imported(tmp_path, "a.log", text(frames, t - 2.5), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)


@pytest.mark.parametrize("cuts", [(12361,), (8000, 16000), (500, 9000, 20000)])
@pytest.mark.parametrize("gap_s", quick([40.0, 0.0], 1))
def test_files_joined_in_the_wrong_order(cuts: tuple[int, ...], gap_s: float, three: Logged, tmp_path: Path) -> None:
    """With pauses between the files the set-up decides; a file's cut inside a move then parts it, as a pause does."""
    frames, t = of(three)
    if gap_s:
        cuts = tuple(int(np.searchsorted(t, at)) for at in (4.31, 4.98)[: len(cuts)])
    edges = [0, *cuts, len(frames)]
    lines = [line(EPOCH + t[k] + gap_s * np.searchsorted(cuts, k, side="right"), frames[k]) for k in range(len(frames))]
    parts = [lines[a:b] for a, b in pairwise(edges)]
    outcome, run = imported(tmp_path, "a.log", "\n".join(chain.from_iterable(reversed(parts))) + "\n", "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "joined in another order" in outcome.output


def test_frames_before_the_setup_are_counted_and_the_start_is_not_given_away(three: Logged, tmp_path: Path) -> None:
    """The first move stands before the set-up: what carries what is not known there."""
    frames, t = of(three)
    second = int(np.searchsorted(t, 4.3))
    transfers = [frame for frame in frames[:second] if frame[1] in (0x581, 0x601)]
    before = [frame for frame in frames[:second] if frame[1] not in (0x581, 0x601)]
    moved = [*before, *transfers, *frames[second:]]
    stamps = np.sort(t)
    outcome, run = imported(tmp_path, "a.log", text(moved, stamps))
    assert outcome.exit_code == 0, outcome.output
    assert len(run.recordings()) == 2
    early = sum(frame[1] == 0x181 for frame in before)
    assert f"not read are {early} frames with the position before the set-up" in outcome.output
    (tmp_path / "again").mkdir()
    outcome, _ = imported(tmp_path / "again", "a.log", text(moved, stamps), "--start-position", "250mm")
    assert outcome.exit_code == 3
    assert "--record K" in outcome.output
    outcome, run = imported(tmp_path / "again", "a.log", text(moved, stamps), "--start-position", "250mm", "--record", "2")
    assert outcome.exit_code == 0, outcome.output
    assert run.recordings()[0].sidecar.start_position_m == 0.25


def test_a_log_written_twice_is_one_log(three: Logged, tmp_path: Path) -> None:
    """As two sockets on one bus write it, each frame behind itself; the torque of each row stays."""
    frames, t = of(three)
    twice = [frame for frame in frames for _ in range(2)]
    outcome, run = imported(tmp_path, "a.log", text(twice, np.repeat(EPOCH + t, 2)), "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    for record, mine in zip(run.recordings(), three.own, strict=True):
        torque = mine["torque_nm"][:500]
        places = range(len(record.torque) - len(torque) + 1)
        assert any(np.abs(record.torque[k : k + len(torque)] - torque).max() < 1e-3 for k in places)
    assert f"{len(frames)} frames that repeat the one before at the same time left out" in outcome.output
    assert f"{len(frames)} of {2 * len(frames)} frames of the file were read" in outcome.output


def test_a_clock_that_never_moves_is_refused_and_a_rate_helps(three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, _ = imported(tmp_path, "a.log", text(frames, np.zeros(len(t))), "--start-position", "250mm")
    assert outcome.exit_code == 3
    assert "rows have standing stamps and no known period" in outcome.output
    assert "--rate" in outcome.output
    outcome, run = imported(tmp_path, "a.log", text(frames, np.zeros(len(t))), "--start-position", "250mm", "--rate", "1kHz")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)


def test_stamps_coarser_than_the_rows_are_refused(three: Logged, tmp_path: Path) -> None:
    frames, t = of(three)
    outcome, _ = imported(tmp_path, "a.log", text(frames, np.floor(t / 0.01) * 0.01))
    assert outcome.exit_code == 3
    assert "--rate" in outcome.output


def test_an_order_that_nothing_tells_is_left(tmp_path: Path) -> None:
    """Stamps that go back by an hour without a set-up: not resorted, for a clock may have been set."""
    path = tmp_path / "a.log"
    path.write_text("".join(f"({7200.0 - 3600.0 * (k > 50) + 1e-3 * k:.6f}) can0 181#{k:04X}\n" for k in range(100)), encoding="utf-8")
    log = in_order(read_frames(path), readable)
    assert log.data[:, 1].tolist() == list(range(100))


@pytest.mark.skipif(not CASE.is_dir(), reason="the cases are not beside the checkout")
@pytest.mark.parametrize("name", ["negative-stamps.asc", "rotated-wrong-order.log", "standing-stamps.log"])
def test_the_cases(name: str, tmp_path: Path) -> None:
    words = ["import", str(CASE / name), "--run", str(tmp_path / "run"), "--axis", "egc-70-600", "--start-position", "200mm", "--json"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    found = json.loads(outcome.stdout)["recordings"]
    assert [(item["samples"], item["experiment"]) for item in found] == [(4200, "frf"), (604, "trajectory"), (604, "free")]
    assert any("all 24720 frames of the file were read" in note for note in found[0]["notes"])
    assert RunFolder.open(tmp_path / "run").recordings()[0].sidecar.start_position_m == 0.2
