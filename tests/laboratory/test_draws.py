"""Run folders without their answers, drawn and written by the independent truth and kept as files: nothing here can be tuned to them.

New ones:  python -m truth.hidden.write SEED EFFECT STRENGTH FOLDER --plan default   (from ``tests``)
"""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from beltcomm.cli.main import cli

DRAWS = Path(__file__).parent / "draws"


def diagnosed(name: str, place: Path, only: str = "") -> tuple[dict[str, Any], dict[str, Any]]:
    """What ``beltcomm diagnose`` says of a draw, and its answer.   only : numbers of the records that it is given; all by default."""
    with tarfile.open(DRAWS / f"{name}.tar.xz") as archive:
        archive.extractall(place, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))  # 3.11.4 knows it first
    for path in (place / name / "recordings").iterdir():
        if only and path.name[:2] not in only.split():
            path.unlink()
    result = CliRunner().invoke(cli, ["diagnose", str(place / name), "--no-cost", "--json"], standalone_mode=False)
    assert result.exception is None, result.exception
    assert not (place / name / "models").exists(), "diagnose changes nothing"
    assert not (place / name / "pictures").exists()
    found = json.loads(result.stdout)
    tried = [f"{step['added']} on trial: it explains" for step in found["steps"] if step["added"]]
    assert all(words in result.stderr for words in tried), "a search that takes long is told of"
    return found, yaml.safe_load((DRAWS / f"{name}.answer.yaml").read_text(encoding="utf-8"))


@pytest.mark.examination
def test_a_healthy_machine_reads_one_and_nothing_is_named(tmp_path: Path) -> None:
    found, answer = diagnosed("draw_a", tmp_path)
    assert answer["effects"] == []
    assert found["verdict"] == "nothing missing"
    assert not any(entry["accepted"] for entry in found["ranking"])
    assert found["base"]["ratio"] == pytest.approx(1.0, abs=0.03)


@pytest.mark.examination
def test_the_hidden_effect_is_named_and_explains_all(tmp_path: Path) -> None:
    found, answer = diagnosed("draw_b", tmp_path)
    assert [found["ranking"][0]["effect"]] == answer["effects"]
    assert found["ranking"][0]["accepted"]
    assert found["verdict"] == "explained"
    assert found["base"]["ratio"] > 1.3  # sample by sample, in which a slow error is a smaller share than in fours
    assert found["after"]["ratio"] == pytest.approx(1.0, abs=0.05)
    hidden = answer["hidden"]["friction_position"]
    place = found["after"]["parameters"]["friction_position.place"]["value"]
    assert abs(place - hidden["place_m"]) < hidden["half_width_m"]
    # Half a wave of a cosine is no bell: its flanks end.
    assert [step["forms"] for step in found["steps"]] == [[], ["friction_position.flatness"]]
    flatness = found["after"]["parameters"]["friction_position.flatness"]
    assert flatness["value"] - flatness["interval"] > 2.0


@pytest.mark.examination
def test_an_effect_that_no_candidate_has_is_not_explained(tmp_path: Path) -> None:
    """Of a fast sweep, one excited record, fast moves and two held out: each further record is fitted again with every candidate."""
    found, _ = diagnosed("draw_c", tmp_path, "01 03 11 12 13")
    assert found["verdict"] == "none of the known effects explains this"
    assert found["base"]["ratio"] > 5.0
