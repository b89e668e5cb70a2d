"""Generalised pseudorandom binary torque: keeps its value by chance, so its spectrum has no zero."""

from __future__ import annotations

import numpy as np

from beltcomm.errors import UsageError
from beltcomm.excitation.record import Excitation, finish

#: A period with fewer changes than this is no random signal.
FEWEST_CHANGES = 8


def gprbs(
    period_samples: int,
    mean_hold: float,
    amplitude_nm: float,
    sample_period_s: float,
    repeats: int,
    *,
    seed: int,
    run_in_periods: int = 1,
    torque_step_nm: float = 0.0,
) -> Excitation:
    """Binary torque that changes its sign at every sample with the probability 1/h.

    P(u[n] = u[n-1]) = 1 - 1/h,   so  E u[n] u[n+k] = A² (1 - 2/h)^|k|   and the spectrum

    S(ω) ∝ (1 - ρ²)/(1 - 2 ρ cos ωT + ρ²),  ρ = 1 - 2/h,   has no zero; h = 2 is white.

    As many samples are +A as -A, as far as the period allows; what is left over is taken away as mean.

    Parameters
    ----------
    period_samples : int
        Samples of a period.
    mean_hold : float
        h, samples, above 1.
    amplitude_nm : float, N m, motor shaft
        A, about the mean.
    sample_period_s : float
        T, s.
    repeats : int
        Measured periods.
    seed : int
        The sequence; the same seed gives the same.
    run_in_periods : int
        Periods before ``first_sample``.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none.

    Returns
    -------
    Excitation
        N m at the motor shaft, (n,), with rest and run-in.

    Raises
    ------
    UsageError
        For values that are no GPRBS.

    References
    ----------
    Thesis 3.1; Isermann, Münchhof, Identification of Dynamic Systems (2011), section 6.3.
    """
    if not mean_hold > 1.0 or period_samples < FEWEST_CHANGES * mean_hold:
        raise UsageError(
            f"{period_samples} samples of which each sign lasts {mean_hold:g} on average: the latter must be above 1, and the period "
            f"at least {FEWEST_CHANGES} times as long"
        )
    if not amplitude_nm > 0 or not sample_period_s > 0:
        raise UsageError(f"amplitude {amplitude_nm} N m, sample period {sample_period_s} s: both must be positive")
    rng = np.random.default_rng(seed)
    signs = np.where(np.cumsum(rng.random(period_samples) < 1.0 / mean_hold) % 2, 1.0, -1.0)
    return finish(
        "gprbs",
        amplitude_nm * signs,
        repeats,
        sample_period_s,
        (1.0 / (period_samples * sample_period_s), 0.5 / sample_period_s),
        {"mean_hold": mean_hold, "peak_to_peak_nm": 2.0 * amplitude_nm, "seed": seed},
        run_in_periods=run_in_periods,
        torque_step_nm=torque_step_nm,
    )
