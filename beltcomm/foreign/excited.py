"""The experiment that setpoints in a log show: an excitation by its period, where it begins and how large it is, or a friction sweep."""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array, BoolArray, runs_of
from beltcomm.recording.sidecar import ExcitationNote

#: A period is at least so long; fewer samples are a square wave.
_SHORTEST = 64
#: More candidates than these are not tried.
_CANDIDATES = 12
#: Levels of a switched signal around its offset, ends and rest included.
_SWITCHED = 4


def excitation_of(setpoint: Array) -> ExcitationNote | None:
    """Kind, period and first sample of a setpoint that repeats exactly at least twice; None when it does not.

    Parameters
    ----------
    setpoint : ndarray (n,)
        As it was sent, so that equal samples are equal numbers. The first period, in which the axis still swings in, is left out where
        three or more are there.
    """
    moves = np.flatnonzero(np.diff(setpoint)) + 1
    if len(moves) < 10:
        return None
    first, last = int(moves[0]), int(moves[-1])
    excited = setpoint[first : last + 1]
    if len(excited) < 2 * _SHORTEST:
        return None
    best: tuple[int, int, int] | None = None  # samples that repeat, where they begin, period
    for period in _likely_periods(excited):
        begin, run = _longest_run(excited[period:] == excited[:-period])
        if run >= period and (best is None or run + period > 1.05 * best[0]):
            best = run + period, begin, period
    if best is None:
        return None
    length, begin, period = best
    begins = first + begin + (period if length >= 3 * period else 0)
    block = setpoint[first + begin : first + begin + period]
    switched = len(np.unique(block)) <= _SWITCHED
    return ExcitationNote("prbs" if switched else "multisine", float(np.abs(excited).max()), period, begins)


def is_sweep(reference_velocity: Array | None) -> bool:
    """True for a speed that was asked for and rests most of the time on two or more levels that are not zero: a friction sweep.

    Parameters
    ----------
    reference_velocity : ndarray (n,) or None
        In any unit; None where nobody asked for a speed.
    """
    if reference_velocity is None or not reference_velocity.any():
        return False
    largest = float(np.abs(reference_velocity).max())
    level = np.round(reference_velocity / (0.005 * largest))
    rests = (np.diff(level, prepend=level[0]) == 0.0) & (np.abs(level) > 1.0)
    _, counts = np.unique(np.abs(level[rests]), return_counts=True)
    long = counts[counts >= 0.02 * len(level)]
    return len(long) >= 2 and bool(long.sum() > 0.5 * len(level))


def _likely_periods(excited: Array) -> list[int]:
    """Lags at which the autocorrelation has its highest peaks, shortest first."""
    centred = excited - excited.mean()
    size = 1 << int(np.ceil(np.log2(2 * len(centred))))
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[: len(centred)]
    lags = np.arange(len(centred))
    share = correlation / np.maximum(len(centred) - lags, 1) / max(float(correlation[0]) / len(centred), 1e-300)
    usable = lags[_SHORTEST : len(centred) // 2 + 1]
    peaks = [int(k) for k in usable if share[k] > 0.7 and share[k] >= share[k - 1] and (k + 1 >= len(share) or share[k] >= share[k + 1])]
    return sorted(sorted(peaks, key=lambda k: -share[k])[:_CANDIDATES])


def _longest_run(equal: BoolArray) -> tuple[int, int]:
    """Start and length of the longest run of True."""
    start, end = max(runs_of(equal), key=lambda run: run[1] - run[0], default=(0, 0))
    return start, end - start
