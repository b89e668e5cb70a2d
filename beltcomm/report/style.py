"""Style of all pictures: colours, the floor of the noise, the line below that names command and data, saving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill, wrap
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FixedLocator, Formatter, FuncFormatter, NullLocator

from beltcomm import atomic
from beltcomm.axis.terms import picture_terms

#: Okabe and Ito's colours, told apart with any kind of colour vision and in grey.
MEASURED, MODEL, RESIDUAL, HELD_OUT, SEVERE = "#000000", "#E69F00", "#0072B2", "#56B4E9", "#D55E00"
FAINT = "#BBBBBB"
GRID, GRID_WIDTH = "#E4E4E4", 0.6
#: Errors in units of the noise: one scale for every picture of every run, pale at the noise, dark far above it, also in grey.
LOWEST, HIGHEST, COLOURS = 1.0, 10.0, "YlOrBr"
#: Where there is too little data.
NO_DATA = "#D5DCE4"
#: Inches: wide enough for two columns of text.
WIDTH = 10.0
#: Letters of a legend, points.
LEGEND_PT = 8.0
#: Share of the height that a grid gives axes which titles and labels leave them.
LEFT_BY_LABELS = 0.75
#: Points per inch of a picture.
DPI = 130
#: Ticks of axes of phase.
DEGREES = (-360.0, -270.0, -180.0, -90.0, 0.0)
#: Hz, of the ticks of logarithmic axes.
HERTZ = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
#: Letters of a line of text above a figure.
LINE = 118
#: The same of a title in bold.
BOLD_LINE = 96

_STYLE: Any = {
    "font.size": 10.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": GRID_WIDTH,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else it is looked for above everything else at every drawing
    "legend.frameon": False,
    "figure.facecolor": "white",
    "svg.hashsalt": "beltcomm",
}


@dataclass(frozen=True)
class Caption:
    """Origin of a picture.

    Attributes
    ----------
    command : str
        That made it.
    data : str
        Run folder and records it shows.
    """

    command: str
    data: str


def styled() -> Any:
    """A context in which figures are made: no global setting is touched."""
    return rc_context(_STYLE)


def figure(title: str, height: float, caption: Caption, sentences: Sequence[str] = ()) -> Figure:
    """An empty figure with its title and sentences on top, command and data below.

    Parameters
    ----------
    title : str
        Bold where there are no sentences.
    height : float, inches
        Without the sentences.
    caption : Caption
    sentences : sequence of str
        Below the title.

    Returns
    -------
    Figure
        Of :data:`WIDTH`.
    """
    below = [line for sentence in sentences for line in wrap(sentence, LINE, initial_indent="• ", subsequent_indent="   ")]
    made = Figure(figsize=(WIDTH, height + 0.2 * len(below)), layout="constrained")
    title = title if len(title) <= BOLD_LINE else fill(title, BOLD_LINE)
    made.suptitle("\n".join([title, *below]), x=0.01, ha="left", fontsize=11, fontweight="normal" if sentences else "bold")
    made.supxlabel(f"{caption.command}    data: {caption.data}", x=0.01, ha="left", fontsize=8, color="#555555")
    return made


def noise_norm() -> LogNorm:
    """The colour scale of errors in units of the noise."""
    return LogNorm(LOWEST, HIGHEST, clip=True)


def floor_line(axes: Axes, *, vertical: bool = False, label: str = "noise, 1.00") -> None:
    """The floor that no model can go below.

    Parameters
    ----------
    axes : Axes
        Drawn on.
    vertical : bool
        True where the error is along the x axis.
    label : str
        In the legend.
    """
    draw = axes.axvline if vertical else axes.axhline
    draw(1.0, color=SEVERE, linewidth=1.2, linestyle=(0, (5, 3)), label=label, zorder=1.5)


def ratio_ticks(axes: Axes, lowest: float, highest: float, *, vertical: bool = True) -> None:
    """A logarithmic axis of ratios with plain numbers.

    Parameters
    ----------
    axes : Axes
        Drawn on.
    lowest, highest : float
        Ends of the axis.
    vertical : bool
        True for the y axis.
    """
    fine = (0.8, 0.9, 1.1, 1.2, 1.3, 1.5, 1.7) if highest <= 3.0 * lowest else (0.7, 1.5, 3.0) if highest <= 20.0 else ()
    ticks = [v for v in sorted((0.5, 1.0, *fine, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)) if lowest <= v <= highest]
    if vertical:
        axes.set_yscale("log")
        axes.set_ylim(lowest, highest)
    else:
        axes.set_xscale("log")
        axes.set_xlim(lowest, highest)
    numbers_at(axes.yaxis if vertical else axes.xaxis, ticks)


def numbers_at(axis: Axis, at: Sequence[float], words: Sequence[str] | None = None, size: float | None = None) -> None:
    """Ticks at these values only, with plain numbers or these words; the limits stay.

    Parameters
    ----------
    axis : Axis
    at : sequence of float
        Values with a tick.
    words : sequence of str or None
        In place of the numbers; None for none.
    size : float or None
        Of the letters, points.
    """
    axis.set_major_locator(FixedLocator(list(at)))
    axis.set_major_formatter(plain_numbers() if words is None else FixedFormatter(list(words)))
    axis.set_minor_locator(NullLocator())
    if size is not None:
        axis.set_tick_params(labelsize=size)


def hertz(axis: Axis) -> None:
    """Ticks of a logarithmic axis of frequencies, as far as its limits go.

    Parameters
    ----------
    axis : Axis
        Logarithmic.
    """
    low, high = axis.get_view_interval()
    numbers_at(axis, [t for t in HERTZ if low <= t <= high])


def highest_shown(values: Sequence[float]) -> float:
    """Upper end of an axis of ratios: 2, 10, 30, 100 or 300, so that the pictures of two runs mostly have the same.

    Parameters
    ----------
    values : sequence of float
        That are drawn.
    """
    top = max([*values, 1.0])
    return next((end for end in (2.0, 10.0, 30.0, 100.0, 300.0) if top < 0.95 * end), 1.3 * top)


def legend(axes: Axes, ncols: int = 1, title: str | None = None) -> None:
    """Legend in an upper corner, the right one if it can be, that no curve runs through; where both are taken the axis goes higher.

    To be called when everything is drawn and scaled.

    Parameters
    ----------
    axes : Axes
        Drawn on.
    ncols : int
        Columns of the legend.
    title : str or None
        Above it; None for none.
    """
    _, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    lines = -(-len(labels) // ncols) + (title is not None)
    around, at = axes.get_figure(), axes.get_position()
    assert isinstance(around, Figure)
    wide, high = (inches * size for inches, size in zip(around.get_size_inches(), (at.width, at.height), strict=True))
    share = min(0.6, (LEGEND_PT * 1.45 * lines + 12.0) / 72.0 / (LEFT_BY_LABELS * high))
    across = min(1.0, LEGEND_PT * ncols * (0.55 * max(map(len, labels)) + 4.5) / 72.0 / wide)
    axes.get_xlim()  # what is scaled to the curves is scaled now
    drawn = axes.transScale + axes.transLimits
    points = [
        drawn.transform(np.asarray(line.get_xydata(), dtype=float)) for line in axes.get_lines() if line.get_transform() == axes.transData
    ]
    spots = np.concatenate([p[np.isfinite(p).all(axis=1)] for p in points]) if points else np.zeros((0, 2))
    spots = spots[(spots[:, 0] >= 0.0) & (spots[:, 0] <= 1.0)]
    reach = {
        side: float(np.max(spots[near, 1], initial=0.0))
        for side, near in (("right", spots[:, 0] > 1.0 - across), ("left", spots[:, 0] < across))
    }
    side = min(reach, key=lambda s: (reach[s] > 1.0 - share, s != "right"))
    if reach[side] > 1.0 - share and not axes.yaxis_inverted():
        scale = axes.yaxis.get_transform()
        low, top = scale.transform(np.array(axes.get_ylim()))
        axes.set_ylim(top=float(scale.inverted().transform(np.array([low + (top - low) * reach[side] / (1.0 - share)]))[0]))
    axes.legend(
        loc="upper right" if side == "right" else "upper left", fontsize=LEGEND_PT, ncols=ncols, title=title, title_fontsize=LEGEND_PT
    )


def save(picture: Figure, path: Path) -> Path:
    """Write a figure as PNG, whole or not at all; the same figure gives the same bytes.

    Parameters
    ----------
    picture : Figure
        Made by :func:`figure`.
    path : Path
        Of the file; its folder is made.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic.replacing(path) as file:
        _laid_out(in_own_words(picture)).savefig(file, format="png", dpi=DPI, metadata={"Software": "beltcomm"})
    return path


def in_own_words(picture: Figure) -> Figure:
    """The figure in words and units of its axis: what is drawn stays, numbers along an axis are multiplied where they are written.

    Parameters
    ----------
    picture : Figure
        Changed in place.
    """
    terms = picture_terms()
    if terms:
        for axes in picture.get_axes():
            for axis in (axes.xaxis, axes.yaxis):
                label, factor = terms.label(axis.get_label_text())
                axis.set_label_text(label)
                if factor != 1.0:
                    axis.set_major_formatter(FuncFormatter(lambda value, _place, factor=factor: f"{factor * value:.4g}"))
        for text in picture.findobj(Text):
            text.set_text(terms.said(text.get_text()))
    return picture


def _laid_out(picture: Figure) -> Figure:
    """The figure with its parts in their places; matplotlib would draw it one time more to find them."""
    if (engine := picture.get_layout_engine()) is not None:
        picture.set_dpi(DPI)
        engine.execute(picture)
        picture.set_layout_engine(None)
    return picture


def plain_numbers() -> Formatter:
    """Numbers without powers of ten."""
    return FuncFormatter(lambda value, _place: f"{value:g}")
