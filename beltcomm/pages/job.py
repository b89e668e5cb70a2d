"""``beltcomm report``: a run as one page of HTML, and as JSON beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.axis.terms import pictures_in
from beltcomm.errors import UsageError
from beltcomm.laboratory.scope import reservation
from beltcomm.language import tr
from beltcomm.pages import axis, changes, diagnosed, loops, model, safety, tracking
from beltcomm.pages.gather import Gathered, gathered
from beltcomm.pages.page_file import admit_page, write_page
from beltcomm.quantities import mm
from beltcomm.report.page import Fact, Page, State, render
from beltcomm.result import Result, plain
from beltcomm.rundata.headline import MEANINGS, headline_of, next_command
from beltcomm.sentences import screens
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.laboratory import error_words
from beltcomm.sentences.own_words import said_in
from beltcomm.talk import Silence, Talk

#: The page and its numbers, in the run folder.
NAME = "report.html"

#: Every part of the page, in the order shown.
PARTS = (
    diagnosed.section,
    tracking.section,
    loops.gains_section,
    model.section,
    model.error_section,
    diagnosed.cost_section,
    axis.frequency,
    axis.friction_section,
    loops.section,
    safety.section,
    safety.journal,
)
#: Parts that are open at once: what was found, what the axis does, and by which gains.
FIRST = ("diagnosed", "tracking", "gains")


def report(run: Path, *, against: Path | None = None, out: Path | None = None, talk: Talk | None = None) -> Result:
    """Write the report of a run and its numbers beside it; returns where they are.

    Parameters
    ----------
    run : Path
    against : Path or None
        An earlier run of the same axis; the page begins with what changed since.
    out : Path or None
        Of the page, ``RUN/report.html`` unless told.
    talk : Talk or None
        Hears progress; None says nothing.

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
    terms = found.folder.terms
    with pictures_in(terms):
        page = said_in(terms, _page_of(found, before), keys=True)
    where = out or run / NAME
    beside = where.with_suffix(".json")
    # a page may be sent to anybody: it names no folder of the machine that it was made on
    data, problems = _numbers_of(found, page, before), []
    written = tr("Report: {page}, numbers in {file}", page=where, file=beside.name)
    try:
        write_page(where, render(page).replace(f"{run.resolve()}/", ""), data)
    except UsageError as problem:
        if out is not None:
            raise
        problems = [written := f"There is no page: {problem}: give another place by --out."]
    facts = [f"  {fact.name}: {fact.value} ({fact.words})" for fact in page.facts]
    since = [f"Since {before.name}:", *(f"  {line}" for line in page.changes)] if before is not None else []
    steps = (step.partition(": ") for step in _next_steps(found, str(run)))
    advice = [f"Next: {command}   ({why})" for command, _, why in steps]
    text = [page.verdict, *screens.warning_lines(page.warnings), *advice, *facts, *since, written]
    return Result({**data, "page": None if problems else str(where)}, text, UsageError.exit_code if problems else 0)


def _page_of(found: Gathered, before: Gathered | None) -> Page:
    """The whole page."""
    changed = changes.compared(before, found) if before is not None else []
    first_part = [changes.section(before, found, changed)] if before is not None else []
    sentence, state = _verdict(found)
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
        _facts(found),
        _next_steps(found),
        [*first_part, *(replace(made, folded=made.key not in FIRST) for made in (part(found) for part in PARTS))],
        [f"Made by: {found.command}", *found.remarks],
        changes.named(changed, before, found) if before is not None else (),
        _warnings(found),
    )


