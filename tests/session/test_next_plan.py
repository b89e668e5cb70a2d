"""What to record next: the plan, its file, and the model a design rests on."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.effects import EFFECTS, effect_named
from beltcomm.errors import UsageError
from beltcomm.experiments import execute_step
from beltcomm.experiments.bounds import course_before
from beltcomm.experiments.paths import Course, path_of, start_of
from beltcomm.experiments.redundant_steps import Before, record_showing
from beltcomm.laboratory.visible import DetectionLimit
from beltcomm.model import load_plant
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.rundata.proof import doubts
from beltcomm.rundata.revisions import new_revision, trusted_model
from beltcomm.runfolder import RunFolder
from beltcomm.schedule import record_schedule
from beltcomm.schedule.next_plan import _discriminating_experiment, _plan_apart, load_plan, plan_for
from beltcomm.schedule.record_schedule import Extent
from beltcomm.schedule.steps import PLACES, Step
from fuzz.parsers import DESIGN

#: m of the carriage per radian of the motor.
RATIO = 0.01


def blind(name: str, strength: float = 4.0) -> DetectionLimit:
    return DetectionLimit(effect_named(name), strength, strength, "amount", 0.02, "N m")


def test_twins_are_told_apart_by_what_their_file_says() -> None:
    plan = plan_for(("cogging", "tooth_ripple"), [blind("warmup")])
    assert set(plan.reasons) == {"cogging", "tooth_ripple"}
    assert any("belt off" in text for text in plan.by_hand)


def test_twins_get_the_experiment_that_separates_them_and_not_what_shows_each() -> None:
    plan = plan_for(("dead_time", "current_lag"), [])
    assert [(s.kind, s.up_to_hz) for s in plan.steps] == [("response", 250.0)], "three usual responses tell nothing new"
    assert not plan.by_hand
    tiny = plan_for(("presliding_cart", "cart_friction"), []).steps
    assert {s.kind for s in tiny} == {"response", "reversals"}
    assert max(s.share for s in tiny if s.kind == "response") < 0.1
    assert plan_for(("cogging", "tooth_ripple"), []).steps == ()


def test_every_pair_of_twins_has_an_experiment() -> None:
    for effect in EFFECTS:
        for twin in effect.twins:
            between = _discriminating_experiment(effect.name, twin) if twin not in effect.apart else effect.apart[twin]
            assert between.records or between.hands, (effect.name, twin)
            if twin in {e.name for e in EFFECTS}:
                _plan_apart((effect.name, twin), lambda _: "")  # its records are steps that a drive knows


def test_a_record_that_shows_as_much_is_left_out_and_said() -> None:
    plan = plan_for(("dead_time", "current_lag"), [], already=lambda step: "frf_9")
    assert plan.steps == ()
    said = "\n".join(plan.lines(Path("RUN")))
    assert "left out: excitation at 50 % of the travel" in said
    assert "frf_9 shows as much" in said
    assert "by hand: record an excitation up to 250 Hz" in said, "an empty plan says what is left to do"
    assert plan.command(Path("RUN")) == ""


def test_what_no_motion_separates_is_told_by_hand() -> None:
    plan = plan_for((), [], named=("constant_offset",))
    said = " ".join(plan.by_hand)
    assert plan.steps == ()
    assert {"tilt", "coulomb_asymmetry", "current_offset"} == {text.split(":")[0] for text in plan.by_hand}
    for word in ("spirit level", "payload", "end for end", "spring balance", "belt off", "RUN_AFTER"):
        assert word in said
    assert plan_for((), [], named=("stribeck",)).reasons == {}


def test_an_empty_plan_says_why_it_cannot_be_run(tmp_path: Path) -> None:
    path = tmp_path / "next.yaml"
    path.write_text(yaml.safe_dump(plan_for(("cogging", "tooth_ripple"), []).to_dict()), encoding="utf-8")
    with pytest.raises(UsageError, match=r"no record of this axis would tell more\. By hand: .*belt off"):
        load_plan(path)


def excited(seconds: float, clock: int, amplitude_nm: float = 1.0, at_m: float = 0.28) -> Recording:
    """A binary excitation."""
    count = round(seconds * 1e3)
    bits = np.sign(np.random.default_rng(1).normal(size=count // clock + 1))
    torque = amplitude_nm * np.repeat(bits, clock)[:count]
    time = 1e-3 * np.arange(count)
    note = ExcitationNote("prbs", amplitude_nm)
    return Recording("frf_9", time, torque, 1e-3 * np.sin(20.0 * time), sidecar=Sidecar("frf", at_m, excitation=note))


@pytest.mark.parametrize(
    ("record", "there"),
    [
        (excited(20.0, 2), True),
        (excited(7.0, 2), False),
        (excited(20.0, 7), False),
        (excited(20.0, 2, at_m=0.5), False),
    ],
    ids=["as asked", "too short", "only up to 140 Hz", "another place"],
)
def test_a_repetition_is_left_out_only_where_it_shows_nothing_new(record: Recording, there: bool) -> None:
    step = plan_for(("dead_time", "current_lag"), []).steps[0]
    assert bool(record_showing(step, Before([record], (0.0, 0.56), 0.01, 0.1))) is there


def test_a_quiet_excitation_is_not_there_because_of_a_loud_one() -> None:
    step = plan_for(("presliding_cart", "cart_friction"), []).steps[0]
    loud = excited(20.0, 2)
    assert not record_showing(step, Before([loud], (0.0, 0.56), 0.01, 0.1))
    assert record_showing(step, Before([loud, excited(20.0, 2, 0.12)], (0.0, 0.56), 0.01, 0.1))


def test_what_was_not_seen_gets_its_records() -> None:
    plan = plan_for((), [blind("stribeck"), blind("end_pulley", math.inf), blind("warmup")])
    kinds = [step.kind for step in plan.steps]
    assert kinds.count("sweep") == 2, "warming up shows between a first and a last sweep"
    assert kinds[0] == kinds[-1] == "sweep"
    assert {"response", "strokes"} <= set(kinds)
    assert any(step.held_out for step in plan.steps)
    assert "these data say nothing of it" in plan.reasons["end_pulley"]


def kinds_there(*kinds: str) -> Callable[[Step], str]:
    """A run that has all steps of some kinds."""
    return lambda step: f"{step.kind}_1" if step.kind in kinds else ""


def test_records_that_are_there_are_not_made_again() -> None:
    plan = plan_for((), [blind("belt_slack"), blind("stribeck")], already=kinds_there("response", "sweep", "moves"))
    assert {step.kind for step in plan.steps} == {"strokes"}
    assert any(text.startswith("belt_slack: such records are here already") for text in plan.by_hand)
    assert any(text.endswith("response_1 shows as much, the same once more would show nothing new") for text in plan.left_out)
    assert plan_for((), [blind("belt_slack")], already=kinds_there("response", "moves")).steps == ()


def test_reversals_and_fast_moves_are_proposed_where_an_effect_needs_them() -> None:
    assert [s.kind for s in plan_for((), [blind("presliding")], already=kinds_there("response")).steps] == ["reversals"]
    moves = plan_for((), [blind("torque_saturation")], already=kinds_there("response")).steps
    assert [s.held_out for s in moves] == [False, True], "held-out moves judge what the fast ones show"
    fast_there = plan_for((), [blind("torque_saturation")], already=lambda step: "" if step.held_out else "moves_1")
    assert fast_there.steps == (), "and would judge nothing new alone"


@cache
def course() -> Course:
    """Of the usual axis."""
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        return course_before(load_axis("egc-70-600"), drive.capabilities, 10.0)


def session(extent: Extent, but: Collection[str] = ()) -> Before:
    """What a commissioning leaves, the search before it left out.   but : kinds for which there was no time."""
    clock_s, recordings = 0.0, []
    steps = [Step("response"), *(item.step for item in record_schedule.BY_EXTENT[extent] if item.step.kind not in but)]
    for name, step in record_schedule.named_steps(steps):
        if step.kind == "response":
            amplitude = execute_step.quieter(1.0, 0.1, step.share)
            made = excited(step.seconds or execute_step.RESPONSE_S, 4, amplitude, course().place_m(step))
        else:
            start_m = start_of(step, course())
            path = path_of(step, course(), start_m)
            position, speed = path.position_m / RATIO, path.velocity_m_s / RATIO
            time = path.sample_period_s * np.arange(len(speed))
            made = Recording(
                name, time, 1e-3 * time, position, reference_velocity=speed, sidecar=Sidecar(execute_step.EXPERIMENT[step.kind], start_m)
            )
        sidecar = replace(made.sidecar, session_time_s=clock_s, held_out=step.held_out)
        recordings.append(replace(made, name=name, sidecar=sidecar))
        clock_s += float(made.t_s[-1]) + 1.0
    return Before(recordings, course().window_m, RATIO, 0.1)


def proposed(before: Before, *effects: str) -> list[tuple[str, float]]:
    """Kind and place of what is to be recorded."""
    plan = plan_for((), [blind(name) for name in effects], already=lambda step: record_showing(step, before))
    return [(step.kind, step.place) for step in plan.steps]


BLIND = ("stiffness_position", "belt_slack", "stribeck", "warmup", "presliding", "torque_saturation", "backlash")


def test_a_thorough_session_has_every_record() -> None:
    assert proposed(session("thorough"), *BLIND) == []


def test_a_usual_session_is_told_the_longer_and_the_missing_ones() -> None:
    usual = session("standard")
    assert proposed(usual, "stiffness_position") == [("response", 0.12), ("response", 0.88)], "the first response is long, the others short"
    assert proposed(usual, "stribeck") == [("strokes", place) for place in PLACES]
    assert ("sweep", 0.5) not in proposed(usual, *BLIND)
    assert ("moves", 0.5) in proposed(session("standard", but=("moves",)), "torque_saturation")
    assert ("moves", 0.5) not in proposed(usual, "torque_saturation")


def test_a_quick_session_is_told_everything_but_the_first_sweep() -> None:
    wanted = proposed(session("quick"), *BLIND)
    assert {kind for kind, _ in wanted} == {"response", "strokes", "reversals", "moves", "sweep"}
    assert wanted[-1][0] == "sweep", "the last one, for what warms up"
    assert [kind for kind, _ in wanted].count("sweep") == 1


def test_fast_moves_are_there_as_hard_as_they_were() -> None:
    before = session("standard")
    assert record_showing(Step("moves", share=0.9), before) == "moves_1"
    assert not record_showing(Step("moves", share=0.45), before), "half the force tells apart what grows with it"


def test_strokes_of_one_place_are_none_of_another() -> None:
    before = session("thorough")
    found = [record_showing(Step("strokes", place, speeds_m_s=(0.01, 0.03, 0.06)), before) for place in (*PLACES, 0.62)]
    assert found == ["strokes_1", "strokes_2", "strokes_3", ""], "a sweep only passes"
    strokes_only = replace(before, recordings=[r for r in before.recordings if r.name.startswith("strokes")])
    assert not record_showing(Step("sweep"), strokes_only), "nor a sweep"
    assert not record_showing(Step("strokes", 0.5, speeds_m_s=(0.003, 0.03)), before), "slower tells more"


def test_nothing_to_record() -> None:
    assert plan_for((), []).steps == ()
    assert "Nothing more" in plan_for((), []).lines(Path("RUN"))[0]


def test_the_file_holds_the_plan(tmp_path: Path) -> None:
    plan = plan_for((), [blind("stribeck"), blind("backlash"), blind("warmup"), blind("torque_saturation")])
    assert {step.kind for step in plan.steps} == {"response", "strokes", "sweep", "reversals", "moves"}
    path = tmp_path / "next.yaml"
    path.write_text(yaml.safe_dump(plan.to_dict()), encoding="utf-8")
    assert load_plan(path) == replace(plan, edited=True), "nobody sealed it"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("steps: []", "has no steps"),
        ("steps: [{kind: jump}]", "kind must be one of"),
        ("steps: [{kind: response, place: 3.0}]", "between 0 and 1"),
        ("steps: [{kind: strokes, place: 0.5}]", "speeds_m_s"),
        ("steps: [{kind: sweep, speed: 1}]", "there is no speed"),
        ("steps: [{kind: response, place: here}]", "place is here; give a number between 0 and 1"),
        ("steps: [{kind: reversals, place: 0.5}]", "amplitudes_m"),
        ("steps: [{kind: reversals, amplitudes_m: [0.5]}]", "between 0 and 0.02"),
        ("steps: [{kind: response, up_to_hz: 1e5}]", "up_to_hz"),
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

    gains = {"kp_nm_s_rad": 0.1, "ki_nm_rad": 0.4, "kpp_1_s": 10.0, "velocity_filter_s": 0.004}
    folder.save("results", "fit", {"suspect": True})
    error = {"dynamic_m": 1e-4, "static_m": 1e-5}
    folder.save("results", "verify_move_1", {"passed": True, "measured": error, "predicted": error, "proof": {"gains": gains}})
    folder.save("designs", "final", {**DESIGN, "parameters": gains, "revision": ""})
    assert doubts(folder) == ["the model does not explain what was measured"]
    folder.save("designs", "final", {**DESIGN, "parameters": gains, "revision": "revision_2"})
    assert doubts(folder) == []
