"""The search of the amplitude: which step follows which outcome.  Machine and models are stood in for; whole ones are in test_complete."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from beltcomm.axis import load_axis
from beltcomm.errors import Refused, SafetyStop
from beltcomm.excitation.choice import AS_CHOSEN
from beltcomm.experiments import raising
from beltcomm.fit.start.first_estimate import FirstPath
from beltcomm.fit.torque.path import FAITHFUL
from beltcomm.identify.amplitude import AmplitudeStep, Prediction
from beltcomm.model import load_plant
from beltcomm.rundata.first_motions import Breakaway
from beltcomm.talk import Silence

BREAKAWAY = Breakaway(0.1, 0.1)
MODEL = load_plant("g_b").model


class Search:
    """What a step may be (limit_nm), whether it moves the axis, what stops it, and what was done."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, limit_nm: float = 10.0, moves_from_nm: float = 0.0) -> None:
        self.limit_nm, self.moves_from_nm = limit_nm, moves_from_nm
        self.stops_from_nm, self.reason, self.stands, self.free_from_nm = float("inf"), "position", True, 0.0
        self.made: list[tuple[float, int]] = []
        folder = SimpleNamespace(finished=lambda _name: None, journal=lambda _text: None)
        capabilities = SimpleNamespace(counts_per_rev=65536, sample_period_s=1e-3)
        self.machine: Any = SimpleNamespace(
            drive=SimpleNamespace(capabilities=capabilities),
            axis=load_axis("egc-70-600"),
            folder=folder,
            talk=Silence(),
            holding_nm=0.0,
            asked=AS_CHOSEN,
            ratio=1.0,
            withdrawing=nullcontext,
            wanderings=0,
        )
        for name, stand_in in {
            "unknown_axis": lambda *_: (MODEL, [MODEL]),
            "_next": self.next,
            "_record_of_step": self.make,
            "_louder": lambda _machine, _family, _made, most_nm: self.step(most_nm),
            "moves_enough": lambda recording, *_: recording >= self.moves_from_nm,
            "not_ruled_out": lambda family, *_: family,
            "carriage_stood": lambda _model, recording, _at: recording < self.free_from_nm,
            "first_path": lambda *_: FirstPath(FAITHFUL, MODEL),
            "stands_after": lambda _machine, problem: self.stands and problem.reason == "position",
        }.items():
            monkeypatch.setattr(raising, name, stand_in)
        monkeypatch.setattr(raising.scale, "check_first", lambda _machine, model, _recording: model)
        monkeypatch.setattr(raising.stops, "lend_brake", lambda *_: None)

    def step(self, most_nm: float) -> AmplitudeStep:
        return AmplitudeStep(min(most_nm, self.limit_nm), Prediction(0.0, 0.0, 0.0, 0.0), "step" if most_nm < self.limit_nm else "speed")

    def next(self, _machine: Any, _breakaway: Any, _family: Any, shapes: Any, most_nm: float) -> Any:
        return SimpleNamespace(step=self.step(most_nm), at_m=0.25, shape=shapes[0])

    def make(self, _machine: Any, _name: str, wanted: Any, _kept: bool) -> Any:
        amplitude = wanted.step.amplitude_nm
        if amplitude >= self.stops_from_nm:
            raise SafetyStop("too far", self.reason)
        self.made.append((round(amplitude, 3), wanted.shape[1]))
        return amplitude

    def __call__(self, **options: Any) -> raising.Excited:
        return raising.raise_amplitude(self.machine, BREAKAWAY, **options)


def test_the_amplitude_grows_until_a_limit_binds(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch, limit_nm=0.5)
    found = search()
    assert [a for a, _ in search.made] == [0.2, 0.34, 0.5]
    assert found.step.amplitude_nm == 0.5


def test_a_brief_search_leaves_the_bound_step_to_the_response(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch, limit_nm=0.5)
    found = search(response=lambda _model, most_nm: search.step(most_nm))
    assert [a for a, _ in search.made] == [0.2, 0.34]
    assert found.step.amplitude_nm == 0.5
    assert found.at_most_nm == pytest.approx(1.7 * 0.34)


