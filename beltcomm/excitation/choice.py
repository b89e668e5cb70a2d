"""Choice of the signal that shows a band of frequencies in a given time, and the one that a person asks for in its place."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import floor
from typing import Any

from scipy.fft import next_fast_len

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation.binary import MAXIMAL_TAPS, ZERO_OVER_HIGHEST, PrbsChoice, choose_prbs, gprbs, prbs_band
from beltcomm.excitation.record import (
    FEWEST_REPEATS,
    LOWEST_OVER_LINE,
    REST_AFTER_S,
    REST_BEFORE_S,
    WIDEST_LINE_SPACING_HZ,
    Excitation,
    RecordTooShort,
    check_band,
)
from beltcomm.excitation.sines import chirp, multisine
from beltcomm.given import EXCITATION_KINDS, ExcitationKind

#: Highest frequency excited over highest to be seen: half an octave, for the upper flank of a resonance.
ABOVE_HIGHEST = math.sqrt(2.0)
#: Share of half the sampling frequency up to which a band may go.
UP_TO_NYQUIST = 0.95
#: Lowest frequency of a chirp or multisine over lowest to be seen: the rigid slope; lower lines only move the carriage.
BELOW_LOWEST = 0.2


@dataclass(frozen=True)
class PeriodicChoice:
    """A signal but for its amplitude, the number of its measured periods, and in words why this one.

    Attributes
    ----------
    signal : callable
        (amplitude N m at the motor shaft, sampling period s, measured periods, ``torque_step_nm``) to the excitation.
    """

    signal: Callable[..., Excitation]
    repeats: int
    reason: str

    def excitation(self, amplitude_nm: float, sample_period_s: float, *, torque_step_nm: float = 0.0) -> Excitation:
        """The record with an amplitude.

        Parameters
        ----------
        amplitude_nm : float, N m, motor shaft
            About the mean.
        sample_period_s : float, s
        torque_step_nm : float, N m
            In which the drive takes torque; 0 for none.
        """
        return self.signal(amplitude_nm, sample_period_s, self.repeats, torque_step_nm=torque_step_nm)


Choice = PrbsChoice | PeriodicChoice


def choose(
    kind: ExcitationKind, sample_period_s: float, lowest_hz: float, highest_hz: float, duration_s: float, *, seed: int = 1
) -> Choice:
    """The signal of a kind that shows ``lowest_hz`` to ``highest_hz`` within ``duration_s``, run-in and rest included.

    Lines lie no further apart than a tenth of the lowest frequency and 1 Hz; of a multisine, where every second one is silent, than a
    twentieth and 1 Hz.

    Parameters
    ----------
    kind : ExcitationKind
        Of signal.
    sample_period_s : float, s
    lowest_hz : float, Hz
        Lowest antiresonance expected.
    highest_hz : float, Hz
        Highest resonance expected.
    duration_s : float, s
        The whole record.
    seed : int
        Of what is random in it.

    Returns
    -------
    Choice
        It makes the record for an amplitude.

    Raises
    ------
    UsageError
        For an unknown kind or numbers that cannot be meant.
    Refused
        When sampling or duration do not reach.
    """
    if kind == "prbs":
        return choose_prbs(sample_period_s, lowest_hz, highest_hz, duration_s)
    if kind not in EXCITATION_KINDS:
        raise UsageError(f"there is no excitation {kind!r}; choose {', '.join(EXCITATION_KINDS)}")
    check_band(sample_period_s, lowest_hz, highest_hz, duration_s)
    nyquist_hz = 0.5 / sample_period_s
    spacing_hz = min(lowest_hz / LOWEST_OVER_LINE / (2.0 if kind == "multisine" else 1.0), WIDEST_LINE_SPACING_HZ)
    period = next_fast_len(math.ceil(1.0 / (spacing_hz * sample_period_s)), real=True)
    left_s = duration_s - REST_BEFORE_S - REST_AFTER_S - 2.0 * sample_period_s
    repeats = floor(left_s / (period * sample_period_s) + 1e-9) - 1
    if repeats < FEWEST_REPEATS:
        raise RecordTooShort(duration_s, left_s, period * sample_period_s, lowest_hz)
    band = (
        max(BELOW_LOWEST * lowest_hz, 1.0 / (period * sample_period_s)),
        min(ABOVE_HIGHEST * highest_hz, UP_TO_NYQUIST * nyquist_hz),
    )
    words = f"lines every {1.0 / (period * sample_period_s):.3g} Hz, {repeats} measured periods of {period * sample_period_s:.3g} s"
    if kind == "gprbs":
        hold = max(2.0, 1.0 / (ZERO_OVER_HIGHEST * highest_hz * sample_period_s))
        return PeriodicChoice(partial(gprbs, period, hold, seed=seed), repeats, f"sign kept for {hold:.3g} samples on average, {words}")
    signal = partial(chirp, period, *band) if kind == "chirp" else partial(multisine, period, *band, seed=seed)
    return PeriodicChoice(signal, repeats, f"{band[0]:.3g} to {band[1]:.4g} Hz, {words}")


#: Samples of a record, three hours at 1 kHz, and measured periods: more are a mistake in a unit, or no excitation that anybody waits for.
MOST_SAMPLES, MOST_PERIODS = 10_000_000, 1000


@dataclass(frozen=True)
class AskedExcitation:
    """None: as it would be chosen.

    Attributes
    ----------
    order : int or None
        n of a PRBS (3.1).
    bit_s : float or None, s
        Of a bit of a PRBS, P T_s of (3.4).
    amplitude_nm : float or None, N m, motor shaft
        Largest torque: the sequence is ± this.
    periods : int or None
        Measured ones, the run-in not counted.
    """

    order: int | None = None
    bit_s: float | None = None
    amplitude_nm: float | None = None
    periods: int | None = None

    @property
    def shape(self) -> bool:
        """True if the sequence itself is asked for."""
        return self.order is not None or self.bit_s is not None

    def check(self, kind: ExcitationKind, sample_period_s: float, torque_step_nm: float, largest_nm: float) -> None:
        """Refuse, before anything moves, what no drive or sequence can do.

        Parameters
        ----------
        kind : ExcitationKind
            Of the sequence.
        sample_period_s : float, s
            Of drive and record.
        torque_step_nm, largest_nm : float, N m, motor shaft
            Step of the drive's torque, and the most that motor, pulley and heat allow.

        Raises
        ------
        UsageError
        Refused
            With the limit.
        """
        if self.shape and kind != "prbs":
            raise UsageError(f"order and clock are those of a PRBS, and {kind} is asked for; leave one of them out")
        if self.order is not None and self.order not in MAXIMAL_TAPS:
            raise UsageError(f"a PRBS of order {self.order} is not available; choose an order from 3 to 16")
        if self.bit_s is not None:
            bits = self.bit_s / sample_period_s
            if bits < 0.999 or abs(bits - round(bits)) > 1e-3 * bits:
                raise UsageError(
                    f"a bit of {1e3 * self.bit_s:.4g} ms is no whole number of samples of {1e3 * sample_period_s:.4g} ms; "
                    f"ask for {1e3 * max(1, round(bits)) * sample_period_s:.4g} ms"
                )
        if self.periods is not None and self.periods < FEWEST_REPEATS:
            raise UsageError(f"{self.periods} measured periods do not tell the noise; ask for {FEWEST_REPEATS} or more")
        if self.periods is not None and self.periods > MOST_PERIODS:
            raise UsageError(f"{self.periods} measured periods are more than anybody waits for; ask for {MOST_PERIODS} or fewer")
        if (seconds := self.seconds()) is not None:
            _check_length(seconds, sample_period_s)
        if self.amplitude_nm is None:
            return
        if not self.amplitude_nm >= 2.0 * torque_step_nm or not self.amplitude_nm > 0.0:
            raise UsageError(
                f"±{self.amplitude_nm:g} N m is below two steps of the drive's torque, {2.0 * torque_step_nm:.3g} N m; ask for more"
            )
        if self.amplitude_nm > largest_nm:
            raise Refused(
                f"±{self.amplitude_nm:g} N m is more than motor, pulley and heat allow an excitation, {largest_nm:.3g} N m; ask for less"
            )

    def of(self, choice: Choice, sample_period_s: float) -> Choice:
        """A choice with what is asked for in its place.

        Parameters
        ----------
        choice : Choice
            As it would be made.
        sample_period_s : float, s
            Of drive and record.

        Returns
        -------
        Choice

        Raises
        ------
        UsageError
            For a record longer than any.
        """
        signal: Any = choice
        if isinstance(signal, PrbsChoice) and self.shape:
            order = signal.order if self.order is None else self.order
            clock = signal.clock if self.bit_s is None else round(self.bit_s / sample_period_s)
            line_hz, zero_hz = prbs_band(order, clock, sample_period_s)
            words = f"order {order}, clock {clock} as asked for: lines every {line_hz:.3g} Hz, excited up to {zero_hz:.4g} Hz"
            signal = replace(signal, order=order, clock=clock, reason=words)
        if self.periods is not None:
            signal = replace(signal, repeats=self.periods, reason=f"{signal.reason}; {self.periods} measured periods asked for")
        if isinstance(signal, PrbsChoice) and signal is not choice:
            _check_length((1 + signal.repeats) * (2**signal.order - 1) * signal.clock * sample_period_s, sample_period_s)
        made: Choice = signal
        return made

    def amplitude_of(self, found_nm: float, binds: str) -> None:
        """Check that the limits allow what is asked for.

        Parameters
        ----------
        found_nm : float, N m
            That they allow.
        binds : str
            What allows no more.

        Raises
        ------
        Refused
            Where they allow less.
        """
        if self.amplitude_nm is None or found_nm >= (1.0 - 1e-3) * self.amplitude_nm:
            return
        what = "what the records so far allow to go on to" if binds == "step" else f"the limit on {binds}"
        raise Refused(
            f"±{self.amplitude_nm:g} N m is asked for, but {what} allows only ±{found_nm:.3g} N m of this sequence at this place; ask for "
            "less, or for a shorter bit or a lower order, which go less far"
        )

    def seconds(self) -> float | None:
        """Length of the whole record, s; None where it does not follow from what is asked for."""
        if self.order is None or self.bit_s is None:
            return None
        periods = 1 + (self.periods or FEWEST_REPEATS)
        return REST_BEFORE_S + REST_AFTER_S + float(periods * (2**self.order - 1)) * self.bit_s


def _check_length(seconds: float, sample_period_s: float) -> None:
    if seconds > MOST_SAMPLES * sample_period_s:
        raise UsageError(
            f"the record would take {seconds / 3600.0:.3g} h, at most {MOST_SAMPLES * sample_period_s / 3600.0:.3g} h are made; ask for a "
            "shorter bit, a lower order or fewer periods"
        )


#: Nothing is asked for.
AS_CHOSEN = AskedExcitation()
