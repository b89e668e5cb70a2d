"""Rows written while the axis moves: they survive a killed process, a broken-off record and a full disk."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beltcomm import drive
from beltcomm.axis import load_axis
from beltcomm.configfiles import read_yaml
from beltcomm.errors import UsageError
from beltcomm.recording import RecordingWriter, Sidecar, load_recording
from beltcomm.recording.writer import FLUSH_ROWS, MOTOR_COLUMNS
from beltcomm.runfolder import RunFolder
from campaign.disk import Disk
from recording.samples import csv_text, rows, signals, write

ROW = (0.0, 0.1, math.nan, 0.5, math.nan, math.nan, math.nan, math.nan)


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
    assert MOTOR_COLUMNS == (
        "t_s", "torque_nm", "torque_setpoint_nm", "position_rad", "velocity_rad_s", "reference_position_rad", "reference_velocity_rad_s",
        "torque_offset_nm",
    )  # fmt: skip
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
        "    writer.write((k * 1e-3, math.sin(k), math.nan, math.cos(k), math.nan, math.nan, math.nan, math.nan))\n"
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
    with RecordingWriter(tmp_path / "a.csv", Sidecar()) as writer, pytest.raises(ValueError, match="3 values for 8 columns"):
        writer.write(ROW[:3])
    with pytest.raises(UsageError, match="cannot be written"):
        RecordingWriter(tmp_path / "nowhere" / "a.csv", Sidecar())
    with pytest.raises(ValueError, match="closed"):
        writer.write(ROW)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("earlier", [False, True])
@pytest.mark.parametrize("fails_at", range(1, 11))
def test_whenever_the_folder_becomes_read_only_it_can_be_gone_on_with(tmp_path: Path, fails_at: int, earlier: bool) -> None:
    """A sidecar that was left alone is no lost recording; with one broken off before, which is moved aside first."""
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    if earlier:
        with pytest.raises(KeyError):
            fill(folder.recordings_folder / "sweep.csv", 10, KeyError())
    disk = Disk(folder.path, full=False, fails_at=fails_at)
    with disk.mounted(), contextlib.suppress(UsageError, OSError):
        fill(folder.recordings_folder / "sweep.csv", 10)
    finished = folder.finished_names()
    assert finished == (["sweep"] if (folder.recordings_folder / "sweep.csv").is_file() else [])
    fill(folder.recordings_folder / "again.csv", 10)
    assert "again" in folder.finished_names()


def test_a_full_disk_is_a_sentence(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.csv", Sidecar())
    writer._file.close()  # type: ignore[union-attr]
    writer._file = open("/dev/full", "w")  # noqa: SIM115
    with pytest.raises(UsageError, match="No space left on device; make room"):
        write_all(writer, 1000)
    with pytest.raises(UsageError, match="No space left"):
        writer.close(finished=False)
