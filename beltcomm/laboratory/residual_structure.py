"""Structure of a residual: means of the whitened one over parts of the data, which noise cannot have.

    z = max over partitions of (Σ_b n_b mean_b² - B)/√(2 B),   B : bins of the partition with enough values

The rms of the whole says little of a small error that always has the same sign at the same place, speed or time; the means do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from beltcomm.arrays import Array, IntArray
from beltcomm.laboratory.samples import Judged, Samples, gather_samples

#: Widths of the bins: m, s, and factor of the speed.  None by torque: its own noise would sort the values.
PLACE_M, TIME_S, SPEED_FACTOR = 0.05, 10.0, 1.5
#: s, width of the Gaussian that a speed is smoothed with.
STEADY_S = 0.025
#: A bin with fewer values, and values beyond which one says no more, say little.
FEWEST, OUTLIER = 60, 5.0


def structure(judged: Sequence[Judged]) -> dict[str, float]:
    """z of the module by partition: speed, position, time and record, each by direction."""
    samples = replace(gather_samples(judged), speed=np.concatenate([steady_speed(item) for item in judged]))
    white = np.clip(samples.white, -OUTLIER, OUTLIER)
    return {name: excess(white, number) for name, number in partitions(samples).items()}


def steady_speed(item: Judged) -> Array:
    """Speed at the kept samples, length per second, smooth: by its own noise a stroke would be sorted into samples above and below."""
    motion = item.piece.motion
    smooth = gaussian_filter1d(motion.omega[:: motion.substeps], STEADY_S / motion.sample_s, mode="nearest")
    return np.asarray(smooth[item.piece.value_samples] * item.ratio_m_rad)


def partitions(samples: Samples) -> dict[str, IntArray]:
    """Number of the bin of every value."""
    forward = samples.speed > 0.0
    speed = np.floor(np.log(np.maximum(np.abs(samples.speed), 1e-6)) / np.log(SPEED_FACTOR)).astype(np.int64)
    place, time = np.floor(samples.position / PLACE_M).astype(np.int64), np.floor(samples.time / TIME_S).astype(np.int64)
    signed = {"speed": speed, "position": place, "time": time, "record": samples.record.astype(np.int64)}
    return {name: 2 * number + forward for name, number in signed.items()}


def excess(white: Array, number: IntArray) -> float:
    """(Σ n mean² - bins)/√(2 bins)."""
    _, bins = np.unique(number, return_inverse=True)
    count = np.bincount(bins)
    sums = np.bincount(bins, white)
    enough = count >= FEWEST
    if not enough.any():
        return 0.0
    squares = sums[enough] ** 2 / count[enough]
    return float((np.sum(squares) - len(squares)) / np.sqrt(2.0 * len(squares)))
