"""The whitened residual over frequency, of all samples or of some, and the part of it that lies in a band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from beltcomm.arrays import Array, BoolArray
from beltcomm.laboratory.samples import Judged

#: Bands over all frequencies.
BANDS = 96


@dataclass(frozen=True)
class GridRow:
    """Samples of one stretch on their grid of time.

    Attributes
    ----------
    at : ndarray of int
        Place of each of its samples, (n,).
    length : int
        Of the grid.
    step_s : float
        Of it.
    """

    at: NDArray[np.intp]
    length: int
    step_s: float


def rows_of(judged: Sequence[Judged]) -> tuple[GridRow, ...]:
    """Grid in time of each segment: which places of it are counted, and its step.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their residuals.

    Returns
    -------
    tuple of GridRow
        One for each segment, in their order.
    """
    rows = []
    for item in judged:
        piece = item.piece
        rows.append(
            GridRow(piece.value_samples // piece.group, piece.motion.samples // piece.group + 1, piece.group * piece.motion.sample_s)
        )
    return tuple(rows)


def edges_of(rows: Sequence[GridRow]) -> Array:
    """Edges of the bands, Hz: up to half the rate of the fastest segment.

    Parameters
    ----------
    rows : sequence of GridRow
        One for each segment.

    Returns
    -------
    ndarray (``BANDS`` + 1,), Hz
        Equally wide.
    """
    return np.asarray(np.linspace(0.0, 0.5 / min(row.step_s for row in rows), BANDS + 1))


def power(rows: Sequence[GridRow], values: Array, edges: Array, chosen: BoolArray | None = None) -> Array:
    """Mean power by band, 1 at the noise, nan where nothing tells.

    Parameters
    ----------
    rows : sequence of GridRow
        One for each segment.
    values : ndarray
        Whitened, of all rows behind each other or of the first.
    edges : ndarray (k + 1,), Hz
        Of the bands.
    chosen : ndarray of bool or None
        Samples that count.
    """
    total, weight = np.zeros((2, len(edges) - 1))
    for row, own, mask in _each(rows, values, chosen):
        count = int(mask.sum())
        if not count:
            continue
        length = next_fast_len(row.length, real=True)
        grid = np.zeros(length)
        grid[row.at] = own * mask
        lines = np.abs(np.fft.rfft(grid)) ** 2 / count
        number = np.searchsorted(edges, np.fft.rfftfreq(length, row.step_s), side="right") - 1
        number = np.clip(number, 0, len(edges) - 2)
        there = np.bincount(number, minlength=len(edges) - 1)
        total += count * np.bincount(number, lines, minlength=len(edges) - 1) / np.maximum(there, 1)
        weight += count * (there > 0)
    return np.asarray(np.where(weight > 0.0, total / np.maximum(weight, 1.0), np.nan))


def filtered(rows: Sequence[GridRow], values: Array, low_hz: float, high_hz: float) -> Array:
    """The part of the values that lies in a band, sample by sample.

    Parameters
    ----------
    rows : sequence of GridRow
        One for each segment.
    values : ndarray (n,)
        Of all rows behind each other.
    low_hz, high_hz : float, Hz
        The band.

    Returns
    -------
    ndarray (n,)
        In their unit.
    """
    parts = []
    for row, own, _ in _each(rows, values, None):
        length = next_fast_len(row.length, real=True)
        grid = np.zeros(length)
        grid[row.at] = own
        spectrum = np.fft.rfft(grid)
        freq = np.fft.rfftfreq(length, row.step_s)
        spectrum[(freq < low_hz) | (freq > high_hz)] = 0.0
        parts.append(np.fft.irfft(spectrum, length)[row.at])
    return np.concatenate(parts)


def _each(rows: Sequence[GridRow], values: Array, chosen: BoolArray | None) -> list[tuple[GridRow, Array, BoolArray]]:
    """Each row that the values reach, with its own of them and of the choice."""
    found, begin = [], 0
    for row in rows:
        end = begin + len(row.at)
        if end > len(values):
            break
        found.append((row, values[begin:end], np.ones(len(row.at), dtype=np.bool_) if chosen is None else chosen[begin:end]))
        begin = end
    return found
