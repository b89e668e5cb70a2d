"""A population at one glance: how errors and margins are distributed, and what they go with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.arrays import Array, BoolArray
from beltcomm.report import style

#: Shares of the members that an axis of values shows: one that runs away must not press all others into a line.
SHOWN = 0.99
#: Panels side by side at most.
_COLUMNS = 3


@dataclass(frozen=True)
class Distributed:
    """One result over all members that have it.   values (n,) : as shown.

    Attributes
    ----------
    bound : float or None
        Its target, None for none.
    """

    words: str
    values: Array
    bound: float | None = None


@dataclass(frozen=True)
class Against:
    """A result (n,) over a drawn parameter (n,).

    Attributes
    ----------
    kept : ndarray
        Whether the member keeps its targets, (n,) bool.
    correlation : str
        In words.
    """

    parameter: str
    words: str
    drawn: Array
    values: Array
    kept: BoolArray
    bound: float | None
    correlation: str


def distribution_figure(shown: Sequence[Distributed], caption: style.Caption) -> Figure:
    """For each result the share of members that lie at or below a value.

    Parameters
    ----------
    shown : sequence of Distributed
        Results of all members, with their units in words.
    caption : Caption
    """
    with style.styled():
        made, grid = _panels("How many axes lie below a value", len(shown), 2.7, caption, sharey=True)
        for axes, one in zip(grid, shown, strict=False):
            values = np.sort(one.values)
            share = 100.0 * np.arange(1, len(values) + 1) / len(values)
            axes.step(values, share, where="post", color=style.MEASURED, linewidth=1.4)
            _bound(axes.axvline, one.bound)
            _limits(axes.set_xlim, values, one.bound)
            axes.set(xlabel=one.words, ylim=(0.0, 101.0))
        for axes in grid[:: min(len(shown), _COLUMNS)]:
            axes.set_ylabel("% of the axes")
    return made


def drivers_figure(shown: Sequence[Against], caption: style.Caption) -> Figure:
    """Results of a study against the parameters they go with, a dot for each member; those that miss a target stand out.

    Parameters
    ----------
    shown : sequence of Against
        One for each panel.
    caption : Caption
    """
    with style.styled():
        made, grid = _panels("What the results go with", len(shown), 2.9, caption)
        for axes, one in zip(grid, shown, strict=False):
            for members, colour, label in ((one.kept, style.RESIDUAL, "keep their targets"), (~one.kept, style.SEVERE, "miss one")):
                axes.plot(one.drawn[members], one.values[members], ".", color=colour, markersize=4, label=label)
            _bound(axes.axhline, one.bound)
            _limits(axes.set_ylim, one.values, one.bound)
            axes.set(xlabel=one.parameter, ylabel=one.words)
            axes.set_title(one.correlation, fontsize=9, fontweight="normal")
        grid[0].legend(loc="best", fontsize=8, handletextpad=0.2)
    return made


def _panels(title: str, number: int, row: float, caption: style.Caption, sharey: bool = False) -> tuple[Figure, Sequence[Axes]]:
    """A figure of so many panels, each row so many inches high."""
    columns = min(number, _COLUMNS)
    rows = math.ceil(number / columns)
    made = style.figure(title, 0.4 + row * rows, caption)
    grid = made.subplots(rows, columns, squeeze=False, sharey=sharey).ravel()
    for axes in grid[number:]:
        axes.set_axis_off()
    return made, list(grid)


def _bound(draw: Callable[..., object], bound: float | None) -> None:
    if bound is not None:
        draw(bound, color=style.SEVERE, linewidth=1.2, linestyle=(0, (5, 3)))


def _limits(put: Callable[[float, float], object], values: Array, bound: float | None) -> None:
    """The bulk of the values and the bound, with room at both ends."""
    low, high = (float(q) for q in np.quantile(values, (1.0 - SHOWN, SHOWN)))
    ends = [low, high] if bound is None else [min(low, bound), max(high, bound)]
    room = 0.06 * (ends[1] - ends[0]) or 0.1 * abs(ends[0]) or 1.0
    put(ends[0] - room, ends[1] + room)
