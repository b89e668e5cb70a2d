"""``beltcomm trajectory``: the file, what is said about it, and that other commands can use it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.errors import DataError
from beltcomm.recording.signalfile import read_columns
from beltcomm.trajectory import load_move

T_A = ("--speed", "5", "--acceleration", "45", "--jerk", "40")
ODD = ("--speed", "800mm/s", "--acceleration", "3", "--deceleration", "6", "--jerk", "45", "--jerk-down", "20", "--speed-back", "0.3")


def call(file: Path, start: str, end: str, *words: str, answer: str | None = None) -> Any:
    return CliRunner().invoke(cli, ["trajectory", str(file), "--from", start, "--to", end, *words], input=answer)


def columns(file: Path) -> dict[str, np.ndarray]:
    return read_columns(file, {"t_s", "position_m", "velocity_m_s", "acceleration_m_s2", "jerk_m_s3"})


def test_the_move_of_the_thesis(tmp_path: Path) -> None:
    """T_A: 0.7368 s by T = 4 (s/2j)^(1/3), only the jerk binds; on the drive's grid 0.737 s (thesis.md, 3)."""
    file = tmp_path / "move.csv"
    outcome = call(file, "0", "500mm", *T_A)
    assert outcome.exit_code == 0, outcome.stderr
    assert "0 to 0.5 m in 0.737 s, 738 rows" in outcome.stdout
    assert "fastest possible   0.736806 s; 0.194 ms more let it end on a sample of 1 ms" in outcome.stdout
    assert "limited by         jerk, jerk down\n" in outcome.stdout
    assert f"beltcomm verify --drive DRIVE --run RUN --move {file}" in outcome.stdout
    rows = columns(file)
    assert list(rows) == ["t_s", "position_m", "velocity_m_s", "acceleration_m_s2", "jerk_m_s3"]
    assert (len(rows["t_s"]), rows["position_m"][-1], rows["velocity_m_s"][-1]) == (738, 0.5, 0.0)
    assert set(np.unique(rows["jerk_m_s3"])) <= {-40.0, 0.0, 40.0}
    assert round(float(rows["velocity_m_s"].max()), 2) == 1.36


def test_a_move_from_rest_to_rest_can_be_given_to_verify(tmp_path: Path) -> None:
    """As ``verify --move`` reads it: the same positions on the drive's grid, inside the limits of the axis."""
    file = tmp_path / "move.csv"
    assert call(file, "0.1", "0.5", *ODD).exit_code == 0
    rows, move = columns(file), load_move(file, 1e-3, load_axis("egc-70-600"))
    np.testing.assert_allclose(move.position_m, rows["position_m"], atol=1e-12)
    # a cubic spline through samples h apart: its second derivative is off by about h j where the jerk switches
    np.testing.assert_allclose(move.acceleration_m_s2, rows["acceleration_m_s2"], atol=2.0 * 1e-3 * 65.0)


def test_limits_hold_along_the_way_whichever_way_it_leads(tmp_path: Path) -> None:
    """Down is up mirrored: the deceleration is the harder one either way."""
    up, down = tmp_path / "up.csv", tmp_path / "down.csv"
    first = call(up, "0.1", "0.5", *ODD, "--json")
    second = call(down, "-0.1", "-0.5", *ODD, "--json")
    assert (first.exit_code, second.exit_code) == (0, 0)
    one, other = json.loads(first.stdout), json.loads(second.stdout)
    assert one["binding"] == other["binding"] == ["speed", "acceleration", "jerk", "jerk down"]
    assert other["bounds"]["acceleration_min_m_s2"] == -3.0
    assert (one["extremes"]["acceleration_m_s2"][1], other["extremes"]["acceleration_m_s2"][0]) == (3.0, -3.0)
    np.testing.assert_allclose(columns(down)["position_m"], -columns(up)["position_m"], atol=1e-12)


def test_boundary_states_and_the_way_beyond_the_ends(tmp_path: Path) -> None:
    file = tmp_path / "turn.csv"
    outcome = call(file, "0", "0", *ODD, "--start-velocity", "0.2", "--end-velocity", "-200 mm/s", "--end-acceleration", "-1")
    assert outcome.exit_code == 0, outcome.stderr
    assert "Note: it goes beyond its ends, from 0 to 0.0" in outcome.stdout
    assert "`beltcomm verify --move` cannot drive it alone" in outcome.stdout
    rows = columns(file)
    assert (rows["velocity_m_s"][0], rows["velocity_m_s"][-1], rows["acceleration_m_s2"][-1]) == (0.2, -0.2, -1.0)
    with pytest.raises(DataError, match="does not start at rest"):
        load_move(file, 1e-3)


def test_an_existing_file_is_overwritten_only_with_a_yes(tmp_path: Path) -> None:
    file = tmp_path / "move.csv"
    file.write_text("mine\n", encoding="utf-8")
    for answer, code in (("n\n", 1), ("", 2)):
        assert call(file, "0", "0.5", *T_A, answer=answer).exit_code == code
        assert file.read_text(encoding="utf-8") == "mine\n"
    assert call(file, "0", "0.5", *T_A, "--yes").exit_code == 0
    assert file.read_text(encoding="utf-8").startswith("t_s,")


@pytest.mark.parametrize(
    ("words", "code", "hint"),
    [
        (("0", "0.5", "--speed", "-1", "--acceleration", "1", "--jerk", "1"), 2, "the speed is -1; give a positive number"),
        (("0", "0.5", *T_A, "--jerk-down", "0"), 2, "the jerk down is 0; give a positive number"),
        (("0", "0.5", *T_A, "--speed-back", "-1"), 2, "the speed back is -1; give 0, which forbids to move back"),
        (("0", "0.5", *T_A, "--jerk-down", "3kg"), 2, "'kg' is not a unit of it"),
        (("0", "0.5", *T_A, "--period", "0"), 2, "the period is 0 s; it must be positive"),
        (("0.5", "0.5", *T_A), 2, "starts and ends in the same state at 0.5 m"),
        (("0", "0.5", *T_A, "--end-velocity", "6"), 2, "6 m/s at its end, outside its bounds -5 to 5 m/s"),
        (("0", "0.5", *ODD, "--start-velocity", "0.75", "--start-acceleration", "3"), 2, "forces the speed to 0.975 m/s after it"),
        (("0", "0.01", *ODD, "--speed-back", "0", "--start-velocity", "0.5"), 1, "nothing may move backward"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(tmp_path: Path, words: tuple[str, ...], code: int, hint: str) -> None:
    outcome = call(tmp_path / "move.csv", *words)
    assert outcome.exit_code == code
    assert hint in outcome.stderr
    assert list(tmp_path.iterdir()) == []
