"""Compiled pieces that the written kernels call: set-valued friction over a sub-step, a drive's period, the triangular mean."""

from __future__ import annotations

import math

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.control.cascade_kernel import cascade_step, velocity_step


@compiled
def setpoint(
    follows_position: bool,
    coefficients: Array,
    state: Array,
    references: Array,
    k: int,
    motor_rad: float,
    sensing: Array,
) -> float:
    """Torque setpoint of period ``k``, N m, for a motor that stands at ``motor_rad``; moves ``state`` on.

    Parameters
    ----------
    follows_position : bool
        True for the position loop, False for the velocity loop alone.
    coefficients, state : ndarray
        As in :mod:`beltcomm.control.cascade_kernel`.
    references : ndarray (4, n)
        Position, speed, acceleration at the motor shaft, torque added.
    k : int
        Number of the period.
    motor_rad : float, rad, motor shaft
        Angle from where the motor stood at first.
    sensing : ndarray (4,)
        Angle of the encoder's zero and of one count, dead zone and bound of the position error, rad.
    """
    step = sensing[1]
    counted = sensing[0] + math.floor(motor_rad / step + 0.5) * step
    if not follows_position:
        return velocity_step(coefficients, state, references[1, k], references[2, k], counted, references[3, k])
    error = references[0, k] - counted
    seen = math.copysign(min(max(0.0, abs(error) - sensing[2]), sensing[3]), error)
    return cascade_step(coefficients, state, counted + seen, references[1, k], references[2, k], counted, references[3, k])


def stick_or_slide(speed: float, push: float, grip: float, h: float) -> float:
    """Speed after ``h`` seconds under a constant push and set-valued friction, solved exactly.

    dv/dt = push - grip sign(v),   v = 0 held while |push| <= grip

    Parameters
    ----------
    speed : float
        v before, m/s or rad/s.
    push : float
        Acceleration by everything but this friction.
    grip : float
        Friction level over inertia, >= 0. A reversal within the step is placed where it happens: taking the whole step with one sign would
        shift the friction by half a step at every reversal, which looks like mass (0.3 % of the carriage of rig g_b at 8 kHz).
    h : float, s
        Duration.
    """
    direction = 1.0 if (speed if speed != 0.0 else push) > 0.0 else -1.0  # a body at rest starts to where it is pushed
    forward = direction * push
    left = direction * speed + h * (forward - grip)
    if left >= 0.0:
        return direction * left
    if forward >= -grip:
        return 0.0
    stopped = direction * speed / (grip - forward)
    return direction * (h - stopped) * (forward + grip)


#: N m; a load beyond it, or none at all, comes from bodies that an absurd model let fly off: as bad as any.
ABSURD_NM = 1e12


def weighted_mean(fine: Array, middle: int, substeps: int) -> float:
    """Mean with weight 1 - |s| around one place of a fine grid, by Simpson's rule; ``substeps`` even.   At most ``ABSURD_NM``.

    The trapezoidal rule would take (2 pi f h)²/12 off, 0.02 % at 134 Hz and 16 kHz.

    Parameters
    ----------
    fine : ndarray (n,)
        On a fine grid.
    middle : int
        Place in it.
    substeps : int
        Fine steps per sample.
    """
    total = 2.0 * substeps * fine[middle]  # the end of one half and the beginning of the other
    for j in range(1, substeps):
        weight = 4.0 if j % 2 else 2.0
        total += weight * (substeps - j) * (fine[middle - j] + fine[middle + j])
    mean = total / (3.0 * (substeps * substeps))
    return float(mean) if abs(mean) < ABSURD_NM else ABSURD_NM


def triangular_mean(fine: Array, substeps: int) -> Array:
    """Triangular mean around every sample; (n*substeps - substeps + 1,) -> (n,), ends 0.

    Parameters
    ----------
    fine : ndarray (n*substeps - substeps + 1,)
        Of any unit.
    substeps : int
        Fine steps per sample, even.

    Returns
    -------
    ndarray (n,)
        In that unit; ends 0.

    Raises
    ------
    ValueError
        For an odd number of substeps.
    """
    if substeps % 2:
        raise ValueError("Simpson's rule needs an even number of substeps")
    mean = np.zeros((len(fine) - 1) // substeps + 1)
    _triangular_mean(fine, substeps, mean)
    return mean


@compiled
def _triangular_mean(fine: Array, substeps: int, mean: Array) -> None:
    n = mean.shape[0]
    share = 1.0 / (3.0 * substeps * substeps)
    for k in range(1, n - 1):
        mean[k] = 2.0 * substeps * share * fine[k * substeps]
    for j in range(1, substeps):  # sample by sample would be a loop too short to be fast
        weight = (4.0 if j % 2 else 2.0) * (substeps - j) * share
        for k in range(1, n - 1):
            mean[k] += weight * (fine[k * substeps - j] + fine[k * substeps + j])
    for k in range(1, n - 1):
        if not abs(mean[k]) < ABSURD_NM:
            mean[k] = ABSURD_NM
