"""A torque that changes inside the sampling period: how what is reported, the mean, is spread over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """In the first ``share`` of each period what acted before still acts, by ``step`` higher than in the rest; (n,), N m."""

    share: float
    step: Array

    def cells(self, torque: Array, per_sample: int) -> Array:
        """Mean over each of so many cells of a period, (n*per_sample,), N m.   torque : (n,), N m, mean over each period."""
        old = np.clip(self.share * per_sample - np.arange(per_sample), 0.0, 1.0)
        return np.asarray((torque[:, None] + self.step[:, None] * (old - self.share)).reshape(-1))

    def triangular(self) -> Array:
        """By how much the mean with the triangular weight around a sample is higher than of an even spread, (n,), N m, ends 0.

        ∫_0^1 u x du of the period before and ∫_0^1 (1-u) x du of that behind a sample, x the spread around its mean.
        """
        more = np.zeros(len(self.step))
        more[1:-1] = 0.5 * self.share * (1.0 - self.share) * (self.step[1:-1] - self.step[:-2])
        return more
