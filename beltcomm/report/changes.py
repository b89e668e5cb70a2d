"""Changes between two runs in per cent, with intervals, beside what is usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from beltcomm.report import style

#: Ends of an axis of changes in per cent: the same for most pictures.
ENDS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0)


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
    """A row for each quantity: change with its interval over the band that is usual; what lies beyond the axis is written at its edge."""
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
