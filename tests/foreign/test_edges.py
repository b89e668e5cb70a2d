"""Files of encoder edge times: the position of a record from them, the estimators on them, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.encoder.edges import Edges, edges_of
from beltcomm.errors import BeltcommError
from beltcomm.foreign.edgetimes import read_edges
from beltcomm.model import load_plant
from beltcomm.runfolder import RunFolder

COUNTS, DURATION_S = 4000, 1.5
STEP = math.tau / COUNTS
RNG = np.random.default_rng(11)
SPEED, WAY, PHASE = RNG.uniform(2.0, 9.0), RNG.uniform(0.5, 2.0), RNG.uniform(0.0, 1.0)


def motion(t: np.ndarray) -> np.ndarray:
    """There and back, with a stop in the middle; begins before the edges do."""
    u = np.minimum(t, 0.7) + np.maximum(t - 0.9, 0.0)
    return np.asarray(WAY * np.sin(SPEED * u + PHASE))


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, list(map(str, words)))


@pytest.fixture(scope="module")
def edges() -> Edges:
    return edges_of(motion, DURATION_S, increment_m=STEP)


def rows_of(edges: Edges) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Time, levels after each edge, count and direction."""
    a, b = np.full(len(edges.tick), edges.level_a), np.full(len(edges.tick), edges.level_b)
    for channel, levels in ((0, a), (1, b)):
        last = np.maximum.accumulate(np.where(edges.channel == channel, np.arange(len(levels)), -1))
        levels[last >= 0] = edges.level[last[last >= 0]]
    place = np.select([(a == 0) & (b == 0), (a == 1) & (b == 0), (a == 1) & (b == 1)], [0, 1, 2], 3)
    before = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}[(edges.level_a, edges.level_b)]
    step = (np.diff(np.concatenate(([before], place))) + 1) % 4 - 1
    return edges.tick * edges.tick_s, a, b, np.cumsum(step), step


