"""A whole commissioning of rig g_a through the CAN bus: what it found, what it left, against the independent truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.control import Cascade
from beltcomm.drive.parameters import parameters_to_cascade
from beltcomm.fit.band_error import _low_passed
from beltcomm.journal import events_of
from beltcomm.laboratory.compare import compare
from beltcomm.model import load_model
from beltcomm.recording import load_recording
from beltcomm.rundata.fitted_run import open_fitted
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from session.bench import RATIO
from session.conftest import Complete

RECORDINGS = [
    "amplitude_1", "amplitude_2", "frf_1", "frf_2", "frf_3", "frf_4", "frf_5", "move_1", "moves_1", "reversals_1", "sweep", "sweep_2",
]  # fmt: skip
HELD_OUT = {"frf_4", "move_1", "moves_1"}
#: (name in the model, name in the truth, largest share that value and interval may be off or wide).  The motor's damping is told from the
#: carriage's next to the antiresonance only: an interval below 10 %, as was once asked for, missed one in four on coarse encoders.
PARAMETERS = (
    ("cart.mass", "mass_kg", 0.03),
    ("belt_stiffness.stiffness", "stiffness_n_m", 0.03),
    ("motor.inertia", "inertia_kg_m2", 0.03),
    ("viscous.damping", "viscous_nm_s_rad", 0.15),
)
CHARACTERISTICS = (
    ("resonance", "resonance_hz", 0.01),
    ("antiresonance", "antiresonance_hz", 0.01),
    ("coulomb_total", "coulomb_total_nm", 0.05),
)


def test_it_meets_its_targets(complete: Complete) -> None:
    assert complete.result.exit_code == 0
    verdict = complete.result.data["verdict"]
    assert verdict.passed
    assert verdict.measured.dynamic_m < 1e-3
    assert verdict.measured.static_m < 100e-6
    text = "\n".join(complete.result.lines())
    assert text.strip().startswith("PASS")
    assert str(complete.path) in text
    assert text.splitlines()[-1].strip() == f"beltcomm open {complete.path}"


@pytest.mark.parametrize(("found", "true", "share"), PARAMETERS)
def test_the_model_is_right_and_its_intervals_hold(complete: Complete, found: str, true: str, share: float) -> None:
    """Within the share asked for; and within twice the 95 % interval, which a right interval misses once in 10 000."""
    item, truth = complete.final.fit.model.parameters[found], complete.bench.plant.truth[true]
    assert item.value == pytest.approx(truth, rel=share)
    assert item.interval is not None
    assert 0.0 < item.interval < share * truth
    assert abs(item.value - truth) < 2.0 * item.interval


@pytest.mark.parametrize(("found", "true", "share"), CHARACTERISTICS)
def test_the_characteristic_numbers_are_right(complete: Complete, found: str, true: str, share: float) -> None:
    item, truth = complete.result.data["fit"]["characteristics"][found], complete.bench.plant.truth[true]
    assert item["value"] == pytest.approx(truth, rel=share)
    assert 0.0 < item["interval"] < share * truth
    assert abs(item["value"] - truth) < 2.0 * item["interval"]


def test_it_takes_the_machine_no_longer_than_promised(complete: Complete) -> None:
    assert 20.0 < complete.result.data["machine_seconds"] <= 75.0
    # all time that passed on the bus, the pauses between records included
    assert complete.bench.now_s <= 75.0


def test_the_limits_of_the_axis_were_kept(complete: Complete) -> None:
    limits, plant = load_axis("egc-70-600").limits, complete.bench.plant
    assert limits.feed_force_n is not None
    force = plant.belt_force_n
    move = plant.first_tick_of(complete.folder.recording("move_1"), complete.bench.start_m)
    assert np.abs(force[:move]).max() <= limits.feed_force_n
    # In the fast move the belt carries the guide's friction on top, which data sheets list apart, and swings by itself: the move's
    # limits are those of a rigid carriage.
    assert np.abs(force[move:]).max() <= 1.05 * (limits.feed_force_n + plant.truth["coulomb_cart_n"])
    places = complete.bench.start_m + plant.cart_m(0, len(plant.torque_nm))
    assert places.min() >= -0.01
    assert places.max() <= 0.57
    assert np.ptp(places) > 0.5  # it has used the travel


def test_the_carriage_itself_meets_the_targets(complete: Complete) -> None:
    """Second sensor: the truth plant's carriage, row by row beside the recorded reference."""
    move = complete.folder.recording("move_1")
    assert move.reference_position is not None
    plant = complete.bench.plant
    first = plant.first_tick_of(move, complete.bench.start_m)
    cart = complete.bench.start_m + plant.cart_m(first, len(move.t_s))
    error = np.abs(RATIO * move.reference_position - cart)
    moving = np.flatnonzero(np.diff(move.reference_position))
    end = int(moving[-1]) + 1
    dynamic, static = error[int(moving[0]) : end + 1].max(), error[end + 500 : end + 1501].max()
    assert dynamic < 1e-3
    assert static < 100e-6
    predicted = complete.result.data["verdict"].predicted_cart
    assert dynamic == pytest.approx(predicted.dynamic_m, rel=0.2, abs=20e-6)
    assert static == pytest.approx(predicted.static_m, rel=0.2, abs=20e-6)


