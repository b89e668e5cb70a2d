"""``beltcomm trend``: one axis over many runs, what drifts, and when it reaches its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.terms import pictures_in
from beltcomm.configfiles import did_you_mean, read_yaml
from beltcomm.errors import DataError, UsageError
from beltcomm.given import pasted
from beltcomm.identify.course import FEWEST, LinearTrend, course_of
from beltcomm.locks import occupied
from beltcomm.pages.gather import results_of
from beltcomm.pages.page_file import admit_page, write_page
from beltcomm.pages.quantities import Quantity, quantities_of
from beltcomm.pages.trend_screen import MINUTE, Dated, TrendLine, date_of, number_of, screen, step
from beltcomm.report.page import Fact, Page, PageTable, Paragraphs, Section, State, picture_of, render
from beltcomm.report.style import Caption
from beltcomm.report.trend import DAY_S, Followed, trend_figure
from beltcomm.result import Line, Result, plain
from beltcomm.rundata.revisions import current_model
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import said_in
from beltcomm.sentences.words import number
from beltcomm.talk import Silence
from beltcomm.watching import store
from beltcomm.watching.limits import LIMITS, Limit, limits_given

NAME = "trend.html"
#: Times the time observed, from which on an extrapolation is called one.
FAR = 3.0
#: What is told first.
STATES = ("reached", "drifts", "unsure", "steady")


def _targets(axis: Axis) -> dict[str, Limit]:
    """Targets of the newest run's axis, as limits."""
    why = "the target" if axis.targets.stated else "the default target"
    return {
        "dynamic_error": Limit(None, axis.targets.following_m, f"{why} of the move that verifies", absolute=True),
        "static_error": Limit(None, axis.targets.settled_m, f"{why} of the move that verifies", absolute=True),
    }


def trend(runs: Sequence[Path], *, limits: Sequence[str] = (), dates: Sequence[str] = (), out: Path | None = None) -> Result:
    """All quantities that at least two of the runs know, over their dates, with limits.   Exit code 1 where a limit is reached.

    The days on which a run was watched in production count as runs: what a quantity was by the first moves is what it was in the run.

    Parameters
    ----------
    runs : sequence of Path
        Run folders of one axis.
    limits : sequence of str
        ``KEY=-20%``, ``KEY=+50%``, or an SI value for an upper limit.
    dates : sequence of str
        ISO 8601, one for each run.
    out : Path or None
        Of the page, ``trend.html`` in the folder of the newest run unless told.

    Raises
    ------
    UsageError
        For fewer than two runs, unknown limits, dates that cannot be read, and runs of different axes.
    """
    if out is not None:
        admit_page(out)
    watched = [day for run in runs for day in _days_watched(RunFolder.open(run))]
    if len(runs) + len(watched) < 2:
        raise UsageError(
            "a trend needs at least two runs of one axis, and three to tell a trend from scatter; or one that `beltcomm watch` has followed"
        )
    if dates and len(dates) != len(runs):
        raise UsageError(f"{len(dates)} dates for {len(runs)} runs; give --date once for each run, in the same order")
    dated = sorted([*(_dated(run, dates[i] if dates else None) for i, run in enumerate(runs)), *watched], key=lambda one: one.t_s)
    known = {key for one in dated for key in one.found}
    if unknown := sorted(set(limits_given(limits)) - known):
        raise UsageError(f"no run knows {unknown[0]}{did_you_mean(unknown[0], sorted(known))}; there are {', '.join(sorted(known))}")
    folders = [RunFolder.open(run) for run in runs]
    given_dates: list[str | None] = [*dates] or [None] * len(runs)
    asked = max(zip(folders, given_dates, strict=True), key=lambda one: _time_of(*one)[0])[0]
    bounds = {**LIMITS, **(_targets(asked.axis) if asked.has_axis else {}), **limits_given(limits)}
    remarks = _remarks(folders, dated)
    followed = [
        one
        for key in dict.fromkeys(k for d in dated for k in d.found)
        if (one := _followed(key, dated, bounds.get(key), len(known))) is not None
    ]
    followed.sort(key=lambda one: STATES.index(one.state))
    if not followed:
        raise DataError("no two of these runs know the same quantity; make models with beltcomm fit")
    given = {run.resolve().name: run for run in runs}
    shown = [one for one in dated if one.name in given]
    terms = asked.terms
    with pictures_in(terms):
        made = _page(folders[0].axis.name or "Axis", followed, shown, [given[one.name] for one in shown], remarks)
    page = said_in(terms, made, keys=True)
    newest = max(runs, key=lambda run: next(d.t_s for d in dated if d.name == run.resolve().name))
    where = out or newest / NAME
    data = {
        "runs": [{"name": d.name, "date": date_of(d.t_s), "date_from": d.source} for d in dated],
        "verdict": page.verdict,
        "quantities": {one.last.key: plain(one) for one in followed},
        "remarks": remarks,
    }
    with occupied(newest, Silence()):
        write_page(where, render(page), said_in(terms, data))
    reached = any(one.state == "reached" for one in followed)
    text: list[str] = [*screen(followed, dated), *(Line("   ", (f"! {line}", "note")) for line in remarks)]
    courses = [f"{one.last.words}: {one.text.removeprefix(f'{one.last.words}: ')}" for one in followed]
    first = given[shown[0].name] if shown else newest
    text = [*text, f"  Trend: {where}, numbers in {where.with_suffix('.json').name}", *step(followed, first, newest)]
    return Result({**data, "page": str(where)}, text, int(reached), details=["", *courses])


