"""A gap is named for what it explains beyond the freedom of its observer, which follows whatever pushes the carriage."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.effects import effect_named
from beltcomm.fit.estimate import fit
from beltcomm.fit.records import prepare, with_process_noise
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory import diagnosis, gaps
from beltcomm.laboratory.gaps import _gap_is_supported
from beltcomm.laboratory.selection import Candidate
from beltcomm.model import build_model
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.ladder import added_notes, trial_line
from truth.hidden import Machine, draw, recorder
from truth.hidden import layout as at
from truth.hidden.folder import write_records
from truth.hidden.layout import Array
from truth.hidden.session import Session, plan

GAP = effect_named("backlash")
BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {})


def jumping(low_n: float, high_n: float) -> Callable[..., tuple[Array, ...]]:
    """The recorder with friction at the carriage that jumps between two levels, each held for 0.1 to 1 s."""
    run, rng = recorder.run, np.random.default_rng(7)

    def jumps(s: Array, p: Array, bursts: Array, gains: Array, memory: Array, *rest: Any) -> tuple[Array, ...]:
        drive, target, forward, unsteady, *_, longest = rest
        parts, first = [], 0
        while first < len(forward):
            last = first + int(rng.uniform(100.0, 1000.0))
            p[at.COULOMB_CART] = low_n + high_n - (p[at.COULOMB_CART] or low_n)
            asked = (column[first:last] for column in (target, forward, unsteady))
            parts.append(run(s, p, bursts, gains, memory, drive, *asked, np.zeros(0), np.zeros(0), longest))
            first = last
        return tuple(np.concatenate(columns) for columns in zip(*parts, strict=True))

    return jumps


def needed_in(machine: Machine, folder: Path) -> bool:
    """Whether a gap is needed in the response of a machine at one place."""
    session = Session(machine)
    task = next(task for task in plan(machine, "default") if task.name == "frf_p1_a2")
    session.place(task.start_m)
    write_records(machine, [session.record(task)], str(folder))
    run = RunFolder.open(folder)
    model = start_model(run.axis, run.recordings()).with_effect("backlash", {"gap": 5e-5})
    data = with_process_noise(prepare(run.recordings(), run.axis, model), model)
    found = fit(data, model, 12)
    calmer = with_process_noise(data, found.model)
    return _gap_is_supported(calmer, fit(calmer, found.model, 6), GAP)


@pytest.mark.examination
def test_a_gap_is_likelier_than_a_carriage_that_strays_without_one(tmp_path: Path) -> None:
    assert needed_in(draw(31, ("backlash",), 0.7, "sheet"), tmp_path / "run")


def test_friction_that_jumps_at_random_is_no_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So backlash was named: 21.6 times the noise to 3.5, and the held-out records confirmed it."""
    machine = draw(31, (), 1.0, "sheet")
    machine.p[at.BRISTLE_CART] = 4e6
    monkeypatch.setattr(recorder, "run", jumping(8.0, 20.0))
    assert not needed_in(machine, tmp_path / "run")


@pytest.mark.parametrize(
    ("leads", "answer", "asked"),
    [
        ([0.5], False, ["stray", "fit 0"]),
        ([9.0, 0.5], False, ["stray", "fit 0", "fit 6"]),
        ([9.0, 4.5], True, ["stray", "fit 0", "fit 6"]),
        ([9.0, 2.0, 1.5], True, ["stray", "fit 0", "fit 6", "stray", "fit 0"]),
        ([9.0, 2.0, 0.5], False, ["stray", "fit 0", "fit 6", "stray", "fit 0"]),
    ],
)
def test_a_gap_is_asked_about_no_longer_than_the_answer_needs(
    monkeypatch: pytest.MonkeyPatch, leads: list[float], answer: bool, asked: list[str]
) -> None:
    """leads : of the gap before the closed model, one for each that is asked, as a multiple of what is enough."""
    heard: list[str] = []
    left = iter(leads)

    def fitted(data: Any, model: Any, iterations: int, fixed: Any) -> Any:
        heard.append(f"fit {iterations}")
        return SimpleNamespace(lead=next(left), model=model)

    def strayed(data: Any, model: Any) -> Any:
        heard.append("stray")
        return data

    monkeypatch.setattr(gaps, "_with_stray", lambda data, width: data)
    monkeypatch.setattr(gaps, "_with_likeliest_stray", strayed)
    monkeypatch.setattr(gaps, "fit", fitted)
    monkeypatch.setattr(gaps, "_exceeds_threshold", lambda grown, closed, times=1.0: closed.lead > times)
    grown: Any = SimpleNamespace(model=BASE.with_effect("backlash", {"gap": 5e-5}), held_out_share=0.5)
    data: Any = None  # nothing is fitted
    assert _gap_is_supported(data, grown, GAP) is answer
    assert heard == asked


