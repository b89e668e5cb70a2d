"""A torque that changes inside the sampling period: how its mean is spread over the period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array

#: Cells of a sampling period in which a torque is given; every number of fine steps a sample divides it.
CELLS = 32


@dataclass(frozen=True)
class Intersample:
    """Torque less its mean over the period, in each of :data:`CELLS` cells, (n, CELLS), N m at the motor; the rows' means are 0."""

    above: Array

    def part(self, rows: slice) -> Intersample:
        """Some of the samples, as an own value."""
        return Intersample(self.above[rows])

    def cells(self, torque: Array, per_sample: int) -> Array:
        """Mean over each of so many cells of a period, (n*per_sample,), N m.

        Parameters
        ----------
        torque : ndarray (n,), N m
            Mean over each period.
        """
        above = self.above.reshape(len(torque), per_sample, -1).mean(axis=2) if per_sample < CELLS else self.above
        return np.asarray((torque[:, None] + above).reshape(-1))

    def triangular(self) -> Array:
        """By how much the mean with the triangular weight around a sample is higher than of an even spread, (n,), N m, ends 0.

        ∫_0^1 u x du of the period before and ∫_0^1 (1-u) x du of that behind a sample, x the spread around its mean.
        """
        rising = self.above @ ((np.arange(CELLS) + 0.5) / CELLS**2)
        more = np.zeros(len(self.above))
        more[1:-1] = rising[:-2] - rising[1:-1]
        return more
