"""Regions in which a model fails: the whitened residual by frequency, speed, direction, position, amplitude, time and angle of the motor.

A *place* is the worst bin of a dimension with its neighbours that are nearly as bad, compared with the rest of the same dimension: it
stands out by ratio / elsewhere, not by ratio alone, or an error that is everywhere would be blamed on all dimensions at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.laboratory.samples import (
    BAND_HZ,
    CARRIAGE_BY_MOTOR,
    FEWEST,
    Judged,
    Samples,
    Units,
    bands,
    bin_numbers,
    bins_of,
    dimensions,
    gather_samples,
    motor_angle,
)

#: A bin is clearly bad from this many deviations above 1 on.
DEVIATIONS = 4.0
#: A range that holds more of all samples is no place.
MOST = 0.75
#: Most other ranges that are told.
ALSO = 2
#: Neighbours with this share of the worst bin's excess belong to the place.
AS_BAD = 0.4
#: A mean torque is told where it makes up this share of what the place has too much.
MEAN_SHARE = 0.25
#: A mean is worth a word from so many small units on, or from this share of the model's torque (rms): a small axis has a small torque.
LEAST_SMALL, LEAST_SHARE = 0.05, 0.01
#: A record is named where it holds this share of a place's excess.
RECORD_SHARE = 0.6
#: Bins and orders of a turn of the motor, turns and share of the bins that must be covered, and by how much a line
#: must stand out of the others.
ANGLES, ORDERS, TURNS, COVERED, STANDS_OUT = 512, 100, 1.0, 0.9, 6.0


@dataclass(frozen=True)
class ErrorRegion:
    """A range of one dimension.   low, high, unit.

    Attributes
    ----------
    ratio, elsewhere : float
        rms of the residual over that of the noise, here and in the rest.
    share : float
        Of all squares above the noise.
    forward, backward : float or None
        Measured minus model's torque in units of the axis, mean over motion in positive and in negative direction (over positive and
        negative torque for the amplitude); None where the mean does not matter.
    record : str
        The one that most of it comes from, "" for several.
    samples : int
        In it.
    swing : float
        Amplitude of a ripple.
    units : Units
    weight : float
        Sum of its squares above the noise over all samples, what it adds to the square of the overall ratio.
    also : tuple of tuple of float
        Other ranges nearly as bad, not in the numbers.
    least : float
        A mean torque below it is not worth a word, in units of the axis.
    """

    dimension: str
    low: float
    high: float
    unit: str
    ratio: float
    elsewhere: float
    share: float
    forward: float | None = None
    backward: float | None = None
    record: str = ""
    samples: int = 0
    swing: float = 0.0
    weight: float = 0.0
    units: Units = CARRIAGE_BY_MOTOR
    also: tuple[tuple[float, float], ...] = ()
    least: float = 0.0

    @property
    def contrast(self) -> float:
        """Contrast to the rest."""
        return self.ratio / max(self.elsewhere, 0.5)

    @property
    def rank(self) -> float:
        """Sort key of places: contrast, or by how much the error falls without what is seen there.

        Everything slow lies in the lowest band: that it does says little.
        """
        if self.dimension in ("direction", "angle"):
            return float(np.sqrt((self.ratio**2 - 1.0) / max(self.elsewhere**2 - 1.0, 0.02))) if self.ratio > 1.0 else 0.0
        return float(np.sqrt(self.contrast)) if self.dimension == "frequency" and self.low <= 0.0 else self.contrast


def worst_places(judged: Sequence[Judged]) -> list[ErrorRegion]:
    """The worst place of every dimension that has one, the one that stands out most first.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their whitened residuals.
    """
    judged = [j for j in judged if len(j.white)]
    if not judged:
        return []
    samples = gather_samples(judged)
    squares = samples.white**2
    found = []
    for dimension, (values, edges, unit) in dimensions(samples).items():
        bins = bins_of(dimension, values, edges, unit, squares)
        spans = _bad_spans(bins.ratio, bins.count)
        if not spans:
            continue
        number = bin_numbers(values, edges)
        inside = [(number >= first) & (number < last) for first, last in spans]
        bad = np.any(inside, axis=0)
        if bad.mean() > MOST:
            continue
        place = _place_of(dimension, edges[spans[0][0]], edges[spans[0][1]], unit, inside[0], ~bad, samples)
        found.append(replace(place, also=tuple((float(edges[first]), float(edges[last])) for first, last in spans[1 : 1 + ALSO])))
    found += [p for p in (_worst_band(judged), _by_direction(samples), _by_angle(judged, samples)) if p is not None]
    return sorted(found, key=lambda p: -p.rank)


def _bad_spans(ratio: Array, count: Array) -> list[tuple[int, int]]:
    """First and last edges of the worst place and of others nearly as bad, apart from it; the worst first."""
    left, spans = ratio.copy(), list[tuple[int, int]]()
    span = _worst_span(left, count)
    excess = np.nan_to_num(ratio, nan=1.0) ** 2 - 1.0
    least = AS_BAD * float(np.max(excess))
    while span is not None and (not spans or float(np.max(excess[span[0] : span[1]])) > least):
        spans.append(span)
        left[span[0] : span[1]] = np.nan
        span = _worst_span(left, count)
    return spans


def _worst_span(ratio: Array, count: Array) -> tuple[int, int] | None:
    """First and last edge of the worst bin with its neighbours that are nearly as bad; None where no bin is clearly above the noise."""
    excess = np.nan_to_num(ratio, nan=1.0) ** 2 - 1.0
    clear = excess > DEVIATIONS * np.sqrt(2.0 / np.maximum(count, 1.0))
    if not clear.any():
        return None
    worst = int(np.argmax(np.where(clear, excess, -np.inf)))
    first = last = worst
    while first > 0 and excess[first - 1] > AS_BAD * excess[worst]:
        first -= 1
    while last + 1 < len(excess) and excess[last + 1] > AS_BAD * excess[worst]:
        last += 1
    return first, last + 1


def _place_of(dimension: str, low: float, high: float, unit: str, inside: BoolArray, outside: BoolArray, samples: Samples) -> ErrorRegion:
    """The samples of a range as a place, compared with those outside."""
    squares = samples.white**2
    here = float(np.mean(squares[inside]))
    rest = squares[outside]
    elsewhere = float(np.sqrt(np.mean(rest))) if len(rest) >= FEWEST else 1.0
    side = samples.load if dimension == "amplitude" else samples.speed
    means: list[float | None] = []
    explained = 0.0
    for half in (inside & (side > 0.0), inside & (side < 0.0)):
        count = int(half.sum())
        means.append(float(np.mean(samples.more[half])) if count >= FEWEST // 3 else None)
        explained += count * float(np.mean(samples.white[half])) ** 2 if count >= FEWEST // 3 else 0.0
    if explained < MEAN_SHARE * inside.sum() * max(here - 1.0, 1e-9):
        means = [None, None]
    excess = np.bincount(samples.record[inside], squares[inside] - 1.0, minlength=len(samples.names))
    most = int(np.argmax(excess))
    named = len(samples.names) > 1 and excess[most] > RECORD_SHARE * float(np.sum(np.maximum(excess, 0.0)))
    return ErrorRegion(
        dimension,
        float(low),
        float(high),
        unit,
        float(np.sqrt(here)),
        elsewhere,
        float(np.sum(squares[inside] - 1.0)) / _above_noise(squares),
        means[0],
        means[1],
        samples.names[most] if named else "",
        int(inside.sum()),
        weight=float(np.sum(squares[inside] - 1.0)) / len(squares),
        units=samples.units,
        least=min(LEAST_SMALL / samples.units.factor, LEAST_SHARE * float(np.sqrt(np.mean(samples.load**2)))),
    )


def _by_direction(samples: Samples) -> ErrorRegion | None:
    """Torque that is missing on average, by direction.   elsewhere : what is left of the ratio without it."""
    squares = samples.white**2
    left = samples.white.copy()
    for half in (samples.speed > 0.0, samples.speed < 0.0):
        if half.sum() >= FEWEST:
            left[half] -= np.mean(left[half])
    place = _place_of("direction", -1.0, 1.0, "", np.ones(len(squares), dtype=bool), np.zeros(len(squares), dtype=bool), samples)
    forward, backward = samples.speed > 0.0, samples.speed < 0.0
    if min(forward.sum(), backward.sum()) < FEWEST:
        return None
    means = [float(np.mean(samples.more[half])) for half in (forward, backward)]
    without = float(np.sqrt(np.mean(left**2)))
    weight = place.ratio**2 - without**2
    return replace(place, elsewhere=without, share=1.0, forward=means[0], backward=means[1], weight=weight)


def _by_angle(judged: Sequence[Judged], samples: Samples) -> ErrorRegion | None:
    """The torque that repeats with the angle of the motor.   elsewhere : what is left of the ratio without it."""
    angle = np.concatenate([motor_angle(j) for j in judged])
    if (
        samples.units.force == "N"
        or samples.position.size == 0
        or np.ptp(angle) < TURNS * 2.0 * np.pi
        or any(j.piece.whitener is None for j in judged)
    ):
        return None
    number = np.floor((angle / (2.0 * np.pi) % 1.0) * ANGLES).astype(int)
    count = np.bincount(number, minlength=ANGLES)
    if np.mean(count > 0) < COVERED:
        return None
    mean = np.bincount(number, samples.more, minlength=ANGLES) / np.maximum(count, 1)
    lines = np.fft.rfft(mean - mean.mean()) / (0.5 * ANGLES)
    size = np.abs(lines[: ORDERS + 1])
    order = int(np.argmax(size))
    if order == 0 or size[order] < STANDS_OUT * float(np.median(size[1:])):
        return None
    left = []
    for item in judged:
        theta = item.piece.motion.theta[:: item.piece.motion.substeps]
        phase = order * (theta - np.pi / ANGLES)
        ripple = np.real(lines[order]) * np.cos(phase) - np.imag(lines[order]) * np.sin(phase)
        left.append(item.white + item.piece.white(ripple))
    rest = np.concatenate(left)
    overall, without = float(np.sqrt(np.mean(samples.white**2))), float(np.sqrt(np.mean(rest**2)))
    share = (overall**2 - without**2) * len(rest) / _above_noise(samples.white**2)
    return ErrorRegion(
        "angle",
        order,
        order,
        "1/turn",
        overall,
        without,
        share,
        samples=len(rest),
        swing=float(size[order]),
        weight=overall**2 - without**2,
        units=samples.units,
    )


def _worst_band(judged: Sequence[Judged]) -> ErrorRegion | None:
    """The worst band of frequency over all records."""
    table = bands(judged)
    power, weight = np.nansum(table.power * table.weight, axis=0), np.sum(table.weight, axis=0)
    mean = power / np.maximum(weight, 1e-9)
    span = _worst_span(np.sqrt(mean), 2.0 * weight * BAND_HZ * table.sample_s)
    if span is None:
        return None
    inside = np.zeros(len(mean), dtype=bool)
    inside[span[0] : span[1]] = True
    here = float(np.sum(power[inside]) / np.sum(weight[inside]))
    rest = float(np.sum(power[~inside]) / np.sum(weight[~inside])) if not inside.all() else 1.0
    total = max(float(np.sum(power - weight)), 1e-9)
    excess = np.nansum((table.power - 1.0)[:, inside] * table.weight[:, inside], axis=1)
    most = int(np.argmax(excess))
    named = len(table.names) > 1 and excess[most] > RECORD_SHARE * float(np.sum(np.maximum(excess, 0.0)))
    return ErrorRegion(
        "frequency",
        float(table.edges[span[0]]),
        float(table.edges[span[1]]),
        "Hz",
        float(np.sqrt(here)),
        float(np.sqrt(rest)),
        float(np.sum((power - weight)[inside])) / total,
        record=table.names[most] if named else "",
        samples=int(np.sum(weight[inside]) / len(mean)),
        weight=float(np.sum((power - weight)[inside]) / np.sum(weight)),
    )


def _above_noise(squares: Array) -> float:
    """Sum of all squares above the noise; no less than noise alone scatters by, √(2n), or shares of nothing would be told."""
    return max(float(np.sum(squares - 1.0)), math.sqrt(2.0 * max(len(squares), 1)))
