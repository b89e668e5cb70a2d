"""Samples of a residual as all who judge it see them, and its structure: means over parts, which noise cannot have.

A bin's ratio is the rms of the whitened residual in it, 1 where nothing is missing.

    z = max over partitions of (Σ_b n_b mean_b² - B)/√(2 B),   B : bins of the partition with enough values

The rms of the whole says little of a small error that always has the same sign at the same place, speed or time; the means do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from beltcomm.arrays import Array, IntArray
from beltcomm.fit.residual.segment import Segment
from beltcomm.model import Model
from beltcomm.quantities import read_in

#: Edges of the speed bins, of a carriage and of a motor alone; m, s and Hz, widths of the others; most bins of position; shares of the
#: largest torque, edges.
SPEEDS_M_S = (0.0, 0.008, 0.02, 0.05, 0.12, 0.3, 0.7, 1.5, 10.0)
SPEEDS_RAD_S = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
PLACE_M, TIME_S, BAND_HZ = 0.04, 10.0, 20.0
MOST_PLACES = 30
TORQUE_SHARES = (0.0, 0.1, 0.2, 0.35, 0.55, 0.8, 1.01)
#: A bin with fewer samples says nothing.
FEWEST = 150


@dataclass(frozen=True)
class Units:
    """Units in which an axis is measured.

    Attributes
    ----------
    force : str
        "N m", "N", "A" or "V".
    length : str
        "m" of the carriage or "rad" of the motor.
    """

    force: str = "N m"
    length: str = "m"

    @property
    def word(self) -> str:
        """Torque, force or current."""
        return {"N m": "torque", "N": "force", "A": "current", "V": "voltage"}[self.force]

    @property
    def small(self) -> str:
        """Unit of what is left over."""
        return {"N": "N", "A": "mA", "V": "mV"}.get(self.force) or read_in(self.force)[1]

    @property
    def factor(self) -> float:
        """Small units in one unit."""
        return 1.0 if self.force == "N" else 1e3

    @property
    def speeds(self) -> Array:
        """Edges of the speed bins, length per second."""
        return np.array(SPEEDS_M_S if self.length == "m" else SPEEDS_RAD_S)


#: The usual axis.
CARRIAGE_BY_MOTOR = Units()


def units_of(model: Model) -> Units:
    """Units of a model's side.

    Parameters
    ----------
    model : Model
        Of any side.
    """
    if model.side == "load":
        return Units("N", "m")
    length = "m" if "cart" in model.base_bodies or model.rigid else "rad"
    return Units({"ampere": "A", "volt": "V"}.get(model.side, "N m"), length)


@dataclass(frozen=True)
class Judged:
    """A segment with its residual.

    Attributes
    ----------
    white : ndarray
        Of the kept samples, in units of the noise.
    torque : ndarray
        The same samples, model minus measured.
    whole : ndarray
        Torque of all samples, kept or not.
    units : Units
        Of the axis, so torque may be a force or a current.
    """

    piece: Segment
    white: Array
    torque: Array
    ratio_m_rad: float
    whole: Array
    units: Units = CARRIAGE_BY_MOTOR


@dataclass(frozen=True)
class Samples:
    """All kept samples of all segments, (n,) each.

    Attributes
    ----------
    more : ndarray
        Measured minus model's torque, N m.
    record : ndarray of int
        Number of the record.
    """

    white: Array
    more: Array
    speed: Array
    position: Array
    time: Array
    load: Array
    record: NDArray[np.intp]
    names: tuple[str, ...]
    units: Units


@dataclass(frozen=True)
class Bins:
    """Ratios along one dimension.

    Attributes
    ----------
    edges : ndarray (k+1,)
    ratio : ndarray (k,)
        Nan where there are too few samples.
    count : ndarray (k,)
    """

    dimension: str
    unit: str
    edges: Array
    ratio: Array
    count: Array


def gather_samples(judged: Sequence[Judged]) -> Samples:
    """The samples of all segments side by side.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their whitened residuals.

    Returns
    -------
    Samples
        Load, N m at the motor, speed and place, m/s and m along the belt (rad/s and rad for a motor alone), time, s.
    """
    names = tuple(dict.fromkeys(j.piece.record for j in judged))
    return Samples(
        np.concatenate([j.white for j in judged]),
        -np.concatenate([j.torque for j in judged]),
        np.concatenate([motor_speed(j) * j.ratio_m_rad for j in judged]),
        np.concatenate([motor_angle(j) * j.ratio_m_rad for j in judged]),
        np.concatenate([j.piece.motion.time_s + j.piece.motion.sample_s * j.piece.value_samples for j in judged]),
        np.concatenate([j.piece.torque[j.piece.value_samples] for j in judged]),
        np.concatenate([np.full(len(j.white), names.index(j.piece.record)) for j in judged]),
        names,
        judged[0].units,
    )


def dimensions(samples: Samples) -> dict[str, tuple[Array, Array, str]]:
    """Value of every sample, edges and unit by dimension.

    Parameters
    ----------
    samples : Samples
        Of all segments.

    Returns
    -------
    dict of str to tuple of ndarray and str
        By "speed", "position", "amplitude" and "time".
    """
    largest = float(np.abs(samples.load).max()) if len(samples.load) else 1.0
    return {
        "speed": (np.abs(samples.speed), samples.units.speeds, f"{samples.units.length}/s"),
        "position": (samples.position, position_edges(samples), samples.units.length),
        "amplitude": (np.abs(samples.load), largest * np.array(TORQUE_SHARES), samples.units.force),
        "time": (samples.time, _grid(samples.time, TIME_S), "s"),
    }


def position_edges(samples: Samples) -> Array:
    """Edges of the position bins: 4 cm, or ``MOST_PLACES`` of them on a long way or for a motor alone.

    Parameters
    ----------
    samples : Samples
        Of all segments.

    Returns
    -------
    ndarray
        In the unit of ``samples.position``.
    """
    return _grid(samples.position, max(PLACE_M, float(np.ptp(samples.position)) / MOST_PLACES))


def bin_numbers(values: Array, edges: Array) -> NDArray[np.intp]:
    """Number of the bin of every value; those beyond the edges are in the bins at the ends.

    Parameters
    ----------
    values : ndarray (n,)
        Of any unit.
    edges : ndarray (k + 1,)
        In that unit, rising.
    """
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def bins_of(dimension: str, values: Array, edges: Array, unit: str, squares: Array) -> Bins:
    """Error over the noise along one dimension.

    Parameters
    ----------
    dimension : str
        Its name.
    values : ndarray (n,)
        Of every sample, in ``unit``.
    edges : ndarray (k + 1,)
        Of the bins, in ``unit``.
    unit : str
        Of the dimension.
    squares : ndarray (n,)
        Whitened residual squared.

    Returns
    -------
    Bins
        nan with fewer than ``FEWEST`` samples.
    """
    number = bin_numbers(values, edges)
    count = np.bincount(number, minlength=len(edges) - 1)
    total = np.bincount(number, squares, minlength=len(edges) - 1)
    ratio = np.where(count >= FEWEST, np.sqrt(total / np.maximum(count, 1)), np.nan)
    return Bins(dimension, unit, edges, ratio, count.astype(np.float64))


@dataclass(frozen=True)
class Bands:
    """Power of the whitened residual by record and band, 1 at the noise.

    Attributes
    ----------
    edges : ndarray (k+1,), Hz
    power, weight : ndarray (records, k)
        Weight counts samples.
    sample_s : float, s
    """

    names: tuple[str, ...]
    held_out: tuple[bool, ...]
    edges: Array
    power: Array
    weight: Array
    sample_s: float


def bands(judged: Sequence[Judged], width_hz: float = BAND_HZ) -> Bands:
    """Power by record and band, left-out samples as zeros.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their whitened residuals.
    width_hz : float, Hz
        Of a band, about.

    Returns
    -------
    Bands
        Power 1 at the noise, and its weight, records by bands.
    """
    names = tuple(dict.fromkeys(j.piece.record for j in judged))
    sample, narrowest = judged[0].piece.motion.sample_s, min(j.piece.group for j in judged)
    count = max(1, round(0.5 / sample / narrowest / width_hz))
    edges = np.linspace(0.0, 0.5 / sample / narrowest, count + 1)
    total, weight = np.zeros((len(names), count)), np.zeros((len(names), count))
    for item in judged:
        counted, stride = item.piece.value_samples, item.piece.group
        if len(counted) < FEWEST:
            continue
        row = np.zeros(item.piece.motion.samples // stride + 1)
        row[counted // stride] = item.white
        spectrum = np.abs(np.fft.rfft(row)) ** 2 / len(counted)
        number = np.clip(np.searchsorted(edges, np.fft.rfftfreq(len(row), stride * sample), side="right") - 1, 0, count - 1)
        lines = np.bincount(number, minlength=count)
        at = names.index(item.piece.record)
        share = len(counted) * (lines > 0)
        total[at] += share * np.bincount(number, spectrum, minlength=count) / np.maximum(lines, 1)
        weight[at] += share
    power = np.where(weight > 0.0, total / np.maximum(weight, 1.0), np.nan)
    return Bands(names, tuple(any(j.piece.held_out for j in judged if j.piece.record == n) for n in names), edges, power, weight, sample)


def motor_speed(item: Judged) -> Array:
    """Speed of the motor at the kept samples, rad/s.

    Parameters
    ----------
    item : Judged
        One segment.
    """
    return np.asarray(item.piece.motion.omega[:: item.piece.motion.substeps][item.piece.value_samples])


def motor_angle(item: Judged) -> Array:
    """Absolute angle of the motor at the kept samples, rad.

    Parameters
    ----------
    item : Judged
        One segment.
    """
    return np.asarray(item.piece.motion.theta[:: item.piece.motion.substeps][item.piece.value_samples])


def _grid(values: Array, width: float) -> Array:
    """Edges of equal bins over all values."""
    low = np.floor(values.min() / width) * width
    return np.asarray(np.arange(low, values.max() + 2.0 * width, width))


#: Widths of the bins: m, s, and factor of the speed.  None by torque: its own noise would sort the values.
PART_M, PART_S, SPEED_FACTOR = 0.05, 10.0, 1.5
#: s, width of the Gaussian that a speed is smoothed with.
STEADY_S = 0.025
#: A bin with fewer values, and values beyond which one says no more, say little.
FEWEST_IN_PART, OUTLIER = 60, 5.0


def structure(judged: Sequence[Judged]) -> dict[str, float]:
    """Distance of the residual from noise by partition, z of the module: speed, position, time and record, each by direction.

    Parameters
    ----------
    judged : sequence of Judged
        Segments with their whitened residuals.
    """
    samples = replace(gather_samples(judged), speed=np.concatenate([_steady_speed(item) for item in judged]))
    white = np.clip(samples.white, -OUTLIER, OUTLIER)
    return {name: _excess(white, number) for name, number in _partitions(samples).items()}


def _steady_speed(item: Judged) -> Array:
    """Speed at the kept samples, length per second, smooth: by its own noise a stroke would be sorted into samples above and below."""
    motion = item.piece.motion
    smooth = gaussian_filter1d(motion.omega[:: motion.substeps], STEADY_S / motion.sample_s, mode="nearest")
    return np.asarray(smooth[item.piece.value_samples] * item.ratio_m_rad)


def _partitions(samples: Samples) -> dict[str, IntArray]:
    """Number of the bin of every value."""
    forward = samples.speed > 0.0
    speed = np.floor(np.log(np.maximum(np.abs(samples.speed), 1e-6)) / np.log(SPEED_FACTOR)).astype(np.int64)
    place, time = np.floor(samples.position / PART_M).astype(np.int64), np.floor(samples.time / PART_S).astype(np.int64)
    signed = {"speed": speed, "position": place, "time": time, "record": samples.record.astype(np.int64)}
    return {name: 2 * number + forward for name, number in signed.items()}


def _excess(white: Array, number: IntArray) -> float:
    """(Σ n mean² - bins)/√(2 bins)."""
    _, bins = np.unique(number, return_inverse=True)
    count = np.bincount(bins)
    sums = np.bincount(bins, white)
    enough = count >= FEWEST_IN_PART
    if not enough.any():
        return 0.0
    squares = sums[enough] ** 2 / count[enough]
    return float((np.sum(squares) - len(squares)) / np.sqrt(2.0 * len(squares)))
