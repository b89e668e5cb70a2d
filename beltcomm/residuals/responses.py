"""Frequency responses of the excited records, measured and by the model, and the torque of a record over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.errors import DataError
from beltcomm.laboratory.samples import Judged, Units
from beltcomm.recording import ExcitationNote, Recording
from beltcomm.response import estimate_response

#: A line counts as excited from this share of the strongest on; the lowest ones hold the drift of the carriage.
LEAST_EXCITATION, FIRST_LINE = 0.05, 3
#: s, the mean that takes the encoder's rounding out of a record that is not excited.
MEAN_S = 0.02


@dataclass(frozen=True)
class ResponsePair:
    """One excited record.

    Attributes
    ----------
    measured : ComplexArray
        Torque to angle, rad/(N m), (k,) at freq_hz.
    model : ComplexArray
        The same angle over the torque that the model says it needed, so friction is in both as the record has it.
    radius : ndarray or None
        95 % of the measured one's noise.
    coherence : ndarray or None
        Of its periods; both None for a single period.
    cart_m : float
        Carriage at the start, m.
    amplitude_nm : float
        Largest torque of the excitation, as noted.
    units : Units
    """

    record: str
    held_out: bool
    cart_m: float
    amplitude_nm: float
    freq_hz: Array
    measured: ComplexArray
    model: ComplexArray
    radius: Array | None
    coherence: Array | None
    units: Units


def response_pairs(recordings: Sequence[Recording], judged: Sequence[Judged]) -> list[ResponsePair]:
    """The periodically excited records that have no gap, fitted ones first.

    Parameters
    ----------
    recordings : sequence of Recording
        Of the fit.
    judged : sequence of Judged
        Segments of these records, with their residuals.

    Returns
    -------
    list of ResponsePair
        Measured and by the model, rad/(N m) at the motor shaft.
    """
    found = []
    for recording in recordings:
        note = recording.sidecar.excitation
        parts = [j for j in judged if j.piece.record == recording.name]
        if note is None or not note.period_samples or len(parts) != 1 or len(parts[0].piece.torque) != len(recording.t_s):
            continue
        piece, period, first = parts[0].piece, note.period_samples, note.first_sample
        begins = note.period_starts or range(first, len(piece.torque) - period + 1, period)
        whole = np.array([start for start in begins if start + period <= len(piece.torque)], dtype=np.intp)
        if len(whole) < 1 or first < 1:
            continue
        each = whole[:, np.newaxis] + np.arange(period)
        torque, needed = _lines(piece.torque[each]), _lines((piece.torque + parts[0].whole)[each])
        turned = _lines(piece.position[each] - piece.position[each - 1])
        freq = np.asarray(np.fft.rfftfreq(period, recording.sample_period_s), dtype=np.float64)
        strong = np.abs(torque) > LEAST_EXCITATION * np.abs(torque[FIRST_LINE:]).max()
        lines = np.flatnonzero(strong & (np.arange(len(freq)) >= FIRST_LINE))
        z = np.exp(2j * np.pi * freq[lines] * recording.sample_period_s)
        angle = z / (z - 1.0) * turned[lines]
        found.append(
            ResponsePair(
                recording.name,
                recording.sidecar.held_out,
                recording.sidecar.start_position_m or 0.0,
                float(np.max(np.abs(piece.torque))) if note.amplitude_nm is None else note.amplitude_nm,
                freq[lines],
                angle / torque[lines],
                angle / needed[lines],
                *_noise(piece.torque, piece.position, recording.sample_period_s, note, freq[lines]),
                parts[0].units,
            )
        )
    return sorted(found, key=lambda pair: pair.held_out)


def _lines(periods: Array) -> ComplexArray:
    """Spectrum of the mean period."""
    return np.asarray(np.fft.rfft(periods.mean(axis=0)))


def _noise(torque: Array, position: Array, sample_s: float, note: ExcitationNote, freq_hz: Array) -> tuple[Array | None, Array | None]:
    """Noise and coherence of the measured response at these lines, nan where they are not known; None for a single period."""
    try:
        response = estimate_response(torque, position, sample_s, note.period_samples or 0, note.first_sample, starts=note.period_starts)
    except DataError:
        return None, None
    radius, coherence = np.full((2, len(freq_hz)), np.nan)
    _, here, there = np.intersect1d(freq_hz, response.freq_hz, return_indices=True)
    radius[here], coherence[here] = response.error_radius()[there], response.coherence[there]
    return radius, coherence


def below(response: ComplexArray) -> Array:
    """Phase in degrees, every one between -360 and 0: single lines that friction turns by half a turn must not shift all that follow.

    Parameters
    ----------
    response : ndarray of complex (k,)
        Of any unit.

    Returns
    -------
    ndarray (k,), deg
        Each line by itself.
    """
    return np.asarray(np.degrees(np.angle(-response)) - 180.0, dtype=np.float64)


@dataclass(frozen=True)
class Trace:
    """One record as a line of samples, gaps closed by nan.

    Attributes
    ----------
    t_s : ndarray
        From its start.
    measured, model : ndarray
        Torque in units of the axis.
    white : ndarray
        Residual over noise, nan where it does not count.
    excited : bool
        By a multisine or the like, so that every sample matters.
    """

    record: str
    held_out: bool
    t_s: Array
    measured: Array
    model: Array
    white: Array
    excited: bool
    units: Units

    @property
    def ratio(self) -> float:
        """rms of the residual over the noise."""
        return float(np.sqrt(np.nanmean(self.white**2)))


def trace_of(judged: Sequence[Judged], record: str, excited: bool) -> Trace:
    """Torque of a record, measured and by the model, its segments behind each other with a gap of nan between.

    Parameters
    ----------
    judged : sequence of Judged
        Of all records.
    record : str
        Name.
    excited : bool
        True if it is an excitation.

    Returns
    -------
    Trace
        Time from the record's first segment, s, torque, N m at the motor shaft, and whitened residual.
    """
    columns: list[list[Array]] = [[], [], [], []]
    held_out = False
    begin = min(j.piece.motion.time_s for j in judged if j.piece.record == record)
    for item in (j for j in judged if j.piece.record == record):
        piece = item.piece
        held_out = held_out or piece.held_out
        time = piece.motion.time_s - begin + piece.motion.sample_s * np.arange(len(piece.torque))
        white = np.full(len(piece.torque), np.nan)
        white[piece.value_samples] = item.white
        for column, values in zip(columns, (time, piece.torque, piece.torque + item.whole, white), strict=True):
            column.append(np.append(values, np.nan))
    joined = [np.concatenate(column) for column in columns]
    return Trace(
        record, held_out, joined[0], joined[1], joined[2], joined[3], excited, next(j.units for j in judged if j.piece.record == record)
    )


def compared(trace: Trace) -> tuple[Array, Array]:
    """Torque measured and by the model where it counts; means of ``MEAN_S`` for a record that is not excited.

    Parameters
    ----------
    trace : Trace
        Of one record.

    Returns
    -------
    tuple of ndarray (n,), N m
        Motor shaft; nan where nothing is compared.
    """
    known = np.isfinite(trace.white)
    if trace.excited:  # of its samples every second or fourth counts
        return trace.measured, np.where(_between(known), trace.model, np.nan)
    model = np.where(known, trace.model, np.nan)
    width = max(1, round(MEAN_S / float(np.nanmedian(np.diff(trace.t_s)))))
    return running_mean(np.where(known, trace.measured, np.nan), width), running_mean(model, width)


def _between(known: BoolArray) -> BoolArray:
    """Samples that count and those between two of them at their usual distance.

    At a reversal none counts: there friction takes any value up to its level, and the model jumps.
    """
    counted = np.flatnonzero(known)
    if len(counted) < 2:
        return known
    gaps = np.diff(counted)
    usual = int(np.bincount(gaps).argmax()) + 1
    edges = np.zeros(len(known) + 1)
    np.add.at(edges, counted[:-1][gaps <= usual], 1.0)
    np.add.at(edges, counted[1:][gaps <= usual] + 1, -1.0)
    return (np.cumsum(edges[:-1]) > 0.5) | known


def running_mean(values: Array, width: int) -> Array:
    """Running mean over the samples that are there: of grouped ones every second or fourth is.

    Parameters
    ----------
    values : ndarray (n,)
        nan where there is none.
    width : int
        Samples.

    Returns
    -------
    ndarray (n,)
        nan where less than half of the most is there.
    """
    known = np.isfinite(values)
    total = np.convolve(np.where(known, values, 0.0), np.ones(width), mode="same")
    count = np.convolve(known, np.ones(width), mode="same")
    return np.asarray(np.where(count > 0.5 * max(float(np.max(count, initial=0.0)), 1.0), total / np.maximum(count, 1.0), np.nan))
