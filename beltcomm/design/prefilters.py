"""Prefilters of the velocity error, laid out so that they leave the plant below its antiresonance alone (4.2), (4.4)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import Prefilter
from beltcomm.errors import UsageError


def notch_width(resonance_rad_s: float, antiresonance_rad_s: float, attenuation_db: float) -> float:
    """d_n of the notch (4.1), centred at the resonance, that attenuates the antiresonance by ``attenuation_db`` (4.2).

    With x = ω_z/ω_r and a = 10^(attenuation_db/20):  ((1 − x²)² + 4 x²/d_n²) = a² ((1 − x²)² + 4 d_n² x²), solved for d_n².

    Parameters
    ----------
    resonance_rad_s : float, rad/s
        ω_r.
    antiresonance_rad_s : float, rad/s
        ω_z.
    attenuation_db : float, dB
        Below 0, such as −6.

    Returns
    -------
    float
        d_n > 1.

    Raises
    ------
    UsageError
        For other frequencies or attenuations.
    """
    _check(resonance_rad_s, antiresonance_rad_s, attenuation_db)
    gain_squared = 10.0 ** (attenuation_db / 10.0)
    x_squared = (antiresonance_rad_s / resonance_rad_s) ** 2
    # a² 4x² D² − (1 − a²)(1 − x²)² D − 4x² = 0 with D = d_n²; one positive root.
    a, b, c = 4.0 * gain_squared * x_squared, (1.0 - gain_squared) * (1.0 - x_squared) ** 2, 4.0 * x_squared
    return math.sqrt((b + math.sqrt(b * b + 4.0 * a * c)) / (2.0 * a))


def butterworth_cutoff_rad_s(antiresonance_rad_s: float, attenuation_db: float) -> float:
    """ω_bw of the low-pass (4.3) that attenuates the antiresonance so much (4.4).

    |G_bw(jω)|² = 1/(1 + (ω/ω_bw)⁴), hence ω_bw = ω_z (10^(−attenuation_db/10) − 1)^(−1/4).

    Parameters
    ----------
    antiresonance_rad_s : float, rad/s
        ω_z.
    attenuation_db : float, dB
        Below 0.

    Returns
    -------
    float, rad/s
        ω_bw.
    """
    _check(math.inf, antiresonance_rad_s, attenuation_db)
    return antiresonance_rad_s / math.sqrt(math.sqrt(10.0 ** (-attenuation_db / 10.0) - 1.0))


def continuous_prefilter(omega_rad_s: Array, prefilter: Prefilter) -> ComplexArray:
    """Frequency response of (4.1) or (4.3) as printed, s = jω, times that of the additional low-pass.

    Parameters
    ----------
    omega_rad_s : ndarray
        Any shape.
    prefilter : Prefilter
        Of any kind.

    Returns
    -------
    ndarray of complex
        1 for no prefilter.
    """
    if prefilter.roll_off_rad_s > 0.0:
        low_pass = Prefilter("butterworth", prefilter.roll_off_rad_s)
        bare = replace(prefilter, roll_off_rad_s=0.0)
        return np.asarray(continuous_prefilter(omega_rad_s, bare) * continuous_prefilter(omega_rad_s, low_pass))
    s = 1j * omega_rad_s
    omega_0 = prefilter.omega_rad_s
    if prefilter.kind == "notch":
        damping = 2.0 * omega_0 * s
        return np.asarray((s * s + damping / prefilter.d_n + omega_0**2) / (s * s + damping * prefilter.d_n + omega_0**2))
    if prefilter.kind == "butterworth":
        return np.asarray(1.0 / ((s / omega_0) ** 2 + math.sqrt(2.0) * s / omega_0 + 1.0))
    return np.ones_like(s)


def _check(resonance_rad_s: float, antiresonance_rad_s: float, attenuation_db: float) -> None:
    if not 0.0 < antiresonance_rad_s < resonance_rad_s:
        raise UsageError(
            f"the antiresonance at {antiresonance_rad_s:.6g} rad/s must lie above 0 and below the resonance at {resonance_rad_s:.6g} rad/s"
        )
    if not attenuation_db < 0.0:
        raise UsageError(f"the prefilter's attenuation at the antiresonance is {attenuation_db} dB; give a negative number")
