"""Score-test columns of effects that repeat with the motor angle, all orders in one pass.

A torque A sin(N θ) adds its triangular mean to the load; e^{jNθ} follows from e^{j(N-1)θ} by one multiplication per fine step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.fit.residual.segment import Segment


def powers_of(number: int) -> Array:
    """sin(0 θ) and cos(0 θ) of so many angles, which :func:`load_means` and :func:`gain_means` raise order by order; (2, number)."""
    return np.stack([np.zeros(number), np.ones(number)])


def load_means(piece: Segment, powers: Array, orders: int) -> Iterator[tuple[Array, Array]]:
    """Triangular means of sin(N θ) and cos(N θ) for the next so many orders N; (n,) each, ends 0.

    Parameters
    ----------
    powers : ndarray (2, fine)
        Of the last one.
    """
    theta, m = piece.motion.theta, piece.motion.substeps
    sine, cosine = np.sin(theta), np.cos(theta)
    for _ in range(orders):
        means = np.zeros((2, piece.motion.samples))
        load_kernel(sine, cosine, powers[0], powers[1], m, means)
        yield means[0], means[1]


def gain_means(piece: Segment, powers: Array, orders: int) -> Iterator[tuple[Array, Array]]:
    """Triangular means of torque sin(N θ) and torque cos(N θ), the torque held from sample n to n+1.

    Parameters
    ----------
    powers : ndarray (2, fine - 1)
    """
    theta, m = piece.motion.theta, piece.motion.substeps
    middle = 0.5 * (theta[:-1] + theta[1:])
    sine, cosine = np.sin(middle), np.cos(middle)
    for _ in range(orders):
        means = np.zeros((2, piece.motion.samples))
        gain_kernel(sine, cosine, powers[0], powers[1], piece.torque, m, means)
        yield means[0], means[1]


def line_columns(piece: Segment, inertia: float, lines: float) -> Array:
    """Inertia torque by errors of the angle shown, 1 rad once and twice per line, N m; (n, 4), ends 0.

        J (θ[n+1] - 2 θ[n] + θ[n-1])/T²  of  -sin Nθ, -cos Nθ, -sin 2Nθ, -cos 2Nθ

    A line passes in so short a time that nothing behind the motor follows; at the samples, above half their rate as well.

    Parameters
    ----------
    inertia : float, kg m², motor side
    """
    once = lines * piece.motion.theta[:: piece.motion.substeps]
    error = np.stack([np.sin(once), np.cos(once), np.sin(2.0 * once), np.cos(2.0 * once)], axis=1)
    columns = np.zeros_like(error)
    columns[1:-1] = -inertia / piece.motion.sample_s**2 * np.diff(error, 2, axis=0)
    return columns


@compiled
def load_kernel(sine: Array, cosine: Array, power_sine: Array, power_cosine: Array, m: int, means: Array) -> None:
    """Raise the powers by one order; their triangular means by Simpson's rule (see ``triangular_mean``)."""
    for k in range(sine.shape[0]):
        s, c = power_sine[k], power_cosine[k]
        power_sine[k] = s * cosine[k] + c * sine[k]
        power_cosine[k] = c * cosine[k] - s * sine[k]
    for n in range(1, means.shape[1] - 1):
        middle = n * m
        total_s, total_c = 2.0 * m * power_sine[middle], 2.0 * m * power_cosine[middle]
        for j in range(1, m):
            weight = (4.0 if j % 2 else 2.0) * (m - j)
            total_s += weight * (power_sine[middle - j] + power_sine[middle + j])
            total_c += weight * (power_cosine[middle - j] + power_cosine[middle + j])
        means[0, n] = total_s / (3.0 * m * m)
        means[1, n] = total_c / (3.0 * m * m)


@compiled
def gain_kernel(sine: Array, cosine: Array, power_sine: Array, power_cosine: Array, torque: Array, m: int, means: Array) -> None:
    """Means of the gain harmonics for cells of held torque; the middle of a cell weighs it."""
    for k in range(sine.shape[0]):
        s, c = power_sine[k], power_cosine[k]
        power_sine[k] = s * cosine[k] + c * sine[k]
        power_cosine[k] = c * cosine[k] - s * sine[k]
    for n in range(1, means.shape[1] - 1):
        for j in range(m):
            rising, falling = (n - 1) * m + j, n * m + j
            up, down = torque[n - 1] * (j + 0.5), torque[n] * (m - j - 0.5)
            means[0, n] += (up * power_sine[rising] + down * power_sine[falling]) / (m * m)
            means[1, n] += (up * power_cosine[rising] + down * power_cosine[falling]) / (m * m)
