"""What a drive does between two of its periods, compiled: counts, compares, computes a torque.  Generated kernels close a loop with it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltcomm.cascade_kernel import cascade_step, velocity_step
from beltcomm.compiled import compiled

Array = NDArray[np.float64]


@compiled
def setpoint(
    follows_position: bool,
    coefficients: Array,
    state: Array,
    reference_rad: float,
    reference_rad_s: float,
    reference_rad_s2: float,
    motor_rad: float,
    added_nm: float,
    sensing: Array,
) -> float:
    """Torque setpoint of one period, N m, for a motor that stands at ``motor_rad``; moves ``state`` on.

    coefficients, state : as in :mod:`beltcomm.cascade_kernel`.   sensing : ndarray (4,): angle of the encoder's zero and of one count,
    dead zone and bound of the position error, rad.
    """
    start, step, dead, bound = sensing
    counted = start + math.floor(motor_rad / step + 0.5) * step
    if not follows_position:
        return velocity_step(coefficients, state, reference_rad_s, reference_rad_s2, counted, added_nm)
    error = reference_rad - counted
    seen = math.copysign(min(max(0.0, abs(error) - dead), bound), error)
    return cascade_step(coefficients, state, counted + seen, reference_rad_s, reference_rad_s2, counted, added_nm)
