"""Deviation of the discrete parts of the cascade from the continuous ones they stand for, with bounds in closed form.

With θ = ωT and s = jω, for 0 < θ < π:

- velocity filter (6.1) by backward differences: s becomes σ = (1 − z⁻¹)/T, and with Re σ ≥ 0
  |G_d/G_c − 1| = |σ/s − 1|/|1 + σ T_R| ≤ θ/2;
- PI with the forward-Euler integrator (6.25):  PI_d − PI_c = K_I T (−1/2 + j (1/θ − cot(θ/2)/2)), whose second term lies below θ/π²;
- prefilter, prewarped bilinear transform: G_d(ω) = G_c(ω'),  ω' = ω_0 tan(θ/2)/tan(ω_0 T/2), hence |ln(G_d/G_c)| ≤ Λ |ln(ω'/ω)| with
  Λ the largest |d ln G_c/d ln ω| between ω and ω', in closed form by :func:`steepest`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.control import Prefilter
from beltcomm.errors import UsageError

Array = NDArray[np.float64]


def velocity_filter_bound(omega_rad_s: Array, period_s: float) -> Array:
    """Bound of |G_d/G_c − 1| of the velocity filter, for any T_R: ωT/2.

    Parameters
    ----------
    omega_rad_s : ndarray (n,)
        Up to π/T.

    Returns
    -------
    ndarray (n,)
    """
    return np.asarray(0.5 * _theta(omega_rad_s, period_s))


def pi_bound(omega_rad_s: Array, kp_nm_s_rad: float, ki_nm_rad: float, period_s: float) -> Array:
    """Bound of |PI_d/PI_c − 1|:  K_I T √(1/4 + (θ/π²)²)/√(K_P² + K_I²/ω²).

    Parameters
    ----------
    omega_rad_s : ndarray (n,)
        Up to π/T.

    Returns
    -------
    ndarray (n,)
    """
    theta = _theta(omega_rad_s, period_s)
    difference = ki_nm_rad * period_s * np.hypot(0.5, theta / math.pi**2)
    return np.asarray(difference / np.hypot(kp_nm_s_rad, ki_nm_rad / omega_rad_s))


def prefilter_bound(omega_rad_s: Array, prefilter: Prefilter, period_s: float) -> Array:
    """Bound of |G_d/G_c − 1| of a prefilter:  exp(Λ |ln(ω'/ω)|) − 1; 0 at its own frequency.

    Parameters
    ----------
    omega_rad_s : ndarray (n,)
        Up to π/T.

    Returns
    -------
    ndarray (n,)

    Raises
    ------
    UsageError
        For a frequency beyond π/T.
    """
    if prefilter.roll_off_rad_s > 0.0:
        parts = (replace(prefilter, roll_off_rad_s=0.0), Prefilter("butterworth", prefilter.roll_off_rad_s))
        return np.asarray(np.prod([1.0 + prefilter_bound(omega_rad_s, part, period_s) for part in parts], axis=0) - 1.0)
    if prefilter.kind == "none":
        return np.zeros_like(omega_rad_s)
    moved = warped_frequency(omega_rad_s, prefilter, period_s)
    slope = steepest(prefilter, np.minimum(omega_rad_s, moved), np.maximum(omega_rad_s, moved))
    return np.asarray(np.expm1(slope * np.abs(np.log(moved / omega_rad_s))))


def warped_frequency(omega_rad_s: Array, prefilter: Prefilter, period_s: float) -> Array:
    """ω', where the continuous prefilter has the value that the discrete one has at ω, rad/s.

    Parameters
    ----------
    omega_rad_s : ndarray (n,)
        Up to π/T.
    """
    omega_0 = prefilter.omega_rad_s
    _theta(np.array([omega_0]), period_s)
    return np.asarray(omega_0 * np.tan(0.5 * _theta(omega_rad_s, period_s)) / math.tan(0.5 * omega_0 * period_s))


def steepest(prefilter: Prefilter, low_rad_s: Array, high_rad_s: Array) -> Array:
    """Λ: bound of |d ln G_c/d ln ω| between two frequencies each, (n,), rad/s; (n,).

    With y = (ω/ω_0)² its square is, for (4.3), (2y + 4y²)/(1 + y²), which rises up to y = 2 + √5 and falls from there.   For (4.1)
    numerator (ε = 1/d_n²) and denominator (ε = d_n²) count apart, each with the square (4y² + 4εy)/((1 − y)² + 4εy), which rises up to
    y = (1 + √((1 − ε)(1 + 3ε)))/(2 − 3ε) for ε < 2/3, and for ever otherwise.   The largest value is at that y, or at the nearer end.
    """
    low, high = (np.square(omega / prefilter.omega_rad_s) for omega in (low_rad_s, high_rad_s))
    if prefilter.kind == "butterworth":
        y = np.clip(2.0 + math.sqrt(5.0), low, high)
        return np.asarray(np.sqrt((2.0 * y + 4.0 * y * y) / (1.0 + y * y)))
    return _steepest_quadratic(prefilter.d_n**-2, low, high) + _steepest_quadratic(prefilter.d_n**2, low, high)


def _steepest_quadratic(epsilon: float, low: Array, high: Array) -> Array:
    top = math.inf
    if epsilon < 2.0 / 3.0:
        top = (1.0 + math.sqrt((1.0 - epsilon) * (1.0 + 3.0 * epsilon))) / (2.0 - 3.0 * epsilon)
    y = np.clip(top, low, high)
    return np.asarray(np.sqrt((4.0 * y * y + 4.0 * epsilon * y) / ((1.0 - y) ** 2 + 4.0 * epsilon * y)))


def _theta(omega_rad_s: Array, period_s: float) -> Array:
    theta = np.asarray(omega_rad_s * period_s)
    if not np.all((theta > 0.0) & (theta < math.pi)):
        raise UsageError(
            f"a loop of {period_s:g} s knows frequencies above 0 and below {math.pi / period_s:.6g} rad/s only; choose one there"
        )
    return theta
