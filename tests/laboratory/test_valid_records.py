"""Healthy axes with the instruments of real drives: no check refuses their records, and the fit begins near the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.run_checks import Checked, check_run
from beltcomm.recording import Recording
from beltcomm.recording.checks import rigid_inertia
from beltcomm.runfolder import RunFolder
from marks import quick
from truth.hidden import Machine, draw, write_session
from truth.hidden.instruments import Instruments
from truth.hidden.quantities import true_base

COARSE = Instruments(counts_per_rev=640)
FILTERED = Instruments(reading_filter_s=2e-3)
UNEVEN = Instruments(sampling_jitter=0.006, period_s=2e-3)


def examined(machine: Machine, folder: Path, *only: str) -> tuple[RunFolder, Checked]:
    """A whole session or some of its records, and what the checks make of it."""
    write_session(machine, folder, only=only)
    run = RunFolder.open(folder)
    return run, check_run(run.recordings(), run.axis, foreign=True)


def test_a_motor_that_moves_by_a_count_is_no_counter_that_starts_anew(tmp_path: Path) -> None:
    run, found = examined(draw(900001, family="rigid", instruments=COARSE), tmp_path / "run")
    steps = [float(np.ptp(r.position)) * 640 / (2.0 * np.pi) for r in found.recordings]
    assert len(found.recordings) == len(run.recordings())
    assert min(steps) < 1.5


@pytest.mark.examination
def test_friction_read_late_in_short_strokes_is_no_turned_sign(tmp_path: Path) -> None:
    run, found = examined(draw(910004, instruments=FILTERED), tmp_path / "run")
    assert len(found.recordings) == len(run.recordings())
    shown = {r.name: rigid_inertia(r.t_s, r.torque, r.position) for r in found.recordings}
    negative = [one for one in shown.values() if one is not None and one.inertia < -6.0 * one.error]
    assert negative  # the filter alone makes one so
    assert all(one.dissipated > 0.0 for one in negative)


def test_samples_a_little_uneven_are_put_right_by_their_stamps(tmp_path: Path) -> None:
    machine = draw(940024, instruments=UNEVEN)
    run, found = examined(machine, tmp_path / "run", "01_sweep_fast_1", "05_frf_p1_a2")
    assert any("the angle was interpolated to even ones" in remark for remark in found.remarks)
    for raw, even in zip(run.recordings(), found.recordings, strict=True):
        assert np.ptp(np.diff(raw.t_s)) > 1e-5
        assert np.ptp(np.diff(even.t_s)) < 1e-9
    raw, even = run.recordings()[0], found.recordings[0]  # a fast sweep
    # what was unevenness of the samples is gone: differences of a fast motion are those of the motion and the rounding
    assert np.std(np.diff(even.position, 3)) < 0.5 * np.std(np.diff(raw.position, 3))


def test_samples_too_uneven_are_still_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="the samples were taken unevenly"):
        examined(draw(940024, instruments=replace(UNEVEN, sampling_jitter=0.05)), tmp_path / "run", "01_sweep_fast_1")


@pytest.mark.parametrize(
    ("seed", "family", "instruments"),
    quick(
        [
            (940013, "wide", Instruments(counts_per_rev=580, period_s=2e-3, setpoint_column=False)),
            (940018, "sheet", Instruments(counts_per_rev=640, period_s=0.5e-3, setpoint_column=False)),
            (940014, "sheet", Instruments(reading_filter_s=2.3e-3, setpoint_column=False)),
        ],
        1,
    ),
    ids=["coarse encoder, slow", "coarse encoder", "filtered reading"],
)
def test_the_fit_begins_near_the_truth(seed: int, family: str, instruments: Instruments, tmp_path: Path) -> None:
    machine = draw(seed, family=family, instruments=instruments)
    write_session(machine, tmp_path / "run", "default")
    run = RunFolder.open(tmp_path / "run")
    records: list[Recording] = run.recordings()
    start, truth = start_model(run.axis, records), true_base(machine)
    for name in ("motor.inertia", "cart.mass", "belt_stiffness.stiffness"):
        assert 1.0 / 1.5 < start[name] / truth[name] < 1.5, name
