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
from beltcomm.simulate.compose import LOOK_AHEAD, MOVING_RAD_S, kernel_for

Array = NDArray[np.float64]

#: m at the belt: distance in which the motor's friction turns round after a reversal.  Small against what a moving motor covers
#: in a fine step; samples in which it rests or reverses are left out by the caller, so chatter there does no harm.  (1.3 um would
#: reach into the samples after a reversal: 1 % of the viscous and 0.3 % of the Coulomb friction of rig g_b.)
BRISTLE_M = 2e-8


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
    position: Array,
    torque: Array,
    sample_s: float,
    inertia: float,
    *,
    start_rad: float,
    substeps: int,
    time_s: float = 0.0,
    load: Array | None = None,
) -> FineMotion:
    """Motor angle between the samples.

    The held torque bends the angle into parabolas, theta'' = (torque - load)/inertia + rest: the known part is integrated on the
    fine grid and taken out, the rest is interpolated by a cubic spline, then the known part is put back.  Without the load a
    reversal of the friction inside a sample would ring through the spline into its neighbours.

    position : ndarray (n,), rad, motor shaft.   torque : ndarray (n,), N m, acting from sample n to n+1.   inertia : kg m², motor
    side.   start_rad : rad, absolute motor angle (carriage position over i_t) of the first sample.
    load : ndarray (fine,), N m, as :func:`fine_load` gives it for a first reconstruction; None: taken as smooth.
    """
    n, h = len(position), sample_s / substeps
    push = np.repeat(torque[: n - 1], substeps)
    if load is not None:
        push = push - 0.5 * (load[:-1] + load[1:])
    change = push / inertia * h
    speed = np.concatenate(([0.0], np.cumsum(change)))
    known = np.concatenate(([0.0], np.cumsum((speed[:-1] + 0.5 * change) * h)))
    spline = CubicSpline(
        np.arange(n), position - known[::substeps]
    )  # not-a-knot: at rest the load that friction carries bends the rest at its ends
    place = np.arange(len(known)) / substeps
    theta = spline(place) + known
    omega = spline(place, 1) / sample_s + speed
    return FineMotion(theta - position[0] + start_rad, omega, n, sample_s, substeps, time_s)


def begins_in_motion(motion: FineMotion) -> bool:
    """Whether the kernel lets all bodies begin at the motor's speed; else they begin at rest."""
    half = max(1, min(LOOK_AHEAD, len(motion.theta) - 1) // 2)
    first, middle, last = (float(motion.theta[i]) for i in (0, half, 2 * half))
    return abs(4.0 * middle - last - 3.0 * first) * motion.substeps >= 2.0 * half * motion.sample_s * MOVING_RAD_S


def fine_load(model: Model, motion: FineMotion, vector: Array | None = None, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Load at the motor shaft, N m, and carriage position, m, on the fine grid; (fine,), (fine,).

    vector : replaces ``model.vector()``.   offset_m : m, a resting carriage is held by its friction up to level/stiffness away
    from where the belt is unstretched.
    """
    p = model.vector() if vector is None else vector
    load, cart = np.empty_like(motion.theta), np.empty_like(motion.theta)
    bristle = BRISTLE_M / p[model.index("transmission.ratio")]
    h = motion.sample_s / motion.substeps
    kernel_for(model).inverse(motion.theta, motion.omega, p, motion.time_s, h, bristle, offset_m, load, cart)
    return load, cart


def load_torque(model: Model, motion: FineMotion, vector: Array | None = None, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Load at the motor shaft averaged with the triangular weight, (n,), N m, ends 0; and the carriage position, (fine,), m.

    ``vector``, ``offset_m`` : see :func:`fine_load`.
    """
    load, cart = fine_load(model, motion, vector, offset_m)
    return triangular_mean(load, motion.substeps), cart


@compiled
def triangular_mean(fine: Array, substeps: int) -> Array:
    """Mean with weight 1 - |s| over one sample before and after each sample, by Simpson's rule; ``substeps`` even.

    (n*substeps - substeps + 1,) -> (n,), ends 0.  The trapezoidal rule would take (2 pi f h)²/12 off, 0.02 % at 134 Hz and 16 kHz.
    """
    if substeps % 2:
        raise ValueError("Simpson's rule needs an even number of substeps")
    n = (fine.shape[0] - 1) // substeps + 1
    mean = np.zeros(n)
    for k in range(1, n - 1):
        middle = k * substeps
        total = 2.0 * substeps * fine[middle]  # the end of one half and the beginning of the other
        for j in range(1, substeps):
            weight = 4.0 if j % 2 else 2.0
            total += weight * (substeps - j) * (fine[middle - j] + fine[middle + j])
        mean[k] = total / (3.0 * substeps**2)
    return mean


def torque_residual(position: Array, torque: Array, load: Array, sample_s: float, inertia: float) -> Array:
    """e[n] of the module's equation, N m at the motor shaft; (n,), ends 0."""
    residual = np.zeros(len(position))
    residual[1:-1] = inertia * np.diff(position, 2) / sample_s**2 + load[1:-1] - 0.5 * (torque[:-2] + torque[1:-1])
    return residual
