"""The proof of a design: open loops of all model variants and of the measured responses, beside the disc that the margins keep free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from beltcomm.design.cascade import DesignResult
from beltcomm.design.measured import MeasuredLoop
from beltcomm.report import style

#: Colours of the records, told apart with any colour vision; further ones begin again with another marker.
COLOURS, MARKERS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"), (".", "x", "+")
#: Frequencies of the model's curves, and the part of the plane that is shown.
POINTS, PLANE = 900, ((-2.2, 1.0), (-2.0, 1.2))
FLOOR_DB = -60.0


@dataclass(frozen=True)
class Shown:
    """One measured response.   label : record and condition."""

    label: str
    loop: MeasuredLoop


def proof_figure(design: DesignResult, shown: Sequence[Shown], sentences: Sequence[str], caption: style.Caption) -> Figure:
    """Nyquist plots over gains, velocity loop on the left, position loop on the right."""
    nyquist = 0.999 * math.pi / design.structure.period_s
    omega = np.geomspace(1.0, nyquist, POINTS)
    curves = [design.open_loops(i, omega) for i in range(len(design.plants))]
    disc = 10.0 ** (-design.specification.sensitivity_db / 20.0)
    with style.styled():
        rows = 1 + math.ceil((len(shown) + 3) / 3)
        made = style.figure("Proof of the design: open loops by model and as measured", 8.6 + 0.2 * rows, caption, sentences)
        grid = made.subplots(3, 2, height_ratios=[4.6, 3.1, 0.2 * rows])
        for column, name in enumerate(("velocity", "position")):
            loops = [pair[column] for pair in curves]
            measured = [one.loop.velocity if column == 0 else one.loop.position for one in shown]
            _plane(grid[0, column], f"{name} loop", loops, measured, disc, design.specification.sensitivity_db)
            _gain(grid[1, column], omega, loops, shown, measured, name)
        handles, labels = grid[1, 0].get_legend_handles_labels()
        top = grid[0, 0].get_legend_handles_labels()
        for axes in grid[2]:
            axes.set_axis_off()
        legend = grid[2, 0].legend(top[0] + handles, top[1] + labels, loc="upper left", bbox_to_anchor=(-0.1, 1.0), ncols=3, fontsize=8)
        legend.set_in_layout(False)  # it spans both columns; its row keeps its height
    return made


def _plane(
    axes: Axes,
    title: str,
    loops: Sequence[NDArray[np.complex128]],
    measured: Sequence[NDArray[np.complex128]],
    disc: float,
    sensitivity_db: float,
) -> None:
    for i, loop in enumerate(loops):
        axes.plot(loop.real, loop.imag, color=style.MODEL, linewidth=1.1, alpha=0.8, label="model: all variants" if i == 0 else None)
    for k, loop in enumerate(measured):
        axes.plot(loop.real, loop.imag, _marker(k), color=_colour(k), markersize=4.0)
    free = Circle((-1.0, 0.0), disc, facecolor=style.SEVERE, alpha=0.18, edgecolor=style.SEVERE)
    free.set_label(f"kept free: sensitivity {sensitivity_db:.0f} dB")
    axes.add_patch(free)
    axes.plot([-1.0], [0.0], "+", color=style.SEVERE, markersize=9, markeredgewidth=1.6)
    around = np.linspace(0.0, 2.0 * math.pi, 200)
    axes.plot(np.cos(around), np.sin(around), color=style.FAINT, linewidth=0.9, zorder=0.5)
    axes.set_xlim(*PLANE[0])
    axes.set_ylim(*PLANE[1])
    axes.set_aspect("equal")
    axes.set_title(title)
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")


def _gain(
    axes: Axes,
    omega: NDArray[np.float64],
    loops: Sequence[NDArray[np.complex128]],
    shown: Sequence[Shown],
    measured: Sequence[NDArray[np.complex128]],
    name: str,
) -> None:
    levels = 20.0 * np.log10(np.maximum(np.abs(loops), 1e-6))
    hz = omega / (2.0 * math.pi)
    axes.fill_between(hz, levels.min(axis=0), levels.max(axis=0), color=style.MODEL, alpha=0.35, linewidth=0.0, label="model: band of them")
    for k, (one, loop) in enumerate(zip(shown, measured, strict=True)):
        axes.plot(
            one.loop.freq_hz, 20.0 * np.log10(np.abs(loop)), _marker(k), color=_colour(k), markersize=3.0, label=f"measured: {one.label}"
        )
    axes.axhline(0.0, color=style.FAINT, linewidth=1.2, zorder=0.5)
    axes.set_xscale("log")
    axes.set_xlim(0.5, hz[-1])
    axes.set_ylim(FLOOR_DB, 30.0)
    axes.set_xticks([t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500) if t <= hz[-1]])
    axes.xaxis.set_major_formatter(style.plain_numbers())
    axes.minorticks_off()
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel(f"open {name} loop in dB")


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _marker(k: int) -> str:
    return MARKERS[k // len(COLOURS) % len(MARKERS)]
