"""Random-phase multisine on odd lines, some left out: what the axis answers on lines that were not asked for is its nonlinearity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.errors import UsageError
from beltcomm.excitation.record import Excitation, finish

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


def detection_lines(excitation: Excitation) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Odd and even lines between the excited ones, which are not excited themselves; both empty where all are.

    Parameters
    ----------
    excitation : Excitation
        Of a multisine.

    Returns
    -------
    tuple of ndarray of int
        Odd and even lines, as indices.
    """
    lines = np.array(excitation.lines, dtype=np.intp)
    if len(lines) == 0 or np.any(lines % 2 == 0):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    silent = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    return silent[silent % 2 == 1], silent[silent % 2 == 0]


def _sum(samples: int, lines: NDArray[np.intp], rng: np.random.Generator) -> Array:
    spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    return np.asarray(np.fft.irfft(spectrum, samples))
