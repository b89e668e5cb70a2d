"""What to record next: the plan, its file, and the model a design rests on."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml

from beltcomm.axis import load_axis
from beltcomm.effects import effect_named
from beltcomm.errors import UsageError
from beltcomm.laboratory.visible import Sight
from beltcomm.model import load_plant
from beltcomm.runfolder import RunFolder
from beltcomm.session.next_plan import load_plan, plan_for
from beltcomm.session.proof import doubts
from beltcomm.session.revisions import new_revision, trusted_model


def blind(name: str, strength: float = 4.0) -> Sight:
    return Sight(effect_named(name), strength, strength, "amount", 0.02, "N m")


def test_twins_are_told_apart_by_what_their_file_says() -> None:
    plan = plan_for(("cogging", "tooth_ripple"), [blind("warmup")])
    assert set(plan.reasons) == {"cogging", "tooth_ripple"}
    assert any("belt off" in text for text in plan.by_hand)


def test_what_was_not_seen_gets_its_records() -> None:
    plan = plan_for((), [blind("stribeck"), blind("end_pulley", math.inf), blind("warmup")])
    kinds = [step.kind for step in plan.steps]
    assert kinds.count("sweep") == 2, "warming up shows between a first and a last sweep"
    assert kinds[0] == kinds[-1] == "sweep"
    assert {"response", "strokes"} <= set(kinds)
    assert any(step.held_out for step in plan.steps)
    assert "these data say nothing of it" in plan.reasons["end_pulley"]


def test_records_that_are_there_are_not_made_again() -> None:
    plan = plan_for((), [blind("belt_slack"), blind("stribeck")], frozenset({"places", "quiet", "sweep", "fast"}))
    assert {step.kind for step in plan.steps} == {"strokes"}
    assert any(text.startswith("belt_slack: such records are here already") for text in plan.by_hand)
    assert plan_for((), [blind("belt_slack")], frozenset({"places", "quiet", "fast"})).steps == ()


def test_reversals_and_fast_moves_are_proposed_where_an_effect_needs_them() -> None:
    assert [s.kind for s in plan_for((), [blind("presliding")], frozenset({"quiet"})).steps] == ["reversals"]
    moves = [s for s in plan_for((), [blind("torque_saturation")], frozenset({"places"})).steps if s.kind == "moves"]
    assert [s.held_out for s in moves] == [False, True], "held-out moves judge what the fast ones show"


def test_nothing_to_record() -> None:
    assert plan_for((), []).steps == ()
    assert "Nothing more" in plan_for((), []).lines(Path("RUN"))[0]


def test_the_file_holds_the_plan(tmp_path: Path) -> None:
    plan = plan_for((), [blind("stribeck"), blind("backlash"), blind("warmup"), blind("torque_saturation")])
    assert {step.kind for step in plan.steps} == {"response", "strokes", "sweep", "reversals", "moves"}
    path = tmp_path / "next.yaml"
    path.write_text(yaml.safe_dump(plan.to_dict()), encoding="utf-8")
    assert load_plan(path) == plan


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("steps: []", "has no steps"),
        ("steps: [{kind: jump}]", "kind must be one of"),
        ("steps: [{kind: response, place: 3.0}]", "between 0 and 1"),
        ("steps: [{kind: strokes, place: 0.5}]", "speeds_m_s"),
        ("steps: [{kind: sweep, speed: 1}]", "there is no speed"),
        ("steps: [{kind: response, place: here}]", "plain numbers"),
        ("steps: [{kind: reversals, place: 0.5}]", "amplitudes_m"),
        ("steps: [{kind: reversals, amplitudes_m: [0.5]}]", "at most 0.02"),
        ("steps: [{kind: moves, seconds: 900}]", "between 0 and 60"),
    ],
)
def test_a_wrong_file_is_a_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "next.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        load_plan(path)


def test_a_design_rests_on_the_last_model_that_was_not_contradicted(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    base = load_plant("g_a").model
    assert trusted_model(folder) == (None, "", "")
    better, worse = base.with_effect("stribeck"), base.with_effect("stribeck").with_effect("backlash")
    for model, change, confirmed in ((base, "base", None), (better, "+stribeck", True), (worse, "+backlash", False)):
        new_revision(folder, model, change, ratio=1.0, held_out=1.0, confirmed=confirmed, command="", when="")
    model, name, sentence = trusted_model(folder)
    assert model is not None
    assert model.effects == better.effects
    assert name == "revision_2"
    assert "revision_3 (+backlash) is not confirmed" in sentence

    gains = {"kp_nm_s_rad": 0.1}
    folder.save_result("fit", {"suspect": True})
    folder.save_result("verify_move_1", {"passed": True, "proof": {"gains": gains}})
    folder.save_design("final", {"parameters": gains, "revision": ""})
    assert doubts(folder) == ["the model does not explain what was measured"]
    folder.save_design("final", {"parameters": gains, "revision": "revision_2"})
    assert doubts(folder) == []
