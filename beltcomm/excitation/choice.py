"""Which signal of a kind shows a band of frequencies in a given time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import floor
from typing import Final, Literal, Protocol

from scipy.fft import next_fast_len

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation.binary import ZERO_OVER_HIGHEST, choose_prbs
from beltcomm.excitation.random_binary import GprbsChoice
from beltcomm.excitation.record import (
    FEWEST_REPEATS,
    LOWEST_OVER_LINE,
    REST_AFTER_S,
    REST_BEFORE_S,
    WIDEST_LINE_SPACING_HZ,
    Excitation,
    check_band,
)
from beltcomm.excitation.sines import MultisineChoice
from beltcomm.excitation.sweep import ChirpChoice

ExcitationKind = Literal["prbs", "gprbs", "chirp", "multisine"]
KINDS: Final[Sequence[ExcitationKind]] = ("prbs", "gprbs", "chirp", "multisine")
#: Highest frequency excited over highest to be seen: half an octave, for the upper flank of a resonance.
ABOVE_HIGHEST = math.sqrt(2.0)
#: Share of half the sampling frequency up to which a band may go.
UP_TO_NYQUIST = 0.95
#: Lowest frequency of a chirp or multisine over lowest to be seen: the rigid slope; lower lines only move the carriage.
BELOW_LOWEST = 0.2


class Choice(Protocol):
    """A signal but for its amplitude."""

    @property
    def repeats(self) -> int:
        """Measured periods."""
        ...

    @property
    def reason(self) -> str:
        """In words, why this one."""
        ...

    def excitation(self, amplitude_nm: float, sample_period_s: float, *, torque_step_nm: float = 0.0) -> Excitation:
        """The record with this amplitude, N m.

        Parameters
        ----------
        amplitude_nm : float, N m, motor shaft
            About the mean.
        sample_period_s : float, s
            Sampling period.
        torque_step_nm : float, N m
            Resolution of the drive's torque setpoint, 0 for none.

        Returns
        -------
        Excitation
            The record, ready to be run.
        """
        ...


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
        Sampling period.
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
    if kind not in KINDS:
        raise UsageError(f"there is no excitation {kind!r}; choose {', '.join(KINDS)}")
    check_band(sample_period_s, lowest_hz, highest_hz, duration_s)
    nyquist_hz = 0.5 / sample_period_s
    spacing_hz = min(lowest_hz / LOWEST_OVER_LINE / (2.0 if kind == "multisine" else 1.0), WIDEST_LINE_SPACING_HZ)
    period = next_fast_len(math.ceil(1.0 / (spacing_hz * sample_period_s)), real=True)
    left_s = duration_s - REST_BEFORE_S - REST_AFTER_S - 2.0 * sample_period_s
    repeats = floor(left_s / (period * sample_period_s) + 1e-9) - 1
    if repeats < FEWEST_REPEATS:
        raise Refused(
            f"{duration_s:.3g} s are too short for one period of run-in and {FEWEST_REPEATS} measured periods of "
            f"{period * sample_period_s:.3g} s; allow {duration_s - left_s + (1 + FEWEST_REPEATS) * period * sample_period_s:.3g} s or "
            f"raise the lowest frequency above {lowest_hz:.3g} Hz"
        )
    band = (
        max(BELOW_LOWEST * lowest_hz, 1.0 / (period * sample_period_s)),
        min(ABOVE_HIGHEST * highest_hz, UP_TO_NYQUIST * nyquist_hz),
    )
    words = f"lines every {1.0 / (period * sample_period_s):.3g} Hz, {repeats} measured periods of {period * sample_period_s:.3g} s"
    if kind == "gprbs":
        hold = max(2.0, 1.0 / (ZERO_OVER_HIGHEST * highest_hz * sample_period_s))
        return GprbsChoice(period, hold, repeats, f"sign kept for {hold:.3g} samples on average, {words}", seed)
    shown = f"{band[0]:.3g} to {band[1]:.4g} Hz, {words}"
    return ChirpChoice(period, band, repeats, shown) if kind == "chirp" else MultisineChoice(period, band, repeats, shown, seed)
