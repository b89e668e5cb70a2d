"""Chirp: a sine whose frequency rises, faded in and out by a trapezoid."""

from __future__ import annotations

from typing import Literal

import numpy as np

from beltcomm.errors import UsageError
from beltcomm.excitation.record import Excitation, finish

#: Share of a period over which the trapezoid rises, and falls.
FADE = 0.05


def chirp(
    period_samples: int,
    lowest_hz: float,
    highest_hz: float,
    amplitude_nm: float,
    sample_period_s: float,
    repeats: int,
    *,
    spacing: Literal["logarithmic", "linear"] = "logarithmic",
    fade: float = FADE,
    torque_step_nm: float = 0.0,
) -> Excitation:
    """Sine from the lowest to the highest frequency under a trapezoidal window, repeated.

    u(t) = A w(t/t_1) sin φ(t), less its mean,   φ' = 2π f_1 (f_2/f_1)^(t/t_1)  (logarithmic)  or  2π (f_1 + (f_2 - f_1) t/t_1)  (linear)

    w rises from 0 to 1 over the share ``fade`` of the period t_1, and falls so at its end.   It is begun within the period where the
    carriage then stays about its place (:func:`beltcomm.excitation.record.finish`).

    Parameters
    ----------
    period_samples : int
        Samples of a period.
    lowest_hz : float
        f_1, Hz.
    highest_hz : float
        f_2, Hz.
    amplitude_nm : float
        Largest torque, N m, motor shaft.
    sample_period_s : float, s
        Sampling period.
    repeats : int
        Measured periods.
    spacing : {'logarithmic', 'linear'}
        Of the frequencies over time.
    fade : float
        Share of the period in which the window rises, and falls.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none.

    Returns
    -------
    Excitation
        N m at the motor shaft, (n,), with rest and run-in.

    Raises
    ------
    UsageError
        For values that are no chirp.

    References
    ----------
    Thesis 3.1.
    """
    period_s = period_samples * sample_period_s
    if not (sample_period_s > 0 and amplitude_nm > 0 and 0.0 <= fade <= 0.5):
        raise UsageError(
            f"amplitude {amplitude_nm} N m, sample period {sample_period_s} s, fade {fade}: the first two must be positive, the last "
            "between 0 and 0.5"
        )
    if not 1.0 / period_s <= lowest_hz < highest_hz < 0.5 / sample_period_s:
        raise UsageError(
            f"a chirp from {lowest_hz:.4g} to {highest_hz:.4g} Hz does not fit: it must lie between {1.0 / period_s:.4g} Hz, one period, "
            f"and {0.5 / sample_period_s:.4g} Hz, half the sampling frequency"
        )
    t_s = sample_period_s * (np.arange(period_samples) + 0.5)  # a held torque stands for the middle of its sample
    window = np.interp(t_s / period_s, (0.0, fade, 1.0 - fade, 1.0), (0.0, 1.0, 1.0, 0.0)) if fade else np.ones(period_samples)
    from scipy.signal import chirp  # takes longer to import than a page of a report to draw

    sine = np.asarray(chirp(t_s, lowest_hz, period_s, highest_hz, method=spacing, phi=-90.0))
    period = window * sine - np.mean(window * sine)
    return finish(
        "chirp",
        amplitude_nm / float(np.max(np.abs(period))) * period,
        repeats,
        sample_period_s,
        (lowest_hz, highest_hz),
        {"amplitude_nm": amplitude_nm, "fade": fade},
        torque_step_nm=torque_step_nm,
    )
