"""A hidden effect from the independent truth, as its user meets it: compare, diagnose, add, ladder, on a folder without the answer."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from truth.hidden import draw, write_session


@pytest.fixture(scope="module")
def hidden_cogging(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """The run folder of a machine with cogging, and the order that only the truth knows."""
    machine = draw(7301, effects=("cogging",), strength=0.7, family="sheet")
    folder = tmp_path_factory.mktemp("hidden") / "run"
    write_session(machine, folder, plan="default")
    return folder, float(machine.hidden["cogging"]["order"])


def beltcomm(*words: str) -> Result:
    result = CliRunner().invoke(cli, [*words, "--json"], standalone_mode=False)
    assert result.exception is None, result.exception
    return result


def test_the_hidden_effect_is_named_added_and_the_error_falls(hidden_cogging: tuple[Path, float], tmp_path: Path) -> None:
    folder, order = hidden_cogging
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    before = {path: path.read_bytes() for path in sorted((run / "recordings").iterdir())}

    found = json.loads(beltcomm("diagnose", str(run)).stdout)
    assert found["ranking"][0]["effect"] == "cogging"
    assert found["ranking"][0]["accepted"]
    assert found["verdict"] == "explained"
    assert found["after"]["parameters"]["cogging.order"]["value"] == order
    assert not (run / "models").exists(), "diagnose changes nothing"

    added = json.loads(beltcomm("add", "cogging", str(run)).stdout)
    assert added["before"]["ratio"] > 1.2
    assert added["after"]["ratio"] < 1.1
    assert added["after"]["held_out"] < added["before"]["held_out"]
    assert added["confirmed"]

    compared = json.loads(beltcomm("compare", str(run)).stdout)
    assert compared["ratio"]["overall"] == pytest.approx(added["after"]["ratio"], rel=0.02)
    ladder = json.loads(beltcomm("ladder", str(run)).stdout)
    assert [rung["change"] for rung in ladder["revisions"]] == ["base", "+cogging"]
    assert {path: path.read_bytes() for path in sorted((run / "recordings").iterdir())} == before


def test_words_of_the_family_create_one_effect(hidden_cogging: tuple[Path, float], tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(hidden_cogging[0], run)
    for path in (run / "recordings").iterdir():  # one excited record is enough for this, and quick
        if "frf" not in path.name:
            path.unlink()
    added = json.loads(beltcomm("add", "tilt", str(run)).stdout)
    assert added["change"] == "+constant_offset"
    removed = json.loads(beltcomm("remove", "coulomb_asymmetry", str(run)).stdout)
    assert removed["change"] == "-constant_offset"
