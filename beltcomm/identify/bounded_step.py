"""A Newton step inside bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def bounded_step(information: Array, gradient: Array, move: NDArray[np.bool_], low: Array, high: Array) -> Array:
    """Newton step of the unknowns that may move; those that would leave their bounds stop there, and the rest make up for it."""
    step, move = np.zeros(len(gradient)), move.copy()
    while np.any(move):
        pull = gradient[move] + information[np.ix_(move, ~move)] @ step[~move]
        step[move] = -np.linalg.solve(information[np.ix_(move, move)], pull)
        outside = move & ((step < low) | (step > high))
        if not np.any(outside):
            break
        step[outside] = np.clip(step, low, high)[outside]
        move &= ~outside
    return step
