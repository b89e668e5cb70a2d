"""Recordings: exact round trips, every fault a sentence with file, column and row, rows that survive a killed process."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import drive
from beltcomm.axis import load_axis
from beltcomm.configfiles import read_yaml
from beltcomm.errors import DataError, UsageError
from beltcomm.recording import ExcitationNote, Recording, RecordingWriter, Sidecar, load_recording, save_recording
from beltcomm.recording_writer import FLUSH_ROWS, MOTOR_COLUMNS

RIG = load_axis("egc-70-600")
PERIOD_S = 1e-3


def signals(samples: int = 2000, seed: int = 0) -> dict[str, Any]:
    """A motor that swings by 5 rad under a noisy torque."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(samples)
    return {
        "t_s": t,
        "torque": 0.3 * np.sin(7 * t) + rng.normal(0.0, 6e-3, samples),
        "position": 5.0 * np.sin(3 * t),
    }


def recording(**changes: Any) -> Recording:
    return Recording(**({"name": "a"} | signals() | changes))


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def csv_text(samples: int = 50, **columns: Any) -> str:
    """A valid file, with some columns replaced or, when None, left out; cells as they stand."""
    made = signals(samples)
    table = {"t_s": made["t_s"], "torque_nm": made["torque"], "position_rad": made["position"]} | columns
    kept = {name: [str(cell) for cell in values] for name, values in table.items() if values is not None}
    return "\n".join([",".join(kept), *map(",".join, zip(*kept.values(), strict=True))]) + "\n"


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


# --- files that cannot be read


FILE_FAULTS: dict[str, tuple[bytes | Callable[[], str], str]] = {
    "empty": (b"", "is empty"),
    "header only": (b"t_s,torque_nm,position_rad\n", "has a header and no rows"),
    "no header": (lambda: csv_text().partition("\n")[2], "has no header row"),
    "UTF-16": (lambda: csv_text(), "is UTF-16"),
    "zero bytes": (b"t_s,torque_nm\n\0\0\0\n", "not a text file"),
    "Latin-1": (b"t_s,torque_nm,position_rad,H\xf6he\n", r"not UTF-8 text \(line 1\)"),
    "semicolons": (lambda: csv_text().replace(",", ";"), "separates its columns by semicolons"),
    "semicolons and commas": (lambda: csv_text().replace(",", ";").replace(".", ","), "by semicolons"),
    "tabs": (lambda: csv_text().replace(",", "\t"), "by tabs"),
    "decimal comma": (lambda: csv_text(torque_nm=['"0,5"'] * 50), r"torque_nm in row 1 is '0,5'; write the decimal point as '\.'"),
    "bare decimal comma": (lambda: csv_text(torque_nm=["0,5"] * 50), "row 1 has 4 values, the header 3 names"),
    "missing": (lambda: csv_text(torque_nm=["0.1"] * 16 + [""] + ["0.2"] * 33), "torque_nm in row 17 is missing"),
    "nan": (lambda: csv_text(position_rad=["0.1"] * 16 + ["nan"] + ["0.2"] * 33), "position_rad in row 17 is missing"),
    "infinite": (lambda: csv_text(torque_nm=["0.1"] * 16 + ["inf"] + ["0.2"] * 33), "torque_nm in row 17 is 'inf', not a finite"),
    "text": (lambda: csv_text(torque_nm=["0.1"] * 16 + ["ERR"] + ["0.2"] * 33), "torque_nm in row 17 is 'ERR', not a finite number"),
    "optional missing": (lambda: csv_text(cart_position_m=[""] + ["0.2"] * 49), "cart_position_m in row 1 is missing"),
    "short row": (lambda: csv_text() + "0.06,0.1\n", "row 51 has 2 values, the header 3 names; is the file cut off"),
    "double column": (lambda: csv_text().replace("position_rad", "torque_nm", 1), "two columns called torque_nm"),
    "unnamed column": (lambda: csv_text().replace("torque_nm", "", 1), "has no name for column 2"),
    "time not rising": (lambda: csv_text(t_s=[0.0, 0.001, 0.001, *[0.01 * k for k in range(1, 48)]]), "t_s in row 3 is 0.001 s"),
    "no torque": (lambda: csv_text(torque_nm=None), "has no column torque_nm"),
    "no position": (lambda: csv_text(position_rad=None), "has no column position_rad beside torque_nm"),
    "degrees": (lambda: csv_text().replace("position_rad", "position_deg", 1), "multiply position_deg by 0.0174533"),
    "milliseconds": (lambda: csv_text().replace("t_s", "t_ms", 1), "multiply t_ms by 0.001 and call it t_s"),
    "misspelt": (lambda: csv_text().replace("torque_nm", "Torque_Nmm", 1), r"has no column torque_nm.*did you mean Torque_Nmm"),
    "two sides": (lambda: csv_text().replace("position_rad", "position_m", 1), "has no column position_rad beside torque_nm"),
}


