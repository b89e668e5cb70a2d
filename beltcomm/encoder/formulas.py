"""Limits and relative errors of the velocity estimators: (6.3) to (6.19), (C.1) to (C.8), and what they leave out.

Assumed throughout, unless said otherwise: constant positive velocity, lines of the scale exactly where they belong, no missed edge, and
times of edges known within ±Δt_min.  Speeds in m/s, errors in percent of the true velocity, returned with the sign of a time measured
too long (negative) or too short (positive).  Speeds are numbers or arrays; what is computed from them are arrays of the same shape.

Printed and meant: (C.6) and the middle of (6.11) agree only with a factor 100 that (C.6) lacks; (6.13) is a limit and no argmin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from beltcomm.arrays import Array
from beltcomm.errors import UsageError


def lowest_speed_m_s(increment_m: float, time_s: float) -> float:
    """Δξ_min over a time, m/s.

    (6.3) of the difference (6.9) and (6.5) of the event counter with T_s: two increments can lie in a period from this speed on, but do
    so in every period only from twice this speed on.   (6.18) of the gate measurement with T_out.

    Parameters
    ----------
    increment_m : float, m
        Δξ_min, of the carriage.
    time_s : float, s
        T_s or T_out.
    """
    return increment_m / time_s


def highest_speed_m_s(increment_m: float, tick_s: float) -> float:
    """Δξ_min/Δt_min, m/s: (6.6) and (6.15), one increment per tick.

    Parameters
    ----------
    increment_m : float, m
        Δξ_min, of the carriage.
    tick_s : float, s
        Δt_min of the timer.
    """
    return increment_m / tick_s


def _travel_in_period_m(speed_m_s: ArrayLike, period_s: float) -> Array:
    """(C.1): Δξ_Ts = ξ T_s, m."""
    return _array(speed_m_s) * period_s


def _increments_real(speed_m_s: ArrayLike, increment_m: float, period_s: float) -> Array:
    """(C.2): n_inc − 1 = ξ T_s/Δξ_min before it is cut to a whole number: increments that the axis travels in a period."""
    return _travel_in_period_m(speed_m_s, period_s) / increment_m


def _intervals_printed(speed_m_s: ArrayLike, increment_m: float, period_s: float) -> Array:
    """(C.3): n_inc − 1 = ⌊ξ T_s/Δξ_min⌋.

    That is the most that a period can hold, reached when an increment lies near its beginning; see :func:`_intervals_fewest`.
    """
    return _floor(_increments_real(speed_m_s, increment_m, period_s))


def _intervals_fewest(speed_m_s: ArrayLike, increment_m: float, period_s: float) -> Array:
    """The fewest intervals between increments of one period: ⌊ξ T_s/Δξ_min⌋ − 1, below 1 where the event counter has no value in some.

    A period of r = ξ T_s/Δξ_min holds ⌊r⌋ or ⌊r⌋ + 1 increments, so ⌊r⌋ − 1 or ⌊r⌋ intervals; (C.3) takes the better of the two cases.
    """
    return _intervals_printed(speed_m_s, increment_m, period_s) - 1.0


def _time_error_percent(measured_s: ArrayLike, tick_s: float, sign: int = 1) -> Array:
    """100 (T/(T ± Δt_min) − 1) = ∓100 Δt_min/(T ± Δt_min): what a time T, measured wrong by a tick, does to a velocity; ``sign`` 1 for a
    time too long, −1 for too short (worse).

    The middle of (C.5), and (C.8).
    """
    return -sign * 100.0 * tick_s / (_array(measured_s) + sign * tick_s)


def _event_counter_error_exact_percent(
    speed_m_s: ArrayLike, increment_m: float, tick_s: float, period_s: float, *, sign: int = 1, fewest: bool = False
) -> Array:
    """(C.5): ∓100 Δt_min ξ/(m Δξ_min ± Δt_min ξ), percent, with m = ⌊ξ T_s/Δξ_min⌋.

    ``fewest``: m = ⌊ξ T_s/Δξ_min⌋ − 1 instead, the true worst case. nan where m < 1. ``sign`` as in :func:`_time_error_percent`.
    """
    count = _intervals_fewest if fewest else _intervals_printed
    intervals = _at_least_one(count(speed_m_s, increment_m, period_s))
    return _time_error_percent(intervals * increment_m / _array(speed_m_s), tick_s, sign)


def event_counter_envelope_percent(speed_m_s: ArrayLike, increment_m: float, tick_s: float, period_s: float) -> Array:
    """(6.12): 100 ξ/((ξ T_s/Δξ_min − 1) ξ_h,max), percent: (6.11) with the floor at its lowest.   nan up to Δξ_min/T_s.

    The true worst case lies above it, see :func:`event_counter_worst_percent`.

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    tick_s : float, s
        Δt_min of the timer.
    period_s : float, s
        T_s.
    """
    intervals = _increments_real(speed_m_s, increment_m, period_s) - 1.0
    return 100.0 * _array(speed_m_s) / (_above_zero(intervals) * highest_speed_m_s(increment_m, tick_s))


def event_counter_worst_percent(speed_m_s: ArrayLike, increment_m: float, tick_s: float, period_s: float) -> Array:
    """(C.5) with the fewest intervals that a period can hold and the time measured too short, percent; nan below 2 Δξ_min/T_s.

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    tick_s : float, s
        Δt_min of the timer.
    period_s : float, s
        T_s.
    """
    return _event_counter_error_exact_percent(speed_m_s, increment_m, tick_s, period_s, sign=-1, fewest=True)


def event_counter_limit_percent(tick_s: float, period_s: float) -> float:
    """(6.13): 100 Δt_min/T_s, percent, which (6.11) and (6.12) tend to for high speeds (printed as an argmin).

    Parameters
    ----------
    tick_s : float, s
        Δt_min of the timer.
    period_s : float, s
        T_s.
    """
    return 100.0 * tick_s / period_s


def _gate_time_s(speed_m_s: ArrayLike, increment_m: float) -> Array:
    """(C.7): T_inc = Δξ_min/ξ, s."""
    return increment_m / _array(speed_m_s)


def gate_error_percent(speed_m_s: ArrayLike, increment_m: float, tick_s: float, *, sign: int = 1) -> Array:
    """(6.16), (C.8): ∓100 ξ/(ξ_l,max ± ξ), percent; exact.

    Meant for speeds below ξ_l,max = Δξ_min/Δt_min (6.15): above, no time is left to be measured.

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    tick_s : float, s
        Δt_min of the timer.
    sign : int
        1 for a time measured too long, −1 for too short (worse).
    """
    speed = _array(speed_m_s)
    return -sign * 100.0 * speed / (highest_speed_m_s(increment_m, tick_s) + sign * speed)


def crossing_speed_m_s(increment_m: float, tick_s: float, period_s: float, *, sign: int = 1) -> float:
    """(6.19): 2 Δξ_min/(T_s ∓ Δt_min), m/s, where (6.12) equals |(6.16)|.

    They differ by 2 Δt_min/T_s.

    Parameters
    ----------
    increment_m : float, m
        Δξ_min.
    tick_s : float, s
        Δt_min of the timer.
    period_s : float, s
        T_s.
    sign : int
        1 as printed; it belongs to a gate time measured too long, the smaller error. −1 : to the larger, which is the worst case the source
        speaks of.

    Raises
    ------
    UsageError
        For a period that is not longer than a tick.
    """
    if period_s <= tick_s:
        raise UsageError(f"the sampling period {period_s:g} s is not longer than the tick {tick_s:g} s; there is no crossing")
    return 2.0 * increment_m / (period_s - sign * tick_s)


def high_pass_worst_percent(speed_m_s: ArrayLike, increment_m: float, period_s: float, lag_s: float) -> Array:
    """100 Δξ_min/((T_R + T_s) ξ), percent: bound on the error of (6.1) by backward differences at constant velocity (not in the source).

    The position is wrong by at most an increment; the first weight of (1 − z⁻¹)/(T_R + T_s − T_R z⁻¹) is 1/(T_R + T_s), all later ones
    are negative and together its opposite.   With T_R = 0 it is 100 ξ_min/ξ of (6.3).

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    period_s : float, s
        T_s.
    lag_s : float, s
        T_R, of the filter behind the difference.
    """
    return 100.0 * increment_m / ((lag_s + period_s) * _array(speed_m_s))


def high_pass_delay_s(period_s: float, lag_s: float) -> float:
    """T_R + T_s/2, s: how far (6.1) by backward differences lags behind a steady acceleration (not in the source).

    Parameters
    ----------
    period_s : float, s
        T_s.
    lag_s : float, s
        T_R, of the filter behind the difference.
    """
    return lag_s + 0.5 * period_s


def event_counter_delay_s(speed_m_s: ArrayLike, increment_m: float, period_s: float) -> tuple[Array, Array]:
    """Least and largest delay of (6.4) under acceleration, s: (T_s ∓ Δξ_min/ξ)/2 (not in the source).

    It is the true velocity midway between the first and the last increment; these lie at most an increment's time inside the period.

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    period_s : float, s
        T_s.
    """
    gap = _gate_time_s(speed_m_s, increment_m)
    return 0.5 * (period_s - gap), 0.5 * (period_s + gap)


def gate_delay_s(speed_m_s: ArrayLike, increment_m: float) -> tuple[Array, Array]:
    """Least and largest delay of (6.14) under acceleration, s: Δξ_min/(2 ξ) to 3 Δξ_min/(2 ξ) (not in the source).

    The last increment is up to one increment's time old, and the middle of the gap half of one older.

    Parameters
    ----------
    speed_m_s : array_like, m/s
        ξ, of the carriage.
    increment_m : float, m
        Δξ_min.
    """
    gap = _gate_time_s(speed_m_s, increment_m)
    return 0.5 * gap, 1.5 * gap


def _array(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


def _floor(values: Array) -> Array:
    # A product of T_s and ξ that should be whole comes out a rounding error below.
    return np.floor(values * (1.0 + 4e-16))


def _at_least_one(values: Array) -> Array:
    return np.where(values >= 1.0, values, np.nan)


def _above_zero(values: Array) -> Array:
    return np.where(values > 0.0, values, np.nan)
