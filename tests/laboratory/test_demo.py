"""The demonstration as somebody sees it: a fault of a seed is found, the error falls to the noise, and a picture shows it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.model import load_plant

SEED = 1


@pytest.mark.examination
def test_a_fault_is_found_and_the_error_falls_to_the_noise(tmp_path: Path) -> None:
    outcome = CliRunner().invoke(cli, ["demo", "--seed", str(SEED), "--run", str(tmp_path / "R"), "--json"])
    assert outcome.exit_code == 0, outcome.output
    assert f"--seed {SEED}" in outcome.stderr
    told = json.loads(outcome.stdout)
    (last,) = told["steps"][-1:]
    assert last["right"], last
    changes = [step for step in told["steps"] if "after" in step]
    assert changes[0]["before"]["ratio"] > 2.0
    assert changes[-1]["after"]["ratio"] < 1.2
    assert changes[-1]["before"]["held_out"] > 2.0
    assert changes[-1]["after"]["held_out"] < 1.2
    pictures = [name for step in changes for name in step["pictures"]]
    assert pictures
    assert all((tmp_path / "R" / name).is_file() for name in pictures)
    # What is verified later is verified on the machine that was diagnosed.
    assert last["hidden"] in load_plant(tmp_path / "R.plant.yaml").model.effects
    assert "R.plant.yaml" in CliRunner().invoke(cli, ["design", str(tmp_path / "R")]).output


def test_the_machine_of_a_run_that_is_there_stays(tmp_path: Path) -> None:
    run, machine = tmp_path / "R", tmp_path / "R.plant.yaml"
    run.mkdir()
    (run / "run.yaml").write_text("beltcomm: 0.2.0\n", encoding="utf-8")
    machine.write_text("name: another\n", encoding="utf-8")
    assert CliRunner().invoke(cli, ["demo", "--run", str(run)]).exit_code == 2
    assert machine.read_text(encoding="utf-8") == "name: another\n"


def test_a_place_where_no_machine_can_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outcome = CliRunner().invoke(cli, ["demo", "--run", str(tmp_path / "file" / "R")])
    assert outcome.exit_code == 2
    assert "cannot be written" in outcome.stderr
