"""Answer of an axis on lines that a multisine leaves out, nonlinearity by kind, apart from noise; the scatter of neighbouring lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, rms
from beltcomm.errors import DataError
from beltcomm.response import LEAST_EXCITATION, FrequencyResponse, period_spectra

#: Lines over which a response is smooth, and unknowns of the parabola through them.
WINDOW, UNKNOWNS = 7, 3


@dataclass(frozen=True, eq=False)
class Silent:
    """Answer on silent lines of one kind.

    Attributes
    ----------
    freq_hz : ndarray (k,), Hz
    level : ndarray (k,)
        |speed| over the torque of an excited line, rad/s/(N m), noise taken off.
    noise : ndarray
        The same of the noise, standard deviation of the mean over the periods.
    """

    freq_hz: Array
    level: Array
    noise: Array

    def rms(self, low_hz: float, high_hz: float) -> float:
        """Root mean square of the level within a band; nan without lines there.

        Parameters
        ----------
        low_hz, high_hz : float, Hz
            Ends of the band; lines upon them count.

        Returns
        -------
        float
            rad/s/(N m).
        """
        here = (self.freq_hz >= low_hz) & (self.freq_hz <= high_hz)
        return rms(self.level[here]) if here.any() else float("nan")


@dataclass(frozen=True, eq=False)
class Distortion:
    """Linear answer on the excited lines, and what the silent ones show.

    Attributes
    ----------
    freq_hz, speed : ndarray (k,), Hz
        |G_ω| in rad/s/(N m).
    noise : ndarray
        Of it.
    odd, even : Silent
        Silent lines.
    """

    freq_hz: Array
    speed: Array
    noise: Array
    odd: Silent
    even: Silent


def distortion(
    torque: Array, position: Array, sample_period_s: float, period_samples: int, first_sample: int, *, t_s: Array | None = None
) -> Distortion:
    """Split the answer to a multisine on odd lines into linear part, odd and even nonlinearity, and noise.

    On a silent line k:  ŵ_k - G_k û_k,  G_k between its excited neighbours, û_k what rounding of the setpoint leaves there;
    |level|² = |mean|² - noise²,  not below 0;  noise² = scatter between the periods over their number.

    Arguments as for :func:`beltcomm.response.estimate_response`.

    Parameters
    ----------
    torque, position : ndarray, (n,)
        N m at the motor shaft and rad.
    sample_period_s : float, s
    period_samples, first_sample : int
        Samples of a period, and where the first begins.
    t_s : ndarray (n,) or None, s
        Time stamps, where samples are missing.

    Returns
    -------
    Distortion
        By line up to half the sampling rate.

    Raises
    ------
    DataError
        As it does, and where even lines are excited.

    References
    ----------
    Pintelon, Schoukens, System Identification (2012), section 4.3.
    """
    freq_hz, u, w, _ = period_spectra(torque, position, sample_period_s, period_samples, first_sample, t_s=t_s)
    u_mean, w_mean = u.mean(axis=0), w.mean(axis=0)
    strength = np.abs(u_mean)
    excited = strength >= LEAST_EXCITATION * strength.max()
    number = np.arange(1, len(freq_hz) + 1)
    if np.any(excited & (number % 2 == 0)):
        raise DataError(
            f"{int(np.sum(excited & (number % 2 == 0)))} even lines are excited; only a multisine on odd lines separates nonlinearity from "
            "noise: record with --excitation multisine"
        )
    typical = rms(strength[excited])
    linear = w_mean[excited] / u_mean[excited]
    where = number[excited].astype(np.float64)
    between = np.interp(number, where, linear.real) + 1j * np.interp(number, where, linear.imag)
    left = w - between * u
    mean = left.mean(axis=0)
    noise = np.sqrt(np.sum(np.abs(left - mean) ** 2, axis=0) / (len(u) - 1) / len(u))
    inside = ~excited & (number > where[0]) & (number < where[-1])

    def silent(parity: int) -> Silent:
        here = inside & (number % 2 == parity)
        level = np.sqrt(np.maximum(np.abs(mean[here]) ** 2 - noise[here] ** 2, 0.0))
        return Silent(freq_hz[here], level / typical, noise[here] / typical)

    return Distortion(freq_hz[excited], np.abs(linear), noise[excited] / strength[excited], silent(1), silent(0))


def line_scatter(response: FrequencyResponse) -> Array:
    """Scatter of a response about what the neighbours of a line vouch for: noise and what repeats with it.

    A parabola through ω² h of ``WINDOW`` lines leaves e:  s² = Σ|e|²/(7 - 3)

    Friction answers a periodic excitation with the same wrong lines in every period: scatter between periods does not see that, scatter
    between lines does.  Where the response bends within the window, at a sharp resonance, it is too large.

    Parameters
    ----------
    response : FrequencyResponse
        With even lines.

    Returns
    -------
    ndarray, (k,)
        Standard deviation of h, rad/(N m); 0 with fewer than ``WINDOW`` lines.

    References
    ----------
    Local polynomial method: Pintelon, Schoukens, System Identification (2012), section 7.2.
    """
    if len(response.freq_hz) < WINDOW:
        return np.zeros(len(response.freq_hz))
    places = np.arange(WINDOW) - WINDOW // 2
    powers = np.vander(places.astype(np.float64), UNKNOWNS)
    left = np.eye(WINDOW) - powers @ np.linalg.pinv(powers)
    windows = np.lib.stride_tricks.sliding_window_view(response.h * response.freq_hz**2, WINDOW)
    deviation = np.sqrt(np.sum(np.abs(windows @ left) ** 2, axis=1) / (WINDOW - UNKNOWNS))
    return np.asarray(np.pad(deviation, WINDOW // 2, mode="edge") / response.freq_hz**2)
