"""Grid, marks and numbers of an axis as a few artists and one text per number, in place of matplotlib's ticks.

A tick of matplotlib is five artists that copy each other: making, measuring and drawing them took half the time of a page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT, TICKRIGHT, TICKUP
from matplotlib.text import Text
from matplotlib.ticker import NullLocator
from matplotlib.transforms import ScaledTranslation

from beltcomm.arrays import Array
from beltcomm.report.style import GRID, GRID_WIDTH

#: Points: length and width of major and of minor marks, and from a mark to its number; matplotlib's own.
MAJOR_PT, MINOR_PT, PAD_PT = (3.5, 0.8), (2.0, 0.6), 3.5
POINTS_PER_INCH = 72.0
#: Above maps, below lines.
BELOW = 0.5
#: Share of an axis by which rounding may put a mark outside.
ROUNDING = 1e-6
#: Side of an axis -> where it lies, its marks, the direction to the numbers, and how these stand there.
_SIDES: Mapping[str, tuple[float, Any, tuple[float, float], tuple[str, str]]] = {
    "bottom": (0.0, TICKDOWN, (0.0, -1.0), ("center", "top")),
    "top": (1.0, TICKUP, (0.0, 1.0), ("center", "baseline")),
    "left": (0.0, TICKLEFT, (-1.0, 0.0), ("right", "center_baseline")),
    "right": (1.0, TICKRIGHT, (1.0, 0.0), ("left", "center_baseline")),
}


def drawn(axis: Axis) -> list[Text]:
    """Grid, marks and numbers drawn where the axis has its ticks.   The limits must not change any more.

    Parameters
    ----------
    axis : Axis
        Of a figure.

    Returns
    -------
    list of Text
        The numbers.
    """
    axes = axis.axes
    across = isinstance(axis, XAxis)
    formatter = axis.get_major_formatter()
    majors = axis.get_majorticklocs()
    words = formatter.format_ticks(list(majors))
    shares, minors = _shares(axis, majors), _shares(axis, axis.get_minorticklocs())
    known = [(float(share), word) for share, word in zip(shares, words, strict=True) if -ROUNDING <= share <= 1.0 + ROUNDING]
    minors = minors[(minors >= -ROUNDING) & (minors <= 1.0 + ROUNDING)]
    shown, small = axis.get_tick_params(), axis.get_tick_params(which="minor")
    if shown.get("gridOn"):
        lines = [[(share, 0.0), (share, 1.0)] if across else [(0.0, share), (1.0, share)] for share, _ in known]
        axes.add_artist(LineCollection(lines, colors=GRID, linewidths=GRID_WIDTH, transform=axes.transAxes, zorder=BELOW))
    texts: list[Text] = []
    for side in ("bottom", "top") if across else ("left", "right"):
        if shown.get(side):
            _marks(axes, side, [share for share, _ in known], *MAJOR_PT)
        if small.get(side):
            _marks(axes, side, minors, *MINOR_PT)
        if shown.get(f"label{side}"):
            texts += _numbers(axes, side, known, shown.get("labelsize"))
    if texts and (offset := formatter.get_offset()):
        line = ScaledTranslation(0.0, -float(texts[0].get_fontsize()) / POINTS_PER_INCH, axes.figure.dpi_scale_trans)
        if across:
            texts.append(axes.text(1.0, 0.0, offset, ha="right", va="top", transform=texts[0].get_transform() + line))
        else:
            texts.append(axes.text(0.0, 1.0, offset, ha="left", va="bottom", transform=axes.transAxes))
    return texts


def without(axis: Axis) -> None:
    """Let the ticks go, of all axes that share this one.

    Parameters
    ----------
    axis : Axis
        Of a figure.
    """
    axis.set_major_locator(NullLocator())
    axis.set_minor_locator(NullLocator())
    axis.offsetText.set_visible(False)


def _shares(axis: Axis, at: Sequence[float] | Array) -> Array:
    """Values as shares of an axis: 0 at its left or lower end, 1 at the other."""
    if not len(at):
        return np.zeros(0)
    low, high, *scaled = axis.get_transform().transform(np.array([*axis.get_view_interval(), *at], dtype=np.float64))
    return np.asarray((np.array(scaled) - low) / (high - low))


def _ends(side: str, shares: Sequence[float] | Array) -> tuple[Array, Array]:
    along, where = np.asarray(shares, dtype=np.float64), np.full(len(shares), _SIDES[side][0])
    return (along, where) if side in ("bottom", "top") else (where, along)


def _marks(axes: Axes, side: str, shares: Sequence[float] | Array, length_pt: float, width_pt: float) -> None:
    if not len(shares):
        return
    marks = Line2D(*_ends(side, shares), linestyle="none", marker=_SIDES[side][1], markersize=length_pt, markeredgewidth=width_pt)
    marks.set(transform=axes.transAxes, clip_on=False, zorder=BELOW, color="black")
    axes.add_artist(marks)


def _numbers(axes: Axes, side: str, known: Sequence[tuple[float, str]], size: float | None) -> list[Text]:
    _, _, step, (ha, va) = _SIDES[side]
    away = (MAJOR_PT[0] + PAD_PT) / POINTS_PER_INCH
    beside = axes.transAxes + ScaledTranslation(step[0] * away, step[1] * away, axes.figure.dpi_scale_trans)
    x, y = _ends(side, [share for share, _ in known])
    named = [(left, up, word) for left, up, (_, word) in zip(x, y, known, strict=True) if word]
    return [axes.text(left, up, word, ha=ha, va=va, transform=beside, fontsize=size, zorder=BELOW) for left, up, word in named]