def written(folder: Path, edges: Edges, kind: str) -> Path:
    t, a, b, count, step = rows_of(edges)
    first = f"-0.001,{edges.level_a},{edges.level_b}"
    head, rows = {
        "analyser": ("Time [s],Channel 0,Channel 1", [first, *(f"{x:.9f},{p},{q}" for x, p, q in zip(t, a, b, strict=True))]),
        "swapped, named": ("t_us,Enc B,Enc A", [f"{1e6 * x:.3f},{q},{p}" for x, p, q in zip(t, a, b, strict=True)]),
        "direction": ("t_ns,direction", [f"{round(1e9 * x)},{d}" for x, d in zip(t, step, strict=True)]),
        "words": ("dir;time [ms]", [f"{'up' if d > 0 else 'down'};{1e3 * x:.6f}" for x, d in zip(t, step, strict=True)]),
        "count": ("t_s,count", [f"{x:.9f},{n}" for x, n in zip(t, count, strict=True)]),
        "no header": ("", [f"{n},{x:.9f}" for x, n in zip(t, count, strict=True)]),
    }[kind]
    path = folder / f"{kind}.csv"
    path.write_text("\n".join([head, *rows] if head else rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", ["analyser", "swapped, named", "direction", "words", "count", "no header"])
def test_the_position_of_a_record_lies_on_the_motion(tmp_path: Path, edges: Edges, kind: str) -> None:
    """An encoder that is read at the rows alone would be wrong by up to a count, 0.29 counts rms."""
    t = np.arange(-0.05, DURATION_S, 1e-3)  # the first rows come before the first edge
    torque = 1e-3 * np.gradient(np.gradient(motion(t), t), t) + RNG.normal(0.0, 1e-2, len(t))
    table = tmp_path / "torque.csv"
    np.savetxt(table, np.column_stack([t, torque]), delimiter=",", header="t_s,torque_nm", comments="")
    file, run = written(tmp_path, edges, kind), tmp_path / "run"
    known = ("--set", "name=bench", "--set", f"motor.encoder_counts_per_rev={COUNTS}", "--accept", "torque is made up")
    outcome = call("import", table, "--edges", file, "--run", run, *known)
    assert outcome.exit_code == 0, outcome.output
    assert "smooth curve through the edges" in outcome.stdout
    record = RunFolder.open(run).recordings()[0]
    moving = (record.t_s < 0.69) | (record.t_s > 0.91)
    off = (record.position - motion(record.t_s))[moving] / STEP
    assert np.std(off - np.mean(off)) < 0.01
    still = (record.position - motion(record.t_s)) / STEP - np.mean(off)
    assert np.abs(still).max() <= 1.0  # within the count that holds
    assert record.t_s[0] >= edges.tick[0] * edges.tick_s
    assert call("import", "--check", "--run", run).exit_code == 0
    (run / "originals" / file.name).write_text("t_s\n1\n2\n3\n", encoding="utf-8")
    assert call("import", "--check", "--run", run).exit_code == 1


def test_the_estimators_are_tried_on_a_run_s_own_edges(tmp_path: Path, edges: Edges) -> None:
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    folder.save("models", "final", load_plant("g_a").model.to_dict())
    file = written(tmp_path, edges, "analyser")
    outcome = call("thesis", "estimators", "--run", folder.path, "--edges", file, "--json")
    assert outcome.exit_code == 0, outcome.output
    data = json.loads(outcome.stdout)
    rows = {row["from_counts"]: row for row in data["rows"]}
    assert data["invalid"] == 0
    assert rows[2.0]["rms_mm_s"]["gate"] < rows[2.0]["rms_mm_s"]["high_pass"]
    assert sum(row["periods"] for row in data["rows"]) > 0.9 * DURATION_S / 1e-3
    assert call("thesis", "designs", "--run", folder.path, "--edges", file).exit_code == 2
    assert call("thesis", "estimators", "--edges", file).exit_code == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,direction\n0.1,1\n0.3,1\n0.2,1\n0.4,1\n", "falls from 0.3 s to 0.2 s in row 3"),
        ("ticks,direction\n1,1\n2,1\n4,1\n", "unknown unit"),
        ("t_s,direction\n0.1,1\n0.2,1\n", "holds 2 edges"),
        ("t_s,power\n0.1,12.5\n0.2,13.1\n0.3,7.0\n", "power say of an edge is not understood"),
        ("x,y\n3.5,1\n2.5,-1\n1.5,1\n", "no column rises as time does"),
    ],
)
def test_what_is_no_file_of_edges_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "edges.csv").write_text(text, encoding="utf-8")
    with pytest.raises(BeltcommError, match=words):
        read_edges(tmp_path / "edges.csv")


def test_edges_without_a_direction_go_one_way_and_missed_ones_are_told(tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text("t_s\n0.1\n0.2\n0.3\n0.4\n", encoding="utf-8")
    found = read_edges(tmp_path / "one.csv")
    np.testing.assert_allclose(found.counts_at(np.array([0.0, 0.1, 0.25, 0.4])), [np.nan, 1.0, 2.5, 4.0], atol=1e-9)
    assert "one throughout" in found.notes[-1]
    (tmp_path / "missed.csv").write_text("t_s,A,B\n0,0,0\n0.1,1,1\n0.2,0,1\n0.3,0,0\n", encoding="utf-8")
    assert "no motion makes" in " ".join(read_edges(tmp_path / "missed.csv").notes)


def test_a_position_from_two_places_is_refused(tmp_path: Path, edges: Edges) -> None:
    table = tmp_path / "torque.csv"
    table.write_text("t_s,torque_nm,enc\n0.1,0.1,1\n0.2,0.2,2\n", encoding="utf-8")
    file = written(tmp_path, edges, "count")
    outcome = call("import", table, "--edges", file, "--map", "position_rad=enc", "--run", tmp_path / "run", "--axis", "egc-70-600")
    assert (outcome.exit_code, "leave one out" in outcome.stderr) == (2, True), outcome.output
    outcome = call("import", table, "--edges", file, "--run", tmp_path / "run", "--set", "name=x")
    assert "encoder_counts_per_rev" in outcome.stderr
    assert outcome.exit_code in (2, 3)