def test_the_prediction_holds_at_the_motor(complete: Complete) -> None:
    verdict = complete.result.data["verdict"]
    assert verdict.measured.dynamic_m == pytest.approx(verdict.predicted.dynamic_m, rel=0.2, abs=20e-6)
    assert verdict.measured.static_m == pytest.approx(verdict.predicted.static_m, rel=0.2, abs=20e-6)


def test_the_verification_move_is_that_of_the_thesis(complete: Complete) -> None:
    move = complete.folder.recording("move_1")
    assert move.reference_position is not None
    reference = RATIO * move.reference_position
    # it begins where the carriage has come to rest after positioning, at most 1 mm beside
    assert (reference[0], reference[-1]) == (pytest.approx(0.0, abs=1e-3), pytest.approx(0.5, abs=1e-3))
    assert np.ptp(move.t_s) > 0.7 + 1.5  # the static error is read until 1.5 s after the move's end


@pytest.mark.parametrize("name", RECORDINGS)
def test_recorded_torque_and_motion_are_aligned(complete: Complete, name: str) -> None:
    """torque_nm[n] acts from t[n] to t[n+1]: weights of the true torque of three ticks, by least squares, have their centroid there."""
    recording = complete.folder.recording(name)
    torque, plant = recording.torque, complete.bench.plant
    first = plant.first_tick_of(recording, complete.bench.start_m)
    lags = np.array([-1, 0, 1])
    rows = np.arange(1, len(torque) - 1)
    true = np.stack([plant.torque_nm[first + rows + lag] for lag in lags], axis=1)
    weights, *_ = np.linalg.lstsq(true, torque[rows], rcond=None)
    assert weights.sum() == pytest.approx(1.0, abs=0.01)
    error = np.std(torque[rows] - true @ weights) * math.sqrt(lags @ np.linalg.inv(true.T @ true) @ lags)  # a smooth move tells it to 27 us
    assert abs(float(weights @ lags / weights.sum())) * 1e-3 < max(4e-3 * error, 5e-6)


@pytest.mark.parametrize("name", RECORDINGS)
def test_every_recording_is_whole_and_says_what_it_is(complete: Complete, name: str) -> None:
    recording = load_recording(complete.path / "recordings" / f"{name}.csv", complete.folder.axis)
    note = recording.sidecar
    kinds = {"amplitude": "frf", "frf": "frf", "sweep": "friction_sweep", "reversals": "reversal"}
    kind = kinds.get(name.partition("_")[0], "trajectory")
    assert (note.experiment, note.finished, note.closed_loop) == (kind, True, kind != "frf")
    assert note.held_out is (name in HELD_OUT)
    assert note.start_position_m == pytest.approx(RATIO * recording.position[0], abs=1e-4)
    assert recording.t_s[0] == 0.0
    assert np.diff(recording.t_s) == pytest.approx(1e-3)


def test_the_drive_is_as_it_was_found(complete: Complete) -> None:
    assert complete.bench.parameters() == complete.bench.initial
    assert complete.bench.stands_disabled()


