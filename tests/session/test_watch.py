"""Production moves of an independent machine, judged by the model of a run: healthy, with more friction, in logs of all kinds."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.drive.access import listen_to
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.convert import Reading
from beltcomm.jobs.watch import _played_production
from beltcomm.runfolder import RunFolder
from beltcomm.watching.moves import Move, moves_in
from beltcomm.watching.streams import GrowingLog
from session.conftest import Complete
from truth.rigs import RIGS

#: Moves of each kind.
HEALTHY, WORN = 8, 9
BEGAN_S = 1.79e9


def log_of(run: Path, moves: int, friction: float, at_s: float) -> list[str]:
    """What a logger writes of a production: the rig with so many times its friction."""
    rig = replace(RIGS["g_a"], coulomb_total_nm=friction * RIGS["g_a"].coulomb_total_nm)
    options = {"seed": 7, "plant": rig.plant(), "silent": True, "production": _played_production(RunFolder.open(run), moves)}
    lines = []
    with listen_to("virtual:g_a", options) as listening:
        for _ in range(moves + 1):
            for t_s, identifier, data, remote in listening.frames(0.5):
                lines.append(f"({at_s + t_s:.6f}) can0 {identifier:03X}#{'R' if remote else data.hex().upper()}")
    return lines


@pytest.fixture(scope="module")
def logs(complete: Complete) -> tuple[list[str], list[str]]:
    return log_of(complete.path, HEALTHY, 1.0, BEGAN_S), log_of(complete.path, WORN, 1.8, BEGAN_S + 86400.0)


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


@pytest.mark.examination
def test_healthy_moves_are_healthy_and_worn_ones_alarm(
    logs: tuple[list[str], list[str]], copy_of_complete: Callable[..., Path], tmp_path: Path
) -> None:
    run = copy_of_complete()
    told: list[dict[str, Any]] = []
    healthy = api.watch(run, log=written(tmp_path / "healthy.log", logs[0]), tell=lambda move: told.append(dict(move.data)))
    assert healthy.exit_code == 0
    assert healthy.to_json()["moves"] == HEALTHY + 1
    assert healthy.to_json()["alarms"] == {}
    assert all(abs(move["error_over_noise"] - 1.0) < 0.15 for move in told)
    assert told[0]["date"].startswith("2026-09-21T")
    friction = told[-1]["over_the_last_moves"]["coulomb_total"]
    assert friction["value"] == pytest.approx(0.125, abs=max(friction["interval"], 0.0015))

    lines: list[str] = []
    worn = api.watch(run, log=written(tmp_path / "worn.log", logs[1]), until_alarm=True, tell=lambda move: lines.extend(move.lines))
    assert worn.exit_code == 1
    assert "coulomb_total" in worn.to_json()["alarms"]
    assert any("ALARM: friction up" in line for line in lines)
    assert all(len(line) < 80 for line in lines if "ALARM" not in line)
    assert [json.loads(line)["move"] for line in (run / "watch" / "moves.jsonl").read_text().splitlines()] == list(
        range(1, HEALTHY + 2 + worn.to_json()["moves"])
    )

    again = api.watch(run, log=tmp_path / "healthy.log")  # what was judged before is not judged twice
    assert again.to_json()["moves"] == 0

    found = api.trend([run]).to_json()["quantities"]["coulomb_total"]  # two days that were watched, and the run
    assert found["values"][-1] > 1.3 * found["values"][0]


@pytest.mark.examination
def test_an_alarm_lasts_into_the_next_watch_and_not_beyond_a_maintenance(
    logs: tuple[list[str], list[str]], copy_of_complete: Callable[..., Path], tmp_path: Path
) -> None:
    run, worn = copy_of_complete(), written(tmp_path / "worn.log", logs[1])
    assert api.watch(run, log=worn, until_alarm=True).exit_code == 1
    still = api.watch(run, log=worn)
    assert still.to_json()["moves"] > 0
    assert still.exit_code == 1
    assert "coulomb_total" in still.to_json()["alarms"]
    assert "ALARM" in still.lines()[0]
    repaired = api.watch(run, log=written(tmp_path / "healthy.log", logs[0]), anew=True)
    assert repaired.to_json()["moves"] == HEALTHY + 1
    assert repaired.exit_code == 0


@pytest.mark.examination
def test_after_a_maintenance_the_next_moves_are_the_base(
    logs: tuple[list[str], list[str]], copy_of_complete: Callable[..., Path], tmp_path: Path
) -> None:
    run = copy_of_complete()
    api.watch(run, log=written(tmp_path / "before.log", logs[0]), moves=6)
    stamped = [line[1:].split(")", 1) for line in logs[0]]
    later = [f"({float(t_s) + 86400.0:.6f}){rest}" for t_s, rest in stamped]
    told: list[dict[str, Any]] = []
    after = api.watch(run, log=written(tmp_path / "after.log", later), moves=5, anew=True, tell=lambda move: told.append(dict(move.data)))
    assert (after.exit_code, after.to_json()["moves"]) == (0, 5)
    states = [{key: one["state"] for key, one in move["over_the_last_moves"].items()} for move in told[::4]]
    assert [state.pop("friction_at_place") for state in states] == ["few", "few"]  # of which each place has a base of its own
    assert [set(state.values()) for state in states] == [{"few"}, {"steady"}]


@pytest.mark.examination
def test_a_log_that_grows_tells_the_same_moves(logs: tuple[list[str], list[str]], complete: Complete, tmp_path: Path) -> None:
    """Written in pieces that end anywhere, as a logger does."""
    text = ("\n".join(logs[0]) + "\n").encode()
    pieces = np.random.default_rng(5)

    def moves_of(path: Path, grown: Callable[[], bool]) -> list[Move]:
        log, found, taken_s = GrowingLog(path, Reading(), complete.folder.axis), [], -np.inf
        while True:
            more = grown()
            before = log.taken_bytes
            for stretch in log.poll():
                moves, passed = moves_in(stretch, taken_s, False)
                found += moves
                taken_s = max([taken_s, *(move.end_s for move in moves)])
                log.forget(passed)
            if not more and log.taken_bytes == before:
                log.close()
                return found

    def a_little_more() -> bool:
        here = min(len(text), path.stat().st_size + int(pieces.integers(100_000, 400_000)))
        path.write_bytes(text[:here])
        return here < len(text)

    at_once = moves_of(written(tmp_path / "whole.log", logs[0]), lambda: False)
    path = tmp_path / "growing.log"
    path.write_bytes(text[:20_000])
    found = moves_of(path, a_little_more)
    assert len(found) == len(at_once) == HEALTHY + 1
    for one, other in zip(found, at_once, strict=True):
        assert one.start_s == pytest.approx(other.start_s, abs=2e-3)
        np.testing.assert_allclose(np.ptp(one.columns["position_rad"]), np.ptp(other.columns["position_rad"]), rtol=1e-6)


def test_what_cannot_be_watched_is_said(complete: Complete, copy_of_complete: Callable[..., Path], tmp_path: Path) -> None:
    run = copy_of_complete()
    with pytest.raises(UsageError, match="one of them"):
        api.watch(run)
    with pytest.raises(UsageError, match="tells nothing of cart_mass"):
        api.watch(run, log=written(tmp_path / "any.log", ["(1.0) can0 181#00"]), limits=("cart_mass=+10%",))
    with pytest.raises(DataError, match="--signal 6064h=181:0:i32"):
        api.watch(run, log=written(tmp_path / "late.log", [f"({k / 1000:.6f}) can0 181#{k:016X}" for k in range(2000)]))
    table = ["t_s,position_rad,torque_nm", *(f"{k / 1000:.3f},{k % 2 * 1e-4:.4f},0" for k in range(2000))]
    still = api.watch(run, log=written(tmp_path / "table.csv", table))
    assert (still.exit_code, still.to_json()["moves"], still.text) == (0, 0, ["No move was found."])
    with pytest.raises(UsageError, match="is no file"):
        api.watch(run, log=tmp_path / "nothing.log")
    gone = GrowingLog(written(tmp_path / "gone.log", ["(1.0) can0 181#00"]), Reading(), complete.folder.axis)
    gone.path.unlink()
    with pytest.raises(DataError, match="cannot be watched any longer"):
        gone.poll()
    gone.close()


def test_a_table_that_was_logged_is_watched_too(complete: Complete, copy_of_complete: Callable[..., Path], tmp_path: Path) -> None:
    """Columns of another program, with the units in their names: the verification move of the run over and over."""
    run, move = copy_of_complete(), complete.folder.recording("move_1")
    rows, lines, t_ms = len(move.t_s), ["time [ms];angle [deg];torque [mNm]"], 0.0
    for _ in range(3):
        for k in range(rows):
            lines.append(f"{t_ms:.3f};{np.degrees(move.position[k]):.9f};{1e3 * move.torque[k]:.4f}")
            t_ms += 1.0
        back = np.linspace(move.position[-1], move.position[0], 700)  # an even way back tells its friction, too
        lines += [f"{t_ms + k:.3f};{np.degrees(angle):.9f};0.0" for k, angle in enumerate(back)]
        t_ms += len(back)
    mapping = ("t_s=time [ms]*ms", "position_rad=angle [deg]*deg", "torque_nm=torque [mNm]/1000")
    found = api.watch(run, log=written(tmp_path / "trace.csv", lines), reading=Reading(mapping=mapping), moves=1)
    assert found.to_json()["moves"] == 1
    assert found.to_json()["alarms"] == {}