def _numbers_of(found: Gathered, page: Page, before: Gathered | None) -> dict[str, Any]:
    """Numbers of the page, for programs."""
    comparison = found.comparison
    doubts = found.laboratory.sheets if found.laboratory is not None else ()
    return {
        "run": found.name,
        "headline": headline_of(found.folder).to_dict(),
        "verdict": page.verdict,
        "warnings": list(page.warnings),
        "state": page.state,
        "facts": [plain(fact) for fact in page.facts],
        "next": list(page.next_steps),
        "sections": [section.key for section in page.sections],
        "missing": None if comparison is None else comparison.missing,
        "decisive_ratio": None if comparison is None else comparison.decisive_ratio,
        "ratio": None if comparison is None else {"overall": comparison.ratio, "held_out": comparison.held_out},
        "plain": None if comparison is None else plain({"overall": comparison.plain, "held_out": comparison.plain_held_out}),
        "data_sheet": [plain(doubt) for doubt in doubts],
        "data_sheet_words": sheet_lines(doubts),
        "costs": [{"revision": rung.name, "change": rung.change, **rung.cost} for rung in found.rungs if rung.cost is not None],
        "results": plain(dict(found.results)),
        "against": None if before is None else {"run": before.name, "changes": plain(changes.compared(before, found))},
    }


def _verdict(run: Gathered) -> tuple[str, State]:
    """The headline, and what it means."""
    found = headline_of(run.folder)
    return found.text, MEANINGS[found.state]


def _warnings(run: Gathered) -> list[str]:
    """Notes below the headline, as the answer on a terminal has them."""
    sheets = run.laboratory.sheets if run.laboratory is not None else ()
    return screens.warnings(run.results.get(headline_of(run.folder).move or "fit") or {}, plain(list(sheets)))


def _facts(run: Gathered) -> list[Fact]:
    """Tracking error, model error, margin; each says what is missing where it is not known."""
    return [_tracking(run), _model(run), _margin(run)]


def _tracking(run: Gathered) -> Fact:
    moves = run.verifications
    if not moves:
        return Fact(tr("Following error"), tr("not measured"), tr("beltcomm verify drives a move and measures it"), "note")
    last: Mapping[str, Any] = list(moves.values())[-1]
    measured, predicted = last["measured"], last["predicted"]
    guess, rest = mm(predicted["dynamic_m"]), mm(measured["static_m"])
    words = tr("largest while moving; predicted {guess}; at rest {rest}", guess=guess, rest=rest)
    return Fact(tr("Following error, motor"), mm(measured["dynamic_m"]), words, "good" if last["passed"] else "bad")


def _model(run: Gathered) -> Fact:
    found = run.comparison
    if found is None:
        return Fact(tr("Model error"), tr("not compared"), run.remarks[0] if run.remarks else "beltcomm compare says why", "note")
    _, said, style = screens.model_state(found.decisive_ratio, missing=found.missing)
    said = said.partition(" (")[0]  # the number stands beside it
    state: State = "good" if style == "good" else "bad"
    if run.laboratory is not None and (doubt := reservation(found, run.laboratory.fitted, run.recordings)):
        said, state = doubt.rstrip("."), "note"
    words = error_words((found.ratio, found.held_out), (found.plain, found.plain_held_out)).partition(", ")[2]
    return Fact(
        tr("Model error"),
        tr("{ratio:.2f} × noise", ratio=found.ratio),
        f"{said}; {words}",
        state,
    )


def _margin(run: Gathered) -> Fact:
    margins = run.design.get("margins") or []
    if not margins:
        belt = not run.folder.has_axis or run.folder.axis.has_transmission
        words = tr("beltcomm design makes one of the model") if belt else tr("none is made of an axis without belt and pulley")
        return Fact(tr("Phase margin"), tr("no design"), words, "note")
    least = min(m["phase_margin_deg"] for m in margins)
    asked = run.design["specification"]["phase_margin_deg"]
    words = tr("velocity loop, smallest of {count} variants of the model; {asked:.0f}° were asked for", count=len(margins), asked=asked)
    return Fact(tr("Phase margin"), f"{least:.0f}°", words, "good" if least >= asked - 0.5 else "note")


def _next_steps(run: Gathered, called: str = "") -> list[str]:
    """The command that helps most; ``called``: the run's folder as a terminal takes it, on a page :attr:`Gathered.place`."""
    found = next_command(run.folder, headline_of(run.folder), called=called or run.place)
    return [f"{found.command}: {found.why}"]
