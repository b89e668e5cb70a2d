"""The torque path of the drive: known from the first record on, told, kept, and used before anything is accused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.configfiles import find_config
from beltcomm.errors import DataError
from beltcomm.fit.start.first_estimate import data_sheet_model, first_path
from beltcomm.fit.torque import reading_fit
from beltcomm.fit.torque.acting_torque import acting_recording
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import FAITHFUL, TorquePath, path_from_dict, path_to_dict
from beltcomm.fit.torque.reading_fit import fit_reading
from beltcomm.machine.delivered import _delivered
from beltcomm.machine.scale import _jumping_inertia
from beltcomm.recording import Recording
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.kept import KEY, kept_path
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.torque_path import path_data, path_lines
from identify.records import COUNTS, PERIOD_S, Recorder, true_model
from marks import quick
from truth.rigs import nominal

Array = NDArray[np.float64]
AXIS = load_axis("egc-70-600")
YES = api.Options(yes=True, seed=1, pictures=False)
LATE = TorquePath(DriveLaw(1.0), ReadingLaw(1.0))


def later(signal: Array, samples: int = 1) -> Array:
    return np.concatenate((np.full(samples, signal[0]), signal[:-samples]))


def smoothed(signal: Array, time_s: float) -> Array:
    """The contract's reading filter, first order, once per sample."""
    found, share = np.empty(len(signal)), 1.0 - np.exp(-PERIOD_S / time_s)
    value = signal[0]
    for n, new in enumerate(signal):
        value += share * (new - value)
        found[n] = value
    return found


def read_as(record: Recording, reading: Array) -> Recording:
    """The same motion with another reading of its torque, 6 mN m of noise on it."""
    return replace(record, torque=reading + np.random.default_rng(5).normal(0.0, 6e-3, len(reading)))


@pytest.fixture(scope="module")
def shaken() -> Recording:
    """Rig g_a under a PRBS, its torque read without noise."""
    return Recorder(3, noise_nm=0.0).shaken(nominal("g_a"), 0.25, 2, at_m=0.28)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (FAITHFUL, []),
        (TorquePath(DriveLaw(2.0, (), 0.998)), []),
        (TorquePath(DriveLaw(1.0, (Lag("first order", (5e-4,), (1e-5,)),))), ["the current loop takes 0.50 ± 0.01 ms"]),
        (TorquePath(DriveLaw(1.0, (Lag("sampled", (1.0 - np.exp(-2.0),)),))), ["the drive filters the torque setpoint with 0.5 ms"]),
        (TorquePath(DriveLaw(1.57, (), delay_interval=0.003)), ["the torque switches at 0.570 ± 0.003 of the sample"]),
        (LATE, ["the torque reading is one sample late"]),
        (TorquePath(DriveLaw(1.0, (Lag("slew rate", (24.3,), (0.4,)),))), ["the drive changes the torque by at most 24.3 ± 0.4 N m/s"]),
        (TorquePath(DriveLaw(1.0), ReadingLaw(0.0, (Lag("sampled", (1.0 - np.exp(-0.5),)),))), ["the torque reading lags 2 ms"]),
        (
            TorquePath(DriveLaw(1.0), commanded=True),
            ["the reported torque is the command: what acts is told by the motion alone"],
        ),
    ],
)
def test_only_what_is_not_ideal_is_told_and_in_one_line(path: TorquePath, said: list[str]) -> None:
    assert path_lines(path, PERIOD_S) == said


def test_rivals_are_named_both() -> None:
    path = TorquePath(DriveLaw(1.0, (Lag("first order", (2e-4,)),)), rivals=(LATE,))
    first, second = path_lines(path, PERIOD_S)
    assert first == "the current loop takes 0.2 ms"
    assert second.startswith("just as likely by these records: the torque reading is one sample late; ")


def test_a_rival_that_reads_the_same_is_not_told() -> None:
    path = TorquePath(DriveLaw(1.0, (Lag("first order", (2e-4,)),)))
    assert path_lines(replace(path, rivals=(path,)), PERIOD_S) == ["the current loop takes 0.2 ms"]


