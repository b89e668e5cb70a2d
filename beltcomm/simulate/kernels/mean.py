"""Means of a load with the triangular weight of one sample before and after each sample."""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled

#: N m; a load beyond it, or none at all, comes from bodies that an absurd model let fly off: as bad as any.
ABSURD_NM = 1e12


def weighted_mean(fine: Array, middle: int, substeps: int) -> float:
    """Mean with weight 1 - |s| around one place of a fine grid, by Simpson's rule; ``substeps`` even.   At most ``ABSURD_NM``.

    The trapezoidal rule would take (2 pi f h)²/12 off, 0.02 % at 134 Hz and 16 kHz.
    """
    total = 2.0 * substeps * fine[middle]  # the end of one half and the beginning of the other
    for j in range(1, substeps):
        weight = 4.0 if j % 2 else 2.0
        total += weight * (substeps - j) * (fine[middle - j] + fine[middle + j])
    mean = total / (3.0 * (substeps * substeps))
    return float(mean) if abs(mean) < ABSURD_NM else ABSURD_NM


def triangular_mean(fine: Array, substeps: int) -> Array:
    """Triangular mean around every sample; (n*substeps - substeps + 1,) -> (n,), ends 0."""
    if substeps % 2:
        raise ValueError("Simpson's rule needs an even number of substeps")
    mean = np.zeros((len(fine) - 1) // substeps + 1)
    _triangular_mean(fine, substeps, mean)
    return mean


@compiled
def _triangular_mean(fine: Array, substeps: int, mean: Array) -> None:
    n = mean.shape[0]
    share = 1.0 / (3.0 * substeps * substeps)
    for k in range(1, n - 1):
        mean[k] = 2.0 * substeps * share * fine[k * substeps]
    for j in range(1, substeps):  # sample by sample would be a loop too short to be fast
        weight = (4.0 if j % 2 else 2.0) * (substeps - j) * share
        for k in range(1, n - 1):
            mean[k] += weight * (fine[k * substeps - j] + fine[k * substeps + j])
    for k in range(1, n - 1):
        if not abs(mean[k]) < ABSURD_NM:
            mean[k] = ABSURD_NM
