"""Model against measurement: every number is the rms of the residual over the rms of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.identify.residual import Stretch, evaluate
from beltcomm.laboratory.data import Data
from beltcomm.laboratory.fitting import Fitted
from beltcomm.laboratory.places import Judged, Place, worst_places

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecordRatio:
    """One record.   ratio : rms of the residual over rms of the noise, 1 when nothing is missing.   samples : that counted."""

    name: str
    held_out: bool
    ratio: float
    samples: int


@dataclass(frozen=True)
class Comparison:
    """ratio, held_out : over all fitted and all held-out records.   places : the worst first, over all records."""

    ratio: float
    held_out: float | None
    records: tuple[RecordRatio, ...]
    places: tuple[Place, ...]
    judged: tuple[Judged, ...]


def compare(data: Data, fitted: Fitted) -> Comparison:
    """How far the fitted model is from every record, and where."""
    judged: list[Judged] = []
    vector = fitted.problem.full(fitted.x)
    for i, piece in enumerate(fitted.problem.pieces):
        white = fitted.residual[fitted.problem.ends[i] : fitted.problem.ends[i + 1]]
        judged.append(_judged(piece, fitted, vector, white))
    for piece, white in zip(data.held_out, fitted.held_residual, strict=True):
        judged.append(_judged(piece, fitted, vector, white))
    records = []
    for name in dict.fromkeys(j.piece.record for j in judged):
        parts = [j for j in judged if j.piece.record == name]
        white = np.concatenate([j.white for j in parts])
        if not len(white):
            continue
        records.append(RecordRatio(name, parts[0].piece.held_out, float(np.sqrt(np.mean(white**2))), len(white)))
    return Comparison(fitted.ratio, fitted.held_ratio, tuple(records), tuple(worst_places(judged)), tuple(judged))


def _judged(piece: Stretch, fitted: Fitted, vector: Array, white: Array) -> Judged:
    torque = evaluate(piece, fitted.model, vector)[piece.counted]
    return Judged(piece, white, torque, fitted.model["transmission.ratio"])


def worst(places: Sequence[Place], count: int = 5, least: float = 1.1) -> list[Place]:
    """The worst places that stand out, at most two of a dimension."""
    chosen: list[Place] = []
    for place in places:
        if place.ratio < least or len(chosen) == count:
            break
        if sum(p.dimension == place.dimension for p in chosen) < 2:
            chosen.append(place)
    return chosen
