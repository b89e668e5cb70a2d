"""Model against records: ratios to the noise, places that stand out, and the error in plain units (N m, N, A, per cent)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import Refused, UsageError
from beltcomm.fit.band_error import BANDS_HZ, QUIET_SHARE, Banded, band_limited_errors, band_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.start.model import BELT_BASE, RIGID_BASE
from beltcomm.identify.landmarks import shape_of
from beltcomm.laboratory.figures import Plain, PlainError
from beltcomm.laboratory.places import ErrorRegion, worst_places
from beltcomm.laboratory.samples import Judged, structure, units_of
from beltcomm.model import Model

#: A place is told when its ratio is this, and this many times that of the rest.
LEAST_RATIO, LEAST_CONTRAST = 1.06, 1.04
#: So many of them are told.
WORST = 5
#: In a model that fits as a whole, up to this ratio, only what adds this to its square and stands out by this factor.
WHOLE, LEAST_WEIGHT, CLEAR_CONTRAST = 1.03, 0.01, 1.5
#: By what it is seen that something is missing.
Missing = Literal["", "size", "stretches", "held out", "structure"]
#: Effects of a model that nothing was added to.
BASE_EFFECTS = frozenset((*BELT_BASE, *RIGID_BASE, "cart_friction", "rigid_load", "belt_spans", "constant_offset"))
#: O per sample up to which a model leaves nothing but noise: how well the noise itself is known, 5 % of its rms.
NOISE_KNOWN = 1.10
#: rms of the rest over the noise, of records fitted or held out, from which on it is not noise though single stretches hold all of it: O
#: gives those up.
GIVEN_UP = 1.2
#: Structure of the rest from which on it is not noise (a simulated healthy machine stays below 3); and where the noise is rounding that
#: goes with the motion, or effects were added, whose law may be another than the machine's.
STRUCTURED, STRUCTURED_BESIDE = 12.0, 25.0
#: O per sample below which the noise was taken too large, by a rounding in step with the motion, which has a structure of its own.
QUIET = 0.93


@dataclass(frozen=True)
class RecordRatio:
    """One record.

    Attributes
    ----------
    ratio : float
        rms of the residual over rms of the noise, 1 when nothing is missing.
    samples : int
        That counted.
    plain : PlainError or None
        The same in plain units.
    """

    name: str
    held_out: bool
    ratio: float
    samples: int
    plain: PlainError | None = None


@dataclass(frozen=True)
class Comparison:
    """Ratios of model error to noise, over all records and by record.

    Attributes
    ----------
    ratio, held_out
        Over all fitted and all held-out records.
    missing : Missing
        By what it is seen that something is left that is not noise, "" where nothing is.
    places : tuple of ErrorRegion
        The worst first, over all records.
    plain, plain_held_out : PlainError or None
        Ratio and held_out in plain units.
    """

    ratio: float
    held_out: float | None
    missing: Missing
    records: tuple[RecordRatio, ...]
    places: tuple[ErrorRegion, ...]
    judged: tuple[Judged, ...]
    plain: PlainError | None = None
    plain_held_out: PlainError | None = None

    @property
    def decisive_ratio(self) -> float:
        """Ratio that the verdict rests on: of the records held out where these alone are not explained."""
        return self.held_out if self.missing == "held out" and self.held_out is not None else self.ratio


def compare(data: Data, fitted: Fitted, band_hz: float | None = None) -> Comparison:
    """Ratio of the model's error to the noise in every record, and where it is largest.

    Parameters
    ----------
    data : Data
        Fitted and held-out records.
    fitted : Fitted
        To these records.
    band_hz : float or None
        Of the errors in plain units; :func:`band_of` without one.

    Returns
    -------
    Comparison
        Ratios 1 at the noise; plain errors in N m and per cent.
    """
    judged: list[Judged] = []
    model, band = fitted.model, band_of(data, fitted.model) if band_hz is None else band_hz
    parts = band_limited_errors(data, fitted, band)
    whites = [*np.split(fitted.residual, fitted.problem.ends[1:-1]), *fitted.held_out_residuals]
    for piece, white, part in zip((*fitted.problem.pieces, *data.held_out), whites, parts, strict=True):
        judged.append(_judge(piece, model, white, part.whole))
    records = []
    for name in dict.fromkeys(j.piece.record for j in judged):
        white = np.concatenate([j.white for j in judged if j.piece.record == name])
        own = [part for part in parts if part.record == name]
        if not len(white):
            continue
        plain = _plain_error(own, model, band)
        records.append(RecordRatio(name, own[0].held_out, float(np.sqrt(np.mean(white**2))), len(white), plain))
    whole, held = (_plain_error([part for part in parts if part.held_out is out], model, band) for out in (False, True))
    missing = sign_of_missing(fitted, max(structure(judged).values(), default=0.0))
    return Comparison(fitted.ratio, fitted.held_out_ratio, missing, tuple(records), tuple(worst_places(judged)), tuple(judged), whole, held)


def sign_of_missing(fitted: Fitted, left: float) -> Missing:
    """By what it is seen that a model leaves more than noise: its size, a few stretches alone, records held out alone, or its structure.

    Parameters
    ----------
    fitted : Fitted
        To the records.
    left : float
        Largest :func:`beltcomm.laboratory.samples.structure` of what it leaves: by speed, place, time or record.
    """
    level = fitted.objective / fitted.problem.samples if fitted.problem.samples else math.inf
    if not level < NOISE_KNOWN:
        return "size"
    if fitted.ratio >= GIVEN_UP:
        return "stretches"
    if (fitted.held_out_ratio or 0.0) >= GIVEN_UP:
        return "held out"
    rounded = any(piece.own_noise or (piece.group == 1 and piece.observer is None) for piece in fitted.problem.pieces)
    beside = rounded or level <= QUIET or not set(fitted.model.effects) <= BASE_EFFECTS
    return "structure" if left >= (STRUCTURED_BESIDE if beside else STRUCTURED) else ""


def _judge(piece: Segment, model: Model, white: Array, whole: Array) -> Judged:
    return Judged(piece, white, whole[piece.value_samples], model["transmission.ratio"], whole, units_of(model))


def worst(comparison: Comparison) -> list[ErrorRegion]:
    """The places that stand out, worst first; few or none where the model fits as a whole.

    Parameters
    ----------
    comparison : Comparison
        Of a model.

    Returns
    -------
    list of ErrorRegion
        At most ``WORST``.
    """
    places = [p for p in comparison.places if p.ratio >= LEAST_RATIO and p.contrast >= LEAST_CONTRAST]
    if max(comparison.ratio, comparison.held_out or 0.0) <= WHOLE:
        places = [p for p in places if p.weight >= LEAST_WEIGHT and p.contrast >= CLEAR_CONTRAST]
    return places[:WORST]


def landmarks(model: Model, position_m: float) -> dict[str, float]:
    """Resonance and antiresonance of the belt with the carriage there, Hz; {} without a belt.

    Parameters
    ----------
    model : Model
        With any bodies.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    dict of str to float
        By "resonance" and "antiresonance".
    """
    try:
        shape = shape_of(model, position_m)
    except (UsageError, Refused):
        return {}
    return {} if shape is None else {"resonance": shape.belt.resonance_hz, "antiresonance": shape.belt.antiresonance_hz}


#: Error in the band over its noise from which on it is none.
ABOVE = 2.0


def _plain_error(parts: Sequence[Banded], model: Model, band_hz: float) -> PlainError | None:
    """Over all samples of some segments that count; None without any."""
    count = sum(int(np.count_nonzero(part.keep)) for part in parts)
    if not count:
        return None
    error = math.sqrt(sum(float(np.sum(part.error[part.keep] ** 2)) for part in parts) / count)
    torque = math.sqrt(sum(float(np.sum(part.torque[part.keep] ** 2)) for part in parts) / count)
    noise = math.sqrt(sum(part.noise**2 * np.count_nonzero(part.keep) for part in parts) / count)
    return PlainError(error, noise, torque, 100.0 * error / torque if torque > 0.0 else math.inf, units_of(model).force, band_hz)


def unexplained_words(errors: Mapping[str, PlainError | None]) -> str:
    """Slow part of a record, by its name, that cannot be noise whatever it was taken for, in words; "" where there is none.

    Parameters
    ----------
    errors : mapping of str to PlainError or None
        By record; None where it is not known.

    Returns
    -------
    str
        On the largest, in per cent of the torque.
    """
    seen = {
        name: one for name, one in errors.items() if one is not None and one.error > ABOVE * one.noise and one.percent > 100.0 * QUIET_SHARE
    }
    if not seen:
        return ""
    name, worst = max(seen.items(), key=lambda item: item[1].percent)
    return (
        f"Below {worst.band_hz:g} Hz {worst.percent:.0f} % of the torque of {name} is not explained, {worst.error / worst.noise:.1f} times "
        "what such noise leaves there: that is no noise, something is missing in the model."
    )


def of_run(data: Data, fitted: Fitted, band_hz: float) -> Plain:
    """Over the fitted records and over those held out; None where there are none.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    band_hz : float, Hz
        Up to which.
    """
    parts = band_limited_errors(data, fitted, band_hz)
    fitted_parts, held = ([part for part in parts if part.held_out is out] for out in (False, True))
    return _plain_error(fitted_parts, fitted.model, band_hz), _plain_error(held, fitted.model, band_hz)


def in_bands(data: Data, fitted: Fitted, widest_hz: float) -> tuple[Plain, ...]:
    """:func:`of_run` in a band and in each that is narrower: another model of the run may see no further.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    widest_hz : float, Hz
        The first band.
    """
    return tuple(of_run(data, fitted, band) for band in (widest_hz, *(band for band in BANDS_HZ if band < widest_hz)))
