"""Measurements of the axis itself: frequency responses by place and amplitude, friction over speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.errors import BeltcommError, DataError
from beltcomm.given import pasted
from beltcomm.identify.smooth_response import SmoothResponse, smooth_response
from beltcomm.pages.gather import Gathered
from beltcomm.report import friction, responses
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.style import Caption
from beltcomm.residuals.responses import response_pairs
from beltcomm.response.distortion import distortion, line_scatter
from beltcomm.rundata.analyse import nonlinearities
from beltcomm.rundata.friction_study import study_of
from beltcomm.sentences.response_table import ResponseRow, table_lines, table_of
from beltcomm.sentences.words import friction_lines, nonlinearity_lines


def frequency(run: Gathered) -> Section:
    """All responses with their 95 % bands and landmarks; the model over those that differ most, with coherence.

    Parameters
    ----------
    run : Gathered
    """
    title = "Frequency responses"
    if run.model is None or not any(r.sidecar.experiment == "frf" for r in run.recordings):
        return Section("responses", title, missing="No response was measured; beltcomm identify does.")
    caption = Caption(run.command, f"{run.name}/recordings")
    table = table_of(run.acting, run.model)
    parts: list[Paragraphs | PageTable | Picture] = []
    if run.comparison is not None:
        pairs = response_pairs(run.recordings, run.comparison.judged)
        if pairs:
            parts.append(picture_of(responses.bode_figure(pairs, run.landmarks, caption)))
    if table.rows:
        shown = [(f"{row.condition.record}, {row.condition.words()}", row.response, row.landmarks) for row in table.rows]
        told, smooth = [f"by {d.cause}: {d.text}" for d in table.differences], [_smooth(run, row) for row in table.rows]
        parts.append(picture_of(responses.responses_figure(shown, told, caption, smooth)))
        parts.append(Paragraphs(table_lines(table), typed=True))
        parts.append(picture_of(responses.levels_figure([_levels(run, row) for row in _split(table.rows)], caption)))
        parts.append(Paragraphs(_distortion_words(run), listed=True))
    return Section("responses", title, parts)


def _smooth(run: Gathered, row: ResponseRow) -> SmoothResponse | None:
    """The model's curve at the place and the speeds of a response; None of a moving one, or where nobody knows the place."""
    place, freq = row.condition.place_m, row.response.freq_hz
    if run.model is None or place is None or row.condition.direction != "standing":
        return None
    record = next(r for r in run.acting if r.name == row.condition.record)
    return smooth_response(run.model, record, place, float(freq[0]), float(freq[-1]))


def _split(rows: Sequence[ResponseRow]) -> list[ResponseRow]:
    """The loudest response and the quietest, where they differ."""
    ordered = sorted(rows, key=lambda row: (-row.condition.amplitude_nm, -row.response.n_periods))
    ends = [ordered[0], ordered[-1]]
    return ends if ends[-1].condition.amplitude_nm < 0.9 * ends[0].condition.amplitude_nm else ends[:1]


def _levels(run: Gathered, row: ResponseRow) -> responses.Levels:
    response = row.response
    made = responses.Levels(
        f"{row.condition.record}, {row.condition.words()}",
        response.freq_hz,
        np.abs(response.h),
        response.error_radius(),
        line_scatter(response),
    )
    record = next(r for r in run.recordings if r.name == row.condition.record)
    note = record.sidecar.excitation
    if note is None or note.kind != "multisine" or not note.period_samples or record.sidecar.closed_loop:
        return made
    try:
        split = distortion(record.torque, record.position, record.sample_period_s, note.period_samples, note.first_sample, t_s=record.t_s)
    except DataError:
        return made
    return replace(made, odd=split.odd, even=split.even)


def _distortion_words(run: Gathered) -> list[str]:
    lines = nonlinearity_lines(nonlinearities(run.recordings))
    return lines or [
        "This excitation has no silent lines: friction, backlash and the like show as scatter from line to line that every period "
        "repeats; odd and even cannot be told apart. "
        f"beltcomm identify --drive DRIVE --run {pasted(run.place)} --excitation multisine does that."
    ]


def friction_section(run: Gathered) -> Section:
    """Friction over speed in both directions with its scatter, its laws, and its drift.

    Parameters
    ----------
    run : Gathered
    """
    title = "Friction"
    try:
        study = study_of(run.recordings, run.folder.axis, run.model, {})
    except BeltcommError as problem:
        return Section("friction", title, missing=f"{problem}; beltcomm friction drives a sweep.")
    caption = Caption(run.command, f"{run.name}/recordings, {len(study.sweeps)} sweeps")
    drawn = friction.figures(study.friction, study.sweeps, study.drifts, study.standstill, caption)
    parts: list[Paragraphs | PageTable | Picture] = [picture_of(figure) for figure in drawn.values()]
    return Section("friction", title, [*parts, Paragraphs(friction_lines(study.friction), typed=True)])
