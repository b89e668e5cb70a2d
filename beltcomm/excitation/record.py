"""A finished torque record from one period of a signal: rest, run-in, measured periods, rest, and no drift of a free axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import Refused, UsageError

#: Rest before and after the motion: effects-and-diagnosis.md, 3.
REST_BEFORE_S = 0.25
#: Periods between the rest and the measured ones.
RUN_IN_PERIODS = 1
REST_AFTER_S = 0.45
#: Lowest frequency to be seen over lowest line (3.6), so that the rigid slope below an antiresonance is seen too.
LOWEST_OVER_LINE = 10.0
#: "these frequencies start in the range of one" hertz (3.1): the lines lie at least this close, Hz.
WIDEST_LINE_SPACING_HZ = 1.0
#: Measured periods without which the scatter between periods, and so the noise level, means little.
FEWEST_REPEATS = 3
#: Half the sampling frequency over highest frequency to be seen: the upper flank of a resonance belongs to it.
NYQUIST_OVER_HIGHEST = 1.1
_ROUNDING = 1e-9
#: s: samples that come more seldom than this show a motion only while it goes on in one direction; Hz, up to which it is then
#: excited, and share of that from which on the lines must be near enough.
SELDOM_S, SLOW_TOP_HZ, SLOW_LOW_SHARE = 2e-3, 15.0, 0.6


def visible_band(sample_period_s: float, lowest_hz: float, highest_hz: float) -> tuple[float, float]:
    """Part of a band that an excitation can show where samples come with this period.

    Rows that come seldom say what a motion took only while it goes on in one direction for several of them: then the excitation must be
    slow, whatever is to be seen.  Of a resonance beyond its band a response says nothing; below, the axis is as heavy all the same.

    Parameters
    ----------
    sample_period_s : float, s
        Of the records.
    lowest_hz : float, Hz
        Lower end of the band.
    highest_hz : float, Hz
        Upper end of the band.

    Returns
    -------
    tuple of float
        Lowest and highest frequency to be excited, Hz.
    """
    top = (1.0 - _ROUNDING) * 0.5 / (sample_period_s * NYQUIST_OVER_HIGHEST)
    if sample_period_s > SELDOM_S:
        top = min(top, SLOW_TOP_HZ)
    return (lowest_hz, highest_hz) if highest_hz <= top else (min(lowest_hz, SLOW_LOW_SHARE * top), top)


def check_band(sample_period_s: float, lowest_hz: float, highest_hz: float, duration_s: float) -> None:
    """Refuse a band that cannot be excited.

    Parameters
    ----------
    sample_period_s : float, s
    lowest_hz, highest_hz : float, Hz
        Ends of the band.
    duration_s : float, s
        Of the record.

    Raises
    ------
    UsageError
        For numbers that cannot be meant.
    Refused
        When the sampling does not reach the highest frequency.
    """
    if not (sample_period_s > 0 and 0 < lowest_hz < highest_hz and duration_s > 0):
        raise UsageError(
            f"sample period {sample_period_s} s, {lowest_hz} Hz to {highest_hz} Hz in {duration_s} s: all must be positive "
            "and the lowest frequency below the highest"
        )
    nyquist_hz = 0.5 / sample_period_s
    if NYQUIST_OVER_HIGHEST * highest_hz > nyquist_hz:
        raise Refused(
            f"a resonance at {highest_hz:.4g} Hz cannot be seen with a sample period of {1e3 * sample_period_s:.4g} ms: "
            f"that ends at {nyquist_hz:.4g} Hz and {NYQUIST_OVER_HIGHEST * highest_hz:.4g} Hz are needed; sample at least "
            f"every {500.0 / (NYQUIST_OVER_HIGHEST * highest_hz):.3g} ms or leave the resonance out"
        )


class RecordTooShort(Refused):
    """A record without time for one period of run-in and the fewest measured ones.

    Attributes
    ----------
    needed_s : float, s
        The shortest that has.
    """

    def __init__(self, duration_s: float, for_periods_s: float, period_s: float, lowest_hz: float) -> None:
        self.needed_s = duration_s - for_periods_s + (1 + FEWEST_REPEATS) * period_s
        super().__init__(
            f"{duration_s:.3g} s are too short for one period of run-in and {FEWEST_REPEATS} measured periods of {period_s:.3g} s; "
            f"allow {self.needed_s:.3g} s or raise the lowest frequency above {lowest_hz:.3g} Hz"
        )


@dataclass(frozen=True, eq=False)
class Excitation:
    """One torque record that starts and ends at rest; ``torque[n]`` acts from sample n to n + 1.

    Attributes
    ----------
    kind : str
        "prbs", "gprbs", "chirp" or "multisine".
    torque : ndarray (n,), N m, motor shaft
        Read-only.
    period_samples : int
        Samples of one period.
    repeats : int
        Measured periods, the run-in not counted.
    amplitude_nm : float, N m
        Largest absolute torque.
    sample_period_s : float, s
    first_sample : int
        Index where the first measured period begins.
    band_hz : tuple of float
        Lowest and highest excited frequency, Hz.
    parameters : dict of str to float
        What the signal was made from, by name.
    lines : tuple of int
        Numbers of the lines that are excited on purpose, 1 is 1/period; () for all within the band.
    """

    kind: str
    torque: Array
    period_samples: int
    repeats: int
    amplitude_nm: float
    sample_period_s: float
    first_sample: int
    band_hz: tuple[float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)
    lines: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        torque = np.array(self.torque, dtype=np.float64)
        torque.setflags(write=False)
        object.__setattr__(self, "torque", torque)

    @property
    def duration_s(self) -> float:
        """Length of the whole record with rest and run-in, s."""
        return len(self.torque) * self.sample_period_s

    @property
    def period(self) -> Array:
        """The torque of one measured period, (period_samples,), N m."""
        return self.torque[self.first_sample : self.first_sample + self.period_samples]

    @property
    def crest_factor(self) -> float:
        """Largest over effective torque of a period; 1 for a binary signal."""
        return float(np.max(np.abs(self.period)) / np.sqrt(np.mean(self.period**2)))


def finish(
    kind: str,
    period: Array,
    repeats: int,
    sample_period_s: float,
    band_hz: tuple[float, float],
    parameters: Mapping[str, float],
    *,
    torque_step_nm: float = 0.0,
    lines: tuple[int, ...] = (),
) -> Excitation:
    """The record of a periodic torque that leaves a free axis where it was.

    The mean is taken away; without that the cart drifts in open loop.  The period is rotated so that its integral, the momentum,
    starts as near as a sample allows to its own mean; one sample before the run-in brings in the rest and one after the last period
    takes it out again.  So a frictionless rigid axis has no mean speed in any period and ends at rest, and the belt alone decides how
    long the run-in must be.

    Parameters
    ----------
    kind : str
        Of the signal.
    period : ndarray (n,), N m
    repeats : int
        Measured periods.
    sample_period_s : float, s
    band_hz : tuple of float, Hz
        That is excited.
    parameters : mapping of str to float
        Of the signal, by name.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none. The momentum is rounded instead of the torque, because what is taken away as
        mean is smaller than a step and would be lost: the torque then has at most one step more than asked for.
    lines : tuple of int
        Excited ones; () where all are.

    Raises
    ------
    UsageError
        For values that are no signal.

    References
    ----------
    thesis.md, erratum 10.
    """
    if repeats < 1:
        raise UsageError(f"{repeats} measured periods: at least 1 must be")
    peak_to_peak = float(np.ptp(period))
    if not peak_to_peak > 0 or not sample_period_s > 0 or torque_step_nm < 0:
        raise UsageError(
            f"peak to peak {peak_to_peak} N m, sample period {sample_period_s} s, torque step {torque_step_nm} N m: "
            "the first two must be positive, the step not negative"
        )
    if torque_step_nm > peak_to_peak / 2:
        raise UsageError(
            f"the amplitude ±{peak_to_peak / 2:.4g} N m is below one torque step of the drive, {torque_step_nm:.4g} N m; "
            f"ask for at least {2 * torque_step_nm:.4g} N m from peak to peak"
        )
    period, start = _rotated_to_mean_momentum(period - period.mean())
    if torque_step_nm > 0:
        period, start = _in_steps(period, start, torque_step_nm)
    rest = round(REST_BEFORE_S / sample_period_s)
    after = np.zeros(round(REST_AFTER_S / sample_period_s))
    torque = np.concatenate((np.zeros(rest), [start], np.tile(period, RUN_IN_PERIODS + repeats), [-start], after))
    return Excitation(
        kind=kind,
        torque=torque,
        period_samples=len(period),
        repeats=repeats,
        amplitude_nm=float(np.max(np.abs(torque))),
        sample_period_s=sample_period_s,
        first_sample=rest + 1 + RUN_IN_PERIODS * len(period),
        band_hz=band_hz,
        parameters={**parameters, "run_in_periods": RUN_IN_PERIODS, "torque_step_nm": torque_step_nm},
        lines=lines,
    )


def _rotated_to_mean_momentum(period: Array) -> tuple[Array, float]:
    """The period begun where its running sum is nearest to the sum's mean, and the torque of one sample still missing."""
    momentum = np.concatenate(([0.0], np.cumsum(period)[:-1]))
    above_mean = momentum - momentum.mean()
    start = int(np.argmin(np.abs(above_mean)))
    return np.roll(period, -start), float(above_mean[start])


def _in_steps(period: Array, start: float, step_nm: float) -> tuple[Array, float]:
    """Period and lead-in in whole steps; their running sum never leaves the exact one by more than half a step."""
    # The sum of a period is zero, so it ends on the level it began with: said here and not left to rounding.
    momentum = np.concatenate(([start], start + np.cumsum(period)[:-1], [start]))
    levels = np.rint(momentum / step_nm) * step_nm
    return np.diff(levels), float(levels[0])
