"""Places the axes of a figure so that what is written around them fits: every text is measured once, in inches.

Matplotlib's own layouts measure everything four times, which takes longer than the drawing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation

from beltcomm.arrays import Array
from beltcomm.report.ticks import MAJOR_PT, POINTS_PER_INCH, drawn, without

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
