"""The first sentence on a run: one everywhere; out of date when gains or model changed; by the user's targets."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm.axis import axis_from_dict, load_axis, save_axis
from beltcomm.axis.entries import AxisTargets
from beltcomm.configfiles import read_yaml
from beltcomm.errors import UsageError
from beltcomm.rundata.headline import headline_of, next_command
from beltcomm.runfolder import RunFolder
from session.conftest import Complete


@pytest.fixture
def copy(complete: Complete, tmp_path: Path) -> Path:
    """A run of its own that a test may change."""
    return Path(shutil.copytree(complete.path, tmp_path / "run"))


def test_terminal_file_and_programs_say_the_same(complete: Complete) -> None:
    said = headline_of(RunFolder.open(complete.path))
    assert said.state == "pass"
    assert complete.result.to_json()["headline"] == said.to_dict()
    assert said.text in "\n".join(complete.result.lines())
    assert said.text in (complete.path / "verdict.txt").read_text(encoding="utf-8")


def test_other_gains_make_a_verification_out_of_date(copy: Path) -> None:
    folder = RunFolder.open(copy)
    design = folder.load("designs", "final")
    design["parameters"]["kp_nm_s_rad"] *= 0.9
    folder.save("designs", "final", design)
    said = headline_of(folder)
    assert said.state == "stale"
    assert "other gains" in said.sentence
    assert next_command(folder, said, "can0").command.startswith("beltcomm verify --drive can0 --run ")


def test_another_model_makes_it_out_of_date_and_asks_for_a_design(copy: Path) -> None:
    folder = RunFolder.open(copy)
    model = folder.load("models", "final")
    model["parameters"]["cart.mass"]["value"] *= 1.05
    folder.save("models", "final", model)
    said = headline_of(folder)
    assert said.state == "stale"
    assert "another model" in said.sentence
    assert next_command(folder, said, "can0").command.startswith("beltcomm design ")


def test_a_model_that_is_not_trusted_is_never_a_pass(copy: Path) -> None:
    folder = RunFolder.open(copy)
    folder.save("results", "fit", {**folder.load("results", "fit"), "suspect": True})
    said = headline_of(folder)
    assert said.state == "doubt"
    assert not said.good
    assert "rollback" not in next_command(folder, said, "can0").command


@pytest.mark.parametrize(("ratio", "state", "command"), [(1.0, "open", "design"), (2.0, "doubt", "improve")])
def test_an_effect_that_was_added_is_judged_and_not_the_fit_before(copy: Path, ratio: float, state: str, command: str) -> None:
    """A first fit that explained nothing, then an effect: the model as it is now counts; the design is still of the first."""
    folder = RunFolder.open(copy)
    for name in [one for one in folder.names("results") if one.startswith("verify_")]:
        folder.file("results", name).unlink()
    folder.save("results", "fit", {**folder.load("results", "fit"), "suspect": True})
    assert headline_of(folder).state == "doubt"
    model = folder.load("models", "final")
    model["parameters"]["cart.mass"]["value"] *= 1.05
    for name in ("final", "revision_2"):
        folder.save("models", name, model)
    rung = {"name": "revision_2", "parent": "revision_1", "change": "+cogging", "effects": model["effects"], "ratio": ratio}
    folder.save("results", "ladder", {"revisions": [{**rung, "command": "beltcomm add", "when": "", "data": {}}]})
    said = headline_of(folder)
    assert said.state == state
    assert said.sentence.endswith("the design is of an earlier model")
    assert next_command(folder, said, "can0").command.startswith(f"beltcomm {command} ")


@pytest.mark.parametrize("applied", ["restore", "keep", "save"])
def test_what_follows_a_success_is_no_rollback(complete: Complete, applied: str) -> None:
    folder = RunFolder.open(complete.path)
    assert "rollback" not in next_command(folder, headline_of(folder), "can0", applied=applied).command


def test_a_result_is_judged_by_the_targets_it_was_driven_with(copy: Path) -> None:
    folder = RunFolder.open(copy)
    result = folder.load("results", "verify_move_1")
    carriage_m = result["predicted_cart"]["dynamic_m"]
    asked = {"following_error_m": 0.9 * carriage_m, "at": "carriage"}
    folder.save("results", "verify_move_1", {**result, "targets": {**result["targets"], **asked}})
    said = headline_of(folder)
    assert said.state == "fail"
    assert "carriage, predicted" in said.sentence
    assert said.targets.stated


def test_targets_are_no_part_of_what_the_machine_is(tmp_path: Path) -> None:
    axis = load_axis("egc-70-600")
    asked = replace(axis, targets=AxisTargets(following_error_m=2e-4, at="both", move="T_B", distance_m=0.3))
    assert asked.fingerprint() == axis.fingerprint()
    save_axis(asked, tmp_path / "axis.yaml")
    assert load_axis(tmp_path / "axis.yaml").targets == asked.targets
    assert "targets" not in axis.to_dict()


@pytest.mark.parametrize(
    ("targets", "match"),
    [
        ({"at": "pulley"}, "motor, carriage, both"),
        ({"move": "T_C"}, "did you mean"),
        ({"distance_m": 3}, "the travel is"),
        ({"following": 1}, "following_error_m"),
    ],
)
def test_wrong_targets_are_named(targets: dict[str, object], match: str) -> None:
    data = {**load_axis("egc-70-600").to_dict(), "targets": targets}
    with pytest.raises(UsageError, match=match):
        axis_from_dict(data)


def test_a_run_keeps_its_targets(copy: Path) -> None:
    assert "targets" in read_yaml(copy / "results" / "verify_move_1.yaml")
