"""What a diagnosis may be called."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from beltcomm.cli.talk import PlainTalk
from beltcomm.effects import effect_named
from beltcomm.fit.estimate import Fitted
from beltcomm.jobs import effect_search, laboratory
from beltcomm.laboratory import acceptance, diagnosis, selection
from beltcomm.laboratory.acceptance import (
    KNOWN,
    implausible_effects,
    is_negligible,
    only_cancels,
    parameters_at_bounds,
    share_left,
    undetermined_effects,
)
from beltcomm.laboratory.compare import NOISE_KNOWN, sign_of_missing
from beltcomm.laboratory.diagnosis import Stage, _verdict_of
from beltcomm.laboratory.samples import _excess, _partitions
from beltcomm.laboratory.selection import Candidate
from beltcomm.model import build_model
from beltcomm.rundata.revisions import Revision
from beltcomm.sentences import ladder
from beltcomm.sentences.ladder import climb_lines

BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {})


@pytest.mark.parametrize(
    ("effect", "values", "wanted"),
    [
        ("torque_ripple", {"sine": 0.1, "cosine": -0.5}, ["torque_ripple.cosine"]),
        ("torque_ripple", {"sine": 0.1, "cosine": -0.4}, []),
        ("stribeck", {"amount": 0.0, "speed_scale": 10.0}, ["stribeck.speed_scale"]),
        ("stribeck", {"amount": 0.0, "speed_scale": 0.2}, []),
    ],
)
def test_a_parameter_that_ran_into_its_bound_is_named(effect: str, values: dict[str, float], wanted: list[str]) -> None:
    assert parameters_at_bounds(BASE.with_effect(effect, values), BASE) == wanted


@pytest.mark.parametrize(
    ("widths", "open_"),
    [
        ({"payload.mass": 0.8, "payload_mode.stiffness": 1.5, "payload_mode.damping": None}, True),
        ({"payload.mass": 0.9 * KNOWN, "payload_mode.stiffness": 1.5, "payload_mode.damping": 1.5}, False),
        ({"payload.mass": 0.8, "payload_mode.stiffness": 0.1, "payload_mode.damping": None}, False),
    ],
)
def test_an_effect_of_which_no_number_is_known_is_named(widths: dict[str, float | None], open_: bool) -> None:
    model = BASE.with_effect("payload_mode", {})
    told = {
        name: replace(p, interval=None if widths.get(name) is None else widths[name] * abs(p.value)) for name, p in model.parameters.items()
    }
    assert undetermined_effects(replace(model, parameters=told), BASE) == (["payload_mode"] if open_ else [])
    assert undetermined_effects(BASE, BASE) == [], "what the base has is not judged"


@pytest.mark.parametrize(("ratio", "why"), [(0.05, []), (1.8, ["payload_mode as a payload that creeps back instead of swinging"])])
def test_a_payload_that_does_not_swing_is_named(ratio: float, why: list[str]) -> None:
    values = {"payload.mass": 2.0, "stiffness": 8e4, "damping": 2.0 * ratio * (8e4 * 2.0) ** 0.5}
    assert [found.partition(" (damping ratio")[0] for found in implausible_effects(BASE.with_effect("payload_mode", values), BASE)] == why


@pytest.mark.parametrize(("exponent", "why"), [(0.8, []), (0.5, ["stribeck as friction that falls with the logarithm of the speed"])])
def test_friction_that_falls_more_slowly_than_any_that_was_measured_is_named(exponent: float, why: list[str]) -> None:
    """So a contact that ages (Dieterich, Ruina) was imitated by Stribeck friction: 7.0 ± 7.1 rad/s, exponent at its end."""
    assert implausible_effects(BASE.with_effect("stribeck", {"exponent": exponent}), BASE) == why


@pytest.mark.parametrize(
    ("level", "ratio", "verdict"),
    [
        (1.0, 1.0, "explained"),
        (1.039, 1.0, "explained"),
        (1.041, 1.0, "partly explained"),
        (1.039, 1.6, "none of the known effects explains this"),
        (1.3, 1.47, "none of the known effects explains this"),
    ],
)
def test_what_is_explained_would_pass_as_a_machine_of_which_nothing_is_missing(
    monkeypatch: pytest.MonkeyPatch, level: float, ratio: float, verdict: str
) -> None:
    model, problem = BASE.with_effect("tilt", {}), SimpleNamespace(pieces=(), samples=5000)
    after: Any = SimpleNamespace(model=model, objective=level * 5000, problem=problem, ratio=ratio, held_out_ratio=None)
    base: Any = SimpleNamespace(model=BASE, ratio=1.5, held_out_ratio=None)
    monkeypatch.setattr(diagnosis, "with_intervals", lambda _fitted: BASE)
    assert _verdict_of(base, [Stage(base, (), "tilt", (), after)], (), 0.0) == verdict
    untouched: Any = SimpleNamespace(objective=after.objective, problem=after.problem, ratio=1.0, held_out_ratio=None, model=BASE)
    missing = _verdict_of(untouched, [], (), 0.0) != "nothing missing"
    assert missing is (level >= NOISE_KNOWN)
    assert not (missing and verdict == "explained")


@pytest.mark.parametrize(
    ("effect", "parameter", "size_m", "nothing"),
    [
        ("backlash", "gap", 0.0, True),
        ("backlash", "gap", 2e-5, False),
        ("presliding", "length", 1.5e-6, True),
        ("presliding", "length", 1.2e-5, False),
        ("cogging", "sine", 0.0, False),
    ],
)
def test_what_is_fitted_to_less_than_is_an_effect_explains_nothing(effect: str, parameter: str, size_m: float, nothing: bool) -> None:
    assert is_negligible(BASE.with_effect(effect, {parameter: size_m}), effect_named(effect)) is nothing


@pytest.mark.parametrize(
    ("dead_time_s", "lag_s", "nothing"),
    [(-485e-6, 505e-6, True), (-375e-6, 377e-6, True), (300e-6, 505e-6, False), (-100e-6, 505e-6, False), (0.0, 505e-6, False)],
)
def test_a_delay_that_another_one_takes_back_is_no_finding(dead_time_s: float, lag_s: float, nothing: bool) -> None:
    model = BASE.with_effect("dead_time", {"time": dead_time_s}).with_effect("current_lag", {"time": lag_s})
    assert [only_cancels(model, effect_named(name)) for name in ("dead_time", "current_lag", "cogging")] == [nothing, nothing, False]


def kept_beside_slack(monkeypatch: pytest.MonkeyPatch, grown: Any, smaller: Any, drop: float) -> Any:
    """What is kept of a model beside a slack strand, and what is thrown out.

    smaller : its refit without the gap.   drop : by how much O falls from that to the model, nats.
    """
    monkeypatch.setattr(selection, "_rise_without", lambda _fitted: {})
    monkeypatch.setattr(selection, "fit_of", lambda *_, **_options: smaller)
    monkeypatch.setattr(selection, "problem_of", lambda *_: None)
    monkeypatch.setattr(selection, "most_within", lambda *_: 0.0)
    monkeypatch.setattr(selection, "drop_by", lambda *_: drop)
    data: Any = SimpleNamespace(fitted=(), held_out=())
    return selection.drop_superfluous(data, grown, BASE, "belt_slack")


@pytest.mark.parametrize(("gap_m", "removed"), [(2e-8, ("backlash",)), (2e-5, ())])
def test_an_earlier_gap_of_no_width_is_thrown_out_however_much_its_observer_forgives(
    monkeypatch: pytest.MonkeyPatch, gap_m: float, removed: tuple[str, ...]
) -> None:
    both = BASE.with_effect("backlash", {"gap": gap_m}).with_effect("belt_slack", {})
    grown: Any = SimpleNamespace(model=both, offsets=np.zeros(1), ratio=1.0)
    smaller: Any = SimpleNamespace(model=grown.model.without_effect("backlash"), offsets=np.zeros(1), ratio=3.0)
    assert kept_beside_slack(monkeypatch, grown, smaller, 432.0) == (smaller if removed else grown, removed)


@pytest.mark.parametrize(("ratio", "removed"), [(1.1, ("backlash",)), (3.0, ())])
def test_nothing_is_superfluous_whose_loss_leaves_much_more(
    monkeypatch: pytest.MonkeyPatch, ratio: float, removed: tuple[str, ...]
) -> None:
    """What an observer does to the noise outweighed an error that went from 15 to 52: a gap was thrown out beside a late torque."""
    both = BASE.with_effect("backlash", {"gap": 1e-4}).with_effect("belt_slack", {})
    grown: Any = SimpleNamespace(model=both, offsets=np.zeros(1), ratio=1.0)
    smaller: Any = SimpleNamespace(model=both.without_effect("backlash"), offsets=np.zeros(1), ratio=ratio)
    assert kept_beside_slack(monkeypatch, grown, smaller, -5e3) == (smaller if removed else grown, removed)


def test_every_form_that_followed_an_effect_is_saved_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(laboratory, "current_revision", lambda _folder: "there")
    monkeypatch.setattr(laboratory, "_undetermined_in", lambda *_: [])
    monkeypatch.setattr(laboratory, "confirms", lambda *_: True)
    monkeypatch.setattr(laboratory, "revision_of", lambda _folder, new, old, change, *_: (old[1], new[1], change))
    step: Any = Stage  # names stand for models
    named = [
        step("base", (), "end_pulley", (), "X"),
        step("X", (), "", (), "Y", ("viscous_end_pulley",)),
        step("Y", (), "", ("warmup",), "Z", ("end_pulley.form",)),
        step("Z", (), "cogging", (), "last"),
        step("last", (), "", (), "last"),
    ]
    folder: Any = SimpleNamespace()
    found: Any = SimpleNamespace(base="base", steps=named, published_base=(None, "base"), data=None)
    made: Any = laboratory._climb(folder, found, True, "", "")
    assert made == [("base", "Z", "+end_pulley +viscous_end_pulley -warmup with its form"), ("Z", "last", "+cogging")]


@pytest.mark.parametrize(
    ("held", "added", "said"),
    [
        ((None, None), 0, ["No record is held out", "`beltcomm add cogging RUN`"]),
        (((3.0, 9.0), (2.0, 4.0)), 1, ["Not added: warmup.", "did not fall"]),
        (((3.0, 9.0), (3.1, 4.0)), 0, ["Not added: cogging and warmup.", "With cogging the error"]),
        (((3.0, 9.0), (2.0, 9.5)), 0, ["Not added: cogging and warmup.", "With cogging the error"]),
    ],
)
def test_only_what_held_out_records_confirm_is_added_by_itself(
    monkeypatch: pytest.MonkeyPatch, held: Any, added: int, said: list[str]
) -> None:
    """``held`` : ratio and objective of the held-out records before and with cogging; with warmup they stay as they are."""
    base, once, twice = (
        SimpleNamespace(model=name, held_out_ratio=h and h[0], held_out_level=h and h[1])
        for name, h in zip(("base", "once", "twice"), (*held, held[1]), strict=True)
    )
    monkeypatch.setattr(laboratory, "current_revision", lambda _folder: "there")
    monkeypatch.setattr(laboratory, "_undetermined_in", lambda *_: [])
    monkeypatch.setattr(
        laboratory,
        "revision_of",
        lambda _folder, _new, _old, change, *_: Revision("r", "", change, (change[1:],), 1.0, 1.0, True, "", "", {}),
    )
    step: Any = Stage
    steps = [step(base, (), "cogging", (), once), step(once, (), "warmup", (), twice), step(twice, (), "", (), twice)]
    folder: Any = SimpleNamespace()
    monkeypatch.setattr(acceptance, "changes", lambda *_: ((-1.0, 0.0), (-1.0, 0.0)))
    monkeypatch.setattr(laboratory, "confirms", lambda _folder, new, old: acceptance.is_confirmed(old[0], old[1], new[1]))
    found: Any = SimpleNamespace(base=base, steps=steps, published_base=(None, base), data=None)
    made = laboratory._climb(folder, found, True, "", "")
    assert len(made) == added
    text = "\n".join(climb_lines(made, ["cogging", "warmup"], held[1] is not None, Path("RUN")))
    assert all(part in text for part in said), text
    monkeypatch.setattr(laboratory, "_undetermined_in", lambda *_: ["cogging"])
    assert laboratory._climb(folder, found, True, "", "") == [], "an effect of which no number is known is a suggestion"
    assert "`beltcomm add cogging RUN`" in "\n".join(climb_lines([], ["cogging"], True, Path("RUN"), ["cogging"]))


def test_two_effects_that_only_both_together_are_confirmed_become_one_revision(monkeypatch: pytest.MonkeyPatch) -> None:
    base, once, twice = (
        SimpleNamespace(held_out_ratio=ratio, held_out_level=objective) for ratio, objective in ((3.0, 9.0), (3.1, 9.5), (1.0, 2.0))
    )
    monkeypatch.setattr(laboratory, "current_revision", lambda _folder: "there")
    monkeypatch.setattr(laboratory, "_undetermined_in", lambda *_: [])
    monkeypatch.setattr(laboratory, "revision_of", lambda _folder, new, old, change, *_: (old[1], new[1], change))
    step: Any = Stage
    steps = [step(base, (), "end_pulley", (), once), step(once, (), "warmup", (), twice), step(twice, (), "", (), twice)]
    folder: Any = SimpleNamespace()
    monkeypatch.setattr(acceptance, "changes", lambda *_: ((-1.0, 0.0), (-1.0, 0.0)))
    monkeypatch.setattr(laboratory, "confirms", lambda _folder, new, old: acceptance.is_confirmed(old[0], old[1], new[1]))
    found: Any = SimpleNamespace(base=base, steps=steps, published_base=(None, base), data=None)
    made: Any = laboratory._climb(folder, found, True, "", "")
    assert made == [(base, twice, "+end_pulley +warmup")]


@pytest.mark.parametrize(
    ("ranked", "twins"),
    [
        ((("measurement_lag", 900.0, True), ("dead_time", 880.0, True)), ("measurement_lag", "dead_time")),
        ((("dead_time", 900.0, True), ("measurement_lag", 880.0, True)), ("dead_time", "measurement_lag")),
        ((("dead_time", 900.0, True), ("cogging", 890.0, True), ("current_lag", 880.0, True)), ("dead_time", "current_lag")),
        ((("dead_time", 900.0, True), ("measurement_lag", 840.0, True)), ()),
        ((("dead_time", 900.0, True), ("measurement_lag", 880.0, False)), ()),
        ((("dead_time", 900.0, True), ("cogging", 890.0, True)), ()),
        ((("dead_time", 900.0, True),), ()),
        ((), ()),
    ],
)
def test_twins_are_told_whichever_comes_first_and_whoever_stands_between(ranked: Any, twins: tuple[str, ...]) -> None:
    given: Any = [SimpleNamespace(effect=effect_named(name), evidence=evidence, accepted=ok) for name, evidence, ok in ranked]
    assert diagnosis._twins_of(given) == twins


def test_noise_has_no_structure_and_a_small_constant_has() -> None:
    random = np.random.default_rng(3)
    number = np.repeat(np.arange(40), 500)
    noise = random.standard_normal(len(number))
    assert abs(_excess(noise, number)) < 5.0
    assert _excess(noise + 0.2 * (number % 2), number) > 25.0
    assert _excess(noise, np.arange(len(noise))) == 0.0, "bins of one value say nothing"


@pytest.mark.parametrize(
    ("verdict", "held", "said", "following"),
    [
        ("explained", (1.5, 1.0), False, "beltcomm improve RUN   (adds cogging and tilt"),
        ("partly explained", (1.49, 1.57), True, "beltcomm improve RUN   (adds cogging and tilt"),
        ("partly explained", (None, None), False, "beltcomm improve RUN   (adds cogging and tilt"),
        (diagnosis.NONE_EXPLAINS, (1.49, 1.57), True, "beltcomm compare RUN   (shows"),
    ],
)
def test_what_the_held_out_records_do_not_confirm_is_said(
    monkeypatch: pytest.MonkeyPatch, verdict: Any, held: Any, said: bool, following: str
) -> None:
    monkeypatch.setattr(ladder, "with_intervals", lambda _fitted: BASE)
    quiet = {"objective": 100.0, "problem": SimpleNamespace(pieces=(), samples=10)}
    base, after = (SimpleNamespace(model=BASE, ratio=2.0, held_out_ratio=ratio, held_out_residuals=(), **quiet) for ratio in held)
    found: Any = SimpleNamespace(
        base=base,
        published_base=(None, base),
        final_fit=after,
        published_model=after,
        steps=(),
        added_effects=["cogging", "tilt"],
        twins=(),
        verdict=verdict,
    )
    assert ("Not confirmed: on records that were not fitted the error was 1.49" in "\n".join(ladder.caveats(found))) is said
    assert following in ladder.after_diagnosis(found, Path("RUN"))[0]


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [
        ((2.0, None), (1.0, None), 0.0),
        ((2.0, None), (2.1, None), 1.14),
        ((2.0, 2.0), (2.1, 1.2), 0.147),  # less than half is left where nothing was fitted: a bad place of the others is none
        ((32.0, 8.5), (31.7, 7.3), 0.98),
        ((1.0, 1.0), (1.0, 1.0), 1.0),
        ((1.0, 1.0), (0.99, 1.0), 0.0),
    ],
)
def test_how_much_is_left_as_a_whole(before: tuple[float, float | None], after: tuple[float, float | None], share: float) -> None:
    one, two = (cast(Fitted, SimpleNamespace(ratio=ratio, held_out_ratio=held)) for ratio, held in (before, after))
    assert share_left(one, two) == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(
    ("grown", "held", "added"),
    [(1.5, 1.2, "measurement_lag"), (2.01, 2.0, "measurement_lag"), (2.1, 2.0, ""), (2.1, 1.1, "measurement_lag")],
)
def test_an_effect_with_which_the_error_as_a_whole_grows_is_not_taken(
    monkeypatch: pytest.MonkeyPatch, grown: float, held: float, added: str
) -> None:
    """But where the held-out records say that it is there; and a per cent is the noise, which is calibrated anew."""

    def fitted(ratio: float, held_out_ratio: float) -> Any:
        size: Any = {"objective": 10.0, "held_out_share": 0.5, "problem": SimpleNamespace(pieces=(), samples=10, forget=lambda: None)}
        return SimpleNamespace(model=SimpleNamespace(effects=()), ratio=ratio, held_out_ratio=held_out_ratio, **size)

    candidate = Candidate(effect_named("measurement_lag"), 0.0, 500.0, 0.5, 1.0, fitted(1.9, 1.9), accepted=True)
    found = [[candidate], []]
    monkeypatch.setattr(diagnosis, "search", lambda *_, **_options: found.pop(0))
    monkeypatch.setattr(diagnosis, "refit_with_rebuilt_motion", lambda data, *_: (data, fitted(grown, held)))
    for name in ("final_refit", "_as_searched"):
        monkeypatch.setattr(diagnosis, name, lambda data, last: (data, last))
    monkeypatch.setattr(diagnosis, "drop_superfluous", lambda _data, last, *_: (last, ()))
    monkeypatch.setattr(diagnosis, "fit_law_shapes", lambda _data, last, _base: SimpleNamespace(fitted=last, new=(), removed=()))
    monkeypatch.setattr(diagnosis, "assign_body", lambda *_: SimpleNamespace(new=()))
    for name in ("Scorer", "ground_of", "left_start_values", "_remaining_structure", "_verdict_of", "_escape_if_far_off"):
        monkeypatch.setattr(diagnosis, name, lambda *_: None)
    monkeypatch.setattr(diagnosis, "lowers", lambda *_: True)
    monkeypatch.setattr(diagnosis, "least_plain_error", lambda _data, last, *_: last)
    begun: Any = SimpleNamespace(fitted=(), held_out=(), substeps=4, path=SimpleNamespace(rivals=())), fitted(2.0, 2.0)
    nothing: Any = SimpleNamespace()
    after = diagnosis.diagnose([], nothing, nothing, begun=begun)
    assert after.steps[0].added == ("measurement_lag" if added else "")
    assert after.final_fit.ratio == (grown if added else 2.0)


def test_whatever_the_rest_goes_with_has_words() -> None:
    row = np.zeros(2)
    samples: Any = SimpleNamespace(speed=row, position=row, time=row, record=row)
    assert set(_partitions(samples)) == set(ladder.LEFT_WORDS)


def test_each_stage_of_a_search_is_a_phase_of_its_own_and_no_number_of_them_is_promised() -> None:
    text = io.StringIO()
    times = iter(range(0, 100, 4))
    talk = PlainTalk(text, clock=lambda: float(next(times)))
    talk.phase(1, 0, "search for missing effects")
    heard = effect_search._staged(talk)
    for stage, fraction in ((1, 0.25), (1, 0.5), (2, 0.25)):
        heard(stage, fraction)
    assert text.getvalue().splitlines() == [
        "[1] search for missing effects",
        "      25 %, about 12 s left",
        "      50 %, about 8 s left",
        "[2] search for what is still missing",
        "      25 %, about 12 s left",
    ]


@pytest.mark.parametrize(
    ("evidence", "held_out_gain", "more", "against"),
    [
        (500.0, 50.0, {"accepted": True}, ""),
        (500.0, 50.0, {"fitted": None}, ""),
        (500.0, 50.0, {"hollow": True}, "only at physically impossible values"),
        (500.0, 50.0, {"grows": True}, "with all fitted again the error as a whole grows"),
        (500.0, 50.0, {"idle": True}, "the error in plain units does not fall"),
        (500.0, 50.0, {"unneeded": True}, "a carriage that strays as far without it explains as much"),
        (500.0, -80.0, {}, "records held out speak against it"),
        (119.0, 50.0, {}, "evidence below 120"),
        (500.0, 50.0, {}, "explains too little"),
    ],
)
def test_why_a_candidate_may_not_be_named_is_said(evidence: float, held_out_gain: float, more: dict[str, Any], against: str) -> None:
    there: Any = SimpleNamespace(held_out_share=0.5)
    one = Candidate(effect_named("cogging"), 0.0, evidence, 0.1, held_out_gain, there, False)
    assert replace(one, **more).against == against


@pytest.mark.parametrize(
    ("level", "ratio", "held_out", "left", "effects", "missing"),
    [
        (1.0, 1.02, 1.02, 3.0, (), ""),
        (1.0, 1.19, 1.19, 3.0, (), ""),
        (1.0, 1.21, None, 3.0, (), "stretches"),
        (1.0, 1.02, 1.21, 3.0, (), "held out"),
        (1.11, 1.06, None, 3.0, (), "size"),
        (1.0, 1.02, None, 13.0, (), "structure"),
        (1.0, 1.02, None, 13.0, ("tilt",), ""),
        (1.0, 1.02, None, 26.0, ("tilt",), "structure"),
        (0.9, 0.96, None, 13.0, (), ""),
    ],
)
def test_compare_and_diagnose_ask_one_thing(
    level: float, ratio: float, held_out: float | None, left: float, effects: tuple[str, ...], missing: str
) -> None:
    """Where a stretch is given up, or only the records held out are not explained, `compare` said so and `diagnose` did not."""
    problem, model = SimpleNamespace(pieces=(), samples=5000), BASE
    for name in effects:
        model = model.with_effect(name, {})
    fitted: Any = SimpleNamespace(objective=level * 5000, problem=problem, ratio=ratio, held_out_ratio=held_out, model=model)
    assert sign_of_missing(fitted, left) == missing
    assert (_verdict_of(fitted, [], (), left) != "nothing missing") is bool(missing)
