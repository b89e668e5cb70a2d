"""Excitation as a person asks for it, in place of what would be chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation.binary import MAXIMAL_TAPS, PrbsChoice, prbs_band
from beltcomm.excitation.choice import Choice
from beltcomm.excitation.record import FEWEST_REPEATS, REST_AFTER_S, REST_BEFORE_S
from beltcomm.given import ExcitationKind

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
        """Raise Refused where the limits allow less than is asked for.

        Parameters
        ----------
        found_nm : float, N m
            That they allow.
        binds : str
            What allows no more.
        """
        if self.amplitude_nm is None or found_nm >= (1.0 - 1e-3) * self.amplitude_nm:
            return
        what = "what the records so far allow to go on to" if binds == "step" else f"the limit on {binds}"
        raise Refused(
            f"±{self.amplitude_nm:g} N m is asked for, but {what} allows only ±{found_nm:.3g} N m of this sequence at this place; ask for "
            "less, or for a shorter bit or a lower order, which go less far"
        )

    def seconds(self) -> float | None:
        """Length of the whole record.

        Returns
        -------
        float or None, s
            None where it does not follow from what is asked for.
        """
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
