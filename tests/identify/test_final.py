"""Constant stiffness is kept where it is constant, the law by position is found where the belt has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from beltcomm.axis import Gearbox, load_axis
from beltcomm.axis.entries import Belt
from beltcomm.axis.kinds import Transmission
from beltcomm.errors import DataError
from beltcomm.fit.model_fit import ModelFit
from beltcomm.identify import final as module
from beltcomm.identify.final import FinalModel, _stiffness_by_record, final_model
from beltcomm.model import Model
from beltcomm.recording import Recording
from identify.records import COUNTS, Recorder, true_model
from truth import Axis, TruthPlant, TwoStrandBelt
from truth.rigs import GEARBOX_KG_M2, draw, geared

AXIS = load_axis("egc-70-600")
PLACES_M = (0.1, 0.3, 0.5)
EA_N, L3_M, OFFSET_M = 92e3, 0.79, 0.05


def stiffness(position_m: float) -> float:
    """(2.26)"""
    l1 = OFFSET_M + position_m
    return EA_N / l1 + EA_N / (2.0 * L3_M - l1)


def at_places(plants: Sequence[TruthPlant]) -> list[Recording]:
    return [
        Recorder(seed).shaken(plant, 0.3, 1, f"place {seed}", at_m=place)
        for seed, (plant, place) in enumerate(zip(plants, PLACES_M, strict=True))
    ]


def two_strand(place_m: float) -> TruthPlant:
    belt = TwoStrandBelt(EA_N, L3_M, OFFSET_M, 20.0)
    axis = Axis(71.73e-6, 1.1, 0.01242, belt, 2.2e-3, 0.08, 0.0, 2.8)
    return TruthPlant(axis, start_position_m=place_m)


@pytest.fixture(scope="module")
def varying() -> tuple[list[Recording], FinalModel]:
    records = at_places([two_strand(place) for place in PLACES_M])
    return records, final_model(records, AXIS, COUNTS)


def test_start_values_take_the_level_of_friction_from_the_record() -> None:
    """Behind 5:1 the friction is a quarter of the rig's; started from the rig's, the search ends far off."""
    axis = replace(AXIS, gearbox=Gearbox(5.0, GEARBOX_KG_M2))
    record = Recorder(3).shaken(geared("g_b", 5.0), 0.1, 3, at_m=0.25)
    fit = final_model([record], axis, COUNTS).fit
    truth = geared("g_b", 5.0).truth
    assert fit.misfit < 1.2  # from the friction of the rig itself the search ends at 6.8
    assert fit.model["cart.mass"] == pytest.approx(truth["mass_kg"], rel=0.05)
    assert fit.model["belt_stiffness.stiffness"] == pytest.approx(truth["stiffness_n_m"], rel=0.05)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_rows_that_come_seldom_are_held_near_the_data_sheet_s_inertia(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not near that of a first estimate, which of rows of 10 ms may be half or twice as much."""
    seen: list[float] = []

    def simulated(_recordings: Sequence[Recording], start: Model, **_: object) -> SimpleNamespace:
        seen.append(start["motor.inertia"])
        return SimpleNamespace(suspect=False)

    record = Recorder(3).shaken(draw("g_b", np.random.default_rng(61)), 0.1, 3, at_m=0.25)
    seldom = replace(record, t_s=10.0 * record.t_s)
    start = true_model(draw("g_b", np.random.default_rng(61)))
    monkeypatch.setattr(module, "fit_seldom", simulated)
    final_model([seldom], AXIS, COUNTS, start=start.with_values({"motor.inertia": factor * start["motor.inertia"]}))
    assert seen == [AXIS.motor_side_inertia_kg_m2]


@pytest.fixture(scope="module")
def constant() -> tuple[list[Recording], FinalModel]:
    plants = [draw("g_b", np.random.default_rng(61)) for _ in PLACES_M]
    records = at_places(plants)
    return records, final_model(records, AXIS, COUNTS)


@pytest.mark.examination
def test_constant_stiffness_is_kept(constant: tuple[list[Recording], FinalModel]) -> None:
    _, final = constant
    truth = true_model(draw("g_b", np.random.default_rng(61)))
    assert "belt_stiffness" in final.fit.model.effects
    assert final.rejected is None
    assert "taken as constant" in final.reason
    assert final.fit.model["belt_stiffness.stiffness"] == pytest.approx(truth["belt_stiffness.stiffness"], rel=0.01)
    assert final.fit.model["cart.mass"] == pytest.approx(truth["cart.mass"], rel=0.01)


