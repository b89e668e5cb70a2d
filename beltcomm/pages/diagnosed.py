"""Faults of the axis: cause, check and remedy of each effect that was named, its law over the records, and what missing it costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.effects import Effect, effect_named
from beltcomm.errors import BeltcommError
from beltcomm.given import pasted
from beltcomm.model import Model
from beltcomm.pages.gather import Gathered
from beltcomm.report.overlay import law_figure
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.style import Caption
from beltcomm.residuals.law import law_between
from beltcomm.result import with_unit
from beltcomm.rundata.cost import cost_rows
from beltcomm.rundata.revisions import Revision
from beltcomm.sentences.words import number

TITLE = "What was found"
COST_TITLE = "What missing effects cost"


def section(run: Gathered) -> Section:
    """A card for each effect that the last diagnosis named or that was added since.

    Parameters
    ----------
    run : Gathered
    """
    told = run.results.get("diagnosis") or {}
    added = run.rungs[-1].effects if run.rungs else ()
    base = run.rungs[0].effects if run.rungs else ()
    named = dict.fromkeys([*(name for name in added if name not in base), *(told.get("named") or ())])
    parts: list[Paragraphs | PageTable | Picture] = []
    for name in named:
        try:
            effect = effect_named(name)
        except BeltcommError:  # of another version
            continue
        if effect.check or effect.causes:
            parts += _card(run, effect, told)
    if not parts:
        searched = (
            "Nothing: the diagnosis named no effect that is missing." if told else "No diagnosis was made: beltcomm diagnose makes one."
        )
        return Section("diagnosed", TITLE, missing=searched)
    return Section("diagnosed", TITLE, parts)


def _card(run: Gathered, effect: Effect, told: Mapping[str, Any]) -> list[Paragraphs | PageTable | Picture]:
    values = _values(run.model, effect, told)
    sizes = ", ".join(f"{name.partition('.')[2]} {with_unit(number(*shown[:2], ''), shown[2])}" for name, shown in values.items())
    rows = [("cause", effect.causes or effect.title), ("check", effect.check), ("remedy", effect.remedy), ("size", sizes)]
    parts: list[Paragraphs | PageTable | Picture] = [
        Paragraphs([f"{effect.title[:1].upper()}{effect.title[1:]} ({effect.name}): {effect.seen}."]),
        PageTable(("", ""), [row for row in rows if row[1]]),
    ]
    if (picture := _picture(run, effect, {name: shown[0] for name, shown in values.items()})) is not None:
        parts.append(picture)
    return parts


def _values(model: Model | None, effect: Effect, told: Mapping[str, Any]) -> dict[str, tuple[float, float | None, str]]:
    """Value, interval and unit of its parameters: of the present model, else as the diagnosis told them."""
    if model is not None and effect.name in model.effects:
        return {name: (v.value, v.interval, v.unit) for name in effect.full_names() if (v := model.parameters[name]).interval is not None}
    said = (told.get("after") or {}).get("parameters") or {}
    known = [(name, one) for name in effect.full_names() if (one := said.get(name)) and one.get("interval") is not None]
    return {name: (one["value"], one["interval"], one.get("unit") or "") for name, one in known}


def _picture(run: Gathered, effect: Effect, values: Mapping[str, float]) -> Picture | None:
    """Its law over what a model without it leaves; None where it is no curve along one coordinate, or nothing can be compared."""
    if run.laboratory is None or run.comparison is None or effect.needs_observer:
        return None
    fitted = run.laboratory.fitted
    try:
        model = fitted.model
        without, grown = (
            (model.without_effect(effect.name), model)
            if effect.name in model.effects
            else (model, model.with_effect(effect.name, {name.partition(".")[2]: value for name, value in values.items()}))
        )
        curve = law_between(fitted, run.comparison.judged, without, grown)
    except BeltcommError:
        return None
    if curve.along == "frequency":
        return None
    units = run.comparison.judged[0].units
    return picture_of(law_figure(effect.title, curve, units, Caption(run.command, f"{run.name}/recordings")))


def cost_section(run: Gathered) -> Section:
    """Predicted errors of the standard move by a controller that does not know an effect, and by one that does; one table a revision.

    Parameters
    ----------
    run : Gathered
    """
    added = [rung for rung in run.rungs if rung.change.startswith("+")]
    if not added:
        return Section(
            "cost", COST_TITLE, missing=f"No effect was added; beltcomm diagnose {pasted(run.place)} looks for one that is missing."
        )
    known = [rung for rung in added if rung.cost is not None]
    parts: list[Paragraphs | PageTable | Picture] = [part for rung in known for part in _priced(rung)]
    if unknown := [f"{rung.name} ({rung.change})" for rung in added if rung.cost is None]:
        parts.append(
            Paragraphs(
                [f"Not known of {', '.join(unknown)}: asked for with --no-cost, part of a later one, or no move could be predicted."]
            )
        )
    return Section("cost", COST_TITLE, parts)


def _priced(rung: Revision) -> list[Paragraphs | PageTable | Picture]:
    assert rung.cost is not None
    name, move = rung.cost["of"], rung.cost["move"]
    ranged = bool(rung.cost.get("aware_range"))
    rows = cost_rows(rung.cost) if ranged else [row[:2] + row[3:4] for row in cost_rows(rung.cost)]
    head = ("error in mm", f"without {name}", "range", "with it", "range") if ranged else ("error in mm", f"without {name}", "with it")
    words = "By a controller made without it and by one made with it." + (
        " Range: smallest to largest over the intervals of the model." if ranged else ""
    )
    return [Paragraphs([f"{rung.name}: predicted for the move from {move} on a machine with {name}."]), PageTable(head, rows, words)]
