"""The report of a run: one file per part of the page, each a function from what the run folder holds to a section.

The functions here import what draws only when they are called: it takes longer to import than a command without pictures may last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltcomm.given import Place, pasted, place, places
from beltcomm.result import Result
from beltcomm.sentences.own_words import about_run, own_words
from beltcomm.talk import Talk

if TYPE_CHECKING:
    from beltcomm.laboratory.compare import Missing


@about_run()
def report(run: Place, *, against: Place | None = None, out: Place | None = None, talk: Talk | None = None) -> Result:
    """Write the page on a run and its numbers beside it; see :func:`beltcomm.pages.job.report`.

    Parameters
    ----------
    run : Place
        Run folder.
    against : Place or None
        An earlier run of the same axis; the page begins with what changed since.
    out : Place or None
        Of the page; None for ``report.html`` in the run.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Path and numbers of the page.
    """
    from beltcomm.pages.job import report as made

    page = None if out is None else place(out, "page")
    return made(place(run), against=None if against is None else place(against), out=page, talk=talk)


@dataclass(frozen=True)
class Ended:
    """The page of a run that was just commissioned, None where there is none.

    Attributes
    ----------
    line : str
        On it, or why there is none.
    error : float or None
        Of the model over the noise, as :attr:`beltcomm.laboratory.compare.Comparison.decisive_ratio`.
    missing : Missing or None
        Of that comparison.
    doubts : sequence of str
        What of the data sheets the model contradicts, in words.
    sheets : sequence of dict
        The same as numbers.
    """

    page: str | None
    line: str
    error: float | None = None
    missing: Missing | None = None
    doubts: Sequence[str] = ()
    sheets: Sequence[Mapping[str, Any]] = ()


def at_the_end(run: Path) -> Ended:
    """The report at the end of a session.   Whatever is wrong with it, the verdict it is about stands.

    Parameters
    ----------
    run : Path

    Returns
    -------
    Ended
        Place of the page and a line on it; None and the reason where there is none.
    """
    try:
        shown = report(run)
        made = shown.data
        known = (made.get("decisive_ratio"), made.get("missing"), made["data_sheet_words"], made["data_sheet"])
        if made["page"] is None:
            return Ended(None, f"Note: {shown.text[-1]}", *known)
        return Ended(str(made["page"]), f"Report: {made['page']}", *known)
    except Exception as problem:  # an axis was commissioned, and its gains may be in the drive
        return Ended(None, f"Note: there is no report ({type(problem).__name__}: {problem}); beltcomm report {pasted(run)} makes one")


@own_words
def trend(runs: Place | Sequence[Place], *, limits: Sequence[str] = (), dates: Sequence[str] = (), out: Place | None = None) -> Result:
    """Show one axis over many runs; see :func:`beltcomm.pages.trend_page.trend`.

    Parameters
    ----------
    runs : Place or sequence of Place
        At least two runs of one axis.
    limits : sequence of str
        ``KEY=-20%``, ``KEY=+50%``, or an SI value for an upper limit.
    dates : sequence of str
        ISO 8601, one for each run; empty for those that the runs tell.
    out : Place or None
        Of the page; None for ``trend.html`` in the folder of the newest run.

    Returns
    -------
    Result
        The quantities over time; exit code 1 where a limit is reached.
    """
    from beltcomm.pages.trend_page import trend as made

    return made(places(runs), limits=limits, dates=dates, out=None if out is None else place(out, "page"))
