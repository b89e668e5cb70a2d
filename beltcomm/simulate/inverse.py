"""From measured motion to the torque that a model needs for it: every instant is judged on its own merits.

For a held torque the second difference of the motor angle is an exact average of the acceleration,

    theta[n+1] - 2 theta[n] + theta[n-1] = T² ∫ tri(s) theta''(t_n + s T) ds,    s = -1 .. 1,

with the triangular weight tri(s) = 1 - |s|.  So the equation of motion, averaged with the same weight, needs no differentiation
and no hold model:

    e[n] = J (theta[n+1] - 2 theta[n] + theta[n-1])/T² + <load>[n] - (torque[n-1] + torque[n])/2

where the load (friction, belt) is computed on a fine grid by driving the unmeasured bodies with the measured motor angle.  Written
in frequency this is the exact sampled response of an inertia to a held torque, -0.5 (w T)² (z + 1)/(z - 1)²; plain
differentiation with a sinc would leave a bias of 0.3 to 0.5 % in J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltcomm.compiled import compiled
from beltcomm.model import Model
from beltcomm.simulate.compose import kernel_for

Array = NDArray[np.float64]

#: m at the belt: distance in which friction turns round after a reversal.  Below one encoder step of usual drives, so that the
#: sign of a resting motor's quantised angle does not chatter.
BRISTLE_M = 1.3e-6


@dataclass(frozen=True)
class FineMotion:
    """Motor motion of one gapless stretch on a fine grid.

    theta, omega : ndarray (n*substeps - substeps + 1,), rad and rad/s at the motor shaft, absolute: theta = position / i_t.
    samples : number of samples n.     sample_s : s, sampling period.    substeps : fine steps per sample.
    time_s : s, session clock at the first sample.
    """

    theta: Array
    omega: Array
    samples: int
    sample_s: float
    substeps: int
    time_s: float


def reconstruct(
    position: Array, torque: Array, sample_s: float, inertia: float, *, start_rad: float, substeps: int, time_s: float = 0.0
) -> FineMotion:
    """Motor angle between the samples.

    The held torque bends the angle into parabolas, theta'' = torque/inertia + smooth: that part is known and taken out, the rest is
    interpolated by a cubic spline, then the parabolas are put back.

    position : ndarray (n,), rad, motor shaft.  torque : ndarray (n,), N m, acting from sample n to n+1.  inertia : kg m², motor side.
    start_rad : rad, absolute motor angle (carriage position over i_t) of the first sample.
    """
    n = len(position)
    push = torque / inertia * sample_s**2
    speed = np.concatenate(([0.0], np.cumsum(push)))[:n]  # held motion per sample, rad
    held = np.concatenate(([0.0], np.cumsum(speed + 0.5 * push)))[:n]
    spline = CubicSpline(np.arange(n), position - held, bc_type="natural")
    fine = np.arange((n - 1) * substeps + 1)
    index = np.minimum(fine // substeps, n - 2)
    s = fine / substeps - index
    theta = spline(index + s) + held[index] + s * speed[index] + 0.5 * s * s * push[index]
    omega = (spline(index + s, 1) + speed[index] + s * push[index]) / sample_s
    return FineMotion(theta - position[0] + start_rad, omega, n, sample_s, substeps, time_s)


def load_torque(model: Model, motion: FineMotion, vector: Array | None = None, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Load at the motor shaft, averaged with the triangular weight, and the carriage motion.

    Returns (load, cart): ndarray (n,), N m, ends without meaning (0); ndarray (fine,), m.   ``vector`` replaces ``model.vector()``.
    offset_m : m, a resting carriage is held by its friction up to level/stiffness away from where the belt is unstretched.
    """
    p = model.vector() if vector is None else vector
    fine = np.empty_like(motion.theta)
    cart = np.empty_like(motion.theta)
    bristle = BRISTLE_M / p[model.index("transmission.ratio")]
    h = motion.sample_s / motion.substeps
    kernel_for(model).inverse(motion.theta, motion.omega, p, motion.time_s, h, bristle, offset_m, fine, cart)
    return triangular_mean(fine, motion.substeps), cart


@compiled
def triangular_mean(fine: Array, substeps: int) -> Array:
    """Mean with weight 1 - |s| over one sample before and after each sample; (n*substeps - substeps + 1,) -> (n,), ends 0."""
    n = (fine.shape[0] - 1) // substeps + 1
    mean = np.zeros(n)
    for k in range(1, n - 1):
        middle = k * substeps
        total = substeps * fine[middle]
        for j in range(1, substeps):
            total += (substeps - j) * (fine[middle - j] + fine[middle + j])
        mean[k] = total / substeps**2
    return mean


def torque_residual(position: Array, torque: Array, load: Array, sample_s: float, inertia: float) -> Array:
    """e[n] of the module's equation, N m at the motor shaft; (n,), ends 0."""
    residual = np.zeros(len(position))
    residual[1:-1] = inertia * np.diff(position, 2) / sample_s**2 + load[1:-1] - 0.5 * (torque[:-2] + torque[1:-1])
    return residual
