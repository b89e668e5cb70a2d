"""Error maps: where the residual lies above the noise, on one colour scale for all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.laboratory.samples import (
    Bins,
    Judged,
    Samples,
    bands,
    bins_of,
    dimensions,
    gather_samples,
    position_edges,
)
from beltcomm.report import style

#: Hz: bands of the map.
BAND_HZ = 20.0
#: On a map, which is pale also where the page is dark: ink, its ground, lines across fields with data and without.
INK, PALE, MARK = "#010101", "#FFFFE5", "#767676"


def maps_figure(
    judged: Sequence[Judged],
    overall: float,
    held_out: float | None,
    landmarks: Mapping[str, float],
    sentences: Sequence[str],
    caption: style.Caption,
) -> Figure:
    """Frequency and record; speed and direction; position and direction; amplitude; time.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their whitened residuals.
    overall : float
        Error over the noise of the fitted records.
    held_out : float or None
        That of the records held out; None without any.
    landmarks : mapping of str to float, Hz
        Lines by name.
    sentences : sequence of str
        Below the title.
    caption : Caption
    """
    judged = [j for j in judged if len(j.white)]
    samples = gather_samples(judged)
    squares = samples.white**2
    held = "" if held_out is None else f", held out {held_out:.2f}"
    with style.styled():
        made = style.figure(
            f"Where the model fails: error {overall:.2f} times the noise{held}; 1.00 means nothing is missing", 10.5, caption, sentences
        )
        spots = made.subplot_mosaic(
            [["band", "band", "bar"], ["speed", "position", "bar"], ["amplitude", "time", "bar"]],
            width_ratios=[1.0, 1.0, 0.05],
            height_ratios=[1.7, 1.0, 1.0],
        )
        image = _band_map(spots["band"], judged, landmarks)
        along = {name: bins_of(name, *values, squares) for name, values in dimensions(samples).items()}
        _by_speed(spots["speed"], samples)
        by_way = _by_position(spots["position"], samples)
        spots["position"].set_title("By carriage position and direction")
        moving = "carriage" if samples.units.length == "m" else "motor"
        spots["position"].set_xlabel(f"{moving} position in {samples.units.length}")
        _bars(spots["amplitude"], along["amplitude"])
        spots["amplitude"].set_title(f"By size of the {samples.units.word}")
        spots["amplitude"].set_xlabel(f"|{samples.units.word}| in {samples.units.force}")
        _bars(spots["time"], along["time"])
        spots["time"].set_title("By time")
        spots["time"].set_xlabel("time on the session's clock in s")
        top = style.highest_shown([1.2 * float(np.nanmax(b.ratio)) for b in along.values() if np.isfinite(b.ratio).any()] + [by_way])
        for name in ("position", "amplitude", "time"):
            style.ratio_ticks(spots[name], 0.8, top)
            spots[name].set_ylabel("error / noise")
            style.floor_line(spots[name])
            style.legend(spots[name])
        bar = made.colorbar(image, cax=spots["bar"], extend="max")
        bar.set_label("error / noise (the same scale in every picture; blue-grey: too little data)")
        style.numbers_at(bar.ax.yaxis, [1.0, 1.5, 2.0, 3.0, 5.0, 10.0])
    return made


def _band_map(axes: Axes, judged: Sequence[Judged], landmarks: Mapping[str, float]) -> Any:
    table = bands(judged, BAND_HZ)
    with np.errstate(invalid="ignore"):
        ratio = np.sqrt(table.power)
    axes.set_facecolor(style.NO_DATA)
    rows = np.arange(len(table.names) + 1) - 0.5
    image = axes.pcolormesh(table.edges, rows, ratio, norm=style.noise_norm(), cmap=style.COLOURS, rasterized=True)
    names = [f"{n} (held out)" if h else n for n, h in zip(table.names, table.held_out, strict=True)]
    style.numbers_at(axes.yaxis, range(len(names)), names, 8.0)
    axes.invert_yaxis()
    axes.grid(False)
    axes.set_xlabel("frequency in Hz")
    axes.set_title("By frequency and record")
    for name, hz in landmarks.items():
        if hz < table.edges[-1]:
            axes.axvline(hz, color=MARK, linewidth=0.9, linestyle=(0, (2, 2)))
            text = f" {name} {hz:.0f} Hz "
            ground = {"facecolor": PALE, "edgecolor": "none", "pad": 0.5}
            foot = (hz, len(table.names) - 0.5)
            axes.annotate(text, foot, fontsize=8, rotation=90, ha="right", va="bottom", color=INK, bbox=ground)
    return image


def _by_speed(axes: Axes, samples: Samples) -> None:
    """Two rows, positive and negative direction; ratio and the mean torque that is missing stand in the cells."""
    units = samples.units
    edges, speed = units.speeds, np.abs(samples.speed)
    sides = [np.sign(samples.speed) == sign for sign in (1.0, -1.0)]
    ratio = np.array([bins_of("", speed[side], edges, "", samples.white[side] ** 2).ratio for side in sides])
    used = np.flatnonzero(np.isfinite(ratio).any(axis=0))
    axes.set_title("By speed and direction")
    axes.grid(False)
    if not len(used):
        return
    first, last = int(used[0]), int(used[-1]) + 1
    axes.set_facecolor(style.NO_DATA)
    axes.pcolormesh(np.arange(last - first + 1), [-0.5, 0.5, 1.5], ratio[:, first:last], norm=style.noise_norm(), cmap=style.COLOURS)
    for row, side in enumerate(sides):
        for column in range(first, last):
            inside = side & (speed >= edges[column]) & (speed < edges[column + 1])
            if np.isfinite(ratio[row, column]):
                text = f"{ratio[row, column]:.1f}\n{units.factor * float(np.mean(samples.more[inside])):+z.0f}"
                colour = "white" if ratio[row, column] > 4.0 else INK
                axes.text(column - first + 0.5, row, text, ha="center", va="center", fontsize=8, color=colour)
    style.numbers_at(axes.yaxis, [0, 1], ["forward", "backward"])
    axes.set_ylim(1.5, -0.5)
    style.numbers_at(axes.xaxis, range(last - first + 1), [f"{v:g}" for v in edges[first : last + 1]], 8.0)
    axes.set_xlabel(f"speed in {units.length}/s\n(in each cell: error/noise, and measured minus model in {units.small})")


def _by_position(axes: Axes, samples: Samples) -> float:
    """One line per direction; returns the largest ratio."""
    largest = 1.0
    edges = position_edges(samples)
    for sign, name, colour, dash in ((1.0, "forward", style.RESIDUAL, "-"), (-1.0, "backward", style.MEASURED, (0, (3, 1.5)))):
        side = np.sign(samples.speed) == sign
        ratio = bins_of("", samples.position[side], edges, "", samples.white[side] ** 2).ratio
        axes.stairs(ratio, edges, baseline=None, color=colour, linewidth=1.6, linestyle=dash, label=name)
        largest = max(largest, float(np.nanmax(ratio, initial=1.0, where=np.isfinite(ratio))))
    return largest


def _bars(axes: Axes, bins: Bins) -> None:
    from matplotlib import colormaps

    known = np.isfinite(bins.ratio)
    colours = colormaps[style.COLOURS](style.noise_norm()(np.where(known, bins.ratio, 1.0)))
    axes.bar(
        bins.edges[:-1][known],
        bins.ratio[known] - 0.8,
        width=np.diff(bins.edges)[known],
        bottom=0.8,
        align="edge",
        color=colours[known],
        edgecolor="#777777",
        linewidth=0.5,
    )
    if known.any():
        axes.set_xlim(bins.edges[:-1][known][0], bins.edges[1:][known][-1])
