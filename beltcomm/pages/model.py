"""The model: parameters with intervals, beside what the data sheets say of them; and where it fails: error maps, records, revisions."""

from __future__ import annotations

import math

import numpy as np

from beltcomm.fit.start.model import knows_stiffness
from beltcomm.given import pasted
from beltcomm.laboratory.compare import worst
from beltcomm.model.value import Value
from beltcomm.pages import pictures
from beltcomm.pages.gather import Gathered
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.result import with_unit
from beltcomm.rundata.revisions import current_revision
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.laboratory import record_table
from beltcomm.sentences.torque_path import path_sentences
from beltcomm.sentences.words import SHOWN, number

#: Names as everywhere, and of what is never fitted.
NAMES = {**SHOWN, "transmission.ratio": ("way of the carriage per turn of the motor", "mm", 2e3 * math.pi)}
#: Entry of axis.yaml -> the parameter that may contradict it.
PARAMETER_OF = {"belt.specific_stiffness_n": "belt_stiffness.stiffness", "motor.inertia_kg_m2": "motor.inertia"}


def section(run: Gathered) -> Section:
    """Section on the model: every parameter, its 95 % interval, where it comes from, and what contradicts a data sheet.

    Parameters
    ----------
    run : Gathered
    """
    if run.model is None:
        return Section("model", "Model", missing=f"There is no model yet; beltcomm fit {pasted(run.place)} makes one.")
    rows = []
    contradicted = {PARAMETER_OF.get(one.entry): one for one in run.laboratory.sheets} if run.laboratory is not None else {}
    for name, value in run.model.parameters.items():
        words, unit, scale = NAMES.get(name, (name, with_unit("", value.unit).strip(), 1.0))
        sheet, expected, factor = _sheet(run, name), "", ""
        if (doubt := contradicted.get(name)) is not None:  # one number for one thing: that of the sentence below
            expected, factor = f"{scale * doubt.sheet:.4g}", f"{doubt.factor:.2f}"
        elif sheet is not None:
            expected = " to ".join(dict.fromkeys(f"{scale * end:.4g}" for end in sheet))
            factor = f"{value.value / min(max(value.value, sheet[0]), sheet[1]):.2f}"
        rows.append((words, _shown(value, scale), unit, value.origin, expected, factor))
    marks = ", ".join(f"{name} {hz:.2f} Hz" for name, hz in run.landmarks.items())
    parts: list[Paragraphs | PageTable | Picture] = [
        Paragraphs(
            [
                f"Effects in it: {', '.join(run.model.effects)}; beltcomm effects NAME says what each is.",
                *([f"In the middle of the travel: {marks}."] if marks else []),
            ]
        ),
        PageTable(("parameter", "value ± 95 %", "unit", "from", "data sheet", "factor"), rows),
    ]
    if run.laboratory is not None:
        doubts = sheet_lines(run.laboratory.sheets)
        parts.append(Paragraphs(doubts or ["Nothing contradicts the data sheets."], listed=bool(doubts)))
    fit = run.results.get("fit")
    if fit and fit.get("remarks") and current_revision(run.folder) is None:  # they are of the model that was fitted then
        parts.append(Paragraphs(fit["remarks"], listed=True))
    return Section("model", "Model", parts)


def _shown(value: Value, scale: float) -> str:
    if value.interval is not None and not math.isfinite(value.interval):
        return f"{scale * value.value:.4g}, not told by these data"
    return number(scale * value.value, None if value.interval is None else scale * value.interval, "").strip()


def _sheet(run: Gathered, name: str) -> tuple[float, float] | None:
    """Range of a parameter by axis.yaml, None where it says nothing.

    A stiffness for the places in the middle of those that were recorded, as :func:`beltcomm.laboratory.cross_checks.sheet_doubts` has it.
    """
    axis = run.folder.axis
    if name == "motor.inertia" and axis.motor_side_inertia_kg_m2 > 0.0:
        return axis.motor_side_inertia_kg_m2, axis.motor_side_inertia_kg_m2
    if name == "transmission.ratio":
        return axis.transmission_m_rad, axis.transmission_m_rad
    places = [
        r.sidecar.start_position_m for r in run.recordings if r.sidecar.experiment == "frf" and r.sidecar.start_position_m is not None
    ]
    if name == "belt_stiffness.stiffness" and places and knows_stiffness(axis):
        both = [axis.belt_stiffness_n_m(float(place)) for place in np.percentile(places, [25.0, 75.0])]
        return min(both), max(both)
    return None


def error_section(run: Gathered) -> Section:
    """Section on the error: ratios by record, places in words, maps over frequency, speed, direction, position, amplitude and time.

    Parameters
    ----------
    run : Gathered
    """
    found = run.comparison
    if found is None or run.laboratory is None:
        return Section(
            "model-error", "Where the model fails", missing=f"Nothing to compare; beltcomm fit {pasted(run.place)} makes a model."
        )
    data = run.laboratory.data
    said = [
        *([] if worst(found) else ["No place stands out."]),
        *path_sentences(data.path, data.recordings),
    ]  # else the picture says where
    titles, rows = record_table(found)
    note = "Error over noise 1.00 means that nothing is missing in that record."
    drawn = pictures.error_figures(run.folder, data, run.laboratory.fitted, found, run.command)
    parts: list[Paragraphs | PageTable | Picture] = [Paragraphs(said, listed=True)] if said else []
    parts += [picture_of(figure) for figure in drawn.values()]
    parts.append(PageTable([title.removeprefix(">") for title in titles], rows, note))
    if run.rungs:
        parts += [picture_of(figure) for figure in pictures.ladder_figures(run.folder, run.rungs, run.command).values()]
    return Section("model-error", "Where the model fails", parts)
