"""What every simulation of the benchmark is held to, and the record that it makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ACCURACY = 1e-4
PERIOD_S = 1e-3
SAMPLES = 250
#: Ours simulates so many times as long: a record of 10 s, as axes are identified with; the others need seconds for a quarter of one.
LONGER = 40
SPEED_M_S = 1.0


def error(found: Array, true: Array) -> float:
    """Largest difference in parts of the largest deviation from the mean, the worse of the two columns."""
    swing = np.max(np.abs(true - true.mean(axis=0)), axis=0)
    return float(np.max(np.abs(found - true) / swing)) if np.all(np.isfinite(found)) else np.inf
