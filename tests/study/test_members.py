"""Members that are commissioned or that are run folders: what is said of them beside the truth, and of those that fail."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.configfiles import find_config, read_yaml
from beltcomm.errors import BeltcommError, SafetyStop
from beltcomm.model import load_plant
from beltcomm.result import Result
from beltcomm.session.study_job import study_of
from beltcomm.session.study_members import Doing, diagnosed

MACHINES: dict[str, Any] = {"base": {"plant": "g_a", "axis": "egc-70-600"}, "members": 3, "each": "commission", "ageing": None}


def commission(drive: str, axis: Any, run: Path, *, options: Any) -> Result:
    """Stands in for a commissioning: what it says of the drawn plant is right in one parameter and wrong in another."""
    model = load_plant(drive.removeprefix("virtual:")).model
    if options.seed == 5:
        raise SafetyStop(f"the belt force was reached in {run}")
    found = {
        "cart.mass": {"value": model["cart.mass"] + 0.01, "interval": 0.02},
        "coulomb.level": {"value": model["coulomb.level"] + 0.03, "interval": 0.02},
        "transmission.ratio": {"value": 1.0, "interval": None},
    }
    verdict = {"passed": True, "measured": {"dynamic_m": 1e-4 * options.seed, "static_m": 1e-5}, "predicted": {"dynamic_m": 1e-4}}
    return Result({"verdict": verdict, "fit": {"suspect": False, "misfit": 1.01}, "model": {"parameters": found}}, [])


def test_a_commissioning_is_held_against_the_truth_and_a_stopped_one_is_a_result(written: Callable[..., Path], tmp_path: Path) -> None:
    result = study_of(written(**MACHINES), tmp_path, doing=Doing(commission), workers=1, report=False)
    lines = [json.loads(line) for line in (tmp_path / "members.jsonl").read_text(encoding="utf-8").splitlines()]
    assert (lines[2]["exit_code"], lines[2]["error"]) == (4, "the belt force was reached in MEMBER/run")
    assert lines[1]["found"] == {
        "passed": True, "dynamic_m": 4e-4, "static_m": 1e-5, "predicted_dynamic_m": 1e-4, "trusted": True, "misfit": 1.01,
        "covers cart.mass": True, "off cart.mass": pytest.approx(0.01),
        "covers coulomb.level": False, "off coulomb.level": pytest.approx(0.03),
    }  # fmt: skip
    shares = {one["key"]: (one["count"], one["of"]) for one in result.data["shares"]}
    assert shares == {"passed": (2, 3), "trusted": (2, 2), "covers cart.mass": (2, 2), "covers coulomb.level": (0, 2)}
    assert "  intervals of cart.mass cover the truth: 100 % (95 %: 15.8 to 100 %; 2 of 2)" in result.text


def test_the_plant_of_a_member_is_one_that_the_virtual_drive_takes(written: Callable[..., Path], tmp_path: Path) -> None:
    again = api.study_member(written(population={"drive.delay": {"uniform": ["1 ms", "2 ms"]}}), 1, out=tmp_path)
    plant = load_plant(str(tmp_path / "plant.yaml"))
    assert plant.setpoint_delay_s == again.data["values"]["drive.delay"]
    assert plant.model["coulomb.level"] > read_yaml(find_config("plants", "g_a"))["parameters"]["coulomb.level"]["value"]


@pytest.mark.parametrize(
    ("hidden", "named", "expected"),
    [
        ("none", [], {"healthy left alone": True}),
        ("none", ["cogging"], {"healthy left alone": False}),
        ("stribeck", ["stribeck"], {"hidden effect named": True, "hidden effect named, nothing else": True}),
        ("stribeck", ["stribeck", "cogging"], {"hidden effect named": True, "hidden effect named, nothing else": False}),
        ("stribeck", [], {"hidden effect named": False, "hidden effect named, nothing else": False}),
        (None, ["cogging"], {}),
    ],
)
def test_a_diagnosis_is_held_against_what_was_hidden(hidden: str | None, named: list[str], expected: dict[str, bool]) -> None:
    made = {"verdict": "explained", "steps": [*({"added": name} for name in named), {"added": ""}]}
    assert diagnosed(made, hidden) == {"verdict": "explained", "named": named, **expected}


def test_a_fleet_with_runs_that_hold_nothing(tmp_path: Path) -> None:
    study = tmp_path / "fleet.yaml"
    study.write_text("{each: compare, base: {runs: [runs/*]}}", encoding="utf-8")
    for name in ("a", "b"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "axis.yaml").write_text(find_config("axes", "egc-70-600").read_text(encoding="utf-8"), encoding="utf-8")
    result = api.study(study, tmp_path / "out", workers=1, report=False)
    assert result.exit_code == 1
    assert set(result.data["failed"]) == {"0", "1"}
    assert result.data["worst"] == [0, 1]
    (tmp_path / "runs" / "a" / "recordings").mkdir(exist_ok=True)
    (tmp_path / "runs" / "a" / "recordings" / "new.csv").touch()
    with pytest.raises(BeltcommError, match="run folder or the version of beltcomm differ"):
        api.study(study, tmp_path / "out", workers=1)
