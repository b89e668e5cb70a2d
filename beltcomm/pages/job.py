"""``beltcomm report``: a run as one page of HTML, and as JSON beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.axis.terms import terms_of
from beltcomm.errors import UsageError
from beltcomm.pages import axis, changes, diagnosed, first, gains, loops, missing, model, model_error, safety, tracking
from beltcomm.pages.gather import Gathered, gathered
from beltcomm.pages.page_file import admit_page, write_page
from beltcomm.report.page import Page, render
from beltcomm.result import Result, plain
from beltcomm.rundata.headline import headline_of
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.own_words import said_in
from beltcomm.talk import Silence, Talk

#: The page and its numbers, in the run folder.
NAME = "report.html"
#: Every part of the page, in the order shown.
PARTS = (
    diagnosed.section,
    tracking.section,
    gains.section,
    model.section,
    model_error.section,
    missing.section,
    axis.frequency,
    axis.sliding,
    loops.section,
    safety.section,
    safety.journal,
)


def report(run: Path, *, against: Path | None = None, out: Path | None = None, talk: Talk | None = None) -> Result:
    """Write the report of a run and its numbers beside it; returns where they are.

    Parameters
    ----------
    against : Path or None
        An earlier run of the same axis; the page begins with what changed since.
    out : Path or None
        Of the page, ``RUN/report.html`` unless told.

    Raises
    ------
    DataError
        For a folder that is none.
    UsageError
        For a place that cannot be written or holds something else.
    """
    if against is not None and against.resolve() == run.resolve():
        raise UsageError(f"{run} cannot be compared with itself; give an earlier run of the same axis behind --against")
    if out is not None:
        admit_page(out)
    before = gathered(against, talk or Silence(), compared=False) if against is not None else None  # first: it may not be there
    found = gathered(run, talk or Silence(), against)
    page = said_in(terms_of(found.folder.axis), page_of(found, before), keys=True) if found.folder.has_axis else page_of(found, before)
    where = out or run / NAME
    beside = where.with_suffix(".json")
    # a page may be sent to anybody: it names no folder of the machine that it was made on
    data, written = numbers_of(found, page, before), [f"Report: {where}, numbers in {beside.name}"]
    try:
        write_page(where, render(page).replace(f"{run.resolve()}/", ""), data)
    except UsageError as problem:
        if out is not None:
            raise
        written = [f"There is no page: {problem}: give another place by --out."]
    facts = [f"  {fact.name}: {fact.value} ({fact.words})" for fact in page.facts]
    since = [f"Since {before.name}:", *(f"  {line}" for line in page.changes)] if before is not None else []
    steps = (step.partition(": ") for step in first.next_steps(found, str(run)))
    following = [f"Next: {command}   ({why})" for command, _, why in steps]
    there = written[0].startswith("Report")
    text = [page.verdict, *following, *facts, *since, *written]
    return Result({**data, "page": str(where) if there else None}, text, 0 if there else UsageError.exit_code)


def page_of(found: Gathered, before: Gathered | None = None) -> Page:
    """The whole page.

    Parameters
    ----------
    before : Gathered or None
        The earlier run that it is compared with.
    """
    changed = changes.compared(before, found) if before is not None else []
    first_part = [changes.section(before, found, changed)] if before is not None else []
    sentence, state = first.verdict(found)
    name, drive = found.folder.axis.name, found.folder.drive
    began, made_by, serial = found.folder.began_s, found.folder.made_by, drive.get("serial_number", "")
    about = [
        name,
        drive.get("device_name", ""),
        f"serial number {serial}" if serial else "",
        f"run {found.name}",
        f"begun {np.datetime64(round(began), 's')} UTC".replace("T", " ") if began is not None else "",
        f"beltcomm {made_by}" if made_by else "",
    ]
    subtitle = ", ".join(filter(None, about))
    return Page(
        f"{name or 'Axis'}: report",
        subtitle,
        sentence,
        state,
        first.facts(found),
        first.next_steps(found),
        [*first_part, *(part(found) for part in PARTS)],
        [f"Made by: {found.command}", *found.remarks],
        changes.named(changed, before, found) if before is not None else (),
    )


def numbers_of(found: Gathered, page: Page, before: Gathered | None = None) -> dict[str, Any]:
    """Numbers of the page, for programs."""
    comparison = found.comparison
    doubts = found.laboratory.sheets if found.laboratory is not None else ()
    return {
        "run": found.name,
        "headline": headline_of(found.folder).to_dict(),
        "verdict": page.verdict,
        "state": page.state,
        "facts": [plain(fact) for fact in page.facts],
        "next": list(page.next_steps),
        "sections": [section.key for section in page.sections],
        "ratio": None if comparison is None else {"overall": comparison.ratio, "held_out": comparison.held_out},
        "plain": None if comparison is None else plain({"overall": comparison.plain, "held_out": comparison.plain_held_out}),
        "data_sheet": [plain(doubt) for doubt in doubts],
        "data_sheet_words": sheet_lines(doubts),
        "costs": [{"revision": rung.name, "change": rung.change, **rung.cost} for rung in found.rungs if rung.cost is not None],
        "results": plain(dict(found.results)),
        "against": None if before is None else {"run": before.name, "changes": plain(changes.compared(before, found))},
    }