@pytest.mark.parametrize("fault", FILE_FAULTS)
def test_unreadable_files_are_explained(tmp_path: Path, fault: str) -> None:
    content, words = FILE_FAULTS[fault]
    raw = content if isinstance(content, bytes) else content().encode("utf-16" if fault == "UTF-16" else "utf-8")
    path = tmp_path / "a.csv"
    path.write_bytes(raw)
    with pytest.raises(DataError, match=words) as caught:
        load_recording(path)
    assert str(path) in str(caught.value)
    assert [item.name for item in tmp_path.iterdir()] == ["a.csv"]


def test_a_missing_file_is_explained(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        load_recording(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(",", " , "),
        lambda text: text.rstrip("\n"),
        lambda text: text + "\n\n",
        lambda text: "\n".join(line + "," for line in text.splitlines()) + "\n",
    ],
    ids=["byte order mark", "CRLF", "spaces", "no last newline", "blank lines", "trailing comma"],
)
def test_harmless_variants_are_read(tmp_path: Path, change: Callable[[str], str]) -> None:
    loaded = load_recording(write(tmp_path / "a.csv", change(csv_text())))
    assert np.array_equal(loaded.torque, signals(50)["torque"])
    assert np.array_equal(loaded.t_s, signals(50)["t_s"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("experiment: ffr", r"experiment is 'ffr', did you mean frf\?"),
        ("closed_loop: 3", "closed_loop is 3; write true or false"),
        ("start_position_m: 500 mm", "start_position_m is '500 mm'; give a number in m"),
        ("payload_kg: -1", "payload_kg is -1 kg"),
        ("excitation: {amplitude_nm: 0.3}", r"excitation\.kind is missing"),
        ("excitation: {kind: noise}", r"excitation\.kind is 'noise'"),
        ("excitation: {kind: prbs, period_samples: 2.5}", "whole number"),
        ("excitation: {kind: prbs, first_sample: -1}", "at least 0"),
        ("excitation: prbs", "must hold names and values"),
        ("- 1", "holds a list"),
        ("a: [", "not valid YAML"),
    ],
)
def test_wrong_sidecars_are_explained(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path / "a.csv", csv_text())
    write(tmp_path / "a.yaml", text)
    with pytest.raises(DataError, match=words) as caught:
        load_recording(path)
    assert str(tmp_path / "a.yaml") in str(caught.value)


def test_a_misspelt_key_of_the_sidecar_is_noted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", csv_text())
    write(tmp_path / "a.yaml", "start_positon_m: 0.3\nlicense: MIT\n")
    assert load_recording(path).notes == ("the sidecar's key start_positon_m means nothing here, did you mean start_position_m?",)


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


def test_methods_state_how_many_samples_they_need() -> None:
    recording().check_samples(2000, "the sweep")
    with pytest.raises(DataError, match="the sweep needs 2001 samples, it has 2000; record longer"):
        recording().check_samples(2001, "the sweep")


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
    assert kept.gaps().tolist() == [499, 697, 1496]  # index of the last sample before each gap
    assert kept.sample_period_s == pytest.approx(PERIOD_S)
    assert kept.notes == ("samples were lost at 3 places, the longest gap is 0.003 s at t = 0.499 s",)
    uneven = recording(t_s=PERIOD_S * (np.arange(2000) + rng.uniform(-0.15, 0.15, 2000)))
    assert len(uneven.gaps()) == 0
    assert "the time steps deviate by up to" in uneven.notes[0]
    assert recording().notes == ()


def test_dead_channels_are_noted() -> None:
    assert recording(temperature_c=np.full(2000, 21.0)).notes == ("temperature_c never changes",)


# --- rows while the axis moves


ROW = (0.0, 0.1, math.nan, 0.5, math.nan, math.nan, math.nan)


