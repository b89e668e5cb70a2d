"""Pseudorandom binary torque (3.1) to (3.6), and which one shows a band of frequencies in a given time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor

import numpy as np
from numpy.typing import NDArray

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation.record import (
    FEWEST_REPEATS,
    LOWEST_OVER_LINE,
    REST_AFTER_S,
    REST_BEFORE_S,
    WIDEST_LINE_SPACING_HZ,
    Excitation,
    RecordTooShort,
    check_band,
    finish,
)

#: Delays i with a_i = 1 in (3.2) that give the longest sequence, by order: one primitive polynomial over GF(2) each.
#: Source: P. Alfke, Xilinx application note XAPP 052 (1996), table 3.
MAXIMAL_TAPS: Mapping[int, tuple[int, ...]] = {
    3: (3, 2),
    4: (4, 3),
    5: (5, 3),
    6: (6, 5),
    7: (7, 6),
    8: (8, 6, 5, 4),
    9: (9, 5),
    10: (10, 7),
    11: (11, 9),
    12: (12, 6, 4, 1),
    13: (13, 4, 3, 1),
    14: (14, 5, 3, 1),
    15: (15, 14),
    16: (16, 15, 13, 4),
}

#: Spectrum zero (3.5) over highest frequency to be seen.  The lines have half their power at 0.443 of the zero
#: (sinc² x = 1/2), and half an octave above a resonance is needed for its upper flank: 2^(1/2) / 0.443.
ZERO_OVER_HIGHEST = 3.2

#: Order of the short excitations with which the amplitude rises.
SHORT_ORDER = 9

#: A period with fewer changes than this is no random signal.
FEWEST_CHANGES = 8


@dataclass(frozen=True)
class PrbsChoice:
    """Order, clock and number of measured periods of a PRBS, and in words why these."""

    order: int
    clock: int
    repeats: int
    reason: str

    def excitation(self, amplitude_nm: float, sample_period_s: float, *, torque_step_nm: float = 0.0) -> Excitation:
        """The record with ±amplitude, N m, about its mean.

        Parameters
        ----------
        amplitude_nm : float, N m, motor shaft
            About the mean.
        sample_period_s : float, s
        torque_step_nm : float, N m
            Resolution of the drive's torque setpoint, 0 for none.

        Returns
        -------
        Excitation
            The record, ready to be run.
        """
        return prbs(self.order, self.clock, 2.0 * amplitude_nm, sample_period_s, self.repeats, torque_step_nm=torque_step_nm)


def prbs_bits(order: int) -> NDArray[np.int8]:
    """One period of a maximal-length binary sequence, s(k) = mod(Σ a_i s(k-i), 2), from s(-1) = ... = s(-n) = 1.

    Parameters
    ----------
    order : int
        n in 3 to 16.

    Returns
    -------
    ndarray of int8, (2^n - 1,)
        0 or 1, with 2^(n-1) ones.

    Raises
    ------
    UsageError
        For another order.

    References
    ----------
    Thesis (3.1) to (3.3).
    """
    if order not in MAXIMAL_TAPS:
        raise UsageError(f"a PRBS of order {order} is not available; choose an order from 3 to 16")
    length = 2**order - 1
    bits = np.ones(order + length, dtype=np.int8)
    for k in range(order, order + length):
        bits[k] = sum(int(bits[k - i]) for i in MAXIMAL_TAPS[order]) % 2
    return bits[order:]


def prbs(
    order: int,
    clock: int,
    peak_to_peak_nm: float,
    sample_period_s: float,
    repeats: int,
    *,
    torque_step_nm: float = 0.0,
) -> Excitation:
    """Pseudorandom binary torque that leaves a free axis where it was.

    u((P k + i) T_s) = A (s(k) - 1/2) - A / (2 M),   i = 0 ... P - 1,   M = 2^n - 1

    The second term takes away the mean of (3.4); see :func:`beltcomm.excitation.record.finish` for drift, start and rounding.

    Parameters
    ----------
    order : int
        n, 3 to 16.
    clock : int
        P, samples per bit.
    peak_to_peak_nm : float
        A of (3.4), N m, motor shaft: the thesis's 0.3 N m is ±0.15 N m.
    sample_period_s : float
        T_s, s.
    repeats : int
        Measured periods.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none.

    Returns
    -------
    Excitation
        N m at the motor shaft, (n,), with rest and run-in.

    Raises
    ------
    UsageError
        For values that are no PRBS.

    References
    ----------
    Thesis (3.1) to (3.6); thesis.md, erratum 10.
    """
    if clock < 1:
        raise UsageError(f"clock {clock}: a bit must last at least 1 sample")
    if not peak_to_peak_nm > 0 or not sample_period_s > 0:
        raise UsageError(f"peak to peak {peak_to_peak_nm} N m, sample period {sample_period_s} s: both must be positive")
    return finish(
        "prbs",
        np.repeat(peak_to_peak_nm * (prbs_bits(order) - 0.5), clock),
        repeats,
        sample_period_s,
        prbs_band(order, clock, sample_period_s),
        {"order": order, "clock": clock, "peak_to_peak_nm": peak_to_peak_nm},
        torque_step_nm=torque_step_nm,
    )


def prbs_band(order: int, clock: int, sample_period_s: float) -> tuple[float, float]:
    """Lowest line and first zero of the spectrum of a PRBS.

    f_min = 1 / ((2^n - 1) P T_s),   f_max = 1 / (P T_s)

    Parameters
    ----------
    order : int
        n.
    clock : int
        P, samples per bit.
    sample_period_s : float
        T_s, s.

    Returns
    -------
    tuple of float
        f_min and f_max, Hz, the latter not above half the sampling frequency.

    References
    ----------
    Thesis (3.5), (3.6).
    """
    bit_s = clock * sample_period_s
    return 1.0 / ((2**order - 1) * bit_s), min(1.0 / bit_s, 0.5 / sample_period_s)


def choose_prbs(sample_period_s: float, lowest_hz: float, highest_hz: float, duration_s: float) -> PrbsChoice:
    """Order, clock and measured periods of a PRBS that shows ``lowest_hz`` to ``highest_hz`` within ``duration_s``.

    The clock is the largest that keeps half the power up to half an octave above ``highest_hz`` and leaves time for enough
    periods: more torque at low frequencies.  The order is the smallest whose lines (3.6) lie no further apart than a
    tenth of ``lowest_hz`` and 1 Hz: a longer period would only move the cart further (its stroke grows with the
    period's 3/2 power).  The time left over becomes measured periods.

    Parameters
    ----------
    sample_period_s : float, s
    lowest_hz : float
        The lowest antiresonance expected.
    highest_hz : float
        The highest resonance expected.
    duration_s : float, s
        The whole record with rest and one period of run-in.

    Returns
    -------
    PrbsChoice
        Order, clock and number of periods.

    Raises
    ------
    UsageError
        For numbers that cannot be meant.
    Refused
        When sampling or duration do not reach, with what would.

    References
    ----------
    Thesis (3.5), (3.6); thesis.md, erratum 9: at 1 kHz clock 2 with order 9 to 11.
    """
    check_band(sample_period_s, lowest_hz, highest_hz, duration_s)
    largest = max(1, floor(1.0 / (ZERO_OVER_HIGHEST * highest_hz * sample_period_s)))
    spacing_hz = min(lowest_hz / LOWEST_OVER_LINE, WIDEST_LINE_SPACING_HZ)
    orders = {clock: _smallest_order(clock, spacing_hz, sample_period_s) for clock in range(largest, 0, -1)}
    fitting = {clock: order for clock, order in orders.items() if order is not None}
    if not fitting:
        raise Refused(
            f"lines every {spacing_hz:.3g} Hz, as an antiresonance at {lowest_hz:.3g} Hz asks for, need a PRBS beyond order "
            f"{max(MAXIMAL_TAPS)} at clock {largest} and {1e3 * sample_period_s:.4g} ms; sample more slowly or start higher"
        )
    for_periods_s = duration_s - REST_BEFORE_S - REST_AFTER_S - 2 * sample_period_s
    repeats = {c: floor(for_periods_s * prbs_band(n, c, sample_period_s)[0] + 1e-9) - 1 for c, n in fitting.items()}
    # A period grows by whole orders; where the largest clock's is too long, the next smaller one's may still do.
    enough = [clock for clock in fitting if repeats[clock] >= FEWEST_REPEATS]
    if not enough:
        shortest_s = min(1.0 / prbs_band(n, c, sample_period_s)[0] for c, n in fitting.items())
        raise RecordTooShort(duration_s, for_periods_s, shortest_s, lowest_hz)
    clock = enough[0]
    order = fitting[clock]
    line_hz, zero_hz = prbs_band(order, clock, sample_period_s)
    return PrbsChoice(
        order,
        clock,
        repeats[clock],
        f"order {order}, clock {clock}: lines every {line_hz:.3g} Hz (at most {spacing_hz:.3g} Hz for an antiresonance at "
        f"{lowest_hz:.4g} Hz), excited up to {zero_hz:.4g} Hz (resonance at {highest_hz:.4g} Hz); {repeats[clock]} measured "
        f"periods of {1.0 / line_hz:.3g} s after one of run-in",
    )


def _smallest_order(clock: int, spacing_hz: float, sample_period_s: float) -> int | None:
    """The smallest order with lines no further apart than ``spacing_hz``; None when there is none."""
    return min((n for n in MAXIMAL_TAPS if prbs_band(n, clock, sample_period_s)[0] <= spacing_hz), default=None)


def gprbs(
    period_samples: int,
    mean_hold: float,
    amplitude_nm: float,
    sample_period_s: float,
    repeats: int,
    *,
    seed: int,
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
        torque_step_nm=torque_step_nm,
    )