def searched(
    monkeypatch: pytest.MonkeyPatch, found: list[list[str]], own: Callable[[Any], bool], alone: tuple[str, ...] = (), imitates: str = ""
) -> Any:
    """The steps of a search with these candidates at each stage, all accepted, and what was said of them.

    own : whether a model needs its gap.   alone : effects beside which the gap is superfluous.   imitates : effect in whose place a
    coupling is likelier.
    """

    def fitted(model: Any) -> Any:
        size = {
            "objective": 2.0,
            "problem": SimpleNamespace(samples=1, forget=lambda: None),
            "ratio": 2.0,
            "held_out_ratio": None,
            "held_out_share": 0.5,
        }
        return SimpleNamespace(model=model, **size)

    stages = iter(found)

    def search(_data: Any, current: Any, *_: Any) -> list[Candidate]:
        names = next(stages)
        grown = [fitted(current.model.with_effect(name)) for name in names]
        sizes = [9000.0 / (n + 1) for n in range(len(names))]
        return [Candidate(effect_named(name), e, e, 0.5, e, g, True) for name, e, g in zip(names, sizes, grown, strict=True)]

    def superfluous(_data: Any, grown: Any, _base: Any, newest: str) -> Any:
        return (fitted(grown.model.without_effect("backlash")), ("backlash",)) if newest in alone else (grown, ())

    heard: list[Candidate] = []
    monkeypatch.setattr(gaps, "_gap_is_supported", lambda _data, grown, _gap: own(grown.model))
    monkeypatch.setattr(diagnosis, "_find_candidates", search)
    monkeypatch.setattr(diagnosis, "drop_superfluous", superfluous)
    monkeypatch.setattr(diagnosis, "refit_with_rebuilt_motion", lambda data, grown, _iterations: (data, grown))
    monkeypatch.setattr(diagnosis, "final_refit", lambda data, grown: (data, grown))
    monkeypatch.setattr(diagnosis, "converged_gap", lambda data, grown: (data, grown))
    monkeypatch.setattr(diagnosis, "fit_law_shapes", lambda _data, grown, _base: SimpleNamespace(fitted=grown, new=(), removed=()))
    monkeypatch.setattr(diagnosis, "assign_body", lambda *_: SimpleNamespace(new=()))
    for name in ("Scorer", "_escape_if_far_off", "_find_shortcut", "_remaining_structure", "_verdict_of"):
        monkeypatch.setattr(diagnosis, name, lambda *_: None)
    monkeypatch.setattr(diagnosis, "lowers", lambda *_: True)
    monkeypatch.setattr(diagnosis, "coupling_candidate", lambda *_: None)

    def instead(_data: Any, base: Any, current: Any, _axis: Any) -> Candidate | None:
        grown = fitted(base.model.with_effect("coupling"))
        return Candidate(effect_named("coupling"), 1.0, 1.0, 0.6, 1.0, grown, True) if imitates in current.model.effects else None

    monkeypatch.setattr(diagnosis, "coupling_instead", instead)
    monkeypatch.setattr(diagnosis, "refit_from_several_stiffnesses", lambda data, grown: (data, grown))
    monkeypatch.setattr(diagnosis, "_as_searched", lambda data, base: (data, base))
    monkeypatch.setattr(diagnosis, "least_plain_error", lambda _data, last, *_: last)
    begun: Any = SimpleNamespace(fitted=(), held_out=(), substeps=4, path=SimpleNamespace(rivals=())), fitted(BASE)
    nothing: Any = SimpleNamespace()
    after = diagnosis.diagnose([], nothing, nothing, begun=begun, trying=heard.append)
    assert next(stages, None) is None, "every stage was looked at"
    return after, [c.effect.name for c in heard if c.unneeded]


