"""A third mass is found where it is, told with the right interval, and refused where it is not or cannot be seen.

The machine is the independent simulator's three belt sections (2.11) to (2.20).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from scipy.linalg import eigh

from beltcomm import api
from beltcomm.axis import Axis as AxisFile
from beltcomm.axis import Gearbox, load_axis
from beltcomm.errors import UsageError
from beltcomm.fit.model_fit import ModelFit
from beltcomm.identify import three_mass as module
from beltcomm.identify.final import FinalModel
from beltcomm.identify.magnitude_fit import fit_magnitudes
from beltcomm.identify.three_mass import (
    MASS,
    ThreeMass,
    _judge_third_mass,
    _signal_up_to,
    compare_masses,
    resonances_hz,
    sheet_mass_kg,
)
from beltcomm.model import load_model
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.rundata import analyse
from beltcomm.runfolder import RunFolder
from identify.records import COUNTS, PERIOD_S, Recorder
from truth import Axis, ConstantBelt, ThreeSectionBelt, TruthPlant
from truth.reference_solution import Matrices

AXIS = load_axis("egc-70-600")
EA_N, L3_M, OFFSET_M, DA_N_S = 106250.0, 0.79, 0.05, 7.17
PLACE_M, CARRIAGE_KG, INERTIA_KG_M2 = 0.3, 0.96, 71.73e-6
#: Ten times the rig's end pulley.
HEAVY_KG = 1.53


def machine(belt: ThreeSectionBelt | ConstantBelt) -> Axis:
    return Axis(INERTIA_KG_M2, CARRIAGE_KG, 0.01242, belt, 2.23e-3, 0.0805, 0.0, 2.7778)


def heavy() -> Axis:
    return machine(ThreeSectionBelt(EA_N, L3_M, OFFSET_M, HEAVY_KG, DA_N_S))


def shaken(axis: Axis) -> Recording:
    return Recorder(4).shaken(TruthPlant(axis, start_position_m=PLACE_M), 0.3, 3, "frf_1", at_m=PLACE_M)


def compared(record: Recording) -> ThreeMass:
    return compare_masses([record], AXIS, COUNTS, analyse.responses([record]))


@pytest.fixture(scope="module")
def record() -> Recording:
    return shaken(heavy())


@pytest.fixture(scope="module")
def found(record: Recording) -> ThreeMass:
    return compared(record)


@pytest.mark.examination
def test_a_heavy_end_pulley_is_identified(found: ThreeMass) -> None:
    assert found.identified
    assert found.evidence > 1e3  # two masses leave 20 times the noise
    model = found.three.model
    for name, true in (
        (MASS, HEAVY_KG),
        ("cart.mass", CARRIAGE_KG),
        ("motor.inertia", INERTIA_KG_M2),
        ("belt_sections.specific_stiffness", EA_N),
        ("belt_sections.offset", OFFSET_M),
        ("belt_sections.specific_damping", DA_N_S),
    ):
        item = model.parameters[name]
        assert item.interval is not None, name
        assert abs(item.value - true) < 2.0 * item.interval, name  # missed once in 10 000 by a right interval
        assert item.interval < 0.05 * true, name


def test_its_modes_are_those_of_the_equations_of_motion(found: ThreeMass) -> None:
    """Against the generalised eigenvalues of matrices written apart from the product."""
    m = Matrices(heavy(), OFFSET_M + PLACE_M)
    stiffness, mass = m.at(0.0)[0], np.diag(m.mass)
    free = np.sqrt(eigh(stiffness, mass, eigvals_only=True)[1:]) / math.tau
    held = np.sqrt(eigh(stiffness[1:, 1:], mass[1:, 1:], eigvals_only=True)) / math.tau
    assert resonances_hz(found.three.model, PLACE_M) == pytest.approx(free, rel=5e-3)
    assert resonances_hz(found.three.model, PLACE_M, ("motor",)) == pytest.approx(held, rel=5e-3)
    assert found.reach[0].mode_hz == resonances_hz(found.three.model, PLACE_M)[-1]


def test_the_log_magnitude_fit_agrees_but_for_friction(found: ThreeMass, record: Recording) -> None:
    fit = fit_magnitudes(analyse.responses([record]), {"frf_1": PLACE_M}, found.three.model, AXIS)
    assert fit is not None
    assert not fit.coupled  # the machine's coupling is rigid, and a spring would explain less
    item = fit.parameters[MASS]
    assert item.interval is not None
    assert abs(item.value - HEAVY_KG) < 2.0 * item.interval
    assert item.interval > 5.0 * (found.three.model.parameters[MASS].interval or 0.0)
    apparent = fit.parameters["viscous.damping"].value + 0.01242**2 * fit.parameters["viscous_cart.damping"].value
    assert apparent > 5.0 * 2.23e-3  # Coulomb friction poses as damping, errata 7


@pytest.mark.examination
def test_a_healthy_axis_gets_no_third_mass() -> None:
    found = compared(shaken(machine(ConstantBelt(222.39e3, 20.0))))
    assert not found.identified
    assert found.evidence < 0.0
    assert "two masses explain these records as well" in found.against[0]
    assert found.two.fit.model["cart.mass"] == pytest.approx(CARRIAGE_KG, rel=0.03)


def response_up_to(highest_hz: float, period_s: float) -> FrequencyResponse:
    """Response of 1/f² with noise of a hundredth of it up to a frequency, and nothing but noise above."""
    f = np.arange(1.0, 0.48 / period_s)
    h = (1.0 / f**2).astype(complex)
    noise = np.where(f <= highest_hz, 0.01, 2.0) * np.abs(h)
    return FrequencyResponse(f, h, noise, np.ones(len(f)), 4, period_s)


def judged_with(found: ThreeMass, record: Recording, response: FrequencyResponse, mass_kg: float) -> ThreeMass:
    three = replace(found.three, model=found.three.model.with_values({MASS: mass_kg}))
    item = three.model.parameters[MASS]
    parameters = {**three.model.parameters, MASS: replace(item, interval=0.05 * mass_kg)}
    return _judge_third_mass(
        found.two, replace(three, model=replace(three.model, parameters=parameters)), AXIS, [record], {"frf_1": response}
    )


def said(fit: ModelFit, **told: float) -> ModelFit:
    """A fit that tells other numbers of itself."""
    return cast("ModelFit", type("Said", (ModelFit,), told)(fit.data, fit.fitted, fit.model))


def test_a_mode_that_no_record_shows_is_refused_with_the_numbers(found: ThreeMass, record: Recording) -> None:
    """The mode of the rig's own end pulley: 262 Hz at 0.3 m."""
    quiet = judged_with(found, record, response_up_to(200.0, PERIOD_S), 0.153)
    (sentence,) = quiet.against
    assert "the mode of an end pulley of 0.153 kg lies near 263 Hz, frf_1 holds no signal above 200 Hz" in sentence
    assert "a PRBS of 2 samples per bit, whose first zero lies at 500 Hz" in sentence
    assert quiet.heavier_kg == pytest.approx(0.153 * (262.6 / 140.0) ** 2, rel=0.01)
    assert not judged_with(found, record, response_up_to(400.0, PERIOD_S), 0.153).against

    (sentence,) = judged_with(found, record, response_up_to(1e3, 2.5e-3), 0.153).against
    assert "the sampling of frf_1 ends at 200 Hz; record with a sample every 1.7 ms or less" in sentence


