"""Members that are commissioned or that are run folders: what is said of them beside the truth, and of those that fail."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.configfiles import find_config, read_yaml
from beltcomm.errors import SafetyStop
from beltcomm.model import load_plant
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.study.file import Study
from beltcomm.study.job import study_of
from beltcomm.study.members import Doing, _diagnosis_quantities
from beltcomm.study.summary import summary_of
from beltcomm.study.words import answer_row, headline, values_text, why
from study.conftest import STUDY

MACHINES: dict[str, Any] = {"base": {"plant": "g_a", "axis": "egc-70-600"}, "members": 3, "each": "commission", "ageing": None}


def test_a_series_of_screws_is_told_in_their_words(tmp_path: Path) -> None:
    (tmp_path / "screws.yaml").write_text(
        "base: {plant: ball_screw, axis: ball-screw}\nmembers: 2\npopulation: {cart.mass: {tolerance: 5 %}}\n", encoding="utf-8"
    )
    outcome = CliRunner().invoke(cli, ["study", str(tmp_path / "screws.yaml"), "--member", "1"])
    assert outcome.exit_code == 0, outcome.output
    for words in ("load.mass: ", "following error at the table: ", "screw force: "):
        assert words in outcome.stdout
    assert not re.search(r"\b(belt|carriage|cart)\b", outcome.stdout)


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
    assert _diagnosis_quantities(made, hidden) == {"verdict": "explained", "named": named, **expected}


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


def moving(folder: Path) -> Path:
    """A user's own move: 0.1 m to 0.3 m in a second."""
    t = np.arange(1001) * 1e-3
    rows = [f"{time:.3f},{x!r}" for time, x in zip(t, (0.2 - 0.1 * np.cos(np.pi * t)).tolist(), strict=True)]
    (folder / "move.csv").write_text("\n".join(["t_s,position_m", *rows]) + "\n", encoding="utf-8")
    return folder / "move.csv"


def test_a_population_around_a_run_with_a_move_of_its_own_from_other_places(written: Callable[..., Path], tmp_path: Path) -> None:
    """The run holds the plant and the gains of the study beside it: the same results.   Where a move leaves the travel is a result too."""
    plant, gains = load_plant("g_a"), STUDY["base"]["gains"]
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    folder.save("models", "final", plant.model.to_dict())
    design = {"parameters": gains, "dead_time_s": plant.setpoint_delay_s, "specification": {"phase_margin_deg": 45.0}, "margins": []}
    folder.save("designs", "final", {**design, "structure": {"name": "x", "period_s": 1e-3, "prefilters": []}})
    told = {
        "members": 8,
        "move": str(moving(tmp_path)),
        "population": {"payload": {"choice": ["0 kg", "2 kg"]}, "move.from": {"choice": ["5 mm", "350 mm", "500 mm"]}},
        "ageing": None,
    }
    found = {}
    for name, base in (("run", {"run": str(tmp_path / "run")}), ("plant", STUDY["base"])):
        api.study(written(base=base, **told), tmp_path / name, workers=1, report=False)
        lines = [json.loads(text) for text in (tmp_path / name / "members.jsonl").read_text(encoding="utf-8").splitlines()]
        found[name] = [(line["values"], line.get("found"), line.get("error")) for line in lines]
    assert found["run"] == found["plant"]
    reached = {values["move.from"]: (result, error) for values, result, error in found["run"]}
    assert reached[0.5][0] is None
    assert "the move would go from 0.5 m to 0.7 m, the travel is -0.01..0.57 m" in reached[0.5][1]
    errors = {payload: [r["dynamic_m"] for v, r, _ in found["run"] if r and v["payload"] == payload] for payload in (0.0, 2.0)}
    assert errors[2.0] == pytest.approx([errors[2.0][0]] * len(errors[2.0]), rel=1e-3)  # this belt is as stiff everywhere
    assert min(errors[2.0]) > 1.1 * max(errors[0.0])


