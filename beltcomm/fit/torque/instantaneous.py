"""A torque that changes all the time between its samples: the trace of a drive whose loops are faster than the record.

The reading is the torque at an instant.  Between the samples it is a cubic spline, y(t) = Σ c[k] B₃(t/T - k), as the angle is
(``noise.propagation``), and reaches the residual with the triangular mean over two periods:

    Σ c[k] B₅(n - k):   b(z)/a(z) = (z² + 26 z + 66 + 26 z⁻¹ + z⁻²)/120 / ((z + 4 + z⁻¹)/6)

Source: Unser, Splines, IEEE Signal Processing Magazine 16 (1999).
"""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.fit.noise.colour import NoiseColour

#: Zeros inside the unit circle of the splines of fifth and third order at the samples, twice in place of those outside.
_FIFTH, _THIRD = 2 * (-0.430575347099973, -0.0430962882032647), 2 * (-0.267949192431123,)


def spline_cells(torque: Array, late: float, cells: int) -> Array:
    """Mean over each cell of every period of a torque that was read at instants.

    Parameters
    ----------
    torque : ndarray (n,), N m
        Readings.
    late : float, sampling periods
        By which they are late; negative for early ones.
    cells : int
        Of each period.

    Returns
    -------
    ndarray (n, cells), N m
        Its first and last readings before and behind them.
    """
    from scipy.interpolate import CubicSpline  # takes a second to import, and most torques are held

    n = len(torque)
    if n == 1:
        return np.full((1, cells), torque[0])
    whole = CubicSpline(np.arange(n), torque).antiderivative()
    edges = np.arange(n * cells + 1) / cells + late
    inside = np.clip(edges, 0.0, n - 1.0)
    area = whole(inside) + (edges - inside) * np.where(edges < 0.0, torque[0], torque[-1])
    return np.asarray(np.diff(area).reshape(n, cells) * cells)


def spline_noise(pole: float) -> NoiseColour:
    """Colour in the residual of the noise of such readings; as of readings that are not late, for less than half a sample changes little.

    Parameters
    ----------
    pole : float
        Of the readings' noise, of variance 1.
    """
    numerator, denominator = np.poly(_FIFTH), np.poly((*_THIRD, *((pole,) if pole else ())))
    gain = np.sum(np.poly(_THIRD)) / np.sum(numerator)  # a steady torque is read as it is
    return NoiseColour(pole, tuple(map(float, numerator * gain * np.sqrt(1.0 - pole**2))), tuple(map(float, denominator)))