def test_no_repeated_excitation_is_refused(found: ThreeMass, record: Recording) -> None:
    (sentence,) = _judge_third_mass(found.two, found.three, AXIS, [record], {}).against
    assert "no record repeats its excitation" in sentence


def test_what_speaks_against_a_third_mass_is_said(found: ThreeMass, record: Recording) -> None:
    responses = analyse.responses([record])
    loose = {**found.three.model.parameters, MASS: replace(found.three.model.parameters[MASS], interval=0.9)}
    unsure = replace(found.three, model=replace(found.three.model, parameters=loose))
    assert "below 2.4 kg" in _judge_third_mass(found.two, unsure, AXIS, [record], responses).against[0]
    bad = said(found.three, misfit=4.0)
    assert "2.00 times the noise is left over" in _judge_third_mass(found.two, bad, AXIS, [record], responses).against[0]
    worse = said(found.three, held_out_misfit=9.0)
    before = replace(found.two, fit=said(found.two.fit, held_out_misfit=4.0))
    assert (
        "does not fall: 2.00 times the noise with two masses, 3.00 with three"
        in _judge_third_mass(before, worse, AXIS, [record], responses).against[0]
    )


def test_where_a_response_ends() -> None:
    assert _signal_up_to(response_up_to(150.0, PERIOD_S)) == pytest.approx(150.0, abs=5.0)
    assert _signal_up_to(response_up_to(0.5, PERIOD_S)) == 0.0


