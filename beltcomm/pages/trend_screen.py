"""``beltcomm trend`` on one screen: what drifts first, then each quantity in a line."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from beltcomm.given import pasted
from beltcomm.identify.course import FEWEST, LinearTrend
from beltcomm.pages.quantities import Quantity
from beltcomm.report.trend import DAY_S
from beltcomm.result import Line, command_lines
from beltcomm.sentences.screens import state_lines

#: State -> its word on the screen, and its style.
WORDS: Mapping[str, tuple[str, str]] = {
    "reached": ("LIMIT REACHED", "bad"),
    "drifts": ("DRIFTS", "note"),
    "unsure": ("CANNOT TELL", "note"),
    "steady": ("STEADY", "good"),
}
#: Per cent a year that nobody speaks of.
MINUTE = 1e-3
#: The year 2200: dates beyond it are no dates of a machine.
LAST_S = 7.258e9


@dataclass(frozen=True)
class Dated:
    """A run.

    Attributes
    ----------
    t_s : float
        Of its beginning, s since 1970.
    source : str
        Where that comes from.
    found : Mapping[str, Quantity]
        Its quantities.
    """

    name: str
    t_s: float
    source: str
    found: Mapping[str, Quantity]


@dataclass(frozen=True)
class TrendLine:
    """One quantity over the runs.

    Attributes
    ----------
    state : str
        "reached", "drifts", "steady", "unsure".
    text : str
        In words.
    reach_s : tuple[float, float, float] or None
        When its limit is reached, earliest, by the line, latest; None where that is not known.
    """

    last: Quantity
    runs: tuple[str, ...]
    t_s: tuple[float, ...]
    values: tuple[float, ...]
    intervals: tuple[float | None, ...]
    limits: tuple[float | None, float | None]
    why: str
    course: LinearTrend | None
    state: str
    text: str
    reach_s: tuple[float, float, float] | None


def screen(followed: Sequence[TrendLine], dated: Sequence[Dated]) -> list[Line]:
    """Headline, and each quantity in a line: now, its change, what it drifts by, its limits.

    Parameters
    ----------
    followed : sequence of TrendLine
        A line for each quantity.
    dated : sequence of Dated
        Runs with their days.
    """
    worst = followed[0] if followed[0].state in ("reached", "drifts") else None
    state = worst.state if worst else "steady" if any(one.state == "steady" for one in followed) else "unsure"
    word, style = WORDS[state]
    days = (dated[-1].t_s - dated[0].t_s) / DAY_S
    over = f"{len(dated)} runs, {date_of(dated[0].t_s)} to {date_of(dated[-1].t_s)} ({days:.0f} days)"
    sentence = (
        worst.text
        if worst
        else f"nothing drifts that these runs show: {over}"
        if state == "steady"
        else f"a trend needs runs of {FEWEST} different days: {over}"
    )
    rows = [Line(" " * 27, (f"{'now':<17}{'change':>8}{'a year':>11}  limit", "soft"))]
    for one in followed:
        name = re.split(r", all|, motor$| from ", one.last.words)[0]
        ahead = [bound for bound in one.limits if bound is not None and _ahead(one, bound)]
        bounds = " .. ".join(f"{one.last.scale * bound:.3g}" for bound in ahead)
        cells = f"{one.last.scale * one.values[-1]:.3g} {one.last.unit}".ljust(17), _changed(one).rjust(8), _yearly(one).rjust(11), "  "
        shown = WORDS[one.state]
        rows.append(Line("   ", name[:23].ljust(24), *cells, (bounds or "-", shown[1] if one.state in ("reached", "drifts") else "")))
    return [*state_lines(word, sentence, style), *([Line("   ", over)] if worst else []), *rows]


def _ahead(one: TrendLine, bound: float) -> bool:
    """A limit on the side that a quantity goes to; both where it goes nowhere."""
    way = one.course.slope if one.course is not None and one.course.drifts else one.values[-1] - one.values[0]
    return one.state not in ("reached", "drifts") or (bound - one.values[0]) * way >= 0.0


def _changed(one: TrendLine) -> str:
    """Change since the first run, in per cent of it."""
    change = 100.0 * (one.values[-1] / one.values[0] - 1.0) if one.values[0] else math.nan
    return f"{change:+.2g} %" if abs(change) > MINUTE else "0 %" if math.isfinite(change) else "-"


def _yearly(one: TrendLine) -> str:
    """Drift in per cent a year, or the least that would be seen."""
    course, year = one.course, 100.0 * 365.25 * DAY_S
    if course is None or not course.level:
        return "-"
    share = year / abs(course.level)
    if not course.drifts and share * course.sure_interval < MINUTE:
        return "0 %"
    return f"{share * course.slope:+.2g} %" if course.drifts else f"< {share * course.sure_interval:.2g} %"


def step(followed: Sequence[TrendLine], first: Path, newest: Path) -> list[Line]:
    """The command to type next.

    Parameters
    ----------
    followed : sequence of TrendLine
        A line for each quantity.
    first : Path
        Run of the trend.
    newest : Path
        Run of the trend.
    """
    if followed[0].state in ("reached", "drifts"):
        return command_lines(f"beltcomm diagnose {pasted(newest)}", "which effect is missing, and what to check on the machine")
    if first == newest:
        return command_lines(f"beltcomm report {pasted(newest)}", "everything known of it, as one page")
    return command_lines(f"beltcomm report {pasted(newest)} --against {pasted(first)}", "first and last run, side by side")


def number_of(item: Quantity, value: float) -> str:
    """A value in the unit of a quantity, three digits.

    Parameters
    ----------
    item : Quantity
        Whose unit it is.
    value : float
        SI.
    """
    return f"{item.scale * value:.3g} {item.unit}"


def date_of(t_s: float) -> str:
    """Day as ISO 8601, UTC; one beyond all planning in words.

    Parameters
    ----------
    t_s : float, s
        Since 1970, UTC.
    """
    if not 0.0 <= t_s < LAST_S:
        return "after 2200" if t_s > 0.0 else "before 1970"
    return str(np.datetime64(int(t_s), "s").astype("datetime64[D]"))
