"""Types of arrays, and the spread of one that outliers do not move."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
#: Numbers of any type, or texts: a column as a file has it.
Column = NDArray[Any]


def robust_deviation(values: Array) -> float:
    """Standard deviation of normal numbers about 0, by the median of their sizes."""
    return 1.4826 * float(np.median(np.abs(values)))