def _dated(run: Path, date: str | None) -> Dated:
    folder = RunFolder.open(run)
    t_s, source = _time_of(folder, date)
    return Dated(folder.path.resolve().name, t_s, source, quantities_of(current_model(folder), results_of(folder), folder.terms))


def _days_watched(folder: RunFolder) -> list[Dated]:
    """The days on which production was watched by a run's model."""
    known = quantities_of(current_model(folder), results_of(folder), folder.terms)
    found = []
    for t_s, told in store.by_day(folder.path):
        here = {
            key: replace(known[key], value=share * known[key].value, interval=half * abs(known[key].value))
            for key, (share, half) in told.items()
            if key in known
        }
        if here:
            found.append(Dated(f"{folder.path.resolve().name}, watched {date_of(t_s)}", t_s, "watch", here))
    return found


def _time_of(folder: RunFolder, date: str | None) -> tuple[float, str]:
    """Time of a run: as given, as its drive's session noted it, else by its oldest file."""
    if date is not None:
        try:
            return float(np.datetime64(date, "s").astype(np.int64)), "given"
        except ValueError:
            raise UsageError(f"the date {date!r} cannot be read; write it as 2026-03-31") from None
    about = folder.path / "run.yaml"
    began = read_yaml(about, DataError).get("began_s") if about.is_file() else None
    if isinstance(began, (int, float)):
        return float(began), "run.yaml"
    files = [path.stat().st_mtime for path in folder.recordings_folder.glob("*.csv")]
    if not files:
        raise DataError(f"{folder.path} has no recordings and no date; give --date for every run")
    return min(files), "the files' own date"


def _remarks(folders: Sequence[RunFolder], dated: Sequence[Dated]) -> list[str]:
    """Differences between the runs other than time."""
    remarks = []
    if any(one.source == "the files' own date" for one in dated):
        names = ", ".join(one.name for one in dated if one.source == "the files' own date")
        remarks.append(f"date by the files' own, which a copy may have changed: {names}; --date tells it")
    prints = {folder.axis.fingerprint() for folder in folders}
    if len(prints) > 1:
        remarks.append("axis.yaml differs between the runs: what changed in it may be what seems to drift")
    serials = {folder.drive.get("serial_number", "") for folder in folders}
    if len(serials) > 1:
        remarks.append("the runs were made on different drives: the scale of their torque may differ by some per cent")
    return remarks


