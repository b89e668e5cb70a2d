"""Noise of the torque sensor, and torque that acts unasked, where reading or residual give them a colour.

    r = reading - L y = L p + s,     u - h = s - (1 - L) p,     s, p : first order (Gauss, Markov), independent of each other

y : setpoint through the drive,   h : torque that acts, y + p,   u = reading + y - L y : what it is taken for,   L : the reading's filter.

What the reading tells of the residual, whatever else is in that, is -M B G r,  M the triangular mean,  B : what a model lets the torque
pass on its way to the motor (a dead time, a lag),  with the Wiener filter

    G = (S_s - (1 - L) L* S_p)/(S_s + |L|² S_p).

All values are found together:   O = 2 Σ (ln S_r + I_r/S_r)  +  n ln Σ (W(e + M B G r))²,   I_r : periodogram of r (Whittle).
An effect that is missing in the model is in e, but not in r, and cannot be taken for torque of a process.
Source: Whittle, Arkiv för Matematik 2 (1953); Wiener's filter as in Kailath, Sayed, Hassibi, Linear Estimation, 2000, chapter 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.fit.noise.decimation import decimate
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.torque.reading_fit import CLEAR

#: Samples of a part of r whose periodogram is taken, long beside any correlation: the most of which records hold enough parts.
PARTS, ENOUGH_PARTS = (2048, 1024, 512, 256, 128), 4.0
#: Deviations beyond which a value of r says no more.
OUTLIER = 5.0
#: Largest pole, pole to begin with of one colour and of a second beside it, and share that is taken for the sensor's at first.
LARGEST, FIRST_POLE, SECOND_POLE, HALF = 0.995, 0.88, 0.62, 0.5
#: Iterations, step of a difference, largest step of an unknown at a time, and fall of O that is not worth another, nats.
ITERATIONS, STEP, MOST, ENOUGH = 15, 1e-3, 1.5, 0.05
#: Bounds of the unknowns: logarithms, beyond which a noise is nothing, or a pole 0.
LOW, HIGH = -25.0, 12.0


class TorqueNoises(NamedTuple):
    """Both noises.

    Attributes
    ----------
    sensor_nm, process_nm : float
        N m rms.
    sensor_pole, process_pole : float
        Correlations of neighbours.
    """

    sensor_nm: float
    process_nm: float
    sensor_pole: float = 0.0
    process_pole: float = 0.0

    def spectra(self, z: ComplexArray) -> tuple[Array, Array]:
        """Power at z⁻¹ = e^(-iω), of sensor and process, (N m)²."""
        return self.sensor_nm**2 * _first_order(self.sensor_pole, z), self.process_nm**2 * _first_order(self.process_pole, z)


@dataclass(frozen=True)
class NoisesFit:
    """Noises as r and the residual have them.

    Attributes
    ----------
    cost : float
        O, -2 ln L up to a constant that is the same for all fits of the same records.
    deviations : TorqueNoises
        One standard deviation of each value; 0 for one that is held.
    """

    noises: TorqueNoises
    cost: float
    deviations: TorqueNoises


class RestPart(NamedTuple):
    """One piece of the records.

    Attributes
    ----------
    rest : ndarray (n,), N m
        r.
    left, weights : ndarray (values,)
        The whitened residual and the square roots of what its blocks count.
    every : int
        Every which sample the piece takes.
    """

    piece: Segment
    rest: Array
    left: Array
    weights: Array
    every: int


class NoisesProblem:
    """O of the module.

    Parameters
    ----------
    parts : sequence of RestPart
        Of all records with a setpoint.
    answer : ndarray
        The reading's to a torque that acts over one sample, L.
    scale_nm : float
        rms of r, N m.
    between : callable
        B, of z⁻¹.
    """

    def __init__(self, parts: Sequence[RestPart], answer: Array, scale_nm: float, between: Callable[[ComplexArray], ComplexArray]) -> None:
        self.parts, self.scale_nm = parts, scale_nm
        rests = [np.clip(part.rest, -OUTLIER * scale_nm, OUTLIER * scale_nm) for part in parts]
        self._transformed = [
            (np.fft.rfft(rest) * between(_delay(len(rest))), _delay(len(rest)), _response(answer, len(rest)), len(rest)) for rest in rests
        ]
        for part in PARTS:
            power = _periodograms(rests, part)
            self._number = 0.5 * len(power)  # two windows that overlap by half tell as much as one
            if self._number >= ENOUGH_PARTS:
                break
        self._power = np.mean(power, axis=0)[1:-1] if power else np.zeros(0)
        self._part, self._z, self._read = part, _delay(part)[1:-1], _response(answer, part)[1:-1]

    @property
    def enough(self) -> bool:
        """True if r is long enough to have a spectrum."""
        return self._number >= ENOUGH_PARTS

    def _read_power(self, noises: TorqueNoises) -> Array:
        """S_r of the module."""
        sensor, process = noises.spectra(self._z)
        return np.asarray(sensor + np.abs(self._read) ** 2 * process)

    def _left(self, several: Sequence[TorqueNoises]) -> Array:
        """W(e + M B G r) for several noises, (n, k)."""
        found = []
        for part, (rest, z, read, number) in zip(self.parts, self._transformed, strict=True):
            columns = np.zeros((number // part.every, len(several)))
            for k, noises in enumerate(several):
                sensor, process = noises.spectra(z)
                told = (sensor - (1.0 - read) * read.conj() * process) / (sensor + np.abs(read) ** 2 * process)
                row = np.fft.irfft(rest * told, number)
                row = decimate(row, part.every) if part.every > 1 else row
                columns[1:-1, k] = 0.5 * (row[:-2] + row[1:-1])
            found.append((part.piece.white(columns) + part.left[:, None]) * part.weights[:, None])
        return np.concatenate(found)

    def _costs(self, several: Sequence[TorqueNoises]) -> tuple[float, Array, Array]:
        """O at the first of several noises, and its slope and information towards the others, per :data:`STEP`."""
        left, power = self._left(several), [self._read_power(noises) for noises in several]
        here, count = left[:, 0], len(left)
        squares = max(float(here @ here), 1e-300)
        share = self._power / power[0]
        cost = count * math.log(squares / count) + 2.0 * self._number * float(np.sum(np.log(power[0]) + share))
        moved = (left[:, 1:] - here[:, None]) / STEP
        turned = np.reshape([np.log(other / power[0]) / STEP for other in power[1:]], (len(several) - 1, len(share)))
        slope = 2.0 * count / squares * moved.T @ here + 2.0 * self._number * turned @ (1.0 - share)
        return cost, slope, 2.0 * count / squares * moved.T @ moved + 2.0 * self._number * turned @ turned.T

    def fit(self, begun: TorqueNoises, coloured: tuple[bool, bool]) -> NoisesFit:
        """The likeliest noises, by Fisher's scoring; ``coloured``: sensor and process have a colour."""
        x, held = _unknowns(begun, coloured), 1e-3

        def around(x: Array) -> list[TorqueNoises]:
            return [_noises_at(at, coloured) for at in (x, *(x + STEP * np.eye(len(x))))]

        cost, slope, information = self._costs(around(x))
        for _ in range(ITERATIONS):
            gain = 0.0
            while held < 1e6:
                system = information + held * np.diag(np.diag(information) + 1e-9)
                ahead = np.clip(x - np.clip(np.linalg.solve(system, slope), -MOST, MOST), LOW, HIGH)
                gain = cost - self._costs([_noises_at(ahead, coloured)])[0]
                if gain > 0.0:
                    break
                held *= 10.0
            if not gain > 0.0:
                break
            x, held = ahead, max(0.1 * held, 1e-6)
            cost, slope, information = self._costs(around(x))
            if gain < ENOUGH:
                break
        return NoisesFit(_noises_at(x, coloured), cost, _deviations_at(x, coloured, information))

    def likeliest(self) -> list[NoisesFit]:
        """Fits with no colour, with one of either noise, and with two, with O plus what their colours cost, the best one first."""
        half = self.scale_nm * math.sqrt(HALF)
        white, process, sensor = (
            self.fit(TorqueNoises(half, half, *poles), (poles[0] > 0.0, poles[1] > 0.0))
            for poles in ((0.0, 0.0), (0.0, FIRST_POLE), (FIRST_POLE, 0.0))
        )
        begun = min((process, sensor), key=lambda one: one.cost).noises
        poles = [pole or SECOND_POLE for pole in (begun.sensor_pole, begun.process_pole)]
        both = self.fit(begun._replace(sensor_pole=poles[0], process_pole=poles[1]), (True, True))
        return sorted((white, process, sensor, both), key=self._priced)

    def _priced(self, one: NoisesFit) -> float:
        """O with ln n and :data:`CLEAR` for every colour, nats."""
        number = sum(len(part.left) for part in self.parts) + self._part * self._number
        return one.cost + (math.log(number) + CLEAR) * sum(pole > 0.0 for pole in one.noises[2:])


