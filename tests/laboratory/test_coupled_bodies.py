"""A coupling that no single effect leads to, on records of the independent simulator."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.axis import Axis, load_axis
from beltcomm.effects import effect_named
from beltcomm.fit.base import fit_base, in_groups_of, ratio_in_groups_of
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data, for_coupling, prepare
from beltcomm.fit.start.model import start_model
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.laboratory import coupled_bodies
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.diagnosis import final_refit
from beltcomm.laboratory.selection import Candidate
from beltcomm.sentences.ladder import narrower_lines
from identify.records import Recorder
from truth import Axis as TrueAxis
from truth import Coupling, ThreeSectionBelt, TruthPlant

PLACE_M = 0.25


def based(seed: int, coupled: bool) -> tuple[Axis, Data, Fitted, dict[str, float]]:
    """A drawn rig with a heavy end pulley, with its coupling or a rigid one, and the base model of its two responses."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    motor, pulley, stiffness = between(4e-5, 9e-5), between(1.5e-5, 3e-5), between(130.0, 250.0)
    mass, end_pulley = between(4.0, 12.0), between(0.15, 0.4)
    belt = ThreeSectionBelt(between(9e4, 1.8e5), 0.79, 0.05, end_pulley, between(5.0, 9.0))
    friction = dict(viscous_motor_nm_s_rad=between(1e-3, 3e-3), coulomb_motor_nm=between(0.04, 0.1), coulomb_cart_n=between(1.0, 4.0))
    coupling = Coupling(stiffness, pulley, between(5e-4, 3e-3)) if coupled else None
    axis = TrueAxis(motor if coupled else motor + pulley, mass, 0.01242, belt, coupling=coupling, **friction)
    loud = 2.0 * (friction["coulomb_motor_nm"] + 0.01242 * friction["coulomb_cart_n"])
    records = [
        Recorder(seed=10 * seed + i).shaken(TruthPlant(axis, start_position_m=PLACE_M), factor * loud, 2, f"frf_{i}", at_m=PLACE_M)
        for i, factor in enumerate((1.0, 0.7))
    ]
    known = load_axis("egc-70-600")
    start = start_model(known, records).with_effect("cart_friction")
    data, fitted = fit_base(prepare(records, known, start), start, publish=False)
    return known, data, fitted, {"stiffness": stiffness, "pulley": pulley, "mass": mass, "end_pulley": end_pulley}


@pytest.fixture(scope="module")
def coupled() -> tuple[Axis, Data, Fitted, dict[str, float]]:
    return based(1, coupled=True)


@pytest.mark.examination
def test_a_coupling_and_an_end_pulley_that_hide_each_other_are_found(coupled: tuple[Axis, Data, Fitted, dict[str, float]]) -> None:
    """From the whole raster: from a sixth of it rounding decides into which valley the search falls."""
    axis, data, base, truth = coupled
    assert base.ratio > 2.0
    found = coupled_bodies.coupling_candidate(data, base, axis)
    assert found is not None
    assert found.fitted is not None
    assert found.accepted
    assert found.beside == "end_pulley"
    _, best = coupled_bodies.refit_from_several_stiffnesses(data, found.fitted)
    assert best.ratio < 1.1
    assert best.model["cart.mass"] == pytest.approx(truth["mass"], rel=0.02)
    assert best.model["coupling.stiffness"] == pytest.approx(truth["stiffness"], rel=0.2)
    assert best.model["driving_pulley.inertia"] == pytest.approx(truth["pulley"], rel=0.2)