def _followed(key: str, dated: Sequence[Dated], limit: Limit | None, looked_at: int) -> TrendLine | None:
    here = [one for one in dated if key in one.found]
    if len(here) < 2:
        return None
    items = [one.found[key] for one in here]
    t_s, values = np.array([one.t_s for one in here]), np.array([item.value for item in items])
    intervals = np.array([math.nan if item.interval is None else item.interval for item in items])
    low, high = limit.values(values[0]) if limit is not None else (None, None)
    course = course_of(t_s, values, intervals, looked_at) if _days(t_s) >= FEWEST else None
    state, text, reach = _said(items, t_s, course, (low, high))
    return TrendLine(
        items[-1],
        tuple(one.name for one in here),
        tuple(t_s.tolist()),
        tuple(values.tolist()),
        tuple(item.interval for item in items),
        (low, high),
        limit.why if limit is not None else "",
        course,
        state,
        text,
        reach,
    )


def _said(
    items: Sequence[Quantity], t_s: np.ndarray, course: LinearTrend | None, limits: tuple[float | None, float | None]
) -> tuple[str, str, tuple[float, float, float] | None]:
    """State, words, and when the limit is reached."""
    first, last = items[0], items[-1]
    low, high = limits
    for bound, beyond in ((low, -1.0), (high, 1.0)):
        if bound is not None and beyond * (last.value - bound) > 0.0:
            surely = last.interval is None or beyond * (last.value - bound) > last.interval
            word = "has reached its limit" if surely else "is at its limit, within its interval"
            return "reached", f"{last.words} {word}: {last.shown()}, limit {number_of(last, bound)}", None
    if course is None:
        change = 100.0 * (last.value / first.value - 1.0) if first.value else math.nan
        days = f"{_days(t_s)} of {FEWEST} days"
        return "unsure", f"{last.words}: {change:+.2g} % from {first.shown()} to {last.shown()}; {days}", None
    if not course.drifts:
        seen = 100.0 * course.sure_interval * 365.25 * DAY_S / abs(course.level) if course.level else 0.0
        least = f" (seen would be {seen:.2g} % a year)" if seen > MINUTE else ""
        return "steady", f"{last.words}: no drift that these runs show{least}", None
    year = 365.25 * DAY_S
    rate = f"{number(last.scale * course.slope * year, last.scale * course.slope_interval * year, last.unit)} a year"
    text = f"{last.more if course.slope > 0.0 else last.less}: {last.words} drifts by {rate}"
    bound = high if course.slope > 0.0 else low
    if bound is None:
        return "drifts", f"{text}; no limit on that side", None
    reach = course.reaches(bound)
    assert reach is not None  # it drifts
    early, by_line, late = reach
    far = by_line - float(t_s[-1]) > FAR * float(np.ptp(t_s))
    when = f"limit {number_of(last, bound)} by the line on {date_of(by_line)} ({date_of(early)} to {date_of(late)})"
    return "drifts", f"{text}; {when}" + (", far beyond the time observed: cannot tell" if far else ""), reach


def _days(t_s: np.ndarray) -> int:
    """Number of days with a run: several runs of one day show how they scatter, no course."""
    return len(np.unique(np.floor(t_s / DAY_S)))


