"""What was measured of the axis itself: frequency responses by place and amplitude, friction over speed."""

from __future__ import annotations

from beltcomm.errors import BeltcommError
from beltcomm.report import bode, friction, responses
from beltcomm.report.page import Picture, Section, Table, Words, picture_of
from beltcomm.report.style import Caption
from beltcomm.session.friction_study import study_of
from beltcomm.session.reporting.gather import Gathered
from beltcomm.session.response_table import table_lines, table_of
from beltcomm.session.words import friction_lines


def frequency(run: Gathered) -> Section:
    """All responses with their 95 % bands and landmarks; the model over those that differ most, with coherence."""
    title = "Frequency responses"
    if run.model is None or not any(r.sidecar.experiment == "frf" for r in run.recordings):
        return Section("responses", title, missing="No response was measured; beltcomm identify does.")
    caption = Caption(run.command, f"{run.name}/recordings")
    table = table_of(run.recordings, run.model)
    parts: list[Words | Table | Picture] = []
    if run.comparison is not None:
        pairs = bode.response_pairs(run.recordings, run.comparison.judged)
        if pairs:
            parts.append(picture_of(bode.bode_figure(pairs, run.landmarks, caption)))
    if table.rows:
        shown = [(f"{row.condition.record}, {row.condition.words()}", row.response, row.landmarks) for row in table.rows]
        parts.append(picture_of(responses.responses_figure(shown, [f"by {d.cause}: {d.text}" for d in table.differences], caption)))
        parts.append(Words(table_lines(table), typed=True))
    return Section("responses", title, parts)


def sliding(run: Gathered) -> Section:
    """Friction over speed in both directions with its scatter, its laws, and its drift."""
    title = "Friction"
    try:
        study = study_of(run.recordings, run.folder.axis, run.model, {})
    except BeltcommError as problem:
        return Section("friction", title, missing=f"{problem}; beltcomm friction drives a sweep.")
    caption = Caption(run.command, f"{run.name}/recordings, {len(study.sweeps)} sweeps")
    drawn = friction.figures(study.friction, study.sweeps, study.drifts, study.standstill, caption)
    parts: list[Words | Table | Picture] = [picture_of(figure) for figure in drawn.values()]
    return Section("friction", title, [*parts, Words(friction_lines(study.friction), typed=True)])