@pytest.mark.parametrize(
    ("lag", "said"),
    [
        (Lag("first order", (3e-4,), (4e-4,)), ""),
        (Lag("first order", (3e-4,), (2e-4,)), "the torque reading lags 0.3 ± 0.2 ms"),
        (Lag("sampled", (0.9976,), (0.01,)), ""),
        (Lag("sampled", (0.8,), (0.01,)), "the torque reading lags 0.62 ± 0.02 ms"),
        (Lag("second order", (1144.757641, 0.7), (2e-6, 0.1)), "the torque reading is filtered at 1145 Hz"),
    ],
)
def test_a_filter_that_may_not_be_there_is_not_told(lag: Lag, said: str) -> None:
    """Nor more digits of one than a reader takes in."""
    assert path_lines(TorquePath(DriveLaw(1.0), ReadingLaw(0.0, (lag,))), PERIOD_S) == ([said] if said else [])


def test_a_path_is_the_same_from_its_file(tmp_path: Path) -> None:
    drive = DriveLaw(1.25, (Lag("second order", (900.0, 0.7), (20.0, 0.1)), Lag("sampled", (0.8,))), 0.99, 0.01)
    path = TorquePath(drive, ReadingLaw(0.5, (Lag("first order", (1e-3,), (1e-5,)),)), rivals=(LATE,))
    assert path_to_dict(path_from_dict(path_data(path, PERIOD_S))) == path_to_dict(path)
    folder = RunFolder.create(tmp_path / "run", AXIS)
    assert kept_path(folder) is None
    folder.save("results", "fit", {KEY: path_data(path, PERIOD_S)})
    assert path_to_dict(kept_path(folder) or FAITHFUL) == path_to_dict(path)
    folder.save("results", "fit", {KEY: {"drive": None}})
    with pytest.raises(DataError, match="torque_path"):
        kept_path(folder)


