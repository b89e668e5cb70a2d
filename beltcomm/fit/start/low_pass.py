"""Low-pass for an angle whose second derivative shall be motion and not the rounding of the encoder.

Torque and angle behind one Gaussian low-pass obey the same linear equation of motion, so the filter biases nothing but the friction's
reversals, over its own width.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

from beltcomm.arrays import Array

TAU = math.tau

#: Cut-off: highest, of the sampling rate, lowest, Hz, and how many are tried; share of the acceleration that its rounding may be.
HIGHEST_CUT, LOWEST_CUT_HZ, CUTS, ROUNDING_SHARE = 0.2, 0.2, 25, 0.1
#: Widths of the filter within which it reaches.
REACH = 4.0


def _widths(sample_s: float) -> Array:
    """Standard deviations of the Gaussian that are tried, in samples, rising."""
    return 1.0 / (TAU * sample_s * np.geomspace(HIGHEST_CUT / sample_s, LOWEST_CUT_HZ, CUTS))


def smooth(values: Array, width: float) -> Array:
    """A signal behind the low-pass, (n,); its ends go on straight.

    Parameters
    ----------
    values : ndarray, (n,)
        Any unit.
    width : float
        Standard deviation of the Gaussian, samples.

    Returns
    -------
    ndarray, (n,)
        In their unit.
    """
    slope = np.linspace(values[0], values[-1], len(values))
    return np.asarray(gaussian_filter1d(values - slope, width, mode="nearest") + slope)


def legible(position: Array, sample_s: float, step: float, share: float = ROUNDING_SHARE) -> tuple[float, Array]:
    """The narrowest low-pass at which the rounding of the acceleration, σ² = q²/12 2 T (2π)⁴ f⁵/5, is a small share of it.

    Parameters
    ----------
    position : ndarray, (n,), rad
        As it was read.
    sample_s : float, s
        T.
    step : float, rad
        q, step of the encoder.
    share : float
        Of the acceleration.

    Returns
    -------
    tuple of float and ndarray (n,)
        Width in samples, and the smooth angle, rad.
    """
    for width in _widths(sample_s):
        angle = smooth(position, width)
        cut_hz = 1.0 / (TAU * width * sample_s)
        rounding = step / math.sqrt(12.0) * math.sqrt(2.0 * sample_s * TAU**4 * cut_hz**5 / 5.0)
        if rounding < share * float(np.std(np.gradient(np.gradient(angle, sample_s), sample_s))):
            break
    return float(width), angle


def fine(position: Array, step: float) -> bool:
    """True if the angle needs no smoothing: the rounding of its second differences, σ² = q²/2, is less than a tenth of them.

    Parameters
    ----------
    position : ndarray, (n,), rad
        As it was read.
    step : float, rad
        q, step of the encoder.
    """
    return step * math.sqrt(0.5) < ROUNDING_SHARE * float(np.std(np.diff(position, 2)))