def test_the_end_pulley_of_the_data_sheet_does_not_turn_with_the_gearbox() -> None:
    """thesis.md, table 1: 23.63 kg mm² over r² is 0.153 kg, whatever stands before the driving pulley."""
    assert sheet_mass_kg(AXIS) == pytest.approx(0.1532, abs=5e-5)
    assert sheet_mass_kg(replace(AXIS, gearbox=Gearbox(5.0, 60e-6))) == sheet_mass_kg(AXIS)


def test_a_missing_belt_is_named() -> None:
    assert AXIS.belt is not None
    without: AxisFile = replace(AXIS, belt=replace(AXIS.belt, pulley_distance_m=None))
    with pytest.raises(UsageError, match=r"three-mass model needs belt.pulley_distance_m"):
        compare_masses([], without, COUNTS, {})


@pytest.fixture
def run(tmp_path: Path, record: Recording, found: ThreeMass, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run folder with the record; the fits are those made above."""
    folder = RunFolder.create(tmp_path / "run", AXIS)
    folder.add_recording(record)
    monkeypatch.setattr("beltcomm.jobs.fit.compare_masses", lambda *_args, **_kwargs: found)
    return tmp_path / "run"


def test_the_command_saves_a_revision_that_design_rests_on(run: Path, found: ThreeMass) -> None:
    result = api.fit(run, model="three-mass", command="beltcomm fit", when="today")
    assert result.exit_code == 0
    assert "A third mass is identified" in result.text[0]
    assert result.data["revision"] == "revision_2"
    assert any("carriage at  570 mm: resonances" in line for line in result.text)
    folder = RunFolder.open(run)
    assert load_model(folder.file("models", "final")) == found.three.model
    designed = api.design(run)
    assert designed.data["revision"] == "revision_2"
    assert designed.data["parameters"]["kp_nm_s_rad"] > 0.0
    ladder = api.ladder(run, pictures=False)
    assert [rung["change"] for rung in ladder.data["revisions"]] == ["base", "+belt_sections -belt_stiffness -belt_damping"]


def test_the_command_refuses_and_leaves_the_files(run: Path, found: ThreeMass, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("beltcomm.jobs.fit.compare_masses", lambda *_args, **_kwargs: replace(found, against=("too quiet",)))
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    result = api.fit(run, model="three-mass")
    assert result.exit_code == 1
    assert result.text[:2] == ["No third mass is identified; nothing was changed:", "  too quiet"]
    assert result.data["against"] == ["too quiet"]
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


def test_a_belt_softer_along_the_travel_is_no_third_mass(found: ThreeMass, record: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one stiffness loses against three masses, spans with a massless end pulley are asked first."""
    spans = said(found.three, objective=found.three.objective - 5.0)
    asked: list[FinalModel] = []

    def with_spans(two: FinalModel, *_args: object) -> FinalModel:
        asked.append(two)
        return FinalModel(spans, two.fit, "spans")

    monkeypatch.setattr(module, "final_model", lambda *_args, **_kwargs: found.two)
    monkeypatch.setattr(module, "_fit_three_mass", lambda *_args, **_kwargs: found.three)
    monkeypatch.setattr(module, "_with_spans", with_spans)
    again = compare_masses([record], AXIS, COUNTS, {})
    assert asked == [found.two]
    assert again.evidence == pytest.approx(-5.0)
