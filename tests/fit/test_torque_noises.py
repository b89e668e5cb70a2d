"""Noise of the sensor and process torque, each with a colour of its own: told apart, and neither takes an error of the model."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from beltcomm.fit.estimate import fit
from beltcomm.fit.model_fit import fit_model
from beltcomm.fit.noise.colour import NoiseColour
from beltcomm.fit.noise.process_torque import ProcessTorque, _spectral_factor, with_unread
from beltcomm.fit.path_fit.sensor_noise import NoiseSplit, split_noise
from beltcomm.fit.records import prepare_records
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath, path_from_dict, path_to_dict
from beltcomm.recording import Recording
from beltcomm.rundata.kept import _restore_fit, _store_fit
from beltcomm.sentences.torque_path import process_lines
from identify.records import COUNTS, PERIOD_S, Recorder, true_model
from truth.rigs import draw

Array = NDArray[np.float64]
SAMPLES = 16384  # more than any response here has
POLE = 0.9


def coloured(seed: int, rms_nm: float, pole: float) -> Array:
    white = np.random.default_rng(seed).normal(0.0, rms_nm * math.sqrt(1.0 - pole**2), SAMPLES + 500)
    return np.asarray(lfilter([1.0], [1.0, -pole], white)[500:])


def record(process: Array, sensor: Array, counts: int = COUNTS, late: float = 0.0, periods: int = 4) -> Recording:
    """A response with process torque, read so many samples late, and the sensor's noise."""
    made = Recorder(7, noise_nm=0.0, counts=counts, disturbance=process).shaken(draw("g_b", np.random.default_rng(5)), 0.3, periods)
    acts = made.torque + process[: len(made.torque)]
    read = (1.0 - late) * acts + late * np.concatenate((acts[:1], acts[:-1]))
    return replace(made, torque=read + sensor[: len(acts)])


def split_of(made: Recording, *, factor: float = 1.0, late: float = 0.0, counts: int = COUNTS) -> NoiseSplit:
    """By the true model, or by one whose carriage is wrong by a factor and held there."""
    truth = true_model(draw("g_b", np.random.default_rng(5)))
    model = truth.with_values({"cart.mass": factor * truth["cart.mass"]})
    path = TorquePath(DriveLaw(1.0), ReadingLaw(late))
    data = prepare_records([made], model, 1e-2, 2.0 * math.pi / counts, {}, path=path)
    found = split_noise(data, fit(data, model, 5, fixed=("cart.mass", "belt_stiffness.stiffness")))
    assert found is not None
    return found


@pytest.mark.parametrize(("process_nm", "counts"), [(8e-3, COUNTS), (8e-3, 6000), (2.5e-3, COUNTS)])
def test_process_torque_with_a_colour_is_told_beside_white_noise_of_the_sensor(process_nm: float, counts: int) -> None:
    found = split_of(record(coloured(6, process_nm, POLE), coloured(3, 8e-3, 0.0), counts), counts=counts)
    assert found.sensor_nm == pytest.approx(8e-3, abs=4.0 * found.deviation_nm)
    assert found.deviation_nm < 0.2e-3
    assert found.colour == 0.0
    assert found.process is not None
    assert found.process.rms_nm == pytest.approx(process_nm, abs=2.0 * found.process.rms_interval)
    assert found.process.time_s == pytest.approx(-PERIOD_S / math.log(POLE), abs=2.0 * found.process.time_interval)
    assert found.process.time_interval < 0.4 * found.process.time_s


@pytest.mark.parametrize("periods", [1, 4])
def test_a_colour_of_the_sensor_is_not_taken_for_process_torque(periods: int) -> None:
    """One period is no 3000 samples long, as records at 100 Hz are."""
    found = split_of(record(coloured(6, 5e-3, 0.0), coloured(3, 8e-3, POLE), periods=periods))
    assert found.colour == pytest.approx(POLE, abs=0.02)
    assert found.sensor_nm == pytest.approx(8e-3, rel=0.1)
    assert found.process is not None
    assert found.process.time_s == 0.0


def test_both_may_have_a_colour() -> None:
    found = split_of(record(coloured(6, 8e-3, 0.55), coloured(3, 8e-3, 0.95), periods=12))
    assert found.colour == pytest.approx(0.95, abs=0.02)
    assert found.process is not None
    assert found.process.pole(PERIOD_S) == pytest.approx(0.55, abs=0.06)


def test_an_error_of_the_model_is_not_taken_for_process_torque() -> None:
    """A carriage 3 % too heavy is no noise of any colour."""
    made = record(coloured(6, 4e-3, POLE), coloured(3, 8e-3, 0.0), periods=12)
    found = split_of(made, factor=1.03)
    assert found.deviation_nm < 0.4e-3
    assert found.sensor_nm == pytest.approx(8e-3, abs=4.0 * found.deviation_nm)
    assert found.process is not None
    assert found.process.rms_nm == pytest.approx(4e-3, rel=0.1)


