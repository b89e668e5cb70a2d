"""A filter of the torque, or a limit of its slew rate: in a drive before the motor, or in its reading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled

#: A filter: of the drive's samples, or of continuous time and of first or second order, as a current loop is; or a limit of the slew rate.
Kind = Literal["sampled", "first order", "second order", "slew rate"]

#: Values of each kind: share that is new in each sample (0 to 1), time constant s, natural frequency Hz and damping ratio, N m/s at most.
VALUES: Mapping[Kind, tuple[str, ...]] = {
    "sampled": ("share",),
    "first order": ("time_s",),
    "second order": ("frequency_hz", "damping_ratio"),
    "slew rate": ("limit_nm_s",),
}


@dataclass(frozen=True)
class Lag:
    """A filter of the torque, 1 for a slow one, or a limit of its slew rate.

    Attributes
    ----------
    values : tuple of float
        See :data:`VALUES`.
    intervals : tuple of float
        Half widths at 95 %, () where not known.
    """

    kind: Kind
    values: tuple[float, ...]
    intervals: tuple[float, ...] = field(default=(), compare=False)

    def answer(self, cells: Array, sample_s: float) -> Array:
        """The lag's answer to the mean torque in each cell of every period, N m, (n, cells), at rest before."""
        if self.kind == "sampled":
            return _follow_samples(cells, self.values[0])
        u, h = np.ascontiguousarray(cells).reshape(-1), sample_s / cells.shape[1]
        if self.kind == "slew rate":
            means = _limit_slew(u, self.values[0] * h)
        elif self.kind == "first order":
            keeps = math.exp(-h / self.values[0])
            means = _follow_first_order(u, keeps, self.values[0] / h * (1.0 - keeps))
        else:
            means = _follow_second_order(u, *_held_second_order(self._roots(), h))
        return means.reshape(cells.shape)

    def poles(self, sample_s: float) -> tuple[complex, ...]:
        """Poles in the clock of the samples; none of a slew rate, which is not linear."""
        if self.kind == "sampled":
            return (1.0 - self.values[0],)
        if self.kind == "slew rate":
            return ()
        return tuple(complex(np.exp(root * sample_s)) for root in self._roots())

    def _roots(self) -> tuple[complex, ...]:
        """Poles in continuous time, 1/s."""
        if self.kind == "first order":
            return (-1.0 / self.values[0],)
        omega, ratio = math.tau * self.values[0], self.values[1]
        root = np.sqrt(complex(ratio**2 - 1.0))
        return -omega * (ratio + root), -omega * (ratio - root)

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque."""
        if self.kind == "slew rate":
            return 0.0
        if self.kind == "sampled":
            return sample_s * (1.0 / self.values[0] - 1.0)
        return self.values[0] if self.kind == "first order" else 2.0 * self.values[1] / (math.tau * self.values[0])


@compiled
def _limit_slew(u: Array, most: float) -> Array:
    """Mean over each cell of a torque that follows u, (n,), and changes by at most so much a cell."""
    out, y = np.empty_like(u), u[0]
    for i in range(len(u)):
        ahead = u[i] - y
        if abs(ahead) <= most:  # there within the cell, after the share |ahead|/most of it
            out[i] = y + ahead * (1.0 - 0.5 * abs(ahead) / most)
            y = u[i]
        else:
            step = most if ahead > 0.0 else -most
            out[i] = y + 0.5 * step
            y += step
    return out


@compiled
def _follow_samples(cells: Array, share: float) -> Array:
    """Cells of a torque that takes a share of the way to its command in every period."""
    out = cells.copy()
    for i in range(1, cells.shape[0]):
        for j in range(cells.shape[1]):
            out[i, j] = share * cells[i, j] + (1.0 - share) * out[i - 1, j]
    return out


@compiled
def _follow_first_order(u: Array, keeps: float, lags: float) -> Array:
    """Mean over each cell behind a first-order lag that keeps so much of a difference over one, and lags by so much of it in the mean."""
    out, y = np.empty_like(u), u[0]
    for i in range(len(u)):
        out[i] = u[i] + (y - u[i]) * lags
        y = keeps * y + (1.0 - keeps) * u[i]
    return out


@compiled
def _follow_second_order(u: Array, b: Array, a: Array) -> Array:
    """Mean over each cell behind a second-order lag, of :func:`_held_second_order`, taken as linear in it."""
    out, first = np.empty_like(u), u[0]
    x1, y1, y2 = 0.0, 0.0, 0.0
    for i in range(len(u)):
        x = u[i] - first
        y = b[0] * x + b[1] * x1 - a[1] * y1 - a[2] * y2
        out[i] = first + 0.5 * (y1 + y)
        x1, y1, y2 = x, y, y1
    return out


def _held_second_order(poles: tuple[complex, ...], h: float) -> tuple[Array, Array]:
    """Numerator and denominator in z⁻¹ of p1 p2/((s - p1)(s - p2)) behind a hold over h seconds, at the ends of the holds."""
    p1, p2 = poles
    if abs(p1 - p2) < 1e-6 * abs(p1):
        p2 = p1 * (1.0 + 1e-6)
    e1, e2 = np.exp(p1 * h), np.exp(p2 * h)
    r1, r2 = p2 / (p1 - p2), -p1 / (p1 - p2)
    first, second = 1.0 + r1 * e1 + r2 * e2, 1.0 + r1 * e1**2 + r2 * e2**2  # the step's answer after one and two holds
    a = np.real(np.array([1.0, -(e1 + e2), e1 * e2]))
    return np.array([float(np.real(first)), float(np.real(second)) - float(np.real(first)) * (1.0 - a[1])]), a
