"""A law of an effect over what the records show of it, along the coordinate in which it is a curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.likelihood.problem import OFFSET_M
from beltcomm.fit.residual.whitened import evaluate
from beltcomm.laboratory.samples import Judged
from beltcomm.model import Model
from beltcomm.residuals.cells import COORDINATES, Cells, cells_of

#: Bins of a coordinate along which a law is drawn, and cells in a bin below which it is left out.
BINS, FEWEST = 60, 3
#: Share of its squares that a law must show along a coordinate to be drawn there; below it is a matter of frequency.
ALONG = 0.4


@dataclass(frozen=True)
class LawCurve:
    """A law over the residual in its own coordinate.

    Parameters
    ----------
    along : str
        One of ``COORDINATES``, or "frequency" where it is no curve along any of them; then all arrays are empty.
    x : ndarray (k,)
    forward, backward : ndarray (k,)
        Torque of the law in either direction, N m, nan where there is nothing.
    missing_forward, missing_backward : ndarray (k,)
        What a model without it leaves there, measured minus model.
    """

    along: str
    x: Array
    forward: Array
    backward: Array
    missing_forward: Array
    missing_backward: Array


def curve_of(cells: Cells, there: BoolArray, torque: Array, missing: Array) -> LawCurve:
    """The curve of a torque.

    Parameters
    ----------
    cells : Cells
        Of the residual.
    there : ndarray
        Cells that have one.
    torque, missing : ndarray
        By cell, N m.
    """
    shown = {along: _shown_along(getattr(cells, along)[there], cells.speed[there], torque[there]) for along in COORDINATES}
    along = max(shown, key=lambda name: shown[name])
    if shown[along] < ALONG:
        return LawCurve("frequency", *(np.zeros(0),) * 5)
    place, way = getattr(cells, along)[there], cells.speed[there] > 0.0
    edges = _edges(place)
    curves = [_binned(place[side], values[there][side], edges) for values in (torque, missing) for side in (way, ~way)]
    return LawCurve(along, 0.5 * (edges[1:] + edges[:-1]), *curves)


def law_between(fitted: Fitted, judged: Sequence[Judged], without: Model, grown: Model) -> LawCurve:
    """Law that one model has and another has not, over the rest of the fitted records.

    Parameters
    ----------
    fitted : Fitted
    judged : sequence of Judged
        By the fitted model, these first.
    without : Model
        The model without the law.
    grown : Model
        The model with it.
    """
    own = [one for one in judged[: len(fitted.problem.pieces)] if len(one.white)]
    cells = cells_of(own)
    left = []
    for model in (without, grown):
        parts = [
            evaluate(piece, model, model.vector(), OFFSET_M * float(fitted.offsets[i]) if fitted.problem.movable else 0.0)[
                piece.value_samples
            ]
            for i, piece in enumerate(fitted.problem.pieces)
            if len(piece.value_samples)
        ]
        left.append(cells.mean(np.concatenate(parts)))
    return curve_of(cells, np.ones(len(cells.count), dtype=np.bool_), left[1] - left[0], -left[0])


def _shown_along(place: Array, speed: Array, torque: Array) -> float:
    """Share of the squares of a torque that its means over bins and both directions hold."""
    edges = _edges(place)
    number = np.clip(np.searchsorted(edges, place, side="right") - 1, 0, BINS - 1) + BINS * (speed > 0.0)
    count = np.bincount(number, minlength=2 * BINS)
    mean = np.bincount(number, torque, minlength=2 * BINS) / np.maximum(count, 1)
    return float(np.sum(count * mean**2) / max(float(np.sum(torque**2)), 1e-300))


def _edges(place: Array) -> Array:
    low, high = np.percentile(place, [0.5, 99.5])
    return np.asarray(np.linspace(low, high if high > low else low + 1.0, BINS + 1))


def _binned(place: Array, values: Array, edges: Array) -> Array:
    """Means in bins, nan where hardly anything lies."""
    inside = (place >= edges[0]) & (place <= edges[-1])
    number = np.clip(np.searchsorted(edges, place[inside], side="right") - 1, 0, BINS - 1)
    count = np.bincount(number, minlength=BINS)
    mean = np.bincount(number, values[inside], minlength=BINS) / np.maximum(count, 1)
    return np.asarray(np.where(count >= FEWEST, mean, np.nan))