def test_in_the_place_of_what_imitates_a_coupling_one_is_taken_that_is_likelier(
    coupled: tuple[Axis, Data, Fitted, dict[str, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not where nothing was added, where that is no likeness of it, nor where it explains as much."""
    axis, data, base, _ = coupled
    late, cogging = (fit(data, base.model.with_effect(name), 2) for name in ("dead_time", "cogging"))
    objective = fit(for_coupling(data, base.model), late.model, coupled_bodies.AGAIN).objective

    def asked(current: Fitted, less: float) -> bool:
        named = Candidate(effect_named("coupling"), 0.0, less, 0.6, 0.0, replace(late, objective=objective - less), True)
        monkeypatch.setattr(coupled_bodies, "coupling_candidate", lambda *_: named)
        return coupled_bodies.coupling_instead(data, base, current, axis) is named

    assert asked(late, 2.0 * EVIDENCE)
    assert not asked(late, 0.5 * EVIDENCE)
    assert not asked(base, 9.0 * EVIDENCE)
    assert not asked(cogging, 9.0 * EVIDENCE)


def test_behind_a_coupling_the_intervals_bear_what_held_out_records_leave(coupled: tuple[Axis, Data, Fitted, dict[str, float]]) -> None:
    """What it did between the samples the fitted records have taken up."""
    _, data, base, truth = coupled
    values = {"coupling.stiffness": truth["stiffness"], "driving_pulley.inertia": truth["pulley"]}
    with_one = fit(for_coupling(data, base.model), base.model.with_effect("coupling").with_values(values), 2)
    held_out = (np.full(400, 9.0),)
    assert parameter_spread(replace(with_one, held_out_residuals=held_out)).unexplained == pytest.approx(9.0)
    for fitted in (with_one, replace(base, held_out_residuals=held_out)):
        assert parameter_spread(fitted).unexplained == pytest.approx(fitted.ratio)


def test_a_raster_gives_way_at_low_frequencies_as_what_it_begins_from(coupled: tuple[Axis, Data, Fitted, dict[str, float]]) -> None:
    """Motor and pulley weigh as much together, coupling and belt give way as much; no delay of the torque stands for either."""
    base = coupled[2].model.with_effect("dead_time")
    flexible = 1.0 / base["belt_stiffness.stiffness"]
    for with_pulley in (False, True):
        models = list(coupled_bodies._raster(base, base, PLACE_M, with_pulley))
        assert len(models) > 3
        for model in models:
            lever = model["transmission.ratio"] ** 2
            assert model["motor.inertia"] + model["driving_pulley.inertia"] == pytest.approx(base["motor.inertia"])
            assert 1.0 / model["belt_stiffness.stiffness"] + lever / model["coupling.stiffness"] == pytest.approx(flexible)
            assert "dead_time" not in model.effects
            assert ("end_pulley" in model.effects) == with_pulley


def test_a_delay_of_the_torque_may_be_one_or_stand_for_a_coupling(coupled: tuple[Axis, Data, Fitted, dict[str, float]]) -> None:
    """Without a millisecond that is there no coupling comes near the records; with one that stands for it neither."""
    base = coupled[2].model.with_effect("dead_time", {"time": 9e-4})
    tried = {True: 0, False: 0}
    for model in coupled_bodies._raster(base, base, PLACE_M, False):
        tried["dead_time" in model.effects] += 1
        assert "dead_time" not in model.effects or model["dead_time.time"] == 9e-4
    assert tried[True] == tried[False] > 3


@pytest.mark.parametrize(
    ("mass", "belt", "radius", "couplings"), [(0.45, 2.1e4, 0.0025, 6), (0.02, 1100.0, 1e-3, 0), (400.0, 9e6, 0.15, 4)]
)
def test_a_raster_of_any_axis_leaves_out_what_no_machine_can_be(
    coupled: tuple[Axis, Data, Fitted, dict[str, float]], mass: float, belt: float, radius: float, couplings: int
) -> None:
    """A carriage behind a gearbox has couplings of a fifth of a N m/rad at the motor; beyond bounds there is no place to begin from."""
    inertia = 0.5 * mass * radius**2
    values = {"cart.mass": mass, "belt_stiffness.stiffness": belt, "transmission.ratio": radius, "motor.inertia": inertia}
    base = coupled[2].model.with_values(values)
    found = list(coupled_bodies._raster(base, base, 0.0, True))
    assert len({round(model["coupling.stiffness"] / (belt * radius**2), 6) for model in found}) == couplings
    for model in found[:1]:
        assert all(coupled_bodies._as_flexible(model, stiffness, 0.0) is None for stiffness in (1e-9, 1e9))


def test_beside_spans_of_known_geometry_the_end_pulley_stands_between_sections(
    coupled: tuple[Axis, Data, Fitted, dict[str, float]],
) -> None:
    base = coupled[2].model.without_effect("belt_stiffness")
    base = base.with_effect("belt_spans", {"specific_stiffness": 1.2e5, "pulley_distance": 0.79, "offset": 0.05})
    for model in coupled_bodies._raster(base, base, PLACE_M, True):
        assert "belt_sections" in model.effects
        assert not {"belt_spans", "belt_damping"} & set(model.effects)
        assert model["belt_sections.pulley_distance"] == 0.79


def test_a_model_that_is_held_against_one_of_fewer_frequencies_is_judged_by_those(
    coupled: tuple[Axis, Data, Fitted, dict[str, float]],
) -> None:
    """Behind a coupling two samples make a value: an error that only the frequencies left out had is not what it explains."""
    _, data, base, _ = coupled
    published, told = final_refit(data, base)
    assert {piece.group for piece in published.fitted} == {1}
    assert {piece.group for piece in data.fitted} == {2}
    _, alike = in_groups_of(published, told, data)
    assert alike.ratio == pytest.approx(ratio_in_groups_of(told, base), rel=1e-9)
    assert alike.ratio != pytest.approx(told.ratio, rel=0.01)
    assert in_groups_of(data, base, data) == (data, base)
    (line,) = narrower_lines(told, base)
    assert "up to 250 Hz" in line
    assert f"{alike.ratio:.2f} before" in line
    assert narrower_lines(base, base) == []