def commissioned_run(drive: str, axis: Any, run: Path, *, options: Any) -> Result:
    """Stands in for a commissioning that leaves records."""
    assert options.thorough
    run.mkdir()
    (run / "machine").write_text(drive.removeprefix("virtual:"), encoding="utf-8")
    return Result({}, [])


def diagnose_run(run: Path, *, cost: bool) -> Result:
    """Stands in for a diagnosis that sees what is large."""
    model = load_plant((run / "machine").read_text(encoding="utf-8")).model
    added = [name for name in ("stribeck", "cogging") if name in model.effects and model.get("stribeck.amount") > 0.04]
    return Result({"verdict": "explained" if added else "nothing missing", "steps": [{"added": name} for name in added]}, [])


def test_a_population_is_diagnosed_and_a_stopped_study_goes_on(
    written: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("beltcomm.jobs.laboratory.diagnose_run", diagnose_run)
    hidden = {"none": {}, "stribeck": {"amount": {"uniform": [0.02, 0.06]}, "speed_scale": 2.5}}
    study = written(**{**MACHINES, "each": "diagnose", "members": 12, "hidden": hidden})
    doing = Doing(commissioned_run)
    whole = study_of(study, tmp_path / "whole", doing=doing, workers=1)
    lines = [json.loads(text) for text in (tmp_path / "whole" / "members.jsonl").read_text(encoding="utf-8").splitlines()]
    seen = [line["values"]["stribeck.amount"] > 0.04 for line in lines[1::2]]
    assert [line["found"]["hidden effect named"] for line in lines[1::2]] == seen
    assert all(line["found"] == {"verdict": "nothing missing", "named": [], "healthy left alone": True} for line in lines[::2])
    shares = {one["key"]: (one["count"], one["of"]) for one in whole.data["shares"]}
    assert shares["hidden effect named"] == (sum(seen), 6)
    assert whole.text[0].startswith(
        f"Diagnosis against the truth: of those with a hidden effect it is named: {100 * sum(seen) / 6:.3g} % (95 %: "
    )
    assert "of the healthy ones nothing is named: 100 % (95 %: 54.1 to 100 %; 6 of 6)" in whole.text[0]
    rows = [("healthy, 6 members", "nothing 6"), ("hidden stribeck, 6 members", f"stribeck {sum(seen)}, nothing {6 - sum(seen)}")]
    assert sum(seen) > 6 - sum(seen) > 0, "what is named most often stands first"
    page = (tmp_path / "whole" / "study.html").read_text(encoding="utf-8")
    for members, named in rows:
        assert f"  {members}: {named}" in whole.text
        assert members in page
        assert named in page
    stopped = study_of(study, tmp_path / "stopped", doing=doing, workers=1, limit=5)
    assert stopped.data["done"] == 5
    study_of(study, tmp_path / "stopped", doing=doing, workers=1)
    for name in ("members.jsonl", "summary.json"):
        assert (tmp_path / "stopped" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_member_without_a_result_stands_beside_what_was_named() -> None:
    found = {"named": ["stribeck", "cogging"], "hidden effect named": True}
    lines: list[dict[str, Any]] = [{"member": k, "values": {"hidden": "cogging"}, "exit_code": 0, "found": found} for k in range(2)]
    lines.append({"member": 2, "values": {"hidden": "cogging"}, "exit_code": 1, "error": "the scale is wrong. Look at it"})
    summary = summary_of(lines, 3, {}, {})
    (answers,) = summary.answers
    assert answer_row(answers) == ("hidden cogging, 3 members", "cogging + stribeck 2, no result 1")
    asked = SimpleNamespace(population=None, units={"cart.mass": "kg"})
    assert headline(summary).endswith("2 of 2); 1 member has no result.")
    assert why(lines[2], {}) == "no result: the scale is wrong"
    assert values_text(cast("Study", asked), {"cart.mass": 2.34567, "hidden": "none"}) == "cart.mass 2.346 kg, hidden none"
