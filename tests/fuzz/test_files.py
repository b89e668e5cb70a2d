"""Nothing in a file raises anything but the errors of this package: CSV and YAML of runs, axes, plants, drives, foreign tables."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.configfiles import find_config
from beltcomm.errors import BeltcommError
from beltcomm.model import load_model, load_plant
from beltcomm.recording import load_recording
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.rundata import backups
from beltcomm.rundata.store import cascade_from_dict, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.trajectory import load_move
from beltcomm_adapters.profiles import load_profile
from fuzz.mutation import mutated
from fuzz.parsers import DESIGN, STRUCTURE

SIDECAR = """experiment: frf
start_position_m: 0.25
session_time_s: 12.3
closed_loop: false
held_out: false
payload_kg: 11.2
excitation: {kind: multisine, amplitude_nm: 0.3, period_samples: 128, first_sample: 10}
controller: {}
finished: true
"""


def recording_csv() -> str:
    t = np.arange(300) * 1e-3
    rows = zip(t, 0.1 * np.sin(40.0 * t), 0.01 * np.cos(40.0 * t), strict=True)
    return "t_s,torque_nm,position_rad\n" + "".join(f"{a:.3f},{b:.6f},{c:.6f}\n" for a, b, c in rows)


def sentences_of(path: Path, original: bytes, load: Callable[[Path], object], times: int, seed: int) -> set[str]:
    """Load damaged versions of a file; returns what was said of those that were refused."""
    draw, said = np.random.default_rng(seed), set[str]()
    for _ in range(times):
        path.write_bytes(mutated(draw, original))
        try:
            load(path)
        except BeltcommError as error:
            said.add(str(error))
    return said


def checked(said: set[str], path: Path, least: int) -> None:
    """Different damages are told apart, each sentence names the file, and none is a bare exception's."""
    assert len(said) >= least
    unnamed = [text for text in said if path.name not in text and path.stem not in text]
    assert unnamed == []
    assert not [text for text in said if re.search(r"Traceback|<class", text)]


@pytest.mark.parametrize(
    ("kind", "name", "load", "times"),
    [
        ("axes", "egc-70-600", load_axis, 250),
        ("axes", "egc-70-600-vertical", load_axis, 100),
        ("plants", "egc_70", load_plant, 120),
        ("drives", "cmmp-as", load_profile.__wrapped__, 120),
    ],
)
def test_shipped_yaml_damaged(tmp_path: Path, kind: str, name: str, load: Callable[[Any], object], times: int) -> None:
    path = tmp_path / f"{name}.yaml"
    original = find_config(kind, name).read_bytes()
    checked(sentences_of(path, original, lambda p: load(str(p)), times, 1), path, 20)


def test_models_damaged(tmp_path: Path) -> None:
    path = tmp_path / "g_a.yaml"
    checked(sentences_of(path, find_config("plants", "g_a").read_bytes(), load_model, 120, 2), path, 20)


def test_recordings_damaged(tmp_path: Path) -> None:
    path = tmp_path / "frf_1.csv"
    checked(sentences_of(path, recording_csv().encode(), load_recording, 250, 3), path, 20)


def test_sidecars_damaged(tmp_path: Path) -> None:
    (tmp_path / "frf_1.csv").write_text(recording_csv(), encoding="utf-8")
    path = tmp_path / "frf_1.yaml"
    checked(sentences_of(path, SIDECAR.encode(), load_sidecar, 300, 4), path, 20)
    checked(sentences_of(path, SIDECAR.encode(), lambda _p: load_recording(tmp_path / "frf_1.csv"), 100, 5), path, 10)


def test_run_folders_damaged(tmp_path: Path) -> None:
    """What a run keeps for later: identity, backup, drive, design."""
    run = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    run.claim_drive({"device_name": "x", "vendor_id": "29"})
    parameters = {"kp_nm_s_rad": 0.05, "ki_nm_rad": 0.2, "kpp_1_s": 10.0, "velocity_filter_s": 0.004, "ff_inertia_kg_m2": 0.002}
    run.save("results", "backup", {"drive": {"device_name": "x"}, "parameters": parameters})
    run.save("results", "drive", {"name": "x", "structure": STRUCTURE, "counts_per_rev": 65536, "peak_torque_nm": 3.1})
    run.save("designs", "final", DESIGN | {"parameters": parameters})

    def design(_path: Path) -> None:
        cascade_from_dict(RunFolder.open(run.path).load("designs", "final"))

    jobs: dict[str, Callable[[Path], object]] = {
        "run.yaml": lambda _p: RunFolder.open(run.path).claim_drive({"device_name": "x", "vendor_id": "29"}),
        "axis.yaml": lambda _p: RunFolder.open(run.path),
        "results/backup.yaml": lambda _p: backups.choose_backup(RunFolder.open(run.path), None),
        "results/drive.yaml": lambda _p: structure_from_dict(RunFolder.open(run.path).load_result("drive") or {}),
        "designs/final.yaml": design,
    }
    for name, job in jobs.items():
        path = run.path / name
        original = path.read_bytes()
        said = sentences_of(path, original, job, 120, 6)
        assert len(said) >= 5, name
        assert not [text for text in said if re.search(r"Traceback|<class", text)]
        path.write_bytes(original)


def test_foreign_tables_damaged(tmp_path: Path) -> None:
    """``beltcomm import`` of a damaged CSV file: a run, or a sentence and no run."""
    axis, reading = load_axis("egc-70-600"), api.Reading(("t_s=time", "torque_nm=torque", "position_rad=angle"))
    draw, said = np.random.default_rng(7), set[str]()
    original = recording_csv().replace("t_s,torque_nm,position_rad", "time;torque;angle").replace(",", ";").encode()
    path, run = tmp_path / "foreign.csv", tmp_path / "run"
    for _ in range(80):
        shutil.rmtree(run, ignore_errors=True)
        path.write_bytes(mutated(draw, original))
        try:
            api.import_recordings([path], run, reading, axis=axis)
        except BeltcommError as error:
            said.add(str(error))
    assert len(said) >= 10


def test_move_files_damaged(tmp_path: Path) -> None:
    path, axis = tmp_path / "move.csv", load_axis("egc-70-600")
    t = np.linspace(0.0, 1.0, 101)
    text = "t_s,position_m\n" + "".join(f"{a:.4f},{0.1 + 0.1 * (1.0 - np.cos(np.pi * a)):.9f}\n" for a in t)
    checked(sentences_of(path, text.encode(), lambda p: load_move(p, 1e-3, axis), 150, 8), path, 15)
