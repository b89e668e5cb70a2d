"""Types of arrays, root mean square, decibels and row means of one, its spread that outliers do not move, and the runs of a mask."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
#: Numbers of any type, or texts: a column as a file has it.
Column = NDArray[Any]


def rms(values: Array) -> float:
    """Root mean square.

    Parameters
    ----------
    values : ndarray
        Of any unit; one at least.
    """
    return float(np.sqrt(np.mean(values**2)))


def decibels(ratio: Array | ComplexArray) -> Array:
    """Size of a ratio, dB.

    Parameters
    ----------
    ratio : ndarray of float or complex
        None of them 0.

    Returns
    -------
    ndarray
        20 log10 of their sizes.
    """
    return 20.0 * np.log10(np.abs(ratio))


def robust_deviation(values: Array) -> float:
    """Standard deviation of normal numbers about 0, by the median of their sizes.

    Parameters
    ----------
    values : ndarray (n,)
        Of any unit.

    Returns
    -------
    float
        1.4826 times the median of their sizes, in their unit.
    """
    return 1.4826 * float(np.median(np.abs(values)))


def row_means(rows: Array) -> Array:
    """Mean of each row of a few values.

    Parameters
    ----------
    rows : ndarray (..., k)
        Of any unit.

    Returns
    -------
    ndarray (...)
        By a product: numpy's own mean takes ten times as long over few columns.
    """
    number = rows.shape[-1]
    return np.asarray((rows.reshape(-1, number) @ np.full(number, 1.0 / number)).reshape(rows.shape[:-1]))


def later(values: Array, samples: int) -> Array:
    """Values so many samples later.

    Parameters
    ----------
    values : ndarray (n,)
    samples : int
        0 to n.

    Returns
    -------
    ndarray (n,)
        The first value before.
    """
    return np.concatenate((np.full(samples, values[0]), values[: len(values) - samples])) if samples else values


def runs_of(mask: BoolArray) -> list[tuple[int, int]]:
    """First row, and the row behind the last, of each run of True.

    Parameters
    ----------
    mask : ndarray of bool (n,)
        Of the rows.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
