"""View of a run's present model in the laboratory tab, as values that go from the worker to the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.compare import Missing, compare, landmarks, worst
from beltcomm.laboratory.place_words import in_words
from beltcomm.laboratory.samples import Units
from beltcomm.laboratory.scope import reservation
from beltcomm.residuals.cells import Cells, cells_of
from beltcomm.residuals.responses import ResponsePair, Trace, response_pairs, trace_of
from beltcomm.residuals.spectra import GridRow, edges_of, power, rows_of
from beltcomm.result import plain
from beltcomm.rundata.fitted_run import Opened, explainable
from beltcomm.rundata.revisions import CURRENT, current_model
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.diagnosis_data import values_of
from beltcomm.sentences.laboratory import comparison_state

#: Dimensions of a place that are coordinates of the page, with their sign.
CHOSEN = ("frequency", "position", "time")


@dataclass(frozen=True)
class ResidualView:
    """A run's present model against its records.

    Attributes
    ----------
    stamp : str
        Of the files that it was made of.
    missing : Missing
        As of the comparison.
    state : tuple of str
        That in words, as ``compare`` has it: word, sentence and style.
    records : Sequence[Mapping[str, Any]]
        As ``compare --json`` has them.
    places : Sequence[Mapping[str, Any]]
        Where it fails, in words, with a range that can be chosen.
    fitted : int
        Samples of the fitted records, which stand first in ``white``, the whitened residual. rows, edges.
    spectrum : ndarray
        Of it over frequency.
    removable : tuple of str
        Effects that may be taken out again.
    traces, responses
        Of the records, measured and by the model.
    sheets : Sequence[Mapping[str, Any]]
        Data-sheet values that the model contradicts.
    """

    stamp: str
    effects: tuple[str, ...]
    removable: tuple[str, ...]
    parameters: Mapping[str, Any]
    ratio: float
    held_out: float | None
    missing: Missing
    state: tuple[str, str, str]
    plain: Mapping[str, Any] | None
    records: Sequence[Mapping[str, Any]]
    places: Sequence[Mapping[str, Any]]
    landmarks: Mapping[str, float]
    units: Units
    cells: Cells
    white: Array
    fitted: int
    rows: tuple[GridRow, ...]
    edges: Array
    spectrum: Array
    traces: Sequence[Trace]
    responses: Sequence[ResponsePair]
    sheets: Sequence[Mapping[str, Any]]


def view_of(here: Opened, stamp: str) -> ResidualView:
    """The view of residuals of an opened run.

    Parameters
    ----------
    here : Opened
        Fitted run.
    stamp : str
        Of :func:`stamp_of`.

    Raises
    ------
    DataError
        For a model that explains nothing at all.
    """
    found = compare(here.data, here.fitted, here.band_hz)
    explainable(found.ratio, here.folder.path)
    judged = [one for one in found.judged if len(one.white)]
    white = np.concatenate([one.white for one in judged])
    rows = rows_of(judged)
    edges = edges_of(rows)
    named = landmarks(here.fitted.model, here.folder.axis.travel.middle_m)
    model = here.fitted.model
    responses = response_pairs(here.data.recordings, judged)
    excited = {one.record for one in responses}
    return ResidualView(
        stamp,
        model.effects,
        tuple(name for name in model.effects if name not in base_effects(here.folder)),
        values_of(with_intervals(here.fitted)),
        found.ratio,
        found.held_out,
        found.missing,
        comparison_state(found, reservation(found, here.fitted, here.records.recordings)),
        plain(found.plain),
        [plain(one) for one in found.records],
        [
            {"text": in_words(place, named), "along": place.dimension, "low": place.low, "high": place.high}
            for place in worst(found)
            if place.dimension in CHOSEN
        ],
        named,
        judged[0].units,
        cells_of(judged),
        white,
        len(here.fitted.residual),
        rows,
        edges,
        power(rows, white, edges),
        [trace_of(judged, name, name in excited) for name in dict.fromkeys(one.piece.record for one in judged)],
        responses,
        plain(list(here.sheets)),
    )


def base_effects(folder: RunFolder) -> tuple[str, ...]:
    """Effects of the first model of the run: what a person added since may be taken out by a click, those only by a command.

    Parameters
    ----------
    folder : RunFolder
    """
    rungs = (folder.load_result("ladder") or {}).get("revisions") or ()
    if rungs:
        return tuple(rungs[0]["effects"])
    model = current_model(folder)
    return () if model is None else model.effects


def stamp_of(folder: Path) -> str:
    """Text that changes with everything that a view rests on: the present model and the complete recordings.

    Parameters
    ----------
    folder : Path
        Of the run.
    """
    files = [folder / "models" / f"{CURRENT}.yaml", *sorted((folder / "recordings").glob("*.csv"))]
    said = []
    for file in files:
        try:
            about = file.stat()
        except OSError:
            continue
        said.append(f"{file.name} {about.st_size} {about.st_mtime_ns}")
    return "; ".join(said)


def shown(values: Array) -> list[float | None]:
    """Values to the five digits that a picture shows; None where there is nothing.

    Parameters
    ----------
    values : ndarray (n,)
        Of any unit.
    """
    return [None if not math.isfinite(x) else float(f"{x:.5g}") for x in np.asarray(values).tolist()]
