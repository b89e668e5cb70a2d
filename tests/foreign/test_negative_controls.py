"""Records of which nothing may be named: what is said of each, at the import and before an analysis.

``pytest tests/foreign/test_negative_controls.py -s`` prints the table.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.cli.main import cli
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.recording.signalfile import write_columns
from foreign.samples import write

Array = NDArray[np.float64]
Columns = dict[str, Array]
AXIS = ("--set", "name=bench", "--set", "motor.inertia_kg_m2=0.0002", "--set", "motor.peak_torque_nm=3", "--set", "motor.rated_torque_nm=1")


def record(seed: int, size: int = 6000) -> Columns:
    """A motor with friction under a torque of its own for each seed: inertia 4e-4 kg m², 0.1 N m, 1 mN m s/rad, 8192 counts."""
    rng = np.random.default_rng(seed)
    period = 1e-3
    torque = 0.6 * np.sign(np.sin(2.0 * math.pi * np.cumsum(rng.uniform(0.5, 3.0, size // 500).repeat(500)) * period))
    torque += 0.25 * np.repeat(rng.standard_normal(size // 20), 20)
    speed, angle, speeds, angles = 0.0, 0.0, [], []
    for value in torque:
        speeds.append(speed)
        angles.append(angle)
        friction = 0.1 * math.tanh(speed / 0.05) + 1e-3 * speed
        speed += period * (value - friction) / 4e-4
        angle += period * speed
    step = 2.0 * math.pi / 8192
    read = torque + rng.normal(0.0, 0.01, size)
    return {
        "t_s": period * np.arange(size),
        "torque_nm": read,
        "position_rad": step * np.round(np.array(angles) / step),
        "speed": np.array(speeds),
    }


GOOD, OTHER = record(1), record(2)


def changed(**columns: Array) -> Callable[[], Columns]:
    return lambda: {**{name: GOOD[name] for name in ("t_s", "torque_nm", "position_rad")}, **columns}


def swapped() -> Columns:
    return {"t_s": GOOD["t_s"], "torque_nm": 1e-2 * GOOD["position_rad"], "position_rad": GOOD["torque_nm"]}


CONTROLS: Mapping[str, tuple[Callable[[], Columns], str]] = {
    "torque shuffled": (changed(torque_nm=np.random.default_rng(3).permutation(GOOD["torque_nm"])), "do not belong together"),
    "another record's torque": (changed(torque_nm=OTHER["torque_nm"]), "do not belong together"),
    "torque of another time": (changed(torque_nm=np.roll(GOOD["torque_nm"], 2500)), "do not belong together"),
    "noise for a torque": (changed(torque_nm=np.random.default_rng(4).normal(0.0, 0.5, 6000)), "do not belong together"),
    "torque and position swapped": (swapped, "look swapped"),
    "torque times 1000": (changed(torque_nm=1e3 * GOOD["torque_nm"]), "'bench' gives at most 3 N m"),
    "time backwards": (changed(torque_nm=GOOD["torque_nm"][::-1], position_rad=GOOD["position_rad"][::-1]), "time seems to run backwards"),
    "sign of the torque": (changed(torque_nm=-GOOD["torque_nm"]), "--flip torque"),
    "sign of the position": (changed(position_rad=-GOOD["position_rad"]), "--flip torque"),
    "a magnitude for a torque": (
        changed(torque_nm=np.abs(GOOD["torque_nm"])),
        "a magnitude (rms)",
    ),
    "torque that never changes": (changed(torque_nm=np.full(6000, 0.3)), "torque_nm is 0.3 N m in every row"),
    "position that never changes": (changed(position_rad=np.zeros(6000)), "the axis did not move"),
    "torque clipped": (changed(torque_nm=np.clip(GOOD["torque_nm"], -0.55, 0.55)), "torque_nm is clipped at 0.55"),
    "position in counts": (changed(position_rad=np.round(GOOD["position_rad"] * 8192 / math.tau)), "degrees or encoder counts"),
    "a counter that starts anew": (changed(position_rad=np.mod(GOOD["position_rad"], math.tau)), "a counter that starts anew"),
    "milliseconds as seconds": (changed(t_s=1e3 * GOOD["t_s"]), "time rises by 1 s per row"),
    "a clock that stands still": (changed(t_s=np.full(6000, 3.0)), "the time is 3 s in every row"),
    "a torque without a value": (changed(torque_nm=np.full(6000, np.nan)), "torque_nm holds no value"),
    "torque behind a gear of 200": (changed(torque_nm=200.0 * GOOD["torque_nm"]), "torque and angle look"),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_what_cannot_be_is_told_as_such(name: str, tmp_path: Path) -> None:
    make, says = CONTROLS[name]
    file = tmp_path / "a.csv"
    write_columns(file, make())
    axis = AXIS[:4] if name == "torque behind a gear of 200" else AXIS
    outcome = CliRunner().invoke(cli, ["import", str(file), "--run", str(tmp_path / "run"), *axis])
    said = outcome.output
    sys.stdout.write(f"{name:30s} {said.strip().splitlines()[-1].replace(str(tmp_path), '')[:200]}\n")
    assert "Traceback" not in said
    assert says in said, said
    if name != "torque behind a gear of 200":  # a doubt, which only the user can settle
        assert outcome.exit_code == 3, said
        assert not (tmp_path / "run").exists()


def test_the_good_record_passes_and_a_reason_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    write_columns(file, {name: GOOD[name] for name in ("t_s", "torque_nm", "position_rad")})
    assert CliRunner().invoke(cli, ["import", str(file), "--run", str(tmp_path / "good"), *AXIS]).exit_code == 0
    write_columns(file, changed(torque_nm=OTHER["torque_nm"])())
    words = ["import", str(file), "--run", str(tmp_path / "bad"), *AXIS, "--accept", "a pendulum that the wind moves"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    assert "accepted, a pendulum that the wind moves" in outcome.stdout
    assert "accepted: a pendulum that the wind moves" in (tmp_path / "bad" / "recordings" / "a.yaml").read_text(encoding="utf-8")


def test_what_swings_before_its_torque_runs_backwards(tmp_path: Path) -> None:
    """Two masses on a spring that hardly rub, where no friction tells the direction of time."""
    rng, period, size = np.random.default_rng(5), 1e-3, 6000
    torque = rng.standard_normal(size)
    angle, speed = np.zeros(2), np.zeros(2)
    angles = []
    for applied in torque:
        angles.append(angle[0])
        twist = 40.0 * (angle[0] - angle[1]) + 0.004 * (speed[0] - speed[1])
        speed += period * np.array([(applied - twist) / 4e-4, twist / 8e-4])
        angle = angle + period * speed
    file = tmp_path / "a.csv"
    for turned, code in ((slice(None), 0), (slice(None, None, -1), 3)):
        columns = {"torque_nm": torque[turned], "position_rad": np.array(angles)[turned]}
        write_columns(file, {"t_s": period * np.arange(size), **columns})
        outcome = CliRunner().invoke(cli, ["import", str(file), "--run", str(tmp_path / f"run{code}"), *AXIS[:2]])
        assert (outcome.exit_code, "time seems to run backwards" in outcome.output) == (code, code == 3), outcome.output


@pytest.mark.parametrize("name", ["torque shuffled", "another record's torque", "time backwards"])
@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_a_run_folder_made_by_hand_is_refused_before_anything_is_named(name: str, verb: str, tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    write_text(tmp_path / "axis.yaml", to_yaml({"name": "bench", "motor": {"inertia_kg_m2": 0.0002}}))
    write_columns(tmp_path / "recordings" / "a.csv", CONTROLS[name][0]())
    outcome = CliRunner().invoke(cli, [verb, str(tmp_path)])
    assert outcome.exit_code == 3, outcome.output
    assert CONTROLS[name][1] in outcome.output


def test_a_unit_that_no_rating_contradicts_is_told_by_what_the_axis_would_be(tmp_path: Path) -> None:
    file, run = tmp_path / "a.csv", str(tmp_path / "run")
    write_columns(file, changed(torque_nm=1e5 * GOOD["torque_nm"])())
    assert CliRunner().invoke(cli, ["import", str(file), "--run", run, *AXIS[:2]]).exit_code == 0
    outcome = CliRunner().invoke(cli, ["compare", run])
    assert (outcome.exit_code, "in another unit than it says" in outcome.output) == (3, True), outcome.output


def test_a_torque_in_held_steps_is_not_clipped(tmp_path: Path) -> None:
    steps = np.round(GOOD["torque_nm"] / 0.1) * 0.1
    held = np.repeat(steps[::10], 10)
    file = write(tmp_path / "a.csv", "")
    write_columns(file, changed(torque_nm=held)())
    outcome = CliRunner().invoke(cli, ["import", str(file), "--run", str(tmp_path / "run"), *AXIS])
    assert "clipped" not in outcome.output, outcome.output