def _page(axis: str, followed: Sequence[TrendLine], dated: Sequence[Dated], paths: Sequence[Path], remarks: Sequence[str]) -> Page:
    names = [one.name for one in dated]
    caption = Caption(f"beltcomm trend {' '.join(map(pasted, names))}", f"models and results of {len(names)} runs")
    reached = [one for one in followed if one.state == "reached"]
    drifting = [one for one in followed if one.state == "drifts"]
    soon = min((one for one in drifting if one.reach_s is not None), key=lambda one: one.reach_s[1] if one.reach_s else 0.0, default=None)
    state: State = "bad" if reached else "note" if drifting or any(one.course is None for one in followed) else "good"
    verdict = (
        f"{len(reached)} of {len(followed)} quantities beyond their limit: {', '.join(one.last.words for one in reached)}."
        if reached
        else f"{len(drifting)} of {len(followed)} quantities drift, none is beyond its limit."
        if drifting
        else "Nothing drifts that these runs show."
        if any(one.course is not None for one in followed)
        else "Cannot tell: runs of three different days are needed to tell a trend from scatter."
    )
    days = (dated[-1].t_s - dated[0].t_s) / DAY_S
    facts = [
        Fact("Runs", f"{len(dated)}", f"{date_of(dated[0].t_s)} to {date_of(dated[-1].t_s)}, {days:.0f} days"),
        Fact(
            "Drifting",
            f"{len(drifting)}",
            ", ".join(one.last.words for one in drifting) or "none that these runs show",
            "note" if drifting else "",
        ),
        Fact(
            "First limit",
            "reached" if reached else date_of(soon.reach_s[1]) if soon is not None and soon.reach_s else "not in sight",
            reached[0].text if reached else soon.text if soon is not None else "",
            "bad" if reached else "note" if soon is not None else "",
        ),
    ]
    steps = [
        f"beltcomm report {pasted(paths[-1])} --against {pasted(paths[0])}: what changed, with responses, friction and tracking of both"
    ]
    if reached or drifting:
        steps.append(f"beltcomm diagnose {pasted(paths[-1])}: which effect is missing, and what to check on the machine")
    scaled = [
        Followed(
            one.last.words,
            one.last.unit,
            np.array(one.t_s),
            one.last.scale * np.array(one.values),
            one.last.scale * np.array([math.nan if i is None else i for i in one.intervals]),
            (_scaled(one, 0), _scaled(one, 1)),
            _course_scaled(one),
        )
        for one in followed
    ]
    rows = [
        (
            one.last.words,
            one.last.unit,
            f"{one.last.scale * one.values[0]:.5g}",
            f"{one.last.scale * one.values[-1]:.5g}",
            "" if (a := _scaled(one, 0)) is None else f"{a:.4g}",
            "" if (b := _scaled(one, 1)) is None else f"{b:.4g}",
            one.why,
        )
        for one in followed
    ]
    sections = [
        Section("words", "What drifts", [Paragraphs([one.text for one in followed], listed=True)]),
        Section("courses", "Courses", [picture_of(trend_figure(scaled, caption))]),
        Section("limits", "Limits", [PageTable(("quantity", "unit", "first", "last", "low", "high", "why"), rows, _LIMIT_WORDS)]),
        Section("runs", "Runs", [PageTable(("run", "date", "from"), [(d.name, date_of(d.t_s), d.source) for d in dated])]),
    ]
    return Page(
        f"{axis}: trend", f"{names[0]} to {names[-1]}", verdict, state, facts, steps, sections, [f"Made by: {caption.command}", *remarks]
    )


_LIMIT_WORDS = (
    "Limits in per cent are of the first run. Line: weighted least squares; band: 95 %, widened to the scatter of the runs where they "
    "differ by more than their own intervals say. --limit KEY=-20%, KEY=+50% or KEY=0.2 (SI) sets others; keys: see the JSON."
)


def _scaled(one: TrendLine, side: int) -> float | None:
    value = one.limits[side]
    return None if value is None else one.last.scale * value


def _course_scaled(one: TrendLine) -> LinearTrend | None:
    if one.course is None:
        return None
    k = one.last.scale
    c = one.course
    return replace(
        c,
        level=k * c.level,
        slope=k * c.slope,
        level_interval=k * c.level_interval,
        slope_interval=k * c.slope_interval,
        sure_interval=k * c.sure_interval,
    )
