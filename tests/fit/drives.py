"""What a drive makes of a setpoint, by convolution on a grid of time far finer than any that the product uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]

#: Points of a sampling period, a multiple of the cells that the product divides it into.
FINE = 640


def held(setpoint: Array, delay: float) -> Array:
    """The setpoint, each value held for a period, so many periods later; its first value before.  (n,) -> (n, FINE), mean of each step."""
    steps = np.arange(len(setpoint) * FINE + 1) / FINE - delay
    whole = np.concatenate(([0.0], np.cumsum(setpoint)))  # the integral, exact also where the setpoint changes inside a step
    integral = np.where(steps < 0.0, steps * setpoint[0], np.interp(steps, np.arange(len(setpoint) + 1), whole))
    return (np.diff(integral) * FINE).reshape(len(setpoint), FINE)


def behind(torque: Array, sample_s: float, numerator: list[float], denominator: list[float]) -> Array:
    """A torque behind a filter of continuous time of gain 1, at rest before; (n, FINE) -> (n, FINE), mean of each step."""
    b, a, _ = cont2discrete((numerator, denominator), sample_s / FINE, "zoh")
    u = np.append(torque.reshape(-1), torque[-1, -1])
    at = lfilter(np.squeeze(b), a, u - u[0]) + u[0]  # at the beginning of each step, before its own input has acted
    return np.asarray(0.5 * (at[:-1] + at[1:]).reshape(torque.shape))


def first_order(time_s: float) -> tuple[list[float], list[float]]:
    """Numerator and denominator of 1/(1 + s time_s)."""
    return [1.0], [time_s, 1.0]


def second_order(frequency_hz: float, damping_ratio: float) -> tuple[list[float], list[float]]:
    """Of ω²/(s² + 2 D ω s + ω²)."""
    omega = 2.0 * np.pi * frequency_hz
    return [omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2]


def smoothed(setpoint: Array, share: float) -> Array:
    """y[n] = y[n-1] + share (x[n] - y[n-1]), at rest before, written out; (n,)."""
    out, y = np.empty(len(setpoint)), setpoint[0]
    for n, x in enumerate(setpoint):
        y += share * (x - y)
        out[n] = y
    return out
