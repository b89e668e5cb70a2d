"""A gap is named for what it explains beyond the freedom of its observer, which follows whatever pushes the carriage."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.effects import effect_named
from beltcomm.laboratory import diagnosis, freedom
from beltcomm.laboratory.data import agitated, prepare
from beltcomm.laboratory.fitting import fit
from beltcomm.laboratory.freedom import needed
from beltcomm.laboratory.stage import Candidate
from beltcomm.laboratory.start import start_model
from beltcomm.model import build_model
from beltcomm.runfolder import RunFolder
from beltcomm.session.ladder_words import added_notes, trial_line
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
        target, forward, _, longest = rest
        parts, first = [], 0
        while first < len(forward):
            last = first + int(rng.uniform(100.0, 1000.0))
            p[at.COULOMB_CART] = low_n + high_n - (p[at.COULOMB_CART] or low_n)
            parts.append(run(s, p, bursts, gains, memory, target[first:last], forward[first:last], np.zeros(0), longest))
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
    data = agitated(prepare(run.recordings(), run.axis, model), model)
    found = fit(data, model, 12)
    calmer = agitated(data, found.model)
    return needed(calmer, fit(calmer, found.model, 6), GAP)


def test_a_gap_is_likelier_than_a_carriage_that_strays_without_one(tmp_path: Path) -> None:
    assert needed_in(draw(31, ("backlash",), 0.7, "sheet"), tmp_path / "run")


def test_friction_that_jumps_at_random_is_no_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So backlash was named: 21.6 times the noise to 3.5, and the held-out records confirmed it."""
    machine = draw(31, (), 1.0, "sheet")
    machine.p[at.BRISTLE_CART] = 4e6
    monkeypatch.setattr(recorder, "run", jumping(8.0, 20.0))
    assert not needed_in(machine, tmp_path / "run")


@pytest.mark.parametrize(("own", "taken"), [(False, "tilt"), (True, "backlash")])
def test_where_a_straying_carriage_does_as_well_the_next_effect_is_asked(monkeypatch: pytest.MonkeyPatch, own: bool, taken: str) -> None:
    def trial(name: str, evidence: float) -> Candidate:
        fitted: Any = SimpleNamespace(model=BASE.with_effect(name), ratio=2.0)
        return Candidate(effect_named(name), evidence, evidence, 0.5, evidence, fitted, True)

    heard: list[Candidate] = []
    monkeypatch.setattr(diagnosis, "again", lambda data, fitted, _iterations: (data, fitted))
    monkeypatch.setattr(freedom, "needed", lambda *_: own)
    current: Any = SimpleNamespace(ratio=9.0)
    data: Any = None
    found = diagnosis.on_trial(data, current, [trial("backlash", 9000.0), trial("tilt", 500.0)], heard.append, True)
    assert found.best is not None
    assert found.best.effect.name == taken
    assert [c.effect.name for c in heard if c.unneeded] == (["backlash"] if taken == "tilt" else [])


def test_it_is_said_why_a_gap_is_not_taken() -> None:
    there: Any = SimpleNamespace()
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
    monkeypatch.setattr(freedom, "needed", lambda *_: own)
    grown: Any = SimpleNamespace(model=BASE.with_effect(effect).with_effect(beside))
    data: Any = None
    assert freedom.unneeded(data, grown, effect_named(effect)) is strays


def test_who_adds_such_a_gap_is_told() -> None:
    assert added_notes("backlash", "backlash", False) == []
    (doubt,) = added_notes("backlash", "backlash", True)
    assert "as much without backlash" in doubt
    (alike,) = added_notes("tilt", "constant_offset", False)
    assert alike.endswith("added as constant_offset")
