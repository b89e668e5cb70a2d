"""A move that proves a design: the path above, the tracking error on an axis of its own below, measured over predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from beltcomm.arrays import Array
from beltcomm.report import style

#: Upper ends of an axis of errors, mm: the same for most pictures, so that two runs compare.
ENDS_MM = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True)
class TrackedMove:
    """One move.

    Attributes
    ----------
    t_s, reference_m, error_m : ndarray (n,)
        Error is reference minus motor angle times i_t. predicted_m : the same by the model on its own grid, None where it cannot be
        predicted.
    target_m : float
        That the error must stay below.
    end_s : float
        Of the reference motion.
    """

    name: str
    t_s: Array
    reference_m: Array
    error_m: Array
    predicted: tuple[Array, Array] | None
    target_m: float
    end_s: float


def tracking_figure(moves: Sequence[TrackedMove], caption: style.Caption) -> Figure:
    """Reference and tracking error of moves, a column for each; errors on one scale.

    Parameters
    ----------
    moves : sequence of TrackedMove
        m of the carriage; errors at the motor.
    caption : Caption
    """
    largest = max(1e3 * float(np.max(np.abs(m.error_m))) for m in moves)
    largest = max([largest, *(1e3 * float(np.max(np.abs(m.predicted[1]))) for m in moves if m.predicted is not None)])
    end = next((end for end in ENDS_MM if largest < 0.95 * end), 1.1 * largest)
    with style.styled():
        made = style.figure("Tracking: the path, and how far the motor is off it", 5.4, caption)
        grid = made.subplots(2, len(moves), sharex="col", sharey="row", squeeze=False, height_ratios=(2, 3))
        for column, move in enumerate(moves):
            above, below = grid[0][column], grid[1][column]
            above.set_title(move.name)
            above.plot(move.t_s, 1e3 * move.reference_m, color=style.MODEL, linewidth=1.6, label="reference")
            above.plot(move.t_s, 1e3 * (move.reference_m - move.error_m), color=style.MEASURED, linewidth=0.8, label="measured")
            below.plot(move.t_s, 1e3 * move.error_m, color=style.MEASURED, linewidth=0.9, label="measured")
            if move.predicted is not None:
                t_s, error_m = move.predicted
                below.plot(t_s, 1e3 * error_m, color=style.MODEL, linewidth=1.2, label="predicted")
            below.axvline(move.end_s, color=style.FAINT, linewidth=1.2)
            below.annotate(" end of the motion", (move.end_s, -0.95 * end), fontsize=8, rotation=90, va="bottom")
            if 1e3 * move.target_m <= end:
                for side in (-1.0, 1.0):
                    below.axhline(side * 1e3 * move.target_m, color=style.SEVERE, linewidth=1.0, linestyle=(0, (5, 3)))
            below.set(xlabel="time in s", ylim=(-end, end))
        grid[0][0].set_ylabel("carriage in mm")
        grid[1][0].set_ylabel("reference minus motor in mm")
        style.legend(grid[0][0])
        style.legend(grid[1][0])
    return made
