"""Torque that acts on the motor unasked: how much, how long it lasts, and what of it a filtered or late reading misses.

p[n] = ρ p[n-1] + √(1-ρ²) σ ν[n],   ρ = e^(-T/τ),     τ : correlation time,   T : sampling period
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.fit.noise.colour import NoiseColour, numerator_of

#: What a reading misses of a torque that is held, below which it misses nothing: as one at the end of the period does.
HARDLY = 1e-6
#: Mean of a torque that is held, over two periods, with the triangular weight.
TRIANGULAR = np.array([0.5, 0.5])


@dataclass(frozen=True)
class ProcessTorque:
    """Torque that acts beside what was asked for, of first order (Gauss, Markov).

    Attributes
    ----------
    rms_nm : float
        σ, N m at the motor shaft.
    time_s : float
        τ, s; 0: each sample has another one.
    rms_interval, time_interval : float
        Half widths at 95 %, N m and s.
    """

    rms_nm: float
    time_s: float = 0.0
    rms_interval: float = field(default=0.0, compare=False)
    time_interval: float = field(default=0.0, compare=False)

    def pole(self, sample_s: float) -> float:
        """ρ."""
        return math.exp(-sample_s / self.time_s) if self.time_s > 0.0 else 0.0


@dataclass(frozen=True)
class Unread:
    """Torque that acts, and of which what is taken for the torque that acts has a part only.

    Attributes
    ----------
    share : float
        Its variance over that of the noise.
    pole : float
        ρ.
    answer : tuple of float
        Of what is taken for the torque to one that acts over a sample; () where it is not read at all.
    """

    share: float
    pole: float
    answer: tuple[float, ...] = ()


def correlation_time(pole: float, deviation: float, sample_s: float) -> tuple[float, float]:
    """τ of a pole, s, and one standard deviation of it.

    Parameters
    ----------
    pole : float
        From one sample to the next.
    deviation : float
        Of the pole.
    sample_s : float, s

    Returns
    -------
    tuple of float
    """
    if pole <= 0.0:
        return 0.0, 0.0
    time_s = -sample_s / math.log(pole)
    return time_s, time_s**2 / sample_s * deviation / pole


def with_unread(answer: Array, poles: Sequence[complex], sensor_pole: float, process_pole: float, share: float) -> NoiseColour:
    """Colour, in the residual, of the sensor's noise with what a reading misses of a torque that acts:  s - (1 - L) p.

    Both spectra over one denominator; the numerator is that of their sum, its zeros inside the unit circle.

    Parameters
    ----------
    answer : ndarray (k,)
        Of the reading to a torque that acts over one sample, L, until it has died away.
    poles : sequence of complex
        Of the reading.
    sensor_pole : float
        Of the sensor's noise s.
    process_pole : float
        Of the process torque p.
    share : float
        Variance of p over that of s.

    Returns
    -------
    NoiseColour
        Of sensor noise with variance 1.
    """
    missed = -answer
    missed[0] += 1.0
    if float(np.abs(missed).max()) < HARDLY:
        return NoiseColour(sensor_pole)
    below, own = np.atleast_1d(np.real(np.poly(poles))), np.array([1.0, -sensor_pole])
    process = np.array([1.0, -process_pole])
    rows = (
        math.sqrt(1.0 - sensor_pole**2) * np.convolve(below, process),
        math.sqrt(share * (1.0 - process_pole**2)) * np.convolve(numerator_of(missed, poles), own),
    )
    size = max(map(len, rows))
    both = sum(np.convolve(row, row[::-1]) for row in (np.pad(row, (0, size - len(row))) for row in rows))
    above = np.convolve(TRIANGULAR, _spectral_factor(np.asarray(both)))
    return NoiseColour(sensor_pole, tuple(map(float, above)), tuple(map(float, np.convolve(np.convolve(below, process), own))))


def _spectral_factor(power: Array) -> Array:
    """b, (k + 1,), with  b(z) b(1/z) = power,  its zeros inside the unit circle; ``power``, (2 k + 1,), is positive on it."""
    least = 1e-12 * float(np.abs(power).max())
    edge = int(np.flatnonzero(np.abs(power) > least)[0])
    power = power[edge : len(power) - edge]
    roots = np.roots(power) if len(power) > 1 else np.empty(0)
    inside = sorted(roots, key=abs)[: len(power) // 2]
    shape = np.atleast_1d(np.real(np.poly(inside)))
    return np.asarray(shape * math.sqrt(float(power.sum())) / abs(float(shape.sum())))


def process_to_dict(process: ProcessTorque | None) -> dict[str, Any]:
    """Key and mapping of a process torque, ready for YAML; empty without one.

    Parameters
    ----------
    process : ProcessTorque or None
        Where it is known.

    Returns
    -------
    dict of str to Any
    """
    if process is None:
        return {}
    told = {name: float(getattr(process, name)) for name in ("rms_nm", "time_s", "rms_interval", "time_interval")}
    return {"process": told}


def process_from_dict(data: Mapping[str, Any] | None) -> ProcessTorque | None:
    """The process torque that :func:`process_to_dict` wrote.

    Parameters
    ----------
    data : dict of str to Any, or None
        The mapping under its key; None in older files.

    Returns
    -------
    ProcessTorque or None

    Raises
    ------
    KeyError
        For a damaged one.
    TypeError
        For a damaged one.
    ValueError
        For a damaged one.
    """
    if data is None:
        return None
    found = ProcessTorque(*(float(data[name]) for name in ("rms_nm", "time_s", "rms_interval", "time_interval")))
    if not (math.isfinite(found.rms_nm) and found.rms_nm >= 0.0 and math.isfinite(found.time_s) and found.time_s >= 0.0):
        raise ValueError(f"a process torque of {found.rms_nm} N m over {found.time_s} s")
    return found
