"""Noise of the inverse residual, exactly: torque noise and encoder rounding, the rounding also through the belt.

    e[n] = a₁ ε[n+1] + a₀ ε[n] + a₁ ε[n-1] - i_t (c χ[n] + d χ'[n]) - (w[n] + w[n-1])/2
    a₁ = J/T² + i_t² c/6,   a₀ = -2 J/T² + 4 i_t² c/6,   m χ'' + (d + d_c) χ' + c χ = i_t (c ε + d ε')

w : torque noise; ε : rounding of the angle; χ : the carriage that the rounding shakes in the model.  At the antiresonance χ is large:
without it the noise there is underrated by orders of magnitude for a heavy carriage, and a false effect found.  A Kalman filter
with these states turns e into independent numbers of variance 1, whatever samples are left out; its gains do not depend on e.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from beltcomm.compiled import compiled
from beltcomm.model import Model

Array = NDArray[np.float64]

#: States: χ, χ', ε[n+1], ε[n], ε[n-1], w[n], w[n-1].
STATES = 7


@dataclass(frozen=True)
class NoiseModel:
    """Linear noise of one model and one record.   step (7, 7), output (7,), variances of the new ε and w."""

    step: Array
    output: Array
    rounding: float
    torque: float


@dataclass(frozen=True)
class Whitener:
    """Gains (n, 7) and innovation deviations (n,) of one stretch."""

    noise: NoiseModel
    gains: Array
    deviations: Array

    def __call__(self, torque: Array, keep: NDArray[np.bool_]) -> Array:
        """Innovations of the kept samples in units of their deviation; (n,) -> (kept,), linear in the torque."""
        return _innovations(torque, keep, self.noise.step, self.noise.output, self.gains, self.deviations)


def noise_model(model: Model, sample_s: float, step_rad: float, noise_nm: float, share: float = 1.0) -> NoiseModel:
    """Noise of the residual for a model.   share : of the rounding's variance q²/12 that acts (slow steady motion rounds in step)."""
    inertia, ratio = model["motor.inertia"], model["transmission.ratio"]
    stiffness, damping = model.get("belt_stiffness.stiffness"), model.get("belt_damping.damping")
    step, output = np.zeros((STATES, STATES)), np.zeros(STATES)
    belt = ratio**2 * stiffness
    output[2] = output[4] = inertia / sample_s**2 + belt / 6.0
    output[3] = -2.0 * inertia / sample_s**2 + 4.0 * belt / 6.0
    output[5] = output[6] = -0.5
    step[3, 2] = step[4, 3] = step[6, 5] = 1.0
    if stiffness > 0.0:
        mass, drag = model["cart.mass"], model.get("viscous_cart.damping")
        # exact for a rounding error that changes linearly between the samples; the damper's ε' is left out (d ω << c)
        system = np.zeros((4, 4))
        system[0, 1] = 1.0
        system[1, :3] = -stiffness / mass, -(damping + drag) / mass, ratio * stiffness / mass
        system[2, 3] = 1.0 / sample_s
        exact = expm(system * sample_s)
        step[:2, :2] = exact[:2, :2]
        step[:2, 3] = exact[:2, 2] - exact[:2, 3]
        step[:2, 2] = exact[:2, 3]
        output[:2] = -ratio * stiffness, -ratio * damping
    return NoiseModel(step, output, share * step_rad**2 / 12.0, noise_nm**2)


def whitener(noise: NoiseModel, keep: NDArray[np.bool_]) -> Whitener:
    """Gains for the kept samples of a stretch."""
    gains, deviations = np.zeros((len(keep), STATES)), np.ones(len(keep))
    _gains(keep, noise.step, noise.output, noise.rounding, noise.torque, gains, deviations)
    return Whitener(noise, gains, deviations)


@compiled
def _gains(keep: NDArray[np.bool_], step: Array, output: Array, rounding: float, torque: float, gains: Array, deviations: Array) -> None:
    """Kalman recursion with exact states: prediction P = A P A' + Q, gain P c/(c' P c)."""
    n = step.shape[0]
    cov = np.zeros((n, n))
    for i in range(2, 5):
        cov[i, i] = rounding
    cov[5, 5] = cov[6, 6] = torque
    half = np.zeros((n, n))
    seen = np.zeros(n)
    for k in range(keep.shape[0]):
        if k > 0:
            for i in range(n):
                for j in range(n):
                    total = 0.0
                    for m in range(n):
                        if step[i, m] != 0.0:
                            total += step[i, m] * cov[m, j]
                    half[i, j] = total
            for i in range(n):
                for j in range(n):
                    total = 0.0
                    for m in range(n):
                        if step[j, m] != 0.0:
                            total += half[i, m] * step[j, m]
                    cov[i, j] = total
            cov[2, 2] += rounding
            cov[5, 5] += torque
        if not keep[k]:
            continue
        variance = 0.0
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += cov[i, j] * output[j]
            seen[i] = total
            variance += output[i] * total
        deviations[k] = np.sqrt(variance)
        for i in range(n):
            gains[k, i] = seen[i] / variance
        for i in range(n):
            for j in range(n):
                cov[i, j] -= gains[k, i] * seen[j]


@compiled
def _innovations(torque: Array, keep: NDArray[np.bool_], step: Array, output: Array, gains: Array, deviations: Array) -> Array:
    """Innovations over their deviations.  The rows of ``step`` but the first two only shift."""
    out = np.empty(keep.sum())
    c0 = c1 = e1 = e0 = e_1 = w0 = w1 = 0.0
    place = 0
    for k in range(torque.shape[0]):
        if k > 0:
            n0 = step[0, 0] * c0 + step[0, 1] * c1 + step[0, 2] * e1 + step[0, 3] * e0
            n1 = step[1, 0] * c0 + step[1, 1] * c1 + step[1, 2] * e1 + step[1, 3] * e0
            c0, c1 = n0, n1
            e_1, e0, e1 = e0, e1, 0.0
            w1, w0 = w0, 0.0
        if not keep[k]:
            continue
        expected = output[0] * c0 + output[1] * c1 + output[2] * e1 + output[3] * e0 + output[4] * e_1 + output[5] * w0 + output[6] * w1
        innovation = torque[k] - expected
        out[place] = innovation / deviations[k]
        place += 1
        c0 += gains[k, 0] * innovation
        c1 += gains[k, 1] * innovation
        e1 += gains[k, 2] * innovation
        e0 += gains[k, 3] * innovation
        e_1 += gains[k, 4] * innovation
        w0 += gains[k, 5] * innovation
        w1 += gains[k, 6] * innovation
    return out
