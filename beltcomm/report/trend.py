"""Quantities of one axis over the dates of its runs, with intervals, line, band and limits; and changes between two runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from beltcomm.arrays import Array
from beltcomm.identify.course import LinearTrend
from beltcomm.report import style

DAY_S = 86400.0

#: Share of the time observed that the line is drawn beyond the last run.
AHEAD = 0.5

#: Ends of an axis of changes in per cent: the same for most pictures.
ENDS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0)


@dataclass(frozen=True)
class Followed:
    """One quantity.

    Attributes
    ----------
    t_s : ndarray
        Since 1970, s, (n,).
    values, intervals : ndarray
        As shown, (n,); nan where no interval is known.
    limits : tuple[float or None, float or None]
        Low and high, None for none.
    course : LinearTrend or None
        In the same unit, None where there is none.
    """

    words: str
    unit: str
    t_s: Array
    values: Array
    intervals: Array
    limits: tuple[float | None, float | None]
    course: LinearTrend | None


def trend_figure(followed: Sequence[Followed], caption: style.Caption) -> Figure:
    """Quantities of an axis over the dates of its runs; each axis holds its limits, so that what is small looks small.

    Parameters
    ----------
    followed : sequence of Followed
        One for each panel.
    caption : Caption
    """
    rows = math.ceil(len(followed) / 2)
    with style.styled():
        made = style.figure("What the runs say of the axis, over their dates", 0.6 + 2.5 * rows, caption)
        grid = made.subplots(rows, 2, squeeze=False, sharex=True).ravel()
        for axes in grid[len(followed) :]:
            axes.set_axis_off()
        grid[len(followed) - 2].tick_params(labelbottom=True)  # the lowest of its column, also where the last row is half empty
        for axes, one in zip(grid, followed, strict=False):
            days = one.t_s / DAY_S
            known = np.isfinite(one.intervals)
            axes.errorbar(
                days, one.values, yerr=np.where(known, one.intervals, 0.0), fmt="o", color=style.MEASURED, markersize=4, capsize=2
            )
            shown = [float(np.min(one.values)), float(np.max(one.values))]
            if one.course is not None:
                t_s = np.linspace(one.t_s.min(), one.t_s.max() + AHEAD * np.ptp(one.t_s), 60)
                line, half = one.course.at(t_s)
                axes.fill_between(t_s / DAY_S, line - half, line + half, color=style.MODEL, alpha=0.3, linewidth=0.0)
                axes.plot(t_s / DAY_S, line, color=style.MODEL, linewidth=1.4)
                shown += [float(line[0]), float(line[-1])]
            for limit in one.limits:
                if limit is not None:
                    axes.axhline(limit, color=style.SEVERE, linewidth=1.2, linestyle=(0, (5, 3)))
                    shown.append(limit)
            room = 0.12 * (max(shown) - min(shown)) or 0.1 * abs(shown[0]) or 1.0
            axes.set_ylim(min(shown) - room, max(shown) + room)
            axes.set_title(f"{one.words} in {one.unit}", fontsize=9)
            locator = AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
            axes.xaxis.set_major_locator(locator)
            axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    return made


@dataclass(frozen=True)
class Bar:
    """One quantity.

    Attributes
    ----------
    change, interval, usual
        Per cent.
    state : str
        As :class:`beltcomm.pages.changes.QuantityChange` has it.
    """

    words: str
    change: float
    interval: float | None
    usual: float
    state: str


def changes_figure(bars: Sequence[Bar], before: str, now: str, caption: style.Caption) -> Figure:
    """Change of each quantity with its interval over the band that is usual; what lies beyond the axis is written at its edge.

    Parameters
    ----------
    bars : sequence of Bar, %
        One for each quantity.
    before, now : str
        Names of the runs.
    caption : Caption
    """
    largest = max(abs(bar.change) + (bar.interval or 0.0) for bar in bars)
    end = next((e for e in ENDS if largest < 0.95 * e), ENDS[-1])
    with style.styled():
        made = style.figure(f"{now} against {before}: change with 95 %, and what is usual", 1.3 + 0.34 * len(bars), caption)
        axes = made.subplots()
        for row, bar in enumerate(bars):
            usual = min(bar.usual, end)
            axes.barh(row, 2.0 * usual, left=-usual, height=0.7, color=style.NO_DATA)
            colour = style.SEVERE if bar.state == "changed" else style.MEASURED
            at = min(max(bar.change, -end), end)
            if bar.interval is not None:
                axes.plot(
                    [max(bar.change - bar.interval, -end), min(bar.change + bar.interval, end)], [row, row], color=colour, linewidth=2.2
                )
            axes.plot([at], [row], "D" if bar.interval is None else "o", color=colour, markersize=6)
            text = f"{bar.change:+.3g}" + ("" if bar.interval is None else f" ± {bar.interval:.2g}")
            axes.annotate(f"  {text} %", (1.0, row), xycoords=("axes fraction", "data"), va="center", fontsize=8, color=colour)
        axes.axvline(0.0, color=style.FAINT, linewidth=1.2, zorder=0.5)
        style.numbers_at(axes.yaxis, range(len(bars)), [bar.words for bar in bars])
        axes.set_ylim(len(bars) - 0.4, -0.6)
        axes.set_xlim(-end, end)
        axes.set_xlabel("change in %; grey: usual, with nothing wrong; diamond: interval not known")
        axes.grid(False, axis="y")
    return made
