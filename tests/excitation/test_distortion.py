"""Distortion of a simulated axis: none where it is linear, odd where it rubs; noise is told apart from both."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.excitation import multisine, prbs
from beltcomm.response.distortion import distortion
from truth import Axis, ConstantBelt, TruthPlant

T_S, INERTIA, MASS, LEVER = 1e-3, 71.73e-6, 2.0, 0.01242
NOISE_RAD = 2e-6


def record(coulomb_nm: float, noise_rad: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Torque and angle of an axis under a multisine, with white noise of the angle."""
    made = multisine(1000, 3.0, 300.0, 0.6, T_S, 7, seed=2)
    plant = TruthPlant(Axis(INERTIA, MASS, LEVER, ConstantBelt(2e5, 60.0), coulomb_motor_nm=coulomb_nm, viscous_motor_nm_s_rad=2e-3))
    angle = []
    for value in made.torque.tolist():
        angle.append(plant.position_rad)
        plant.step(value, T_S)
    noise = noise_rad * np.random.default_rng(seed).normal(size=len(angle))
    return made.torque, np.array(angle) + noise, made.period_samples, made.first_sample + made.period_samples  # run in for two


def test_a_linear_axis_shows_nothing_but_noise() -> None:
    torque, angle, period, first = record(0.0, NOISE_RAD)
    found = distortion(torque, angle, T_S, period, first)
    for silent in (found.odd, found.even):
        # |mean|²/noise² is an F(2, 10) variable: its mean is 10/8, and of the level, noise taken off, less than that.
        assert np.mean((silent.level / silent.noise) ** 2) < 1.25
    # White noise of the angle is noise of the speed with √2 |sin(ωT/2)|·2/T … : its size is known in closed form.
    factor = 2.0 * np.sin(np.pi * found.odd.freq_hz * T_S)
    typical = np.sqrt(np.mean(np.abs(np.fft.rfft(torque[first : first + period])[np.rint(found.freq_hz * period * T_S).astype(int)]) ** 2))
    expected = NOISE_RAD * factor * np.sqrt(period / 6) / typical
    assert np.mean(found.odd.noise / expected) == pytest.approx(1.0, abs=0.1)


def test_friction_is_an_odd_nonlinearity() -> None:
    torque, angle, period, first = record(0.08, NOISE_RAD)
    found = distortion(torque, angle, T_S, period, first)
    odd, even = (s.rms(5.0, 60.0) for s in (found.odd, found.even))
    assert odd > 5.0 * even
    assert odd > 5.0 * float(np.median(found.odd.noise))


def test_a_binary_sequence_separates_nothing() -> None:
    made = prbs(9, 2, 0.6, T_S, 3)
    with pytest.raises(DataError, match="--excitation multisine"):
        distortion(made.torque, np.cumsum(np.cumsum(made.torque)), T_S, made.period_samples, made.first_sample)