@pytest.mark.parametrize(("pole", "late"), [(POLE, 0.0), (0.6, 0.35)])
def test_a_healthy_machine_leaves_one(pole: float, late: float) -> None:
    """Behind a late reading, what it misses of the process is in the noise, too."""
    made = record(coloured(6, 10e-3, pole), coloured(3, 8e-3, 0.0), late=late)
    path = TorquePath(DriveLaw(1.0), ReadingLaw(late))
    found = fit_model([made], true_model(draw("g_b", np.random.default_rng(5))), counts_per_rev=COUNTS, path=path)
    assert found.misfit == pytest.approx(1.0, abs=0.06)
    assert found.noise_nm == pytest.approx(8e-3, rel=0.06)
    data, fitted = _restore_fit([made], json.loads(json.dumps(_store_fit(found.data, found.fitted))))
    assert data.path.process == found.path.process is not None
    np.testing.assert_array_equal(fitted.residual, found.fitted.residual, "kept with the run, read to the same digits")


def test_rounding_does_not_weigh_the_sensor_s_share() -> None:
    """By one share for all frequencies the sensor had 4.6 mN m here: rounding leaves the low ones, where the process is."""
    made = record(coloured(6, 10e-3, POLE), coloured(3, 8e-3, 0.0), 6000)
    found = fit_model([made], true_model(draw("g_b", np.random.default_rng(5))), counts_per_rev=6000)
    assert found.noise_nm == pytest.approx(8e-3, rel=0.06)


@pytest.mark.parametrize("lags", [(), (Lag("first order", (2e-3,)),)])
def test_what_a_reading_misses_has_the_power_that_it_has(lags: tuple[Lag, ...]) -> None:
    """Of s - (1 - L) p behind the triangular mean, by the filter's coefficients and by the definition."""
    path = TorquePath(DriveLaw(1.0), ReadingLaw(0.35, lags))
    answer = path.read_pulse(PERIOD_S)
    poles = tuple(pole for lag in lags for pole in lag.poles(PERIOD_S))
    colour = with_unread(answer.copy(), poles, 0.3, POLE, 2.0)
    z = np.exp(-1j * np.linspace(0.05, 3.0, 60))
    shown = np.polyval(np.array(colour.numerator)[::-1], z) / np.polyval(np.array(colour.denominator)[::-1], z)
    missed = 1.0 - np.polyval(answer[::-1], z)
    sensor, process = (1.0 - 0.09) / np.abs(1.0 - 0.3 * z) ** 2, 2.0 * (1.0 - POLE**2) / np.abs(1.0 - POLE * z) ** 2
    wanted = np.abs(0.5 * (1.0 + z)) ** 2 * (sensor + np.abs(missed) ** 2 * process)
    np.testing.assert_allclose(np.abs(shown) ** 2, wanted, rtol=1e-6)


def test_a_reading_at_the_end_of_the_period_misses_nothing_of_a_held_torque() -> None:
    """Not faithful, and yet nothing is left of 1 - L."""
    path = TorquePath(DriveLaw(1.0), ReadingLaw(at_end=True), acts=0.3, process=ProcessTorque(8e-3, 4e-3))
    assert path.acting_noise(0.2, PERIOD_S) == NoiseColour(0.2)


def test_a_spectral_factor_has_its_zeros_inside() -> None:
    power = np.convolve([1.0, -2.5, 0.3], [0.3, -2.5, 1.0])
    factor = _spectral_factor(power)
    np.testing.assert_allclose(np.convolve(factor, factor[::-1]), power, atol=1e-12)
    assert np.all(np.abs(np.roots(factor)) < 1.0)


def test_it_is_kept_with_the_path_and_older_paths_have_none() -> None:
    path = TorquePath(DriveLaw(1.0), ReadingLaw(0.35), acts=0.3, process=ProcessTorque(8e-3, 4e-3, 1e-4, 2e-4))
    kept = path_to_dict(path)
    assert path_from_dict(kept) == path
    assert path_from_dict(kept).process == path.process
    del kept["process"]
    assert path_from_dict(kept).process is None
    assert "process" not in path_to_dict(TorquePath(DriveLaw(1.0)))
    with pytest.raises(ValueError, match="process torque"):
        path_from_dict({**kept, "process": {"rms_nm": -1.0, "time_s": 0.0, "rms_interval": 0.0, "time_interval": 0.0}})


def test_it_is_said_in_a_clause() -> None:
    said = process_lines(TorquePath(DriveLaw(1.0), process=ProcessTorque(8.0e-3, 4.2e-3, 1e-4, 2e-4)))
    assert said == ["process torque of 8.0 ± 0.1 mN m rms, correlation time 4.2 ± 0.2 ms"]
    assert process_lines(TorquePath(DriveLaw(1.0), process=ProcessTorque(1e-4, 4e-3, 2e-4, 2e-3))) == []