@pytest.mark.examination
def test_law_by_position_is_chosen_and_found(varying: tuple[list[Recording], FinalModel]) -> None:
    _, final = varying
    model = final.fit.model
    assert "belt_spans" in model.effects
    assert "belt_stiffness" not in model.effects
    assert model["belt_spans.specific_stiffness"] == pytest.approx(EA_N, rel=0.02)
    assert model["belt_spans.offset"] == pytest.approx(OFFSET_M, abs=0.002)
    assert model["belt_spans.pulley_distance"] == L3_M
    assert model["cart.mass"] == pytest.approx(1.1, rel=0.01)
    assert final.rejected is not None
    assert "belt_stiffness" in final.rejected.model.effects
    # At 0.1 m the motor swings against the belt at 191 Hz, where the motion between samples of 1 ms is known less well.
    assert final.fit.misfit < 0.01 * final.rejected.misfit
    for place in ("place 1", "place 2"):
        assert final.fit.record_misfit[place] < 1.3
    assert "by position (2.26)" in final.reason


@pytest.mark.examination
def test_an_axis_without_a_belt_keeps_one_stiffness(varying: tuple[list[Recording], FinalModel]) -> None:
    """Places that disagree, of a gap for instance: no law of the place, and a model with what it leaves over."""
    records, _ = varying
    rack = replace(AXIS, transmission=Transmission("rack", 3e5), belt=Belt())
    found = final_model(records, rack, COUNTS)
    assert "this kind of axis has no law for it" in found.reason
    assert "belt_stiffness" in found.fit.model.effects
    assert found.fit.suspect


@pytest.mark.examination
def test_stiffness_of_each_place(varying: tuple[list[Recording], FinalModel]) -> None:
    """What each record alone wants, all else as in the fit with one stiffness for all: the order and size of (2.26)."""
    records, final = varying
    assert final.rejected is not None
    found = _stiffness_by_record(records, final.rejected.model, COUNTS, 6e-3)
    assert list(found) == ["place 0", "place 1", "place 2"]
    assert found["place 0"].stiffness_n_m > found["place 1"].stiffness_n_m > found["place 2"].stiffness_n_m
    for name, place in zip(found, PLACES_M, strict=True):
        assert found[name].stiffness_n_m == pytest.approx(stiffness(place), rel=0.1)


@pytest.mark.examination
def test_held_out_places_have_no_say(varying: tuple[list[Recording], FinalModel]) -> None:
    records, final = varying
    away = [replace(r, name=f"{r.name} away", sidecar=replace(r.sidecar, held_out=True)) for r in records[:2]]
    model = (final.rejected or final.fit).model
    assert set(_stiffness_by_record([*away, records[2]], model, COUNTS, 6e-3)) == {"place 2"}


def test_a_record_from_nowhere_has_no_say_in_a_law_along_the_travel(
    varying: tuple[list[Recording], FinalModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second record of the first place, which does not say so: the fit is that without it, and says so."""
    records, final = varying
    nowhere = replace(records[0], name="nowhere", sidecar=replace(records[0].sidecar, start_position_m=None))
    asked: list[list[str]] = []

    def fit(used: Sequence[Recording], start: Model, **_: object) -> ModelFit:
        asked.append([r.name for r in used])
        return final.fit if "belt_spans" in start.effects else final.rejected or final.fit

    monkeypatch.setattr(module, "fit_model", fit)
    found = final_model([*records, nowhere], AXIS, COUNTS)
    assert asked == 2 * [["place 0", "place 1", "place 2"]]
    assert found.fit is final.fit
    assert found.reason == f"{final.reason}; left out, because nobody knows where it was made: nowhere"
    alone = final_model([nowhere], AXIS, COUNTS)
    assert asked[2:] == [["nowhere"]]
    assert "holds for that place alone" in alone.reason


def test_nothing_excited_is_refused() -> None:
    strokes = Recorder().stroked(draw("g_b", np.random.default_rng(62)), (0.2, 0.4), 0.2)
    with pytest.raises(DataError, match=r"no recording with an excitation .*beltcomm identify"):
        final_model([strokes], AXIS, COUNTS)


@pytest.mark.examination
def test_progress_ends_at_one(constant: tuple[list[Recording], FinalModel]) -> None:
    records, final = constant
    seen: list[float] = []
    final_model(records[:2], AXIS, COUNTS, start=final.fit.model, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
