"""The revisions of a model as a staircase that falls to the noise; and one step of it, record by record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from beltcomm.report import style

#: A record that gets worse but stays below this has not lost anything that could be told from noise.
WITHIN_CHANCE = 1.05


@dataclass(frozen=True)
class Stair:
    """One revision.

    Attributes
    ----------
    change : str
        "base", "+effect".
    ratio, held_out
        Error over noise.
    confirmed : bool or None
        As in the ladder.
    """

    name: str
    change: str
    ratio: float
    held_out: float | None
    confirmed: bool | None


@dataclass(frozen=True)
class RecordChange:
    """One record before and after a change.

    Attributes
    ----------
    before, after : float
        Error over noise.
    """

    record: str
    held_out: bool
    before: float
    after: float


def staircase_figure(rungs: Sequence[Stair], caption: style.Caption) -> Figure:
    """Error over noise of every revision, fitted and held out, with the floor.

    Parameters
    ----------
    rungs : sequence of Stair
        Revisions, in their order.
    caption : Caption
    """
    values = [r.ratio for r in rungs] + [r.held_out for r in rungs if r.held_out is not None]
    top = style.highest_shown(values)
    with style.styled():
        made = style.figure("Model error, revision by revision", 5.2, caption)
        axes = made.subplots()
        edges = np.arange(len(rungs) + 1) - 0.5
        fitted = np.array([r.ratio for r in rungs])
        axes.stairs(fitted, edges, baseline=0.8, fill=True, color=style.HELD_OUT, alpha=0.35)
        axes.stairs(fitted, edges, baseline=None, color=style.RESIDUAL, linewidth=2.2, label="records that were fitted")
        if any(r.held_out is not None for r in rungs):
            held = np.array([np.nan if r.held_out is None else r.held_out for r in rungs])
            axes.stairs(held, edges, baseline=None, color=style.MODEL, linewidth=2.2, linestyle=(0, (4, 2)), label="records held out")
        style.floor_line(axes, label="noise: no model can go lower")
        style.ratio_ticks(axes, 0.8, top)
        for place, rung in enumerate(rungs):
            highest = max(rung.ratio, rung.held_out or 0.0)
            text = f"{rung.ratio:.2f}" + ("" if rung.held_out is None else f" / {rung.held_out:.2f}")
            if rung.confirmed is False:
                text += "\nnot confirmed"
            colour = style.SEVERE if rung.confirmed is False else style.MEASURED
            axes.annotate(text, (place, highest), xytext=(0, 5), textcoords="offset points", ha="center", fontsize=9, color=colour)
        axes.set_xticks(range(len(rungs)), [f"{r.change}\n{r.name}" for r in rungs])
        axes.set_xlim(-0.5, len(rungs) - 0.5)
        axes.grid(False, axis="x")
        axes.set_ylabel("error / noise (fitted / held out)")
        axes.legend(loc="upper right", fontsize=9)
    return made


def change_figure(change: str, records: Sequence[RecordChange], before: float, after: float, caption: style.Caption) -> Figure:
    """Error of every record before and after a change, as an arrow from one to the other.

    Parameters
    ----------
    change : str
        In words, for the title.
    records : sequence of RecordChange
        Error over the noise of each, before and after.
    before, after : float
        Error over the noise of all fitted records.
    caption : Caption
    """
    ordered = sorted(records, key=lambda r: (r.held_out, r.record))
    top = style.highest_shown([v for r in records for v in (r.before, r.after)])
    with style.styled():
        title = f"{change}: error {before:.2f} → {after:.2f} times the noise"
        made = style.figure(title, 1.8 + 0.32 * len(records), caption)
        axes = made.subplots()
        for row, item in enumerate(ordered):
            better = item.after <= max(item.before, WITHIN_CHANCE)
            axes.plot([item.before, item.after], [row, row], color=style.FAINT, linewidth=2.5, zorder=2)
            axes.plot(item.before, row, "o", markersize=8, color="white", markeredgecolor=style.MEASURED, zorder=3)
            axes.plot(item.after, row, "o" if better else "X", markersize=8, color=style.RESIDUAL if better else style.SEVERE, zorder=4)
            text = f"{item.before:.2f} → {item.after:.2f}"
            axes.annotate(text, (max(item.before, item.after), row), xytext=(9, 0), textcoords="offset points", va="center", fontsize=8)
        axes.plot([], [], "o", color="white", markeredgecolor=style.MEASURED, label="before")
        axes.plot([], [], "o", color=style.RESIDUAL, label="after")
        axes.plot([], [], "X", color=style.SEVERE, label="after, and worse")
        names = [f"{r.record} (held out)" if r.held_out else r.record for r in ordered]
        style.numbers_at(axes.yaxis, range(len(ordered)), names, 9.0)
        axes.set_ylim(len(ordered) - 0.4, -0.6)
        style.ratio_ticks(axes, 0.8, 1.15 * top, vertical=False)
        style.floor_line(axes, vertical=True)
        axes.set_xlabel("error / noise")
        axes.grid(False, axis="y")
        axes.legend(loc="upper right", fontsize=8)
    return made
