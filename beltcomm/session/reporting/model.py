"""The model: parameters with intervals, beside what the data sheets say of them."""

from __future__ import annotations

import math

from beltcomm.axis import Axis
from beltcomm.model import Value
from beltcomm.report.page import Picture, Section, Table, Words
from beltcomm.session.cross_check_words import sheet_lines
from beltcomm.session.pictures import middle_of
from beltcomm.session.reporting.gather import Gathered
from beltcomm.session.words import SHOWN, number


def section(run: Gathered) -> Section:
    """Every parameter, its 95 % interval, where it comes from, and what contradicts a data sheet."""
    if run.model is None:
        return Section("model", "Model", missing=f"There is no model yet; beltcomm fit {run.name} makes one.")
    rows = []
    for name, value in run.model.parameters.items():
        sheet = _sheet(run.folder.axis, name, middle_of(run.folder))
        factor = "" if sheet is None else f"{value.value / sheet:.2f}"
        words, unit, scale = SHOWN.get(name, (name, value.unit, 1.0))
        rows.append((words, _shown(value, scale), unit, value.origin, "" if sheet is None else f"{scale * sheet:.4g}", factor))
    marks = ", ".join(f"{name} {hz:.2f} Hz" for name, hz in run.landmarks.items())
    parts: list[Words | Table | Picture] = [
        Words([f"Effects: {', '.join(run.model.effects)}.", *([f"In the middle of the travel: {marks}."] if marks else [])]),
        Table(("parameter", "value ± 95 %", "unit", "from", "data sheet", "factor"), rows),
    ]
    if run.laboratory is not None:
        doubts = sheet_lines(run.laboratory.sheets, run.folder.axis)
        parts.append(Words(doubts or ["Nothing contradicts the data sheets."], listed=bool(doubts)))
    fit = run.results.get("fit")
    if fit and fit.get("remarks"):
        parts.append(Words(fit["remarks"], listed=True))
    return Section("model", "Model", parts)


def _shown(value: Value, scale: float) -> str:
    if value.interval is not None and not math.isfinite(value.interval):
        return f"{scale * value.value:.4g}, not told by these data"
    return number(scale * value.value, None if value.interval is None else scale * value.interval, "").strip()


def _sheet(axis: Axis, name: str, middle_m: float) -> float | None:
    """What axis.yaml expects of a parameter, None where it says nothing."""
    if name == "motor.inertia":
        return axis.motor_side_inertia_kg_m2
    if name == "transmission.ratio":
        return axis.transmission_m_rad
    if name == "belt_stiffness.stiffness" and axis.get("belt.specific_stiffness_n") and axis.get("belt.pulley_distance_m"):
        return axis.belt_stiffness_n_m(middle_m)
    return None
