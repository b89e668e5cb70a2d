"""Noise of the torque sensor told from torque that the drive makes beside its setpoint: the one moves nothing, the other does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.estimate import fit
from beltcomm.fit.model_fit import fit_model
from beltcomm.fit.path_fit.sensor_noise import NoiseSplit, split_noise
from beltcomm.fit.records import prepare_records
from beltcomm.fit.torque.laws import DriveLaw
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from identify.records import COUNTS, NOISE_NM, STEP_RAD, Recorder, true_model
from truth.rigs import draw

SAMPLES = 8192  # more than the response has


def split_of(process_nm: float, sensor_nm: float, path: TorquePath = TorquePath(DriveLaw(1.0))) -> NoiseSplit | None:  # noqa: B008
    """Of a response in which so much torque acts, and is read, beside the setpoint; rms, both white."""
    plant = draw("g_b", np.random.default_rng(5))
    beside = np.random.default_rng(6).normal(0.0, process_nm, SAMPLES) if process_nm else np.zeros(SAMPLES)
    record = Recorder(7, noise_nm=sensor_nm, disturbance=beside).shaken(plant, 0.3, 4)
    record = replace(record, torque=record.torque + beside[: len(record.torque)])
    truth, total = true_model(plant), float(np.hypot(process_nm, sensor_nm))
    data = prepare_records([record], truth, total, STEP_RAD, {}, path=path)
    return split_noise(data, fit(data, truth, 5))


@pytest.mark.parametrize(("process_nm", "sensor_nm"), [(0.0, NOISE_NM), (6e-3, 6e-3), (12e-3, 6e-3), (3e-3, 10e-3)])
def test_what_the_reading_differs_by_from_its_setpoint_is_parted(process_nm: float, sensor_nm: float) -> None:
    found = split_of(process_nm, sensor_nm)
    assert found is not None
    assert found.deviation_nm < 0.1 * sensor_nm
    assert found.sensor_nm == pytest.approx(sensor_nm, abs=4.0 * found.deviation_nm)
    assert np.hypot(found.sensor_nm, found.process_nm) == pytest.approx(np.hypot(sensor_nm, process_nm), rel=0.05)
    assert found.colour == 0.0


@pytest.mark.parametrize("path", [FAITHFUL, TorquePath(DriveLaw(1.0), commanded=True)])
def test_without_a_setpoint_beside_the_reading_nothing_is_parted(path: TorquePath) -> None:
    assert split_of(0.0, NOISE_NM, path) is None


def test_a_drive_that_makes_torque_beside_its_setpoint_still_leaves_one() -> None:
    """Were all of the difference taken for noise of the sensor, a healthy machine would leave 0.5 in the square."""
    plant = draw("g_b", np.random.default_rng(8))
    beside = np.random.default_rng(9).normal(0.0, 8e-3, SAMPLES)
    record = Recorder(10, noise_nm=8e-3, disturbance=beside).shaken(plant, 0.3, 4)
    record = replace(record, torque=record.torque + beside[: len(record.torque)])
    found = fit_model([record], true_model(plant), counts_per_rev=COUNTS)
    assert found.noise_nm == pytest.approx(8e-3, rel=0.08)
    assert found.misfit == pytest.approx(1.0, abs=0.1)


def test_what_the_motion_does_not_tell_is_no_more_than_reading_and_setpoint_leave() -> None:
    """Behind rounding a hundred times as loud nobody knows how much of it acts: all of it may be the sensor's."""
    plant = draw("g_b", np.random.default_rng(5))
    record, truth = Recorder(7, counts=600).shaken(plant, 0.3, 4), true_model(plant)
    data = prepare_records([record], truth, 30.0 * NOISE_NM, 2.0 * np.pi / 600, {}, path=TorquePath(DriveLaw(1.0)))
    found = split_noise(data, fit(data, truth, 5))
    assert found is not None
    assert found.sensor_nm == pytest.approx(NOISE_NM, rel=0.05)
    assert found.process_nm == 0.0
