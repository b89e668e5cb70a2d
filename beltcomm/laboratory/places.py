"""Where a model fails: the whitened residual by record, frequency, speed, direction, position, torque and time."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.identify.residual import Stretch

Array = NDArray[np.float64]

#: m/s, edges of the speed bins; m, s and Hz, widths of the others; share of the largest torque, edges.
SPEEDS_M_S = (0.0, 0.008, 0.02, 0.05, 0.12, 0.3, 0.7, 1.5, 10.0)
PLACE_M, TIME_S, BAND_HZ = 0.08, 20.0, 20.0
TORQUE_SHARES = (0.0, 0.1, 0.2, 0.35, 0.55, 0.8, 1.01)
#: A bin with fewer samples says nothing.
FEWEST = 150


@dataclass(frozen=True)
class Place:
    """One bin.   dimension, low, high, unit.   ratio : rms of the residual over that of the noise.   share : of all squares above
    the noise.   more_nm : by how much the measured torque lies above the model's, in the direction of motion, N m."""

    dimension: str
    low: float
    high: float
    unit: str
    ratio: float
    share: float
    more_nm: float
    samples: int


@dataclass(frozen=True)
class Judged:
    """A stretch with its residual.   white : of the kept samples, in units of the noise.   torque : the same samples, N m, model minus
    measured.   cart : carriage position of all samples, m."""

    piece: Stretch
    white: Array
    torque: Array
    ratio_m_rad: float


def worst_places(judged: Sequence[Judged]) -> list[Place]:
    """All bins, the worst first."""
    squares = np.concatenate([j.white**2 for j in judged])
    above = max(float(np.sum(squares - 1.0)), 1e-9)
    torque = np.concatenate([j.torque for j in judged])
    speed = np.concatenate([motor_speed(j) * j.ratio_m_rad for j in judged])
    side = np.sign(speed)
    place = np.concatenate([motor_angle(j) * j.ratio_m_rad for j in judged])
    time = np.concatenate([j.piece.motion.time_s + j.piece.motion.sample_s * j.piece.counted for j in judged])
    load = np.concatenate([np.abs(j.piece.torque[j.piece.counted]) for j in judged])
    found: list[Place] = []

    def add(dimension: str, values: Array, edges: Iterable[float], unit: str) -> None:
        edges = list(edges)
        for low, high in itertools.pairwise(edges):
            inside = (values >= low) & (values < high)
            count = int(inside.sum())
            if count >= FEWEST:
                excess = float(np.sum(squares[inside] - 1.0))
                more = -float(np.mean((torque * side)[inside])) if dimension != "direction" else -float(np.mean(torque[inside]))
                ratio = float(np.sqrt(np.mean(squares[inside])))
                found.append(Place(dimension, low, high, unit, ratio, excess / above, more, count))

    add("speed", np.abs(speed), SPEEDS_M_S, "m/s")
    add("direction", side, (-1.5, 0.0, 1.5), "")
    add("position", place, grid(place, PLACE_M), "m")
    add("time", time, grid(time, TIME_S), "s")
    largest = float(load.max()) if len(load) else 1.0
    add("torque", load, [share * largest for share in TORQUE_SHARES], "N m")
    found += bands(judged, above)
    return sorted(found, key=lambda p: -p.ratio)


def bands(judged: Sequence[Judged], above: float) -> list[Place]:
    """Bins of frequency, from the power of the whitened residual with left-out samples as zeros."""
    power: dict[int, float] = {}
    weight: dict[int, float] = {}
    sample = judged[0].piece.motion.sample_s
    for item in judged:
        counted, stride = item.piece.counted, 1 if item.piece.pairs is None else 2
        if len(counted) < FEWEST:
            continue
        row = np.zeros(item.piece.motion.samples // stride + 1)
        row[counted // stride] = item.white
        spectrum = np.abs(np.fft.rfft(row)) ** 2 / len(counted)
        freq = np.fft.rfftfreq(len(row), stride * item.piece.motion.sample_s)
        number = (freq / BAND_HZ).astype(int)
        for band in range(number.max() + 1):
            inside = number == band
            power[band] = power.get(band, 0.0) + float(spectrum[inside].mean()) * len(counted)
            weight[band] = weight.get(band, 0.0) + len(counted)
    total = sum(weight.values()) / max(len(weight), 1)
    found = []
    for band, value in power.items():
        mean = value / weight[band]
        share = (mean - 1.0) * total / len(weight) / above
        found.append(
            Place("frequency", band * BAND_HZ, min((band + 1) * BAND_HZ, 0.5 / sample), "Hz", float(np.sqrt(mean)), share, 0.0, int(total))
        )
    return found


def motor_speed(item: Judged) -> Array:
    """Speed of the motor at the kept samples, rad/s."""
    return np.asarray(item.piece.motion.omega[:: item.piece.motion.substeps][item.piece.counted])


def motor_angle(item: Judged) -> Array:
    """Absolute angle of the motor at the kept samples, rad."""
    return np.asarray(item.piece.motion.theta[:: item.piece.motion.substeps][item.piece.counted])


def grid(values: Array, width: float) -> Array:
    """Edges of equal bins over all values."""
    low = np.floor(values.min() / width) * width
    return np.asarray(np.arange(low, values.max() + 2.0 * width, width))


def in_words(place: Place) -> str:
    """A bin as a sentence."""
    milli = 1e3 * place.more_nm
    torque = f": measured torque {abs(milli):.2g} mN m {'higher' if milli > 0 else 'lower'} than the model's" if abs(milli) >= 0.05 else ""
    spans = {
        "speed": f"speeds of {place.low:g} to {place.high:g} m/s",
        "direction": "motion in positive direction" if place.high > 1.0 else "motion in negative direction",
        "position": f"carriage between {place.low:.2f} and {place.high:.2f} m",
        "time": f"{place.low:.0f} to {place.high:.0f} s on the session's clock",
        "torque": f"torques of {place.low:.2g} to {place.high:.2g} N m",
        "frequency": f"{place.low:.0f} to {place.high:.0f} Hz",
    }
    along = " along the motion" if torque and place.dimension != "direction" else ""
    return f"{spans[place.dimension]}: {place.ratio:.2f} times the noise{torque}{along}"