def test_the_run_folder_is_complete(complete: Complete) -> None:
    folder = complete.folder
    assert folder.finished_names() == RECORDINGS
    assert folder.unfinished() == []
    assert folder.axis == load_axis("egc-70-600")
    assert {"backup", "drive", "fit", "friction", "verify_move_1"} <= set(folder.names("results"))
    assert not list(complete.path.rglob("*.part"))
    journal = (complete.path / "journal.txt").read_text(encoding="utf-8")
    for name in RECORDINGS:
        assert f"{name}: " in journal
    assert "  connected to beltcomm reference drive" in journal.splitlines()[0]
    assert journal.splitlines()[-1].endswith("  all parameters restored")
    assert len(journal.splitlines()) == len(events_of(complete.path))
    assert (events_of(complete.path)[0], events_of(complete.path)[-1]) == ("connected", "restored")


def test_the_saved_model_is_the_one_that_was_found(complete: Complete) -> None:
    model = load_model(complete.folder.file("models", "final"))
    found = complete.final.fit.model
    assert model.effects == found.effects
    for name, item in found.parameters.items():
        saved = model.parameters[name]
        assert saved.value == pytest.approx(item.value, rel=1e-12)
        assert (saved.unit, saved.side) == (item.unit, item.side)
        assert saved.interval == (None if item.interval is None else pytest.approx(item.interval, rel=1e-12))


def test_the_saved_design_is_the_one_that_ran(complete: Complete) -> None:
    saved = complete.folder.load("designs", "final")
    cascade = parameters_to_cascade(saved["parameters"])
    assert isinstance(cascade, Cascade)
    journal = (complete.path / "journal.txt").read_text(encoding="utf-8").splitlines()
    last = [line.partition("  wrote ")[2] for line in journal if "  wrote " in line][-1]
    wrote = dict(item.split("=") for item in last.split(", "))
    for name, value in saved["parameters"].items():
        assert float(wrote[name]) == pytest.approx(value, rel=1e-5, abs=1e-9)  # REAL32 in the drive, six digits in the journal
    # every margin the proof rests on is kept with it
    assert len(saved["margins"]) >= 8
    assert min(m["phase_margin_deg"] for m in saved["margins"]) >= saved["specification"]["phase_margin_deg"]


def test_the_backup_is_what_was_in_the_drive(complete: Complete) -> None:
    backup = complete.folder.load_result("backup")
    assert backup is not None
    assert backup["parameters"] == pytest.approx(complete.bench.initial, rel=1e-12)
    assert backup["drive"]["device_type"] == "00020192h"


def test_the_talk_tells_the_plan_then_every_phase_once(complete: Complete) -> None:
    numbers = [index for index, _ in complete.talk.phases]
    assert numbers == list(range(1, 10))
    plan = "\n".join(complete.talk.said[:2])
    for word in ("Ctrl-C", "mm", "m/s", "N m", "on the machine, at most"):
        assert word in plan
    assert complete.talk.asked == []  # yes=True
    assert all(0.0 <= f <= 1.0 and math.isfinite(f) for f in complete.talk.fractions)


def test_the_plan_promised_no_less_than_was_used(complete: Complete) -> None:
    """Every number of the plan is an upper bound."""
    (last,) = [line for line in complete.talk.said[1].splitlines() if line.startswith("on the machine, at most")]
    assert complete.result.data["machine_seconds"] <= float(last.split()[-2])


def test_a_second_reader_finds_the_same_axis(complete: Complete) -> None:
    assert RunFolder.open(complete.path).recordings("friction_sweep")[0].name == "sweep"


def test_what_is_drawn_of_a_record_is_the_error_that_is_told(complete: Complete) -> None:
    """The residual over time, speed and place has the rms of the table: a carriage that swung at the start is no error in either."""
    opened = open_fitted(complete.path, Silence())
    found = compare(opened.data, opened.fitted)
    for record in found.records:
        parts = [one for one in found.judged if one.piece.record == record.name]
        passed = [_low_passed(one.whole, one.piece.keep, record.plain.band_hz, one.piece.motion.sample_s) for one in parts]
        drawn = math.sqrt(np.mean(np.concatenate([values[counts] for values, counts in passed]) ** 2))
        assert drawn == pytest.approx(record.plain.error, rel=0.03), record.name