def test_no_step_is_louder_for_a_response_that_may_not_follow_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A response is longer than a step: a limit may bind it where the next step still grows.   One that cannot be had yet is not bound."""
    search = Search(monkeypatch, limit_nm=5.0)
    asked: list[float] = []

    def response(_model: Any, most_nm: float) -> AmplitudeStep:
        asked.append(round(most_nm, 3))
        if len(asked) == 1:
            raise Refused("no excitation fits")
        return replace(search.step(most_nm), amplitude_nm=0.4, binds="belt force" if most_nm > 0.4 else "step")

    found = search(response=response)
    assert asked == [0.34, 0.578]
    assert [a for a, _ in search.made] == [0.2, 0.34]
    assert found.at_most_nm == pytest.approx(0.578)


def test_where_a_limit_binds_and_nothing_moves_the_changes_become_slower(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch, limit_nm=0.2, moves_from_nm=1.0)
    search()
    assert [clock for _, clock in search.made] == [2, 3, 4, 6], "each sequence once, then the estimate says what it can"


def test_a_record_that_only_stretched_the_belt_is_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """As behind 10:1: the motor breaks away long before the carriage, which passed for one of 10 t."""
    search = Search(monkeypatch, limit_nm=0.9)
    search.free_from_nm = 0.5
    assert len(search().recordings) == len(search.made) == 4
    assert [a for a, _ in search.made] == [0.2, 0.34, 0.578, 0.9]
    search = Search(monkeypatch, limit_nm=0.3)
    search.free_from_nm = 0.5
    with pytest.raises(Refused, match=r"±0\.300 N m .*limit on speed allows, moved its motor .* not the carriage.*payload"):
        search()
    assert [clock for _, clock in search.made] == [2, 2, 3, 4, 6], "louder as far as it may be, then slower changes"


def test_an_amplitude_that_was_asked_for_and_moves_nothing_is_not_repeated_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch)
    search.free_from_nm, search.machine.asked = 0.5, replace(AS_CHOSEN, amplitude_nm=0.25)
    with pytest.raises(Refused, match=r"±0\.250 N m of excitation, all that is asked for,.*ask for more \(--amplitude\)"):
        search()
    assert [a for a, _ in search.made] == [0.2, 0.25]


def test_a_carriage_that_wanders_ends_the_search_with_what_stayed_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch)
    search.stops_from_nm = 0.5
    found = search()
    assert [a for a, _ in search.made] == [0.2, 0.34]
    assert found.step.amplitude_nm == found.at_most_nm == pytest.approx(0.34)


def test_a_first_record_that_wanders_is_made_again_with_less_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(monkeypatch)
    search.stops_from_nm = 0.19
    found = search()
    assert [a for a, _ in search.made] == [0.14]
    assert found.at_most_nm == pytest.approx(0.14)


@pytest.mark.parametrize(("stops_from_nm", "reason", "stands"), [(0.1, "position", True), (0.5, "speed", True), (0.5, "position", False)])
def test_any_other_stop_ends_the_session(monkeypatch: pytest.MonkeyPatch, stops_from_nm: float, reason: str, stands: bool) -> None:
    """A first record cannot be much quieter than friction; speed would come again; what still rolls is no place to go on from."""
    search = Search(monkeypatch)
    search.stops_from_nm, search.reason, search.stands = stops_from_nm, reason, stands
    with pytest.raises(SafetyStop):
        search()


@pytest.mark.parametrize(("slope_nm_s", "most_nm"), [(0.0, 0.1), (0.5, 0.1 - 0.5 * (6.0 * 5e-5 * 1e-4 / (0.0133 * 0.5)) ** (1.0 / 3.0))])
def test_breaking_away_bounds_the_friction_where_the_belt_is_stiff(slope_nm_s: float, most_nm: float) -> None:
    """While it was noticed the torque rose on:  x = i_t Ṁ t³/6J.   A soft belt lets the motor move beside a carriage that stands."""
    breakaway = Breakaway(0.1, 0.1, slope_nm_s)
    assert breakaway.most_friction_nm(2e5, 1e-4, 0.0133) == pytest.approx(most_nm)
    assert breakaway.most_friction_nm(1e4, 1e-4, 0.0133) == float("inf")
    assert breakaway.most_friction_nm(1.45e5, 1e-4, 0.0133) == float("inf"), "less than all the torque: the carriage may have stood"
