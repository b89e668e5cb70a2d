"""A closed loop on a model: the drive's cascade along a reference, with a torque added to its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltcomm.control import Cascade, cascade_step, discrete_coefficients, new_state, reset_state, velocity_step
from beltcomm.model import Model
from beltcomm.simulate.plant import SimulatedPlant, substeps_needed

Array = NDArray[np.float64]
LoopKind = Literal["velocity", "position"]


@dataclass(frozen=True)
class LoopDrive:
    """What a drive adds to its controller.   period_s : of its loops.   delay_s : torque setpoint to acting torque.

    torque_limit_nm : motor shaft.   counts_per_rev : of the encoder.
    """

    period_s: float
    delay_s: float
    torque_limit_nm: float
    counts_per_rev: int


@dataclass(frozen=True)
class LoopRun:
    """What the model did, (n,), at the start of each loop period.   position_rad, velocity_rad_s : motor shaft, from where it began.

    cart_m : carriage on the axis.   torque_nm : acting, motor shaft.   belt_force_n : largest within the period.
    """

    position_rad: Array
    velocity_rad_s: Array
    cart_m: Array
    torque_nm: Array
    belt_force_n: Array


def simulate_loop(
    model: Model,
    cascade: Cascade,
    drive: LoopDrive,
    kind: LoopKind,
    start_m: float,
    reference_rad: Array,
    reference_rad_s: Array,
    added_nm: Array,
) -> LoopRun:
    """The drive's own loop on a model that begins at rest, one reference per loop period.

    kind : which loop is closed; "velocity" leaves the position free.   start_m : carriage, m.   reference_rad : (n,), motor shaft, from
    where it began.   reference_rad_s, added_nm : (n,), speed asked for and torque added to the controller's.
    """
    n = len(added_nm)
    plant = SimulatedPlant(model, start_m, substeps_needed(model, start_m))
    coefficients, state = discrete_coefficients(cascade, drive.period_s, drive.torque_limit_nm), new_state()
    reset_state(state, 0.0)
    acceleration = np.diff(reference_rad_s, prepend=reference_rad_s[0]) / drive.period_s
    step = 2.0 * math.pi / drive.counts_per_rev
    whole = math.floor(drive.delay_s / drive.period_s + 1e-9)
    late = max(drive.delay_s - whole * drive.period_s, 0.0)
    late = late if late > 1e-9 else 0.0
    waiting = [0.0] * (whole + 1)
    position, speed, cart, acting, belt = np.empty((5, n))
    for k in range(n):
        position[k], speed[k], cart[k] = plant.position_rad, plant.velocity_rad_s, plant.cart_position_m
        counted = math.floor(plant.position_rad / step + 0.5) * step
        if kind == "velocity":
            asked = velocity_step(coefficients, state, reference_rad_s[k], acceleration[k], counted, added_nm[k])
        else:
            asked = cascade_step(coefficients, state, reference_rad[k], reference_rad_s[k], acceleration[k], counted, added_nm[k])
        before = waiting.pop(0)
        waiting.append(float(asked))
        force = 0.0
        if late:
            plant.step(before, late)
            force = abs(plant.belt_force_n)
        plant.step(waiting[0], drive.period_s - late)
        belt[k] = max(force, abs(plant.belt_force_n))
        acting[k] = (late * before + (drive.period_s - late) * waiting[0]) / drive.period_s
    return LoopRun(position, speed, start_m + cart, acting, belt)
