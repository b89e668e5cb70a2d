"""Sinusoidal excitations: the chirp, and the random-phase multisine on odd lines, some of them left out."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
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


#: Odd lines of which one, chosen by chance, is left out for detection.
GROUP = 4
#: Sets of random phases of which the one with the smallest crest factor is taken.
TRIALS = 64


def multisine(
    period_samples: int,
    lowest_hz: float,
    highest_hz: float,
    amplitude_nm: float,
    sample_period_s: float,
    repeats: int,
    *,
    seed: int,
    detection: bool = True,
    torque_step_nm: float = 0.0,
) -> Excitation:
    """Sum of sines with equal amplitudes and random phases, the calmest of :data:`TRIALS` sets, on odd lines of the period.

    u[n] = a Σ_k cos(2π k n/N + φ_k),   k odd;  of every :data:`GROUP` odd lines one is left out

    A torque that acts like -u backwards answers on odd lines (friction, cubic stiffness), one that acts alike on even ones (backlash to
    one side, asymmetry): both kinds show on lines that are not excited, apart from each other and from noise.

    Parameters
    ----------
    period_samples : int
        N, samples of a period.
    lowest_hz : float, Hz
        Lowest excited line.
    highest_hz : float, Hz
        Highest excited line.
    amplitude_nm : float
        Largest torque, N m, motor shaft.
    sample_period_s : float
        T, s.
    repeats : int
        Measured periods.
    seed : int
        Of the phases and the lines left out.
    detection : bool
        False excites every line of the band.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none.

    Returns
    -------
    Excitation
        N m at the motor shaft, (n,), with rest and run-in.

    Raises
    ------
    UsageError
        For values that are no multisine.

    References
    ----------
    Pintelon, Schoukens, System Identification (2012), sections 4.3 and 5.2.
    """
    if not (sample_period_s > 0 and amplitude_nm > 0):
        raise UsageError(f"amplitude {amplitude_nm} N m, sample period {sample_period_s} s: both must be positive")
    line_hz = 1.0 / (period_samples * sample_period_s)
    low, high = max(1, int(np.ceil(lowest_hz / line_hz - 1e-9))), int(np.floor(highest_hz / line_hz + 1e-9))
    if not 0.0 < lowest_hz < highest_hz < 0.5 / sample_period_s or high - low < 2 * GROUP:
        raise UsageError(
            f"a multisine from {lowest_hz:.4g} to {highest_hz:.4g} Hz with lines every {line_hz:.4g} Hz has {max(0, high - low + 1)} lines "
            f"below {0.5 / sample_period_s:.4g} Hz; it needs more than {2 * GROUP}: lengthen the period or widen the band"
        )
    rng = np.random.default_rng(seed)
    within = np.arange(low, high + 1)
    excited = within[within % 2 == 1] if detection else within
    if detection:
        groups = [excited[i : i + GROUP] for i in range(0, len(excited), GROUP)]
        excited = np.concatenate([np.delete(g, rng.integers(len(g))) if len(g) == GROUP else g for g in groups])
    period = min((_sum(period_samples, excited, rng) for _ in range(TRIALS)), key=lambda p: float(np.max(np.abs(p))))
    return finish(
        "multisine",
        amplitude_nm / float(np.max(np.abs(period))) * period,
        repeats,
        sample_period_s,
        (lowest_hz, highest_hz),
        {"amplitude_nm": amplitude_nm, "seed": seed},
        torque_step_nm=torque_step_nm,
        lines=tuple(int(k) for k in excited),
    )


def _sum(samples: int, lines: NDArray[np.intp], rng: np.random.Generator) -> Array:
    spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    return np.asarray(np.fft.irfft(spectrum, samples))
