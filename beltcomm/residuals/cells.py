"""The residual of all records in cells: neighbouring samples of one record at nearly one angle, few enough to be drawn and linked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.laboratory.samples import Judged, motor_angle, motor_speed

#: Samples and turns of the motor in a cell at most, and cells that a page is given; where there would be more both grow.
SAMPLES, TURNS, MOST = 10, 1.0 / 128.0, 16_000
#: Coordinates along which a residual is shown, in the order of the page.
COORDINATES = ("time", "position", "speed", "angle", "torque")


@dataclass(frozen=True)
class Cells:
    """Means of cells, (cells,) each.

    Attributes
    ----------
    record : ndarray of int
        Number among ``names``.
    time : ndarray, s
        Session's clock.
    position : ndarray
        m (rad without a carriage).
    speed : ndarray
        The same per s, with its sign.
    angle : ndarray
        rad of the motor within its turn.
    torque : ndarray, of the motor
    more : ndarray
        Measured minus model's torque.
    square : ndarray
        Of the whitened residual, 1 at the noise.
    count : ndarray
        Samples.
    of : ndarray of int
        Cell of every sample that counts, fitted records first, (n,).
    """

    names: tuple[str, ...]
    record: NDArray[np.intp]
    time: Array
    position: Array
    speed: Array
    angle: Array
    torque: Array
    more: Array
    square: Array
    count: Array
    of: NDArray[np.intp]

    def mean(self, samples: Array) -> Array:
        """Mean over each cell of the first samples, as many as there are, (cells,); 0 in cells without any."""
        number = len(self.count)
        cell = self.of[: len(samples)]
        return np.asarray(np.bincount(cell, samples, minlength=number) / np.maximum(np.bincount(cell, minlength=number), 1))

    def sums(self, samples: Array) -> Array:
        """Sum over each cell of the first samples, as many as there are, (cells,)."""
        return np.asarray(np.bincount(self.of[: len(samples)], samples, minlength=len(self.count)))


def cells_of(judged: Sequence[Judged]) -> Cells:
    """Cells of all records.

    Parameters
    ----------
    judged : sequence of Judged
        In the order of the fit, held-out ones behind.
    """
    names = tuple(dict.fromkeys(j.piece.record for j in judged))
    grain = 1.0
    while True:
        of = _cell_numbers(judged, grain)
        if len(of) == 0 or of[-1] < MOST:
            break
        grain *= max(1.3, 0.8 * (of[-1] + 1) / MOST)
    count = np.bincount(of).astype(np.float64)

    def mean(parts: Sequence[NDArray[np.floating[Any]]]) -> Array:
        return np.asarray(np.bincount(of, np.concatenate(parts)) / count)

    angles = [motor_angle(j) for j in judged]
    wave = mean([np.cos(angle) for angle in angles]), mean([np.sin(angle) for angle in angles])
    first = np.flatnonzero(np.diff(of, prepend=-1))
    record = np.concatenate([np.full(len(j.white), names.index(j.piece.record), dtype=np.intp) for j in judged])
    return Cells(
        names,
        record[first],
        mean([j.piece.motion.time_s + j.piece.motion.sample_s * j.piece.value_samples for j in judged]),
        mean([angle * j.ratio_m_rad for angle, j in zip(angles, judged, strict=True)]),
        mean([motor_speed(j) * j.ratio_m_rad for j in judged]),
        np.mod(np.arctan2(wave[1], wave[0]), 2.0 * np.pi),
        mean([j.piece.torque[j.piece.value_samples] for j in judged]),
        mean([-j.torque for j in judged]),
        mean([j.white**2 for j in judged]),
        count,
        of,
    )


def _cell_numbers(judged: Sequence[Judged], grain: float) -> NDArray[np.intp]:
    """Number of the cell of every sample: a new one after so many samples, so much of a turn, at a turn back and at a gap."""
    numbers, begin = [], 0
    for item in judged:
        if not len(item.white):
            continue
        at = item.piece.value_samples
        step = np.floor(at / (SAMPLES * grain))
        turn = np.floor(motor_angle(item) / (2.0 * np.pi * TURNS * grain))
        way = motor_speed(item) > 0.0
        new = (np.diff(step) != 0) | (np.diff(turn) != 0) | (np.diff(way.astype(int)) != 0)
        numbers.append(begin + np.concatenate(([0], np.cumsum(new))))
        begin = int(numbers[-1][-1]) + 1
    return np.concatenate(numbers).astype(np.intp) if numbers else np.zeros(0, dtype=np.intp)
