"""Cost in tracking error of effects that the model missed."""

from __future__ import annotations

from beltcomm.given import pasted
from beltcomm.pages.gather import Gathered
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section
from beltcomm.rundata.cost import cost_rows
from beltcomm.rundata.revisions import Revision

TITLE = "What missing effects cost"


def section(run: Gathered) -> Section:
    """Predicted errors of the standard move by a controller that does not know an effect, and by one that does; one table a revision."""
    added = [rung for rung in run.rungs if rung.change.startswith("+")]
    if not added:
        return Section("cost", TITLE, missing=f"No effect was added; beltcomm diagnose {pasted(run.place)} looks for one that is missing.")
    known = [rung for rung in added if rung.cost is not None]
    parts: list[Paragraphs | PageTable | Picture] = [part for rung in known for part in _priced(rung)]
    if unknown := [f"{rung.name} ({rung.change})" for rung in added if rung.cost is None]:
        parts.append(
            Paragraphs(
                [f"Not known of {', '.join(unknown)}: asked for with --no-cost, part of a later one, or no move could be predicted."]
            )
        )
    return Section("cost", TITLE, parts)


def _priced(rung: Revision) -> list[Paragraphs | PageTable | Picture]:
    assert rung.cost is not None
    name, move = rung.cost["of"], rung.cost["move"]
    ranged = bool(rung.cost.get("aware_range"))
    rows = cost_rows(rung.cost) if ranged else [row[:2] + row[3:4] for row in cost_rows(rung.cost)]
    head = ("error in µm", f"without {name}", "range", "with it", "range") if ranged else ("error in µm", f"without {name}", "with it")
    words = "By a controller made without it and by one made with it." + (
        " Range: smallest to largest over the intervals of the model." if ranged else ""
    )
    return [Paragraphs([f"{rung.name}: predicted for the move from {move} on a machine with {name}."]), PageTable(head, rows, words)]