def _first_order(pole: float, z: ComplexArray) -> Array:
    """Spectrum of noise of first order with variance 1."""
    return np.asarray((1.0 - pole**2) / np.abs(1.0 - pole * z) ** 2)


def _delay(number: int) -> ComplexArray:
    """z⁻¹ = e^(-iω) at the frequencies of a transform of so many samples."""
    return np.asarray(np.exp(-2j * np.pi * np.arange(number // 2 + 1) / number))


def _response(answer: Array, number: int) -> ComplexArray:
    """Of an answer to a unit sample, at the frequencies of a transform of so many samples."""
    return np.asarray(np.fft.rfft(answer[:number], number))


def _periodograms(rests: Sequence[Array], part: int) -> list[Array]:
    """Power of parts of so many samples that overlap by half, each (part/2 + 1,)."""
    window = np.hanning(part + 2)[1:-1]
    window /= math.sqrt(float(np.mean(window**2)))
    begins = [(rest, first) for rest in rests for first in range(0, len(rest) - part + 1, part // 2)]
    return [np.abs(np.fft.rfft(window * rest[first : first + part])) ** 2 / part for rest, first in begins]


def _unknowns(noises: TorqueNoises, coloured: tuple[bool, bool]) -> Array:
    """ln of both deviations, then ln(ρ/(ρ_max - ρ)) of the poles that are free."""
    poles = [math.log(pole / (LARGEST - pole)) for pole, free in zip(noises[2:], coloured, strict=True) if free]
    return np.array([math.log(noises.sensor_nm), math.log(noises.process_nm), *poles])


def _noises_at(x: Array, coloured: tuple[bool, bool]) -> TorqueNoises:
    """The noises of :func:`_unknowns`."""
    poles = iter(x[2:])
    own = [LARGEST / (1.0 + math.exp(-next(poles))) if free else 0.0 for free in coloured]
    return TorqueNoises(math.exp(x[0]), math.exp(x[1]), *own)


def _deviations_at(x: Array, coloured: tuple[bool, bool], information: Array) -> TorqueNoises:
    """One standard deviation of every value, by the information, of -2 ln L, of the unknowns."""
    spread = np.sqrt(np.maximum(2.0 * np.diag(np.linalg.pinv(information, hermitian=True)), 0.0))
    here, poles = _noises_at(x, coloured), iter(spread[2:])
    own = [pole * (1.0 - pole / LARGEST) * float(next(poles)) if free else 0.0 for pole, free in zip(here[2:], coloured, strict=True)]
    return TorqueNoises(here.sensor_nm * float(spread[0]), here.process_nm * float(spread[1]), *own)