def test_a_coupling_takes_the_place_of_what_imitated_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The payload that was named first stood in its way; it is asked for once."""
    after, _ = searched(monkeypatch, [["payload_mode"], ["cogging"], [], ["cogging"], []], lambda _model: True, imitates="payload_mode")
    assert [step.added for step in after.steps] == ["coupling", "cogging", ""]
    assert after.final_fit.model.effects == BASE.with_effect("coupling").with_effect("cogging").effects


def test_a_gap_that_is_needed_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    after, refused = searched(monkeypatch, [["backlash", "cogging"], ["cogging"], []], lambda _model: True)
    assert ([step.added for step in after.steps], refused) == (["backlash", "cogging", ""], [])


def test_where_a_straying_carriage_does_as_well_the_next_effect_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a look behind the gap, where nothing shows itself; the second time without one."""
    found = [["backlash", "cogging"], [], ["backlash", "tilt"], []]
    after, refused = searched(monkeypatch, found, lambda _model: False)
    assert ([step.added for step in after.steps], refused) == (["cogging", "tilt", ""], ["backlash", "backlash"])
    assert next(c.against for c in after.steps[0].candidates).startswith("a carriage that strays")
    assert after.final_fit.model.effects == BASE.with_effect("cogging").with_effect("tilt").effects


def test_what_shows_itself_only_behind_a_gap_in_doubt_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slack strand: the search to first order did not see it without the gap, and beside it the gap is nothing."""
    after, refused = searched(monkeypatch, [["backlash", "cogging"], ["belt_slack"], []], lambda _model: False, ("belt_slack",))
    assert ([step.added for step in after.steps], refused) == (["backlash", "belt_slack", ""], [])
    assert after.added_effects == ["belt_slack"]


def test_a_gap_in_doubt_stays_that_is_needed_beside_what_else_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [["backlash", "cogging"], ["cogging"], []]
    after, refused = searched(monkeypatch, found, lambda model: "cogging" in model.effects)
    assert ([step.added for step in after.steps], refused) == (["backlash", "cogging", ""], [])


def test_it_is_said_why_a_gap_is_not_taken() -> None:
    there: Any = SimpleNamespace(held_out_share=0.5)
    refused = Candidate(GAP, 9.0, 9.0, 0.5, 9.0, there, False, unneeded=True)
    assert refused.against == "a carriage that strays as far without it explains as much"
    assert trial_line(refused).startswith("backlash taken back, a carriage that strays as far")


@pytest.mark.parametrize(
    ("effect", "beside", "own", "strays"),
    [
        ("backlash", "cogging", False, True),
        ("backlash", "cogging", True, False),
        ("backlash", "measurement_lag", False, False),  # then nothing follows the carriage
        ("cogging", "backlash", False, False),
    ],
)
def test_only_a_gap_behind_an_observer_can_be_one_that_a_straying_carriage_does_without(
    monkeypatch: pytest.MonkeyPatch, effect: str, beside: str, own: bool, strays: bool
) -> None:
    monkeypatch.setattr(gaps, "_gap_is_supported", lambda *_: own)
    grown: Any = SimpleNamespace(model=BASE.with_effect(effect).with_effect(beside), held_out_share=0.5)
    data: Any = None
    assert gaps.is_replaceable_gap(data, grown, effect_named(effect)) is strays


def test_who_adds_such_a_gap_is_told() -> None:
    assert added_notes("backlash", "backlash", False) == []
    (doubt,) = added_notes("backlash", "backlash", True)
    assert "as much without backlash" in doubt
    (alike,) = added_notes("tilt", "constant_offset", False)
    assert alike.endswith("added as constant_offset")
