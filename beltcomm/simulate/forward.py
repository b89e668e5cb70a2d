"""Forward simulation: motor torque in, motion out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltcomm.errors import Refused, UsageError
from beltcomm.linear import describes, fastest_rate, operating_point
from beltcomm.model import Model
from beltcomm.simulate.compose import kernel_for
from beltcomm.simulate.imperfect import is_late, late_torque
from beltcomm.statics import equilibrium

Array = NDArray[np.float64]

#: Largest (sub-step x fastest eigenvalue) that is let through.  The Verlet step is unstable above 2; at 0.5 its phase error
#: is ω²h²/24, 1 %, in the fastest mode and far less in those that matter.
LARGEST_STEP = 0.5


@dataclass(frozen=True)
class State:
    """Positions and speeds of all bodies in the order of ``Model.bodies()``, (n,), rad or m, rad/s or m/s; absolute.

    Behind the positions stands the state of elastic friction where the model has it.  Torque under way in a dead time is not kept.
    """

    positions: Array
    speeds: Array


@dataclass(frozen=True)
class Simulated:
    """A simulated record of n samples; every entry is the state at the start of its sampling interval.

    t_s : (n,), s, session clock.     position_rad, velocity_rad_s : (n,), motor shaft, true; the position is absolute, its zero is
    where an unstretched belt puts the carriage to position 0.     cart_position_m : (n,), m, carriage on the axis.
    belt_force_n : (n,), N, largest force between driven end and carriage within the interval.     end : state after the last.
    """

    t_s: Array
    position_rad: Array
    velocity_rad_s: Array
    cart_position_m: Array
    belt_force_n: Array
    end: State


def simulate_torque(
    model: Model,
    torque_nm: ArrayLike,
    sample_period_s: float,
    position_m: float = 0.0,
    substeps: int = 20,
    time_s: float = 0.0,
    state: State | None = None,
) -> Simulated:
    """Motion of a model under a torque that is held for each sampling period.

    torque_nm : (n,), N m at the motor shaft (N for an axis whose first body is the carriage); acts from t[n] to t[n+1].
    position_m : m, carriage at the start, at rest in static equilibrium (beltcomm.linear.equilibrium); unused with ``state``.
    substeps : integration steps per sampling period.     time_s : s, session clock at the start.

    Raises UsageError when the sub-steps are too long for the model, Refused when the carriage leaves what the model describes.
    """
    torque = np.ascontiguousarray(torque_nm, dtype=np.float64)
    if torque.ndim != 1 or not np.all(np.isfinite(torque)):
        raise UsageError(f"the torque must be one row of finite numbers, not an array of shape {torque.shape}")
    check_step(model, position_m, sample_period_s, substeps)
    start = state or at_rest(model, position_m)
    q, v = start.positions.copy(), start.speeds.copy()
    if is_late(model):  # the acting torque changes within a sampling period: every sub-step becomes a period of its own
        h = sample_period_s / substeps
        fine = np.empty((4, torque.size * substeps))
        acting = late_torque(model, np.repeat(torque, substeps), h)
        kernel_for(model).run(q, v, model.vector(), acting, time_s, h, 1, *fine)
        theta, omega, cart = fine[:3, ::substeps].copy()
        belt = fine[3].reshape(-1, substeps).max(axis=1)
    else:
        theta, omega, cart, belt = np.empty((4, torque.size))
        kernel_for(model).run(q, v, model.vector(), torque, time_s, sample_period_s, substeps, theta, omega, cart, belt)
    for reached in (np.min(cart, initial=position_m), np.max(cart, initial=position_m)):
        if not describes(model, float(reached)):
            raise Refused(f"the carriage ran to {reached:g} m, where model {model.name!r} has no belt; use less torque or time")
    t_s = np.asarray(time_s + sample_period_s * np.arange(torque.size))
    return Simulated(t_s, theta, omega, cart, belt, State(q, v))


def at_rest(model: Model, position_m: float) -> State:
    """Static equilibrium with the carriage at ``position_m``."""
    positions = equilibrium(model, position_m).positions
    unloaded = np.zeros(kernel_for(model).states - len(positions))
    return State(np.concatenate([positions, unloaded]), np.zeros_like(positions))


def check_step(model: Model, position_m: float, duration_s: float, substeps: int) -> None:
    """Raise UsageError unless ``substeps`` integration steps in ``duration_s`` resolve the model's fastest motion there."""
    if not (duration_s > 0.0 and substeps >= 1):
        raise UsageError(f"simulation needs a period above 0 s and at least one sub-step, not {duration_s:g} s and {substeps}")
    if not describes(model, position_m):
        raise UsageError(f"the carriage cannot start at {position_m:g} m: model {model.name!r} has no belt there")
    needed = duration_s * fastest_rate(model, operating_point(model, position_m)) / LARGEST_STEP
    if substeps < needed:
        raise UsageError(
            f"{substeps} sub-steps in {1e3 * duration_s:g} ms are too few for model {model.name!r}; use {math.ceil(needed)} or more"
        )
