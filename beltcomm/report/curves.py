"""Numbers behind the curves of a figure, for the charts that a page draws of them where scripts may run."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from beltcomm.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

#: Points of a curve that are kept, and digits of each.
MOST, DIGITS = 1500, 5
#: Points from which a line is a curve and no mark.
LEAST = 3


def curves_of(figure: Figure) -> str:
    """JSON of the panels of a figure that hold curves, before it is drawn; "" for a figure without any.

    Parameters
    ----------
    figure : Figure
        With all of its curves.
    """
    panels = [panel for axes in figure.get_axes() if (panel := _panel(axes))["curves"]]
    return json.dumps(panels, separators=(",", ":")).replace("<", "\\u003c") if panels else ""


def _panel(axes: Axes) -> dict[str, Any]:
    shared = [one for one in axes.figure.get_axes() if one.get_xlabel()]  # panels above each other name it once
    return {
        "title": axes.get_title() or axes.get_title(loc="left"),
        "x": axes.get_xlabel() or (shared[-1].get_xlabel() if shared else ""),
        "y": axes.get_ylabel(),
        "log": [axes.get_xscale() == "log", axes.get_yscale() == "log"],
        "xlim": [_cut(v) for v in axes.get_xlim()],
        "ylim": [_cut(v) for v in sorted(axes.get_ylim())],
        "curves": [curve for line in axes.get_lines() if _of_data(line, axes) and (curve := _curve(line))],
    }


def _of_data(line: Line2D, axes: Axes) -> bool:
    return line.get_transform() == axes.transData


def _curve(line: Line2D) -> dict[str, Any]:
    """One line; {} for one that is a mark, or holds no number."""
    x: Array
    y: Array
    x, y = (np.ma.filled(np.ma.asarray(values, dtype=float), np.nan) for values in line.get_data())
    if len(x) < LEAST or not np.isfinite(x).any() or not np.isfinite(y).any():
        return {}
    kept = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST)).round().astype(int))
    known = kept[np.isfinite(x[kept])]
    order = known[np.argsort(x[known], kind="stable")]
    label = str(line.get_label())
    return {
        "label": "" if label.startswith("_") else label,
        "colour": _hex(line.get_color()),
        "dots": line.get_linestyle() == "None",
        "xy": [[_cut(v) for v in x[order]], [_cut(v) for v in y[order]]],
    }


def _cut(value: float) -> float | None:
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def _hex(colour: Any) -> str:
    from matplotlib.colors import to_hex

    return to_hex(colour).upper()
