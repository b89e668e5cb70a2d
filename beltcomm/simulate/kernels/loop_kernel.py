"""A drive's period, compiled: it counts, compares, computes a torque.  Generated kernels close a loop with it."""

from __future__ import annotations

import math

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
    coefficients, state : ndarray
        As in :mod:`beltcomm.control.cascade_kernel`.
    references : ndarray (4, n)
        Position, speed, acceleration at the motor shaft, torque added.
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
