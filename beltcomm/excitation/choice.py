"""Choice of the signal of a kind that shows a band of frequencies in a given time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import floor

from scipy.fft import next_fast_len

from beltcomm.errors import UsageError
from beltcomm.excitation.binary import ZERO_OVER_HIGHEST, PrbsChoice, choose_prbs, gprbs
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
from beltcomm.excitation.sines import multisine
from beltcomm.excitation.sweep import chirp
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
        """The record with this amplitude, as :meth:`PrbsChoice.excitation`."""
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
