"""Failures of the model: error maps, the worst record, and the ladder of revisions."""

from __future__ import annotations

from beltcomm.given import pasted
from beltcomm.laboratory.compare import worst
from beltcomm.laboratory.place_words import in_words
from beltcomm.pages import pictures
from beltcomm.pages.gather import Gathered
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.sentences.ladder import record_table
from beltcomm.sentences.torque_path import path_sentences


def section(run: Gathered) -> Section:
    """Ratios by record, places in words, maps over frequency, speed, direction, position, amplitude and time."""
    found = run.comparison
    if found is None or run.laboratory is None:
        return Section(
            "model-error", "Where the model fails", missing=f"Nothing to compare; beltcomm fit {pasted(run.place)} makes a model."
        )
    data = run.laboratory.data
    places = [in_words(place, run.landmarks) for place in worst(found)] or ["No place stands out."]
    titles, rows = record_table(found)
    note = "Error over noise 1.00 means that nothing is missing in that record."
    drawn = pictures.error_figures(run.folder, data, run.laboratory.fitted, found, run.command)
    parts: list[Paragraphs | PageTable | Picture] = [Paragraphs([*places, *path_sentences(data.path, data.recordings)], listed=True)]
    parts += [picture_of(figure) for figure in drawn.values()]
    parts.append(PageTable([title.removeprefix(">") for title in titles], rows, note))
    if run.rungs:
        parts += [picture_of(figure) for figure in pictures.ladder_figures(run.folder, run.rungs, run.command).values()]
    return Section("model-error", "Where the model fails", parts)
