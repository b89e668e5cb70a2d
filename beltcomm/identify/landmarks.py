"""Antiresonance and resonance of one measured response, with intervals, whatever friction makes of it elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from beltcomm.errors import DataError
from beltcomm.response import FrequencyResponse

Array = NDArray[np.float64]

#: Band of the fit over the antiresonance expected and the resonance expected; how far either may be from what is expected.
BELOW, ABOVE, FARTHEST = 0.5, 1.5, 1.7
#: Lines with noise above this share of the response say nothing; as many as this are needed.
LARGEST_NOISE, FEWEST_LINES = 0.3, 16
#: An interval larger than this share of its frequency says that there is nothing to see.
LOST = 0.25
#: Damping ratios beyond this are no resonance.
MOST_DAMPING = 1.0


@dataclass(frozen=True)
class Landmark:
    """A frequency, Hz, with the half width of its 95 % interval, and its damping ratio."""

    freq_hz: float
    interval_hz: float
    damping: float


@dataclass(frozen=True)
class Landmarks:
    """Of one response.   None where it cannot be told.   scatter : of the lines about the fit, relative, standard deviation."""

    antiresonance: Landmark | None
    resonance: Landmark | None
    scatter: float


def find_landmarks(response: FrequencyResponse, antiresonance_hz: float, resonance_hz: float) -> Landmarks:
    """Fit  ω^n a (f_z² - f² + 2j ζ_z f_z f)/(f_r² - f² + 2j ζ_r f_r f)  to log h, every line with the same weight.

    a complex and n real take up the rigid part, whose damping friction decides.  Friction's wrong lines scatter about the fit and widen the
    intervals (linearised, variance J*/(n - p)); a bias that all lines share they do not hold.

    antiresonance_hz, resonance_hz : expected, Hz.   Raises DataError when too few lines lie around them.     Source: (2.42), 3.5.
    """
    if not antiresonance_hz < resonance_hz:
        raise DataError(f"the model's antiresonance, {antiresonance_hz:.3g} Hz, is not below its resonance, {resonance_hz:.3g} Hz")
    band = (response.freq_hz >= BELOW * antiresonance_hz) & (response.freq_hz <= ABOVE * resonance_hz)
    band &= (response.noise <= LARGEST_NOISE * np.abs(response.h)) & (np.abs(response.h) > 0.0)
    count = int(np.sum(band))
    if count < FEWEST_LINES:
        raise DataError(
            f"{count} clear lines lie between {BELOW * antiresonance_hz:.3g} and {ABOVE * resonance_hz:.3g} Hz, {FEWEST_LINES} are needed; "
            "raise the amplitude or lengthen the period"
        )
    freq = response.freq_hz[band]
    h = response.h[band] * np.exp(1j * np.pi * freq * response.sample_period_s)  # a torque held for a period acts half of it later
    middle = math.sqrt(freq[0] * freq[-1])

    def flexible(x: Array) -> NDArray[np.complex128]:
        (f_z, f_r), (d_z, d_r) = np.exp(x[:2]), x[2:4]
        return np.asarray((f_z**2 - freq**2 + 2j * d_z * f_z * freq) / (f_r**2 - freq**2 + 2j * d_r * f_r * freq))

    def residual(x: Array) -> Array:
        left = h / (flexible(x) * np.exp(x[4] + 1j * x[5]) * (freq / middle) ** x[6])
        return np.concatenate([np.log(np.abs(left)), np.angle(left)])

    start = np.array([math.log(antiresonance_hz), math.log(resonance_hz), 0.1, 0.1, 0.0, 0.0, -2.0])
    rest = h / flexible(start) * (freq / middle) ** 2
    start[4], start[5] = np.median(np.log(np.abs(rest))), np.angle(np.mean(rest / np.abs(rest)))
    wide = math.log(FARTHEST)
    low = np.array([start[0] - wide, start[1] - wide, 1e-4, 1e-4, -np.inf, -np.inf, -6.0])
    high = np.array([start[0] + wide, start[1] + wide, MOST_DAMPING, MOST_DAMPING, np.inf, np.inf, 2.0])
    found = least_squares(residual, start, bounds=(low, high), loss="soft_l1", f_scale=0.3)
    freedom = 2 * count - len(start)
    variance = float(np.sum(residual(found.x) ** 2)) / freedom
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    half = float(stdtrit(freedom, 0.975)) * np.sqrt(np.diag(covariance))

    def landmark(i: int) -> Landmark | None:
        at_bound = min(found.x[i] - low[i], high[i] - found.x[i]) < 1e-3 or found.x[2 + i] > 0.99 * MOST_DAMPING
        value = math.exp(found.x[i])
        return None if at_bound or half[i] > LOST else Landmark(value, float(value * half[i]), float(found.x[2 + i]))

    return Landmarks(landmark(0), landmark(1), math.sqrt(variance))
