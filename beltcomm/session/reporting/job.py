"""``beltcomm report``: a run as one page of HTML, and as JSON beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from beltcomm.configfiles import write_text
from beltcomm.report.page import Page, render
from beltcomm.result import Result, jsonable, plain
from beltcomm.session.reporting import axis, first, gains, loops, model, model_error, safety, tracking
from beltcomm.session.reporting.gather import Gathered, gathered
from beltcomm.talk import Silence, Talk

#: The page and its numbers, in the run folder.
NAME = "report.html"
#: Every part of the page, in the order shown.
PARTS = (
    safety.section,
    axis.frequency,
    axis.sliding,
    model.section,
    model_error.section,
    loops.section,
    tracking.section,
    gains.section,
    safety.journal,
)


def report(run: Path, *, out: Path | None = None, talk: Talk | None = None) -> Result:
    """Write the report of a run and its numbers beside it; returns where they are.

    out : of the page, ``RUN/report.html`` unless told.   Raises DataError for a folder that is none, UsageError for a place that cannot be
    written.
    """
    found = gathered(run, talk or Silence())
    page = page_of(found)
    where = out or run / NAME
    beside = where.with_suffix(".json")
    # a page may be sent to anybody: it names no folder of the machine that it was made on
    write_text(where, render(page).replace(f"{run.resolve()}/", ""))
    data = numbers_of(found, page)
    write_text(beside, json.dumps(jsonable(data), indent=1) + "\n")
    facts = [f"  {fact.name}: {fact.value} ({fact.words})" for fact in page.facts]
    return Result({**data, "page": str(where)}, [page.verdict, *facts, f"Report: {where}, numbers in {beside.name}"])


def page_of(found: Gathered) -> Page:
    """The whole page."""
    sentence, state = first.verdict(found)
    name, drive = found.folder.axis.name, found.folder.drive
    subtitle = ", ".join(filter(None, [name, drive.get("device_name", ""), f"run {found.name}"]))
    return Page(
        f"{name or 'Axis'}: report",
        subtitle,
        sentence,
        state,
        first.facts(found),
        first.next_steps(found),
        [part(found) for part in PARTS],
        [f"Made by: {found.command}", *found.remarks],
    )


def numbers_of(found: Gathered, page: Page) -> dict[str, Any]:
    """What the page shows, for programs."""
    comparison = found.comparison
    return {
        "run": found.name,
        "verdict": page.verdict,
        "state": page.state,
        "facts": [plain(fact) for fact in page.facts],
        "next": list(page.next_steps),
        "sections": [section.key for section in page.sections],
        "ratio": None if comparison is None else {"overall": comparison.ratio, "held_out": comparison.held_out},
        "results": plain(dict(found.results)),
    }