def rows(samples: int) -> list[tuple[float, ...]]:
    made = signals(samples)
    return [(t, q, math.nan, x, math.nan, math.nan, math.nan) for t, q, x in zip(*(made[n].tolist() for n in made), strict=True)]


def fill(path: Path, samples: int, broken_off_by: BaseException | None = None) -> None:
    with RecordingWriter(path, Sidecar()) as writer:
        for row in rows(samples):
            writer.write(row)
        if broken_off_by is not None:
            raise broken_off_by


def write_all(writer: RecordingWriter, samples: int) -> None:
    for row in rows(samples):
        writer.write(row)


def test_columns_are_those_of_a_drive() -> None:
    assert MOTOR_COLUMNS == drive.COLUMNS


def test_written_rows_become_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "frf.csv"
    with RecordingWriter(path, Sidecar(experiment="frf", session_time_s=3.0)) as writer:
        assert not path.exists()
        assert read_yaml(tmp_path / "frf.yaml")["finished"] is False
        for row in rows(300):
            writer.write(row)
    loaded = load_recording(path)
    assert np.array_equal(loaded.position, signals(300)["position"])
    assert (loaded.velocity, loaded.torque_setpoint) == (None, None)  # NaN columns are left out
    assert loaded.sidecar == Sidecar(experiment="frf", session_time_s=3.0)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["frf.csv", "frf.yaml"]


def test_what_is_known_only_afterwards_goes_into_the_sidecar(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.csv", Sidecar())
    for row in rows(20):
        writer.write(row)
    assert writer.close(finished=True, session_time_s=4.5) == tmp_path / "a.csv"
    assert writer.close(finished=False) == tmp_path / "a.csv"  # a closed record stays as it is
    assert load_recording(tmp_path / "a.csv").sidecar.session_time_s == 4.5


def test_a_record_that_was_broken_off_is_kept_as_such(tmp_path: Path) -> None:
    path = tmp_path / "frf.csv"
    with pytest.raises(KeyboardInterrupt):
        fill(path, 100, KeyboardInterrupt())
    assert not path.exists()
    kept = load_recording(tmp_path / "frf.csv.part")
    assert len(kept.torque) == 100
    assert "the record was broken off" in kept.notes
    fill(path, 50)  # --resume: a second attempt
    assert len(load_recording(path).torque) == 50
    assert len(load_recording(tmp_path / "frf.unfinished1.csv.part").torque) == 100


def test_flushed_rows_survive_a_killed_process(tmp_path: Path) -> None:
    program = (
        "import sys, os, signal, math\n"
        "from pathlib import Path\n"
        "from beltcomm.recording import RecordingWriter, Sidecar\n"
        "writer = RecordingWriter(Path(sys.argv[1]), Sidecar())\n"
        "for k in range(1000):\n"
        "    writer.write((k * 1e-3, math.sin(k), math.nan, math.cos(k), math.nan, math.nan, math.nan))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path / "a.csv")])
    assert done.returncode == -signal.SIGKILL
    kept = load_recording(tmp_path / "a.csv.part")
    assert 1000 - FLUSH_ROWS < len(kept.torque) <= 1000
    assert kept.torque == pytest.approx(np.sin(np.arange(len(kept.torque))), abs=0.0)


def test_a_torn_last_row_is_left_out(tmp_path: Path) -> None:
    write(tmp_path / "a.csv.part", csv_text(50) + "0.05,0.1,0.12")
    assert len(load_recording(tmp_path / "a.csv.part").torque) == 50


def test_wrong_rows_and_folders_are_errors(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.csv", Sidecar()) as writer, pytest.raises(ValueError, match="3 values for 7 columns"):
        writer.write(ROW[:3])
    with pytest.raises(UsageError, match="cannot be written"):
        RecordingWriter(tmp_path / "nowhere" / "a.csv", Sidecar())
    with pytest.raises(ValueError, match="closed"):
        writer.write(ROW)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_a_sentence(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.csv", Sidecar())
    writer._file.close()  # type: ignore[union-attr]
    writer._file = open("/dev/full", "w")  # noqa: SIM115
    with pytest.raises(UsageError, match="No space left on device; make room"):
        write_all(writer, 1000)
    with pytest.raises(UsageError, match="No space left"):
        writer.close(finished=False)
