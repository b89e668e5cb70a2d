"""Damaged and poor data sets: each gets its sentence, and none a wrong name.  One healthy session of the "
"independent truth, damaged in memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltcomm.axis import Axis
from beltcomm.cli.main import cli
from beltcomm.errors import DataError
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory import run_checks
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis, Stage, fit_base_of
from beltcomm.laboratory.run_checks import check_run
from beltcomm.laboratory.scope import missing_records, restrict_to_scope
from beltcomm.laboratory.score import Scorer
from beltcomm.model import build_model
from beltcomm.recording import Recording
from beltcomm.recording.checks import RigidInertia
from beltcomm.rundata.fitted_run import explainable
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.cross_checks import sheet_lines
from truth.hidden import draw, write_session

Change = Callable[[Recording], Recording]
SEED = 31001


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("healthy") / "run"
    write_session(draw(SEED), path, plan="default")
    return path


@pytest.fixture(scope="module")
def run(folder: Path) -> tuple[list[Recording], Axis]:
    opened = RunFolder.open(folder)
    return opened.recordings(), opened.axis


def changed(records: list[Recording], word: str, change: Change) -> list[Recording]:
    """The same records, those with a word in their name changed."""
    return [change(r) if word in r.name else r for r in records]


def picked(record: Recording, rows: NDArray[np.intp], restamped: bool) -> Recording:
    """Some rows of a record; restamped : the time goes on as if nothing had happened."""
    signals = {name: getattr(record, name)[rows] for name in ("t_s", "torque", "position", "torque_setpoint")}
    if restamped:
        signals["t_s"] = 1e-3 * np.arange(len(rows))
    return replace(record, notes=(), **signals)


def some(record: Recording, share: float) -> NDArray[np.bool_]:
    return np.random.default_rng(len(record.t_s)).random(len(record.t_s)) < share


def lost(share: float, *, restamped: bool) -> Change:
    return lambda record: picked(record, np.flatnonzero(~some(record, share)), restamped)


def doubled(share: float) -> Change:
    return lambda record: picked(record, np.repeat(np.arange(len(record.t_s)), 1 + some(record, share)), True)


def wandering(record: Recording, share: float) -> NDArray[np.float64]:
    """Deviations of the time stamps, s; the first and the last stay."""
    off = 1e-3 * share * np.random.default_rng(1).uniform(-0.49, 0.49, len(record.t_s))
    off[[0, -1]] = 0.0
    return off


def uneven(record: Recording, share: float) -> Recording:
    """Sampled at uneven times, which the stamps tell."""
    there = record.t_s + wandering(record, share)
    step = math.tau / 31230
    return replace(record, t_s=there, position=step * np.round(CubicSpline(record.t_s, record.position)(there) / step), notes=())


def test_a_healthy_run_has_nothing_odd(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    found = check_run(records, axis, foreign=True)
    assert found.remarks == ()
    assert list(found.recordings) == records


@pytest.mark.parametrize(
    ("word", "change", "sentence"),
    [
        ("", lost(0.001, restamped=True), "samples are missing although t_s goes on evenly"),
        ("sweep_slow", lost(0.1, restamped=True), r"06_sweep_slow: samples are missing .* twice as long as those before and after"),
        ("", lost(0.01, restamped=False), r"samples were lost at \d+ places .* Behind a gap nobody knows how the carriage swings"),
        ("sweep", doubled(0.01), "rows were written twice although t_s goes on"),
        ("sweep_slow", lambda r: uneven(r, 0.1), r"taken unevenly: in 06_sweep_slow .* up to 9\.6 % from 1 ms"),
        ("frf_p1_a1", lambda r: uneven(r, 0.1), r"taken unevenly: in 03_frf|taken unevenly: in .* times the noise of torque and encoder"),
        ("frf_p1_a1", lambda r: picked(r, np.arange(2500), False), "frf_p1_a1 ends after 2500 samples, .* the file is cut off"),
        ("frf_p1_a1", lambda r: replace(r, torque=-r.torque, torque_setpoint=None), "the sign of torque_nm or of position_rad is turned"),
        ("slow_p1", lambda r: replace(r, torque=-r.torque, torque_setpoint=None), "positive torque_nm drives to negative position_rad"),
        ("reversal", lambda r: replace(r, position=np.degrees(r.position)), "the angle has degrees instead of rad"),
        ("", lambda r: replace(r, torque=1e-3 * r.torque, torque_setpoint=None), r"the motor's side alone has 6\.39e-05 kg m²"),
        ("", lambda r: picked(r, np.arange(500), False), r"the records are too short: .* lasts 0\.5 s, at least 1 s"),
    ],
)
def test_damage_is_refused_in_a_sentence(run: tuple[list[Recording], Axis], word: str, change: Change, sentence: str) -> None:
    records, axis = run
    with pytest.raises(DataError, match=sentence):
        check_run(changed(records, word, change), axis, foreign=True)


def test_torque_cut_off_with_its_setpoint_is_seen(run: tuple[list[Recording], Axis]) -> None:
    record = next(r for r in run[0] if r.name.endswith("_fast"))
    assert record.torque_setpoint is not None
    end = 0.9 * float(np.abs(record.torque).max())
    with pytest.raises(DataError, match=r"torque_nm is clipped at .* in \d+ % of the rows \(allowed: 2 %\)"):
        replace(record, torque=np.clip(record.torque, -end, end), torque_setpoint=np.clip(record.torque_setpoint, -end, end))


def test_stamps_that_jitter_beside_even_samples_are_set_even(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    found = check_run([replace(r, t_s=r.t_s + wandering(r, 1.0), notes=()) for r in records], axis, foreign=True)
    (remark,) = found.remarks
    assert "the samples were taken evenly: the stamps were set even" in remark
    for record, even in zip(records, found.recordings, strict=True):
        np.testing.assert_allclose(even.t_s, record.t_s, atol=1e-9)


def test_jitter_beside_lost_rows_is_set_even_and_the_rows_stay_lost(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    jittering = changed(records, "frf_p1_a2", lambda r: replace(r, t_s=r.t_s + wandering(r, 0.3), notes=()))
    kept = np.delete(np.arange(len(jittering[2].t_s)), np.r_[3000:3400])
    found = check_run(changed(jittering, "frf_p1_a2", lambda r: picked(r, kept, False)), axis, foreign=True)
    assert any("about 400, " in remark for remark in found.remarks)
    record = next(r for r in found.recordings if "frf_p1_a2" in r.name)
    np.testing.assert_allclose(record.t_s, 1e-3 * np.arange(3000), atol=1e-3)
    assert record.sample_period_s == pytest.approx(1e-3, rel=1e-4)


def test_a_single_gap_costs_what_stands_behind_it(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    found = check_run(changed(records, "frf_p1_a2", lambda r: picked(r, np.delete(np.arange(len(r.t_s)), 3000), False)), axis, foreign=True)
    assert "at 1 place of 03_frf_p1_a2 (about 1, 0.0017 % of the rows" in found.remarks[0]
    assert [len(r.t_s) for r in found.recordings if "frf_p1_a2" in r.name] == [3000]


def test_records_of_two_axes_are_told_apart(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run

    def heavier(record: Recording) -> Recording:  # twice the torque for the same motion
        assert record.torque_setpoint is not None
        return replace(record, torque=2.0 * record.torque, torque_setpoint=2.0 * record.torque_setpoint)

    with pytest.raises(DataError, match=r"not of one axis, or not with one payload: .* an inertia of .* \(allowed: 25 % apart\)"):
        check_run(changed(records, "sweep", heavier), axis, foreign=True)

    def other_encoder(record: Recording) -> Recording:
        step = math.tau / 40000
        return replace(record, position=step * np.round(record.position / step))

    with pytest.raises(DataError, match=r"31230 counts per turn, those of 08_slow_p1 of 40000: they were made with another encoder"):
        check_run(changed(records, "slow_p1", other_encoder), axis, foreign=True)


def told_apart_if(
    told_apart: bool, monkeypatch: pytest.MonkeyPatch, run: tuple[list[Recording], Axis], odd: RigidInertia, others: RigidInertia
) -> None:
    """Records of which the fourth shows ``odd`` as its inertia and the rest ``others`` are refused as those of two axes, or not."""
    records, axis = run
    position = records[3].position

    def as_one_mass(_t_s: NDArray[np.float64], _torque: NDArray[np.float64], at: NDArray[np.float64], **_weight: object) -> RigidInertia:
        return odd if at is position else others

    monkeypatch.setattr(run_checks, "rigid_inertia", as_one_mass)
    if told_apart:
        with pytest.raises(DataError, match="not of one axis, or not with one payload"):
            run_checks._refuse_two_axes(records, axis)
    else:
        run_checks._refuse_two_axes(records, axis)


@pytest.mark.parametrize(("friction_nm", "told_apart"), [(0.02, True), (0.12, False)])
def test_a_record_that_hardly_slides_says_nothing_of_the_inertia(
    run: tuple[list[Recording], Axis], monkeypatch: pytest.MonkeyPatch, friction_nm: float, told_apart: bool
) -> None:
    """A quiet record on bristles shows less inertia and less friction than the axis has; that of the surest record decides."""
    others = RigidInertia(1.67e-3, 5e-6, 0.5, friction_nm)
    told_apart_if(told_apart, monkeypatch, run, RigidInertia(0.95e-3, 8e-5, 0.03, 0.02), others)


@pytest.mark.parametrize(("accelerating", "told_apart"), [(0.9, False), (30.0, True)])
def test_cogging_of_a_slow_motion_poses_as_no_inertia(
    run: tuple[list[Recording], Axis], monkeypatch: pytest.MonkeyPatch, accelerating: float, told_apart: bool
) -> None:
    """Twenty times the inertia: nothing from a record that hardly accelerates with that of the others, another axis from one that does."""
    others = RigidInertia(1.67e-3, 5e-6, 0.5, 0.1)
    told_apart_if(told_apart, monkeypatch, run, RigidInertia(3.4e-2, 2e-3, accelerating, 0.1), others)


def moved(record: Recording, way_m: float | None) -> Recording:
    start = record.sidecar.start_position_m
    assert start is not None
    return replace(record, sidecar=replace(record.sidecar, start_position_m=None if way_m is None else start + way_m))


def test_places_are_held_against_the_motor_angle(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    with pytest.raises(DataError, match=r"09_slow_p2 begins at 0\.8997 m by its sidecar and at 0\.7997 m by its angle"):
        check_run(changed(records, "slow_p2", lambda r: moved(r, 0.1)), axis, foreign=True)
    found = check_run(changed(records, "slow_p2", lambda r: moved(r, None)), axis, foreign=True)
    assert "the place was taken from the motor angle" in found.remarks[0]
    assert next(r for r in found.recordings if "slow_p2" in r.name).sidecar.start_position_m == pytest.approx(0.7997, abs=1e-3)
    (remark,) = check_run([moved(r, None) for r in records], axis, foreign=True).remarks
    assert "guessed from the motor angle" in remark
    wrong = replace(axis, pulley=replace(axis.pulley, effective_radius_m=1.2 * axis.transmission_m_rad, teeth=None))
    with pytest.raises(
        DataError, match=r"the carriage moves 12\.43 mm per rad of the motor, by the axis file 14\.91 mm .*effective_radius_m"
    ):
        check_run(records, wrong, foreign=True)


def test_a_sensor_at_the_carriage_is_told_and_not_used(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    ratio = axis.transmission_m_rad
    for scale, offset, words in ((1.0, 0.012, "stands +12 mm"), (1.05, 0.0, "13.05 mm per rad"), (-1.0, 0.5, "the other way")):
        found = check_run([replace(r, cart_position_m=scale * ratio * r.position + offset) for r in records], axis, foreign=True)
        (remark,) = found.remarks
        assert words in remark
        assert "not used for the model" in remark


@pytest.mark.parametrize(
    ("inertia", "stiffness", "entries", "words"),
    [
        (1.0, 1.0, [], ""),
        (0.5, 1.0, ["motor.inertia_kg_m2"], "inertias of coupling, gearbox and pulley"),
        (1.0, 0.85, [], ""),  # teeth, clamps and bearings, as on the thesis's rigs
        (1.0, 0.5, ["belt.specific_stiffness_n"], "turn the motor"),  # a slack strand
        (1.0, 1.44, ["belt.specific_stiffness_n"], "turn the motor ten times and measure how far the carriage goes"),
        (1.0 / 0.65, 1.0 / 0.65, ["motor.inertia_kg_m2", "belt.specific_stiffness_n"], "the current in A instead of the torque"),
    ],
)
def test_a_wrong_data_sheet_comes_out_as_such(
    run: tuple[list[Recording], Axis], inertia: float, stiffness: float, entries: list[str], words: str
) -> None:
    records, axis = run
    values = {"motor.inertia": inertia * axis.motor_side_inertia_kg_m2, "transmission.ratio": axis.transmission_m_rad}
    values["belt_stiffness.stiffness"] = stiffness * axis.belt_stiffness_n_m(0.5)
    model = build_model("axis", ("belt_stiffness", "coulomb"), values)
    known = {name: replace(item, interval=0.01 * item.value) for name, item in model.parameters.items()}
    model = replace(model, parameters=known)
    doubts = sheet_doubts(model, 1.03, axis, records)
    assert [doubt.entry for doubt in doubts] == entries
    lines = sheet_lines(doubts)
    assert words in "\n".join(lines)
    assert max(map(len, lines), default=0) <= 140, "each finding is a line that is read at a glance"
    assert sheet_doubts(model, 5.0, axis, records) == (), "a model that explains nothing knows no inertia"


def test_a_soft_belt_is_off_its_sheet_by_one_number_however_many_places_were_excited(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    values = {"motor.inertia": axis.motor_side_inertia_kg_m2, "transmission.ratio": axis.transmission_m_rad}
    model = build_model("axis", ("belt_stiffness",), {**values, "belt_stiffness.stiffness": 0.6 * axis.belt_stiffness_n_m(0.25)})
    model = replace(model, parameters={name: replace(item, interval=0.01 * item.value) for name, item in model.parameters.items()})
    excited = next(r for r in records if r.sidecar.experiment == "frf")
    for places in ([0.25], [0.05, 0.25, 0.45], [0.25, 0.25, 0.24, 0.1, 0.3, 0.5]):
        at = [replace(excited, name=str(n), sidecar=replace(excited.sidecar, start_position_m=p)) for n, p in enumerate(places)]
        (doubt,) = sheet_doubts(model, 1.0, axis, at)
        assert doubt.factor == pytest.approx(0.6, rel=1e-9)


def test_strokes_alone_bear_no_name_of_the_belt_or_of_a_delay(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    slow = [r for r in records if "slow_p1" in r.name]
    data, base = fit_base_of(slow, axis, start_model(axis, slow))
    found = Diagnosis(base, data, (Stage(base, (), "current_lag", (), base),), "explained", (), Scorer(base), data)
    kept, sentences = restrict_to_scope(found, slow)
    assert kept.verdict == "cannot tell"
    assert not kept.steps[-1].added
    assert "no record is excited" in sentences[0]
    assert restrict_to_scope(found, records) == (found, [])
    friction = Diagnosis(base, data, (Stage(base, (), "stribeck", (), base),), "explained", (), Scorer(base), data)
    assert restrict_to_scope(friction, slow) == (friction, [])
    far = replace(base, residual=51.0 * base.residual / base.ratio, objective=9.0 * base.problem.samples)
    unexplained = Diagnosis(far, data, (Stage(far, (), "", (), far),), NONE_EXPLAINS, (), Scorer(base), data)
    kept, (sentence,) = restrict_to_scope(unexplained, records)
    assert kept is unexplained
    assert "An error of 51 times the noise" in sentence
    assert "dial gauge" in sentence
    assert [line.partition(":")[0].partition(" (")[0] for line in missing_records(slow, axis.transmission_m_rad)] == [
        "no excited record",
        "no fitted record is faster than 0.5 m/s for a tenth of its time",
        "one place only",
        "no record is held out",
    ]
    assert missing_records(records, axis.transmission_m_rad) == []


def test_an_error_far_below_the_noise_is_no_verdict(run: tuple[list[Recording], Axis]) -> None:
    records, axis = run
    data, base = fit_base_of(records[1:3], axis, start_model(axis, records[1:3]))
    quiet = replace(base, residual=0.1 * base.residual)
    for verdict in ("nothing missing", "explained", "none of the known effects explains this"):
        kept, (sentence,) = restrict_to_scope(Diagnosis(quiet, data, (), verdict, (), Scorer(base), data), records)
        assert kept.verdict == "cannot tell"
        assert "less than noise can leave" in sentence
        assert "--period-samples" in sentence


def test_the_command_ends_with_a_sentence_and_its_code(folder: Path, tmp_path: Path) -> None:
    recordings = tmp_path / "run" / "recordings"
    recordings.mkdir(parents=True)
    (tmp_path / "run" / "axis.yaml").write_text((folder / "axis.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    for path in (folder / "recordings").glob("08_slow_p1.*"):
        lines = path.read_text(encoding="utf-8").splitlines()
        text = "\n".join(lines[:400] if path.suffix == ".csv" else lines)
        (recordings / path.name).write_text(text + "\n", encoding="utf-8")
    for verb in ("compare", "diagnose"):
        outcome = CliRunner().invoke(cli, [verb, str(tmp_path / "run")])
        assert outcome.exit_code == 3
        assert "the records are too short" in outcome.output


def test_a_model_beyond_all_measure_is_unfit_data_and_no_number() -> None:
    with pytest.raises(DataError, match="cannot be explained by any model of an axis") as problem:
        explainable(2.5e14, Path("R"))
    assert "2.5e" not in str(problem.value)
    assert "beltcomm bundle R" in str(problem.value)
    with pytest.raises(DataError):
        explainable(math.nan, Path("R"))
    explainable(300.0, Path("R"))  # poor, but a number


def test_each_of_three_loads_that_nobody_mentions_is_told_with_its_own_inertia() -> None:
    """``c`` carries more than ``b``, and both another load than most: the sentence once gave c the inertia of a."""
    sizes = {"a": 7e-4, "b": 9e-4, "held": 9.02e-4, "c": 1.17e-3}
    own: Any = [(SimpleNamespace(name=name, inertia_unit="kg m²"), size, 1e-6) for name, size in sizes.items()]
    with pytest.raises(DataError, match=r"b, held show an inertia of 0.0009 .* a 0.0007 ± .*, c 0.00117 ± "):
        run_checks._refuse_apart(own)
