"""Places the axes of a figure so that what is written around them fits: every text is measured once, in inches.

Matplotlib's own layouts measure everything four times, which takes longer than the drawing.  And grid, marks and numbers of an axis as a
few artists and one text per number: a tick of matplotlib is five artists that copy each other, which took half the time of a page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
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
    """Numbers of an axis, with grid and marks drawn where it has its ticks.   The limits must not change any more."""
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
    """Let the ticks go, of all axes that share this one."""
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


#: Inches around the figure, and between what belongs to neighbouring axes.
EDGE_IN, GAP_IN = 0.05, 0.08
#: Inches that axes mostly need at their left and right, below with a label and above with a title: which numbers stand along them goes
#: with their size.
USUAL_IN = (0.7, 0.1, 0.4, 0.3)
#: Sides of axes, as rows of what is measured.
LEFT, RIGHT, BOTTOM, TOP = range(4)


def place(figure: Figure, renderer: RendererBase) -> bool:
    """Give all axes their places; False where they do not stand in one grid, or nothing is left for them.

    From left to right an axes has the width  w_k = r_k (W - Σ margins)/Σ r,  r the grid's ratios; from top to bottom likewise.

    Parameters
    ----------
    figure : Figure
        Changed in place.
    renderer : RendererBase
        That will draw it.
    """
    specs = [axes.get_subplotspec() for axes in figure.get_axes()]
    grids = {id(spec.get_gridspec()): spec.get_gridspec() for spec in specs if spec is not None}
    if len(grids) != 1 or any(spec is None for spec in specs):
        return False
    (grid,) = grids.values()
    columns = [(spec.colspan.start, spec.colspan.stop - 1) for spec in specs if spec is not None]
    rows = [(spec.rowspan.start, spec.rowspan.stop - 1) for spec in specs if spec is not None]
    wide, high = figure.get_size_inches()

    def set_within(around: list[Array]) -> bool:
        across = _spread(columns, [(m[LEFT], m[RIGHT]) for m in around], grid.get_width_ratios(), wide)
        down = _spread(rows, [(m[TOP], m[BOTTOM]) for m in around], grid.get_height_ratios(), high)
        if across is None or down is None:
            return False
        for axes, (left, right), (top, bottom) in zip(figure.get_axes(), across, down, strict=True):
            axes.set_position((left / wide, 1.0 - bottom / high, (right - left) / wide, (bottom - top) / high))
        return True

    if not set_within([_usual(axes) for axes in figure.get_axes()]):
        return False
    around = [_margins(axes, renderer) for axes in figure.get_axes()]
    for axes in figure.get_axes():
        without(axes.xaxis)
        without(axes.yaxis)
    return set_within(around)


def _spread(
    spans: list[tuple[int, int]], margins: list[tuple[float, float]], ratios: Any, whole: float
) -> list[tuple[float, float]] | None:
    """First and last inch of every axes along one direction; None where nothing is left.   spans : first and last cell of each."""
    before, after = np.zeros(len(ratios)), np.zeros(len(ratios))
    for (first, last), (ahead, behind) in zip(spans, margins, strict=True):
        before[first], after[last] = max(before[first], ahead), max(after[last], behind)
    left = whole - 2.0 * EDGE_IN - GAP_IN * (len(ratios) - 1) - float(np.sum(before + after))
    if left <= 0.0:
        return None
    sizes = left * np.asarray(ratios, dtype=np.float64) / float(np.sum(ratios))
    starts = EDGE_IN + before + np.concatenate(([0.0], np.cumsum(before + sizes + after + GAP_IN)[:-1]))
    return [(float(starts[first]), float(starts[last] + sizes[last])) for first, last in spans]


def _usual(axes: Axes) -> Array:
    """Roughly what :func:`_margins` will find."""
    left, right, below, above = USUAL_IN
    titled = any(axes.get_title(loc) for loc in ("left", "center"))
    return np.array([left, right, below if axes.get_xlabel() else 0.0, above if titled else 0.0])


def _margins(axes: Axes, renderer: RendererBase) -> Array:
    """Inches that numbers, labels, title and notes need beyond each side; puts the labels beside their numbers."""
    if not axes.axison:
        return np.zeros(4)
    found = np.zeros(4)
    told: set[Text] = set()
    for axis, low, high in ((axes.xaxis, BOTTOM, TOP), (axes.yaxis, LEFT, RIGHT)):
        beyond = np.zeros(4)
        numbers = drawn(axis)
        told.update(numbers)
        for number in _farthest(numbers, along=axis is axes.xaxis):
            beyond = np.maximum(beyond, _beyond(axes, number.get_window_extent(renderer).extents))
        if axis.label.get_visible() and axis.label.get_text():
            side = high if axis.get_label_position() in ("right", "top") else low
            beyond[side] = max(float(beyond[side]), MAJOR_PT[0] / POINTS_PER_INCH) + axis.labelpad / POINTS_PER_INCH
            _label(axes, axis, side, float(beyond[side]))
            size = axis.label.get_window_extent(renderer)
            beyond[side] += (size.height if axis is axes.xaxis else size.width) / axes.figure.dpi
        found = np.maximum(found, beyond)
    for child in axes.get_children():
        if isinstance(child, Text) and child not in told and child.get_text() and child.get_visible():
            beyond = _beyond(axes, child.get_window_extent(renderer).extents)
            if child not in axes.texts:  # a title that is too long is no reason for narrower axes
                beyond[[LEFT, RIGHT]] = 0.0
            found = np.maximum(found, beyond)
    return found


def _farthest(numbers: Sequence[Text], *, along: bool) -> list[Text]:
    """Those that may reach farthest: along the axis the first, the last and the highest one, across it the longest ones."""
    if along:
        return [numbers[0], numbers[-1], max(numbers, key=lambda t: t.get_text().count("\n"))] if numbers else []
    return [t for t in numbers if len(t.get_text()) >= max(len(other.get_text()) for other in numbers) - 1]


def _beyond(axes: Axes, extents: Any) -> Array:
    """Reach of a box in pixels beyond each side of axes, inches."""
    x0, y0, x1, y1 = extents
    left, bottom, right, top = axes.bbox.extents
    return np.maximum(np.array([left - x0, x1 - right, bottom - y0, y1 - top]) / axes.figure.dpi, 0.0)


def _label(axes: Axes, axis: Axis, side: int, away_in: float) -> None:
    """A label beside the middle of its axis, some inches beyond a side."""
    step, (x, y) = {
        LEFT: ((-away_in, 0.0), (0.0, 0.5)),
        RIGHT: ((away_in, 0.0), (1.0, 0.5)),
        BOTTOM: ((0.0, -away_in), (0.5, 0.0)),
        TOP: ((0.0, away_in), (0.5, 1.0)),
    }[side]
    axis.set_label_coords(x, y, axes.transAxes + ScaledTranslation(*step, axes.figure.dpi_scale_trans))
