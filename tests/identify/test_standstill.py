"""The describing function of Coulomb friction against a Fourier integral and against an own simulation of a mass that is shaken."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from beltcomm.errors import DataError
from beltcomm.identify.standstill import _friction_as_damping, _sine_amplitude

LEVEL = 0.125
TIME = np.linspace(0.0, 2.0 * math.pi, 20001)[:-1]


@pytest.mark.parametrize("amplitude", [0.3, 4.0, 50.0])
def test_of_a_sine_it_is_the_fundamental_of_the_square_wave(amplitude: float) -> None:
    """b_1/Ω with b_1 = (1/π) ∫ M sign(Ω sin θ) sin θ dθ over a period."""
    fundamental = quad(lambda theta: LEVEL * math.copysign(1.0, math.sin(theta)) * math.sin(theta), 0.0, 2.0 * math.pi, points=[math.pi])[0]
    assert _friction_as_damping(LEVEL, amplitude) == pytest.approx(fundamental / math.pi / amplitude, rel=1e-9)
    assert _sine_amplitude(amplitude * np.sin(TIME)) == pytest.approx(amplitude, rel=1e-6)


def test_of_any_other_motion_it_is_the_gain_nearest_in_the_mean_square() -> None:
    """Argmin over d of E (M sign ω - d ω)² on a grid, for a triangle; √(2/π) M/σ for Gaussian noise (Bussgang), to 0.5 %."""
    triangle = np.abs(TIME / math.pi - 1.0) * 8.0 - 4.0
    grid = np.linspace(0.0, 0.2, 20001)
    square, product = float(np.mean(triangle**2)), LEVEL * float(np.mean(np.abs(triangle)))
    best = grid[np.argmin(grid**2 * square - 2.0 * grid * product)]
    assert _friction_as_damping(LEVEL, _sine_amplitude(triangle)) == pytest.approx(best, abs=2e-5)
    noise = 3.0 * np.random.default_rng(1).normal(size=200_000)
    assert _friction_as_damping(LEVEL, _sine_amplitude(noise)) == pytest.approx(math.sqrt(2.0 / math.pi) * LEVEL / 3.0, rel=5e-3)


def test_a_shaken_mass_shows_it_as_damping() -> None:
    """Rigid G_A under a sine of torque three to ten times its friction, stepped here: Re of torque over speed at that frequency.

    The motion is no pure sine, because friction is none; the gain nearest in the mean square is that of the fundamental to 5 %."""
    inertia, viscous, step, omega = 0.002145, 2.53e-3, 1e-5, 2.0 * math.pi * 5.0
    count = round(2.0 * math.pi / omega / step)
    for torque in (3.0 * LEVEL, 10.0 * LEVEL):
        speed, speeds = 0.0, np.empty(6 * count)
        phases = omega * step * np.arange(6 * count)
        for k, push in enumerate((torque * np.sin(phases)).tolist()):
            free = speed + step * (push - viscous * speed) / inertia
            speed = math.copysign(max(abs(free) - step * LEVEL / inertia, 0.0), free)
            speeds[k] = speed
        last, turn = speeds[-count:], np.exp(-1j * phases[-count:])
        impedance = (torque * np.sin(phases[-count:]) @ turn) / (last @ turn)
        assert impedance.real == pytest.approx(viscous + _friction_as_damping(LEVEL, _sine_amplitude(last - last.mean())), rel=0.05)


def test_where_nothing_moves_there_is_no_gain() -> None:
    with pytest.raises(DataError, match="nothing moves"):
        _sine_amplitude(np.zeros(100))
