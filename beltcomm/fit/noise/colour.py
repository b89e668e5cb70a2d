"""Colour of the torque's noise: of first order as it is read, or behind a linear law on its way to the residual."""

from __future__ import annotations

from dataclasses import dataclass

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


#: No colour.
WHITE_NOISE = NoiseColour()


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