@pytest.mark.examination
def test_intervals_of_a_filter_cover_it(shaken: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 40 draws of the noise a half width of 95 % holds the truth in 38 ± 1.4; 33 is beyond chance.

    Of the chains this one and none are fitted, for time; the first draw is fitted by all.
    """
    assert shaken.torque_setpoint is not None
    clean, share = later(smoothed(shaken.torque_setpoint, 5e-4)), 1.0 - np.exp(-2.0)
    inside = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0.0, 6e-3, len(clean))
        found = fit_reading([replace(shaken, torque=clean + noise)])
        assert found is not None
        assert [lag.kind for lag in found.law.lags] == ["sampled"]
        inside += abs(found.law.lags[0].values[0] - share) < found.law.lags[0].intervals[0]
        monkeypatch.setattr(reading_fit, "CHAINS", (("sampled",),))
        monkeypatch.setattr(reading_fit, "AT_END", ())
    assert inside >= 34


def test_a_current_loop_of_first_order_is_not_taken_for_a_filter_and_a_switch(shaken: Recording) -> None:
    """Both read the same from sample to sample: (1 - p + p/z)(1 - a)/(1 - a/z) is the mean of exp(-t/T); the one with fewer holds."""
    assert shaken.torque_setpoint is not None
    keeps = np.exp(-2.0)
    share = 0.5 * (1.0 - keeps)  # of the step's way that the mean over its first period lacks:  T/h (1 - exp(-h/T))
    before = later(smoothed(shaken.torque_setpoint, 5e-4), 2)
    mean = later(shaken.torque_setpoint) + (before - later(shaken.torque_setpoint)) * share
    found = fit_reading([read_as(shaken, mean)])
    assert found is not None
    assert found.law.delay == 1.0
    assert [lag.kind for lag in found.law.lags] == ["first order"]
    assert found.law.lags[0].values[0] == pytest.approx(5e-4, rel=0.01)


def test_a_first_record_tells_a_late_reading(shaken: Recording) -> None:
    model = true_model(nominal("g_a"))
    late = read_as(shaken, later(shaken.torque))
    found = first_path(late, data_sheet_model(AXIS, 0.28, 0.1), COUNTS)
    assert found.path.reading.late == 1.0
    assert found.model["motor.inertia"] == pytest.approx(model["motor.inertia"], rel=0.1)
    assert found.model["cart.mass"] == pytest.approx(model["cart.mass"], rel=0.1)
    assert not _jumping_inertia(late) < 1.6 * model["motor.inertia"]  # it is not even a number
    assert _jumping_inertia(acting_recording(late, found.path)) == pytest.approx(_jumping_inertia(read_as(shaken, shaken.torque)), rel=0.05)


@pytest.mark.parametrize("time_s", quick([1e-3, 5e-3], 1))
def test_a_first_record_tells_a_filtered_reading(shaken: Recording, time_s: float) -> None:
    model = true_model(nominal("g_a"))
    found = first_path(read_as(shaken, smoothed(shaken.torque, time_s)), data_sheet_model(AXIS, 0.28, 0.1), COUNTS)
    (lag,) = found.path.reading.lags
    assert lag.values[0] == pytest.approx(1.0 - np.exp(-PERIOD_S / time_s), rel=0.03)
    assert found.model["motor.inertia"] == pytest.approx(model["motor.inertia"], rel=0.1)


def test_a_faithful_reading_stays_one(shaken: Recording) -> None:
    record = read_as(shaken, shaken.torque)
    found = first_path(record, data_sheet_model(AXIS, 0.28, 0.1), COUNTS)
    assert found.path.read_as_acts
    assert acting_recording(record, found.path) is record


@pytest.mark.examination
def test_a_filter_takes_nothing_of_the_torque_away(shaken: Recording) -> None:
    filtered = read_as(shaken, smoothed(shaken.torque, 2e-3))
    for record in (filtered, replace(filtered, sidecar=replace(filtered.sidecar, held_out=True))):
        found = _delivered(record)
        assert found is not None
        assert found.sound
    halved = _delivered(read_as(shaken, 0.5 * smoothed(shaken.torque, 2e-3)))
    assert halved is not None
    assert halved.share == pytest.approx(0.5, abs=0.02)


def test_the_loop_counts_with_the_delay_to_the_torque_that_acts(shaken: Recording) -> None:
    """The reading comes 2 ms after its setpoint, the torque 1 ms."""
    model, late = true_model(nominal("g_a")), read_as(shaken, later(shaken.torque))
    told, known = Findings(), Findings(kept_path=LATE)
    assert known.path is LATE
    measure_delay_and_damping(told, [late], model)
    measure_delay_and_damping(known, [late], model)
    assert told.dead_time is not None
    assert told.dead_time.value_s == pytest.approx(2e-3, abs=5e-5)
    assert known.dead_time is not None
    assert known.dead_time.value_s == pytest.approx(1e-3, abs=5e-5)


@pytest.mark.examination
@pytest.mark.parametrize(
    ("instrument", "said"), [("reading_late_ticks: 1", "one sample late"), ("current_loop_s: 0.0005", "current loop takes 0.5")]
)
def test_a_real_drive_is_identified_and_its_path_told(tmp_path: Path, instrument: str, said: str) -> None:
    plant = tmp_path / "plant.yaml"
    text = find_config("plants", "g_a").read_text(encoding="utf-8")
    plant.write_text(text.replace("counts_per_rev: 65536}", f"counts_per_rev: 65536, {instrument}}}"), encoding="utf-8")
    result = api.identify(f"virtual:{plant}", "egc-70-600", tmp_path / "run", options=YES)
    assert any(said in line for line in result.details), result.details
    assert said in result.data["fit"][KEY]["words"][0]
    mass, stiffness = (result.data["model"]["parameters"][name] for name in ("cart.mass", "belt_stiffness.stiffness"))
    assert abs(mass["value"] - 13.44) < mass["interval"]
    assert abs(stiffness["value"] - 203740.0) < stiffness["interval"]


def test_a_coarse_encoder_is_not_taken_for_a_brake() -> None:
    """It shows the motion behind a filter; before that it was told that the axis hardly moved."""
    record = Recorder(3, counts=500).shaken(nominal("g_a"), 0.17, 1, at_m=0.28)
    found = first_path(record, data_sheet_model(AXIS, 0.28, 0.1), 500)
    assert found.path.reading.faithful
    assert 0.5 * AXIS.motor_side_inertia_kg_m2 <= found.model["motor.inertia"] <= 2.0 * AXIS.motor_side_inertia_kg_m2
