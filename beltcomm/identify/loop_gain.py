"""Meaning of the gains of a drive's cascade, from small steps of its setpoints: no model of the axis is needed.

The law of the controller itself is fitted to what it was given and what it answered, all at the motor shaft:

    τ = K_P e + K_I ∫e dt + c,        e = ω_d - ω                     (velocity loop)
    e = K_PP (φ_d - φ) - ω                                            (position loop above it)

An axis that friction holds keeps ω at nought and makes e known; one that moves a little is measured.  Every repeat of the steps is fitted
by itself; their scatter gives the 95 % interval.

When in its period a setpoint acts, no row shows: ∫e begins up to a sample T early or late, which a step e cannot tell from K_P:

    τ = (K_P ± K_I T) e + K_I ∫e dt + c

A lag of the reading, or of the setpoint, does the same by its time constant, and more while it settles: it is found by the edges of the
steps, as the delay is, and all that the law is given passes it.

K_I alone is free of it, and with a time T_n that is known K_P = K_I T_n and K_PP are, too.  Rows that are seldom need that: at 12.8 ms
beside T_n = 32 ms the step alone says K_P to 40 %.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.special import stdtrit

from beltcomm.arrays import Array, BoolArray, later, rms
from beltcomm.errors import DataError

#: Samples from a setpoint to the torque that answers it, at most.
LATEST = 8
#: Lags of the first order between the controller's torque and its reading that are tried, in samples, and to what the best is found
#: between its neighbours.
LAGS, LAG_TO = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0), 0.01
#: Samples either way from which the slope over a lag is taken.
STEP = 0.5
#: Samples after a change of the setpoint that are left out: a drive spreads a step over a period or two.
RISE = 3
#: A law leaves no more than this share of the torque that it explains, or so many times the noise.
LARGEST_REST, NOISES = 0.1, 3.0
#: Samples of the integral part that nobody sees, at worst: where in its period a setpoint acts, and whether the present error is counted,
#: half each.
UNSEEN_SAMPLES = 1.0
#: Estimates with a wider 95 % interval than this share of their value tell nothing.
WIDEST = 0.3


@dataclass(frozen=True)
class Gain:
    """One estimate with the half-width of its 95 % interval, in SI at the motor shaft."""

    value: float
    interval: float

    @property
    def share(self) -> float:
        """Interval as a share of the value."""
        return self.interval / abs(self.value) if self.value else math.inf

    @property
    def span(self) -> tuple[float, float, float]:
        """The value, and both ends of its interval, none below 0."""
        return self.value, max(self.value - self.interval, 0.0), self.value + self.interval


@dataclass(frozen=True)
class VelocityLaw:
    """K_P, N m s/rad, T_n = K_P/K_I, s, and K_I, N m/rad, of a velocity loop; the last None where it was not fitted."""

    gain: Gain
    integral_time_s: Gain
    integral_gain: Gain | None = None

    def gain_at(self, integral_time_s: float) -> Gain:
        """K_P of a loop whose integral time is known: from the steps or from the slope of the integral part, as is known better.

        Parameters
        ----------
        integral_time_s : float, s
            T_n.

        Returns
        -------
        Gain
            N m s/rad.
        """
        if self.integral_gain is None:
            return self.gain
        by_slope = Gain(self.integral_gain.value * integral_time_s, self.integral_gain.interval * integral_time_s)
        return _better_known(self.gain, by_slope)


@dataclass(frozen=True)
class Steps:
    """Rows of a record at a fixed period: setpoint (rad/s of the velocity loop, rad of the position loop), position, speed, torque.

    Attributes
    ----------
    repeat : int
        Rows of one repeat of the steps.
    noise_nm : float
        Of the torque signal at rest.
    """

    period_s: float
    setpoint: Array
    position_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    repeat: int
    noise_nm: float

    @property
    def repeats(self) -> int:
        """Whole repeats."""
        return len(self.setpoint) // self.repeat


def velocity_law(steps: Steps) -> VelocityLaw:
    """Law of a velocity loop, from steps of its setpoint.

    Parameters
    ----------
    steps : Steps
        At the motor shaft.

    Returns
    -------
    VelocityLaw
        Gain and integral time with their intervals.

    Raises
    ------
    DataError
        When the torque does not follow one, or too little of it is seen to tell.
    """

    def regressors(late: int, lag: float) -> list[Array]:
        error = later(steps.setpoint, late) - later(steps.velocity_rad_s, 1)
        return [_lagged(error, lag), _lagged(_integral(error) * steps.period_s, lag)]

    late, lag = _late(steps, regressors, lambda _: steps.torque_nm)
    steady = _steady(steps, late)
    times: list[Gain] = []
    gains: list[Gain] = []
    slopes: list[Gain] = []
    for one in lag.span:
        each, rest = _fit(steps, regressors(late, one), steps.torque_nm, steady)
        if not gains:
            _check(steps, rest, "the velocity loop's setpoint")
        gains.append(_mean(each[:, 0]))
        slopes.append(_mean(each[:, 1]))
        times.append(_ratio(each[:, 0], each[:, 1]))
    gain, slope, time = _spread(gains), _spread(slopes), _spread(times)
    if not gain.share < WIDEST or gain.value <= 0.0:
        raise DataError(
            f"the velocity gain cannot be told: {gain.value:.3g} ± {gain.interval:.2g} N m s/rad over {steps.repeats} repeats; the torque "
            "that may be asked for is too small against its noise"
        )
    unseen = UNSEEN_SAMPLES * steps.period_s / time.value if time.value > 0.0 else 0.0
    return VelocityLaw(
        Gain(gain.value, math.hypot(gain.interval, gain.value * unseen)),
        Gain(time.value, math.hypot(time.interval, time.value * unseen)),
        slope,
    )


def position_gain(steps: Steps, law: VelocityLaw) -> Gain:
    """K_PP of the position loop above a velocity loop whose law is known.

    Parameters
    ----------
    steps : Steps
        Of the position setpoint.
    law : VelocityLaw
        Of the loop below.

    Returns
    -------
    Gain
        1/s, with its interval.

    Raises
    ------
    DataError
        As :func:`velocity_law`.
    """
    kp, ki = law.gain.value, law.gain.value / law.integral_time_s.value if math.isfinite(law.integral_time_s.value) else 0.0

    def through(error: Array) -> Array:
        return kp * error + ki * _integral(error) * steps.period_s

    def errors(late: int) -> Array:
        return later(steps.setpoint, late) - later(steps.position_rad, 1)

    def regressors(late: int, lag: float) -> list[Array]:
        return [_lagged(through(errors(late)), lag)]

    def answered(lag: float) -> Array:
        return steps.torque_nm + _lagged(through(later(steps.velocity_rad_s, 1)), lag)

    late, lag = _late(steps, regressors, answered)
    steady = _steady(steps, late)
    gains: list[Gain] = []
    slopes: list[Gain] = []
    for one in lag.span:
        each, rest = _fit(steps, regressors(late, one), answered(one), steady)
        if not gains:
            _check(steps, rest, "the position loop's setpoint")
        gains.append(_mean(each[:, 0]))
        if ki > 0.0:
            parts = [kp * errors(late), ki * _integral(errors(late)) * steps.period_s]
            apart, _ = _fit(steps, [_lagged(part, one) for part in parts], answered(one), steady)
            slopes.append(_mean(apart[:, 1]))
    gain, unseen = _spread(gains), UNSEEN_SAMPLES * steps.period_s * ki / kp
    best = Gain(gain.value, math.hypot(gain.interval, gain.value * unseen))
    if slopes:
        best = _better_known(best, _spread(slopes))
    if not gain.share < WIDEST or gain.value <= 0.0:
        raise DataError(f"the position gain cannot be told: {gain.value:.3g} ± {gain.interval:.2g} 1/s over {steps.repeats} repeats")
    # the velocity gain that it was computed with is not exact either
    return Gain(best.value, math.hypot(best.interval, best.value * law.gain.share))


def _better_known(one: Gain, other: Gain) -> Gain:
    """The positive one whose interval is the smaller share of it."""
    return other if other.value > 0.0 and other.share < one.share else one


def _integral(values: Array) -> Array:
    """Sum of the values so far, the present one half."""
    return np.cumsum(values) - 0.5 * values


def _lagged(values: Array, lag: float) -> Array:
    """Values behind a lag of the first order, its time constant in samples, from rest."""
    if lag <= 0.0:
        return values
    pole = math.exp(-1.0 / lag)
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values))


def _late(steps: Steps, regressors: Callable[[int, float], list[Array]], answered: Callable[[float], Array]) -> tuple[int, Gain]:
    """Samples from the setpoint to the torque, and the lag behind it: those with which the edges of the steps fit best."""
    whole = np.ones(len(steps.setpoint), dtype=bool)

    def left(late: int, lag: float) -> float:
        return _fit(steps, regressors(late, lag), answered(lag), whole)[1]

    late, lag = min(itertools.product(range(LATEST + 1), LAGS), key=lambda one: left(*one))
    at = LAGS.index(lag)
    between = LAGS[max(at - 1, 0)], LAGS[min(at + 1, len(LAGS) - 1)]
    found = minimize_scalar(lambda one: left(late, one), bounds=between, method="bounded", options={"xatol": LAG_TO})
    lag = float(found.x) if found.fun < left(late, lag) else lag
    law = np.mean(_fit(steps, regressors(late, lag), answered(lag), whole)[0], axis=0)

    def beside(one: float) -> Array:
        return np.asarray(law @ np.array(regressors(late, one)) - answered(one))

    low, high = max(lag - STEP, 0.0), lag + STEP
    slope = (beside(high) - beside(low)) / (high - low)
    each, _ = _fit(steps, [*regressors(late, lag), slope], answered(lag), whole)
    return late, Gain(lag, _mean(each[:, -1]).interval)


def _spread(found: list[Gain]) -> Gain:
    """An estimate with what it changes by over the interval of the lag: the first is that at the lag itself."""
    best = found[0]
    return Gain(best.value, math.hypot(best.interval, max(abs(one.value - best.value) for one in found)))


def _steady(steps: Steps, late: int) -> BoolArray:
    """Rows in which a setpoint so late has not just changed."""
    changed = np.flatnonzero(np.diff(later(steps.setpoint, late), prepend=steps.setpoint[0]))
    steady = np.ones(len(steps.setpoint), dtype=bool)
    for row in changed:
        steady[row : row + RISE] = False
    return steady


def _fit(steps: Steps, regressors: list[Array], answered: Array, rows: BoolArray) -> tuple[Array, float]:
    """Coefficients of every repeat, (repeats, n), and what they leave, rms."""
    table = np.stack([*regressors, np.ones(len(answered))], axis=1)
    each, rests = [], []
    for number in range(steps.repeats):
        chosen = np.zeros(len(answered), dtype=bool)
        chosen[number * steps.repeat : (number + 1) * steps.repeat] = True
        chosen &= rows
        scale = np.maximum(np.abs(table[chosen]).max(axis=0), 1e-30)
        solved, *_ = np.linalg.lstsq(table[chosen] / scale, answered[chosen], rcond=None)
        each.append(solved / scale)
        rests.append(answered[chosen] - table[chosen] @ each[-1])
    return np.array(each)[:, : len(regressors)], rms(np.concatenate(rests))


def _check(steps: Steps, rest_nm: float, what: str) -> None:
    seen = float(np.std(steps.torque_nm))
    if rest_nm > max(LARGEST_REST * seen, NOISES * steps.noise_nm):
        raise DataError(
            f"the torque does not answer {what} as a PI controller's does: {1e3 * rest_nm:.2g} mN m of {1e3 * seen:.2g} mN m are "
            f"unexplained, the noise is {1e3 * steps.noise_nm:.2g} mN m; look for filters, limits and ramps in the drive"
        )


def _mean(values: Array) -> Gain:
    count = len(values)
    if count < 2:
        return Gain(float(values[0]), math.inf)
    half = float(stdtrit(count - 1, 0.975)) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return Gain(float(np.mean(values)), half)


def _ratio(above: Array, below: Array) -> Gain:
    """Ratio of the means of two estimates that scatter together."""
    middle = float(np.mean(below))
    if middle <= 0.0:
        return Gain(math.inf, math.inf)
    value = float(np.mean(above)) / middle
    return Gain(value, _mean((above - value * below) / middle).interval)
