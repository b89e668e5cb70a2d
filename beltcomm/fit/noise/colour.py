"""Colour of the torque's noise: of first order as it is read, or behind a linear law, told by undoing that law.

    H(z) = B(z)/A(z),   A = Π (1 - p/z),  p the known poles:   u = A y / B

Zeros of B inside the unit circle are undone forwards, those outside backwards; a delay is a shift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from beltcomm.arrays import Array


@dataclass(frozen=True)
class NoiseColour:
    """Colour of the noise of the torque that acts.

    With ν white, of variance 1,

        w[n] = ρ w[n-1] + √(1-ρ²) ν[n],   in the residual  (w[n-1] + w[n])/2,     or there  b(z)/a(z) ν.

    Attributes
    ----------
    pole : float
        ρ, 0 for white noise.
    numerator, denominator : tuple of float
        b and a, of z⁰, z⁻¹, ..., zeros inside the unit circle, a[0] = 1; () for noise by its pole alone.
    """

    pole: float = 0.0
    numerator: tuple[float, ...] = ()
    denominator: tuple[float, ...] = ()

    @property
    def new(self) -> float:
        """Variance in the residual that no sample before tells, over that of w."""
        return self.numerator[0] ** 2 if self.numerator else 0.25 * (1.0 - self.pole**2)


#: Colours whose states are kept: a search asks for the same ones for every segment.
KEPT = 16
#: No colour.
WHITE_NOISE = NoiseColour()


@lru_cache(maxsize=KEPT)
def filter_states(colour: NoiseColour) -> tuple[Array, Array, Array]:
    """States of b(z)/a(z):  s[n+1] = F s[n] + G ν[n],  y[n] = s₁[n] + b₀ ν[n].

    Parameters
    ----------
    colour : NoiseColour
        With a numerator.

    Returns
    -------
    tuple of ndarray
        F (m, m), G (m,), and the covariance of s, (m, m).
    """
    size = max(len(colour.numerator), len(colour.denominator)) - 1
    b, a = (np.pad(row, (0, size + 1 - len(row))) for row in (colour.numerator, colour.denominator))
    f, g = np.eye(size, k=1), b[1:] - a[1:] * b[0]
    f[:, 0] -= a[1:]
    covariance = np.linalg.solve(np.eye(size * size) - np.kron(f, f), np.outer(g, g).reshape(-1)).reshape(size, size)
    return f, g, covariance


#: Share of the largest coefficient below which one is 0.
NOTHING = 1e-7
#: Points of a spectrum, from 0 to the sampling frequency.
POINTS = 1024
#: Least share of its largest answer that a law must have at every frequency to be undone.
LEAST_ANSWER = 0.02


def numerator_of(answer: Array, poles: Sequence[complex]) -> Array:
    """B of a law.

    Parameters
    ----------
    answer : ndarray (k,)
        To a unit sample, from that sample on.
    poles : sequence of complex
        All it has.

    Returns
    -------
    ndarray
        Coefficients of z⁰, z⁻¹, ...
    """
    found = np.convolve(answer, np.atleast_1d(np.real(np.poly(poles))))[: len(answer)]
    known = np.flatnonzero(np.abs(found) > NOTHING * np.abs(found).max())
    return np.asarray(found[: known[-1] + 1])


def deconvolve(row: Array, answer: Array, poles: Sequence[complex]) -> Array:
    """The row u whose answer is given; at rest before its first sample.

    Parameters
    ----------
    row : ndarray (n,)
        The answer y.
    answer, poles
        As for :func:`numerator_of`.

    Returns
    -------
    ndarray (n,)
    """
    from scipy.signal import lfilter  # takes a second to import, and most records have a setpoint

    above, below = numerator_of(answer, poles), np.atleast_1d(np.real(np.poly(poles)))
    delay = int(np.flatnonzero(np.abs(above) > NOTHING * np.abs(above).max())[0])
    above = above[delay:]
    zeros = np.roots(above) if len(above) > 1 else np.empty(0)
    inside, outside = zeros[np.abs(zeros) < 1.0], zeros[np.abs(zeros) >= 1.0]
    out = lfilter(below, [1.0], np.concatenate((np.full(len(below) - 1, row[0]), row)))[len(below) - 1 :] / above[0]
    for backwards, group in ((False, inside), (True, outside)):
        if len(group):
            behind = np.real(np.poly(1.0 / group if backwards else group))
            turned = out[::-1] / np.real(np.prod(-group)) if backwards else out
            found = lfilter([1.0], behind, turned - turned[0]) + turned[0] / behind.sum()
            out = found[::-1] if backwards else found
    ahead = delay + len(outside)
    return np.append(out[ahead:], np.full(ahead, out[-1])) if ahead else np.asarray(out)


def undone_noise(shown: Array, wanted: Array, poles: Sequence[complex], pole: float) -> NoiseColour:
    """Noise of what is told by an answer to which noise was added.

    Parameters
    ----------
    shown, wanted : ndarray (k,)
        Answers to a unit sample, until they have died away: of the row that is read, of the one that is told by it.
    poles : sequence of complex
        Of both.
    pole : float
        Of the noise that was added.

    Returns
    -------
    NoiseColour
        Of noise with variance 1.

    Raises
    ------
    ValueError
        Where the answer is next to nothing at a frequency.
    """
    size = np.abs(np.fft.fft(shown, POINTS))
    if size.min() < LEAST_ANSWER * size.max():
        raise ValueError(f"the answer has {size.min() / size.max():.2g} of its largest at a frequency; at least {LEAST_ANSWER:g} is needed")
    above, below = (_stable(numerator_of(answer, poles)) for answer in (wanted, shown))
    below = np.convolve(below, [1.0, -pole])
    scale = np.sqrt(1.0 - pole**2) / below[0]
    return NoiseColour(pole, tuple(map(float, scale * above)), tuple(map(float, below / below[0])))


def _stable(coefficients: Array) -> Array:
    """Coefficients whose answer has the same size at every frequency, without delay, and with no zero outside the unit circle."""
    known = coefficients[np.flatnonzero(np.abs(coefficients) > NOTHING * np.abs(coefficients).max())[0] :]
    zeros = np.roots(known) if len(known) > 1 else np.empty(0)
    outside = np.abs(zeros) > 1.0
    lead = known[0] * np.real(np.prod(-zeros[outside]))
    return np.asarray(lead * np.atleast_1d(np.real(np.poly(np.where(outside, 1.0 / np.where(outside, zeros.conj(), 1.0), zeros)))))
