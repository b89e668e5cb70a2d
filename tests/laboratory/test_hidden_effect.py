"""A hidden effect from the independent truth, as its user meets it: compare, add, ladder, on a folder without the answer.

That ``diagnose`` names what is hidden: ``test_draws``, ``test_demo``.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.effects import effect_named
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.fit.start.model import start_model
from beltcomm.jobs.change import _better, _diagnosis_start
from beltcomm.laboratory.diagnosis import Stage, _find_shortcut, fit_base_of
from beltcomm.laboratory.score import Scorer, ground_of
from beltcomm.laboratory.selection import candidate, with_effect
from beltcomm.laboratory.visible import detection_limits
from beltcomm.quantities import in_mm
from beltcomm.rundata.revisions import revisions, trusted_model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session


@pytest.fixture(scope="module")
def hidden_cogging(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """The run folder of a machine with cogging, and the order that only the truth knows."""
    machine = draw(7301, effects=("cogging",), strength=0.7, family="sheet")
    folder = tmp_path_factory.mktemp("hidden") / "run"
    write_session(machine, folder, plan="default")
    return folder, float(machine.hidden["cogging"]["order"])


@pytest.fixture(scope="module")
def apart(hidden_cogging: tuple[Path, float]) -> tuple[Data, Fitted, dict[str, Fitted]]:
    """Its moves without the excited records, which is quick: the base model, and the same with each of two effects."""
    folder = RunFolder.open(hidden_cogging[0])
    recordings = [r for r in folder.recordings() if "frf" not in r.name]
    data, base = fit_base_of(recordings, folder.axis, start_model(folder.axis, recordings))
    ground = ground_of(base, data.fitted, folder.axis)
    return data, base, {name: with_effect(data, base, ground, effect_named(name)) for name in ("quadratic_drag", "cogging")}


def beltcomm(*words: str) -> Result:
    result = CliRunner().invoke(cli, [*words, "--json"], standalone_mode=False)
    assert result.exception is None, result.exception
    return result


def test_compare_says_where_the_hidden_effect_is_added_and_the_error_falls(hidden_cogging: tuple[Path, float], tmp_path: Path) -> None:
    folder, order = hidden_cogging
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    before = {path: path.read_bytes() for path in sorted((run / "recordings").iterdir())}

    first = json.loads(beltcomm("compare", str(run), "--no-pictures").stdout)["worst"][0]
    assert (first["dimension"], first["low"]) == ("angle", order)
    assert first["text"].startswith(f"{order:.0f} times per turn of the motor")
    assert not (run / "pictures").exists()

    added = json.loads(beltcomm("add", "cogging", str(run)).stdout)
    assert added["before"]["ratio"] > 1.2
    assert added["after"]["ratio"] < 1.1
    assert added["after"]["held_out"] < added["before"]["held_out"]
    assert added["confirmed"]
    assert added["parameters"]["cogging.order"]["value"] == order
    assert added["cost"]["unaware"]["dynamic_m"] > 0.0
    assert (run / added["pictures"][0]).is_file()

    compared = json.loads(beltcomm("compare", str(run)).stdout)
    assert {"compare_maps.png", "compare_overlay.png", "compare_response.png"} <= {Path(p).name for p in compared["pictures"]}
    assert not [place for place in compared["worst"] if place["dimension"] == "angle"], "the ripple is in the model now"
    assert compared["ratio"]["overall"] == pytest.approx(added["after"]["ratio"], rel=0.02)
    ladder = json.loads(beltcomm("ladder", str(run), "--no-pictures").stdout)
    assert [rung["change"] for rung in ladder["revisions"]] == ["base", "+cogging"]
    first, second = ladder["revisions"]
    assert first["cost"] is None
    assert second["cost"] == {"of": "cogging", **added["cost"]}
    low, high = second["cost"]["aware_range"]
    assert low["dynamic_m"] < high["dynamic_m"], "over the intervals of the model"
    text = CliRunner().invoke(cli, ["ladder", str(run), "--no-pictures"], standalone_mode=False).stdout
    assert f"revision_2  {second['when']}, {len(second['data'])} recordings, data {second['data_hash']}\n" in text
    assert f"    beltcomm add cogging {run}" in text
    assert f"{in_mm(added['cost']['unaware']['dynamic_m'])} (" in text
    assert {path: path.read_bytes() for path in sorted((run / "recordings").iterdir())} == before


@pytest.mark.examination
def test_a_detour_is_judged_again(apart: tuple[Data, Fitted, dict[str, Fitted]]) -> None:
    """Quadratic drag first, thrown out when the cogging was found: as if both had been tried.  The other way round it stays."""
    data, base, fits = apart

    def steps(first: str, second: str) -> list[Stage]:
        tried = candidate(data, base, effect_named(first), 0.0, fits[first], 1)
        return [Stage(base, (tried,), first, (), fits[first]), Stage(fits[first], (), second, (first,), fits[second])]

    found = _find_shortcut([data, data], steps("quadratic_drag", "cogging"))
    assert found is not None
    number, step = found
    assert (number, step.before, step.added, step.removed, step.detour) == (0, base, "cogging", (), ("quadratic_drag",))
    assert [c.effect.name for c in step.candidates] == ["cogging", "quadratic_drag"]
    assert _find_shortcut([data, data], steps("cogging", "quadratic_drag")) is None
    tried, last = steps("quadratic_drag", "cogging")
    shaped = Stage(tried.after, (), "", (), tried.after, ("cogging.order",))
    found = _find_shortcut([data], [tried, shaped, last])
    assert found is not None
    assert found[0] == 0
    assert found[1].forms == ("cogging.order",), "a form that stays in the model stays in its steps"
    kept = Stage(fits["quadratic_drag"], (), "cogging", (), fits["cogging"])
    assert _find_shortcut([data], [kept]) is None, "nothing came before it"


@pytest.mark.examination
def test_adding_begins_where_the_diagnosis_ended(
    hidden_cogging: tuple[Path, float], apart: tuple[Data, Fitted, dict[str, Fitted]], tmp_path: Path
) -> None:
    """From an order that is not there the fit finds nothing; the values that a diagnosis left in the folder lead it to the cogging."""
    data, base, fits = apart
    right = fits["cogging"]
    wrong = fit(data, base.model.with_effect("cogging", {"order": hidden_cogging[1] + 7.0}), 3, offsets=base.offsets)
    other = RunFolder.open(shutil.copytree(hidden_cogging[0], tmp_path / "run"))

    assert _better(other, data, base, wrong, "cogging") is wrong, "no diagnosis yet"
    found = {"effects": list(right.model.effects), "parameters": {name: {"value": v.value} for name, v in right.model.parameters.items()}}
    other.save("results", "diagnosis", {"after": found})
    led = _better(other, data, base, wrong, "cogging")
    assert led.objective <= right.objective + 0.1, "it begins there, and may go on"
    assert led.model["cogging.order"] == pytest.approx(right.model["cogging.order"], rel=1e-3)
    assert _better(other, data, base, wrong, "stribeck") is wrong, "the diagnosis says nothing of it"
    form = {"stribeck.exponent": {"value": 2.25}, "stribeck.amount": {"value": 0.03}}
    other.save("results", "diagnosis", {"after": {"effects": ["stribeck"], "parameters": form}})
    told = _diagnosis_start(other, base.model, "stribeck")
    assert told is not None
    assert (told["stribeck.amount"], told["stribeck.exponent"]) == (0.03, 2.0), "a form is found after its effect"
    for damaged in ({}, {"after": None}, {"after": {"effects": ["cogging"], "parameters": {"motor.inertia": {"value": -1.0}}}}):
        other.save("results", "diagnosis", damaged)
        assert _better(other, data, base, wrong, "cogging") is wrong


@pytest.mark.examination
def test_a_poor_data_set_says_what_it_cannot_show(hidden_cogging: tuple[Path, float], tmp_path: Path) -> None:
    folder = RunFolder.open(hidden_cogging[0])
    weakest = []
    for wanted in ("", "frf_p1"):
        recordings = [r for r in folder.recordings() if wanted in r.name]
        data, fitted = fit_base_of(recordings, folder.axis, start_model(folder.axis, recordings))
        ground = ground_of(fitted, data.fitted, folder.axis)
        weakest.append({sight.effect.name: sight for sight in detection_limits(Scorer(fitted), ground)})
    rich, poor = weakest
    assert all(sight.is_detectable for name, sight in rich.items() if name != "encoder_eccentricity"), "the default plan shows them"
    for name in ("warmup", "cable_chain", "quadratic_drag"):
        assert rich[name].is_detectable
        assert not poor[name].is_detectable
    assert poor["dead_time"].is_detectable
    assert all(poor[name].hardest > 0.99 * rich[name].hardest for name in ("stribeck", "cogging", "dead_time", "constant_offset"))


@pytest.mark.examination
def test_words_of_the_family_create_one_effect(hidden_cogging: tuple[Path, float], tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(hidden_cogging[0], run)
    for path in (run / "recordings").iterdir():  # one excited record is enough for this, and quick
        if "frf" not in path.name:
            path.unlink()
    added = json.loads(beltcomm("add", "tilt", str(run), "--no-cost", "--no-pictures").stdout)
    assert added["change"] == "+constant_offset"
    removed = json.loads(beltcomm("remove", "coulomb_asymmetry", str(run), "--no-pictures").stdout)
    assert removed["change"] == "-constant_offset"
    folder = RunFolder.open(run)
    assert trusted_model(folder)[1] == revisions(folder)[-1].name, "a design rests on what the user has decided"
