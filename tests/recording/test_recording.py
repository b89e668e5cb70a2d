"""Recordings: exact round trips, signals that cannot be used, records that contradict the axis, uneven time, torques that were cut off."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.errors import DataError
from beltcomm.recording import ExcitationNote, Recording, RecordingWriter, Sidecar, load_recording, save_recording
from beltcomm.recording.checks import clipped_share
from recording.samples import PERIOD_S, csv_text, recording, signals, write

RIG = load_axis("egc-70-600")


# --- round trips


def test_save_and_load_are_exact(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    sidecar = Sidecar(
        experiment="frf",
        start_position_m=0.1 + 0.2,
        session_time_s=12.3,
        held_out=True,
        payload_kg=11.2,
        excitation=ExcitationNote("prbs", 0.15, 2046, 250),
        controller={"kp_nm_s_rad": 0.02},
        source="here",
        extra={"foreign": [1, 2.5, "x"]},
    )
    full = recording(
        name="frf_1",
        torque_setpoint=rng.normal(size=2000),
        reference_position=rng.normal(size=2000),
        reference_velocity=rng.normal(size=2000) * 1e-300,
        temperature_c=rng.normal(size=2000),
        cart_position_m=rng.normal(size=2000),
        load_position_rad=rng.normal(size=2000),
        extra={"voltage_v": rng.normal(size=2000), "remark": np.array(['a, "b"'] * 2000)},
        sidecar=sidecar,
    )
    loaded = load_recording(save_recording(full, tmp_path))
    assert loaded.sidecar == sidecar
    assert (loaded.name, loaded.side) == ("frf_1", "motor")
    assert list(loaded.columns()) == list(full.columns())
    for name, column in full.columns().items():
        assert np.array_equal(loaded.columns()[name], column), name
    assert loaded.notes == ("columns kept and ignored: voltage_v, remark",)


@pytest.mark.parametrize(
    ("side", "torque", "position", "units"),
    [
        ("motor", "torque_nm", "position_rad", ("N m", "rad")),
        ("load", "force_n", "position_m", ("N", "m")),
        ("ampere", "current_a", "position_rad", ("A", "rad")),
    ],
)
def test_each_side_has_its_columns_and_units(tmp_path: Path, side: Any, torque: str, position: str, units: tuple[str, str]) -> None:
    loaded = load_recording(save_recording(recording(side=side), tmp_path))
    assert list(loaded.columns()) == ["t_s", torque, position]
    assert (loaded.side, loaded.torque_unit, loaded.position_unit) == (side, *units)


def test_current_becomes_torque_by_the_torque_constant(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", csv_text(torque_nm=None, current_a=signals(50)["torque"]))
    assert load_recording(path).side == "ampere"
    assert "in ampere" in load_recording(path).notes[0]
    scaled = load_recording(path, RIG)
    assert scaled.side == "motor"
    assert scaled.torque == pytest.approx(0.65 * signals(50)["torque"], rel=1e-15)


def test_a_static_map_has_no_time(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "position_rad,current_a\n0.0,0.25\n0.1,0.43\n0.2,0.31\n")
    with pytest.raises(DataError, match=r"no column t_s; a static map .* experiment: static_map"):
        load_recording(path)
    write(tmp_path / "a.yaml", "experiment: static_map\n")
    loaded = load_recording(path)
    assert (loaded.is_static_map, len(loaded.t_s), loaded.torque.tolist()) == (True, 0, [0.25, 0.43, 0.31])
    with pytest.raises(DataError, match="has no time"):
        _ = loaded.sample_period_s
    again = load_recording(save_recording(replace(loaded, name="b", notes=()), tmp_path))
    assert set(again.columns()) == {"position_rad", "current_a"}


def test_without_sidecar_a_record_is_free(tmp_path: Path) -> None:
    assert load_recording(write(tmp_path / "a.csv", csv_text())).sidecar == Sidecar(experiment="free")


def test_raw_recordings_are_never_overwritten(tmp_path: Path) -> None:
    path = save_recording(recording(), tmp_path)
    before = path.read_bytes()
    with pytest.raises(DataError, match="raw recordings are never changed"):
        save_recording(recording(torque=2 * signals()["torque"]), tmp_path)
    with pytest.raises(DataError, match="raw recordings are never changed"):
        RecordingWriter(path, Sidecar())
    assert path.read_bytes() == before


def test_a_recording_owns_its_arrays() -> None:
    made = signals()
    kept = Recording(name="a", **made)
    made["torque"][0] = 99.0
    assert kept.torque[0] != 99.0
    with pytest.raises(ValueError, match="read-only"):
        kept.torque[0] = 0.0


def test_reading_100_000_rows_is_fast(tmp_path: Path) -> None:
    path = save_recording(recording(**{name: np.tile(v, 50) for name, v in signals().items() if name != "t_s"},
                                    t_s=PERIOD_S * np.arange(100_000)), tmp_path)  # fmt: skip
    begun = time.process_time()
    load_recording(path)
    assert time.process_time() - begun < 0.6  # measured 0.11 s; the bound is for a loaded machine


# --- signals that cannot be used


def clipped(level: float) -> dict[str, Any]:
    return {"torque": np.clip(signals()["torque"], -level, level)}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque": np.full(2000, 0.1)}, "torque_nm is 0.1 N m in every row"),
        ({"position": np.full(2000, 0.1)}, "position_rad is 0.1 rad in every row: the axis did not move"),
        (clipped(0.2), r"torque_nm is clipped at 0\.2 N m in \d\d % of the rows \(allowed: 2 %\)"),
        ({name: values[:9] for name, values in signals().items()}, "it has 9 samples, at least 10"),
        ({"torque": signals()["torque"][:-1]}, "position has 2000 samples, torque has 1999"),
        ({"velocity": np.full(2000, np.nan)}, "velocity_rad_s in row 1 is nan"),
        ({"t_s": np.arange(2000.0)}, "looks like milliseconds or sample numbers"),
        ({"position": np.zeros((2000, 2))}, "2 dimensions"),
        ({"velocity": np.rad2deg(15.0 * np.cos(3 * signals()["t_s"]))}, "the velocity has degrees instead of rad"),
        ({"velocity": 15.0 * np.cos(3 * signals()["t_s"]) * 60 / math.tau}, "the velocity has 1/min instead of rad/s"),
        ({"velocity": -15.0 * np.cos(3 * signals()["t_s"])}, "the opposite sign"),
        (
            {"velocity": 15.0 * np.cos(3 * signals()["t_s"]), "position": np.rad2deg(signals()["position"])},
            "the position has degrees",
        ),
        ({"side": "belt"}, "side is 'belt'"),
    ],
)  # fmt: skip
def test_unusable_signals_are_explained(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError, match=words) as caught:
        recording(**changes)
    assert "recording 'a'" in str(caught.value)


def test_a_filtered_velocity_is_no_unit_fault() -> None:
    t, tau = signals()["t_s"], 0.05
    lagged = 15.0 * np.cos(3 * t - math.atan(3 * tau)) / math.hypot(1.0, 3 * tau)
    assert recording(velocity=lagged).velocity is not None


def test_switched_torque_is_not_clipped_unless_it_falls_short() -> None:
    levels = 0.15 * np.sign(np.random.default_rng(5).normal(size=500)).repeat(4)
    assert recording(torque=levels).notes == ()
    note = Sidecar(experiment="frf", excitation=ExcitationNote("prbs", 0.3))
    with pytest.raises(DataError, match=r"clipped at 0\.15"):
        recording(torque=levels, sidecar=note)
    assert recording(torque=levels, sidecar=replace(note, closed_loop=True)).torque.max() == 0.15


def test_the_setpoint_decides_what_is_clipped() -> None:
    asked = signals()["torque"]
    with pytest.raises(DataError, match=r"clipped at 0\.2"):
        recording(torque_setpoint=np.roll(asked, 1), **clipped(0.2))
    # the same torque, asked for as it is: a plateau by intent
    assert recording(torque_setpoint=np.clip(asked, -0.2, 0.2), **clipped(0.2)).torque.max() == 0.2


def test_a_torque_that_settles_at_its_largest_value_is_not_clipped() -> None:
    settling = 0.3 * (1.0 - np.exp(-np.arange(2000) / 20.0))  # exactly 0.3 from about sample 700 on
    assert np.mean(settling == settling.max()) > 0.5
    assert recording(torque=settling).notes == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"position": np.rad2deg(0.5 * signals()["position"])}, r"position_rad covers .* more than the 0\.58 m of axis 'EGC-70-600'"),
        ({"position": 1e-3 * signals()["position"], "side": "load", "sidecar": Sidecar(start_position_m=0.7)}, "outside the travel"),
        ({"sidecar": Sidecar(start_position_m=0.56)}, "correct start_position_m or the axis file"),
        ({"torque": 1e3 * signals()["torque"]}, r"torque_nm reaches .* gives at most 3\.1 N m"),
        ({"cart_position_m": 12.42 * signals()["position"]}, "cart_position_m is in mm"),
    ],
)
def test_records_that_contradict_the_axis_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError, match=words):
        recording(**changes).check_against(RIG)


def test_records_that_fit_the_axis_pass() -> None:
    recording(sidecar=Sidecar(start_position_m=0.3), cart_position_m=0.01242 * signals()["position"]).check_against(RIG)


# --- time


def test_lost_samples_and_jitter_are_noted() -> None:
    rng = np.random.default_rng(2)
    t = np.delete(PERIOD_S * np.arange(2004), [500, 501, 700, 1500])
    kept = recording(t_s=t)
    assert kept.gaps.tolist() == [499, 697, 1496]  # index of the last sample before each gap
    assert kept.sample_period_s == pytest.approx(PERIOD_S)
    assert kept.notes == ("samples were lost at 3 places, the longest gap is 0.003 s at t = 0.499 s",)
    uneven = recording(t_s=PERIOD_S * (np.arange(2000) + rng.uniform(-0.15, 0.15, 2000)))
    assert len(uneven.gaps) == 0
    assert "the time steps deviate by up to" in uneven.notes[0]
    assert recording().notes == ()


def test_dead_channels_are_noted() -> None:
    assert recording(temperature_c=np.full(2000, 21.0)).notes == ("temperature_c never changes",)


#: Finer than a third of the noise's median deviation: where steps are coarser, values at rest repeat as well, and the check says nothing.
STEPS_NM = (0.3e-3, 0.6e-3)


def reading(seed: int, step_nm: float) -> tuple[np.ndarray, np.ndarray]:
    """A setpoint of slow waves and what is read of it, N m: noise of 6 mN m, rounded."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) * 1e-3
    setpoint = 0.4 * np.sin(2.0 * np.pi * rng.uniform(0.5, 5.0) * t + rng.uniform(0.0, 6.0))
    return setpoint, step_nm * np.round((setpoint + rng.normal(0.0, 6e-3, len(t))) / step_nm)


@pytest.mark.parametrize("step_nm", STEPS_NM)
def test_largest_values_that_repeat_by_chance(step_nm: float) -> None:
    found = [clipped_share(read, setpoint, None) for setpoint, read in (reading(seed, step_nm) for seed in range(300))]
    assert found == [0.0] * 300


def test_three_equal_peaks_under_noise_are_chance() -> None:
    setpoint, read = reading(7, STEPS_NM[1])
    at = int(np.argmin(setpoint))
    read[at - 1 : at + 2] = read.min()
    assert clipped_share(read, setpoint, None) == 0.0


@pytest.mark.parametrize("step_nm", STEPS_NM)
def test_a_setpoint_that_was_cut_off_with_it_is_still_seen(step_nm: float) -> None:
    for seed in range(20):
        setpoint, read = reading(seed, step_nm)
        limit = step_nm * round(0.38 / step_nm)
        cut = np.clip(read, -limit, limit)
        assert clipped_share(cut, np.clip(setpoint, -limit, limit), None) > 0.02
