"""Forward simulation: motor torque in, motion out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from beltcomm.arrays import Array
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model
from beltcomm.model.linear import describes, fastest_rate, operating_point
from beltcomm.model.statics import equilibrium
from beltcomm.simulate.exact import exact_record, is_exact
from beltcomm.simulate.imperfect import is_late, late_torque, memory_s
from beltcomm.simulate.kernels.compose import kernel_for, states_of
from beltcomm.simulate.kernels.nystrom import CELLS, LONGEST_STEP, STRIDE, nystrom_kernel, torque_at_stages

#: Largest (sub-step x fastest eigenvalue) that is let through.  The Verlet step is unstable above 2; at 0.5 its phase error
#: is ω²h²/24, 1 %, in the fastest mode and far less in those that matter.
LARGEST_STEP = 0.5
#: Periods whose late torque is worked out at once: cells of a whole record would be new memory each time, which takes longer than they do.
BLOCK = 500
#: Times :func:`memory_s` after which nothing of a torque is left in any digit, e⁻³⁷.
TO_THE_DIGIT = 2.5


@dataclass(frozen=True)
class BodyStates:
    """Positions and speeds of all bodies in the order of ``Model.bodies()``, (n,), rad or m, rad/s or m/s; absolute.

    Behind the positions stands the state of elastic friction where the model has it.  Torque under way in a dead time is not kept.
    """

    positions: Array
    speeds: Array


@dataclass(frozen=True)
class Simulated:
    """A simulated record of n samples; every entry is the state at the start of its sampling interval.

    Attributes
    ----------
    t_s : ndarray (n,), s
        Session clock.
    position_rad, velocity_rad_s : ndarray (n,), motor shaft
        True; the position is absolute, its zero is where an unstretched belt puts the carriage to position 0.
    cart_position_m : ndarray (n,), m
        Carriage on the axis.
    belt_force_n : ndarray (n,), N
        Largest force between driven end and carriage within the interval.
    end : BodyStates
        State after the last.
    """

    t_s: Array
    position_rad: Array
    velocity_rad_s: Array
    cart_position_m: Array
    belt_force_n: Array
    end: BodyStates


def simulate_torque(
    model: Model,
    torque_nm: ArrayLike,
    sample_period_s: float,
    position_m: float = 0.0,
    substeps: int = 20,
    time_s: float = 0.0,
    state: BodyStates | None = None,
) -> Simulated:
    """Motion of a model under a torque that is held for each sampling period.

    Laws that are linear, with friction of constant level, are solved exactly (``exact.is_exact``): ``substeps`` then only divides a torque
    that acts late.  All others by Nyström's (``nystrom``): five of these steps in one, but where friction changes.

    Parameters
    ----------
    model : Model
    torque_nm : ArrayLike, (n,)
        N m at the motor shaft (N for an axis whose first body is the carriage); acts from t[n] to t[n+1].
    sample_period_s : float, s
    position_m : float, m
        Carriage at the start, at rest in static equilibrium (beltcomm.model.statics.equilibrium); unused with ``state``.
    substeps : int
        Integration steps per sampling period.
    time_s : float, s
        Session clock at the start.
    state : BodyStates or None
        Of all bodies at the start; None begins at rest.

    Raises
    ------
    UsageError
        When the sub-steps are too long for the model.
    Refused
        When the carriage leaves what the model describes.
    """
    return _simulate(
        model, torque_nm, sample_period_s, position_m, substeps, time_s, state, _solve_exactly if is_exact(model) else _nystrom
    )


def integrate_torque(
    model: Model,
    torque_nm: ArrayLike,
    sample_period_s: float,
    position_m: float = 0.0,
    substeps: int = 20,
    time_s: float = 0.0,
    state: BodyStates | None = None,
) -> Simulated:
    """Motion of a model under held torque by integration steps, whatever its laws; see :func:`simulate_torque`.

    Parameters
    ----------
    model : Model
        With any effects.
    torque_nm : array_like (n,), N m, motor shaft
        Held from each sample to the next.
    sample_period_s : float, s
    position_m : float, m
        Carriage at the start.
    substeps : int
        Integration steps in a sample.
    time_s : float, s
        Session's clock at the start.
    state : BodyStates or None
        Of all bodies at the start; None begins at rest.
    """
    return _simulate(model, torque_nm, sample_period_s, position_m, substeps, time_s, state, _integrate)


#: (model, state, torque, its period s, steps in it, time s, fastest rate 1/s) -> angle, speed, carriage, belt force, (4, n), and the state
#: at the end.
_Motion = Callable[[Model, BodyStates, Array, float, int, float, float], tuple[Array, BodyStates]]


def _simulate(
    model: Model,
    torque_nm: ArrayLike,
    sample_period_s: float,
    position_m: float,
    substeps: int,
    time_s: float,
    state: BodyStates | None,
    motion: _Motion,
) -> Simulated:
    torque = np.ascontiguousarray(torque_nm, dtype=np.float64)
    if torque.ndim != 1 or not np.all(np.isfinite(torque)):
        raise UsageError(f"the torque must be one row of finite numbers, not an array of shape {torque.shape}")
    _check_period(model, position_m, sample_period_s, substeps)
    rate = 0.0 if motion is _solve_exactly else check_step(model, position_m, sample_period_s, substeps)
    start = state or at_rest(model, position_m)
    if is_late(model) and motion is not _nystrom:
        # The acting torque changes within a sampling period: every sub-step becomes a period of its own.
        h = sample_period_s / substeps
        acting = late_torque(model, np.repeat(torque, substeps), h)
        fine, end = motion(model, start, acting, h, 1, time_s, rate)
        theta, omega, cart = fine[:3, ::substeps].copy()
        belt = fine[3].reshape(-1, substeps).max(axis=1)
    else:
        (theta, omega, cart, belt), end = motion(model, start, torque, sample_period_s, substeps, time_s, rate)
    if model.rigid and torque.size:
        belt = rigid_force_n(model, np.append(omega, end.speeds[0]), sample_period_s)
    for reached in (np.min(cart, initial=position_m), np.max(cart, initial=position_m)):
        if not describes(model, float(reached)):
            raise Refused(f"the carriage ran to {reached:g} m, where model {model.name!r} has no belt; use less torque or time")
    t_s = np.asarray(time_s + sample_period_s * np.arange(torque.size))
    return Simulated(t_s, theta, omega, cart, belt, end)


def _solve_exactly(
    model: Model, start: BodyStates, torque: Array, period_s: float, substeps: int, time_s: float, rate: float
) -> tuple[Array, BodyStates]:
    n = start.positions.size
    out, end = exact_record(model, np.concatenate([start.positions, start.speeds]), torque, period_s)
    return out, BodyStates(end[:n], end[n:])


def _integrate(
    model: Model, start: BodyStates, torque: Array, period_s: float, substeps: int, time_s: float, rate: float
) -> tuple[Array, BodyStates]:
    q, v, out = start.positions.copy(), start.speeds.copy(), np.empty((4, torque.size))
    kernel_for(model).run(q, v, model.vector(), torque, time_s, period_s, substeps, *out)
    return out, BodyStates(q, v)


def _nystrom(
    model: Model, start: BodyStates, torque: Array, period_s: float, substeps: int, time_s: float, rate: float
) -> tuple[Array, BodyStates]:
    steps = max(math.ceil(substeps / STRIDE), math.ceil(period_s * rate / LONGEST_STEP))
    parts = CELLS if memory_s(model) > 0.0 else 1
    nystrom, vector, short = nystrom_kernel(model), model.vector(), math.ceil(substeps / steps)
    q, v, out = start.positions.copy(), start.speeds.copy(), np.empty((4, torque.size))
    beside = math.ceil(memory_s(model) * TO_THE_DIGIT / period_s)
    block = max(BLOCK, 8 * beside) if beside else max(torque.size, 1)
    for first in range(0, torque.size, block):
        heard = torque[max(first - beside, 0) : first + block + beside]
        acting = late_torque(model, np.repeat(heard, steps * parts), period_s / (steps * parts))
        cells = acting.reshape(heard.size, steps * parts)[min(first, beside) :][:block]
        rows = out[:, first : first + block]
        nystrom(q, v, vector, cells, torque_at_stages(cells, parts), time_s + first * period_s, period_s, steps, short, *rows)
    return out, BodyStates(q, v)


def rigid_force_n(model: Model, omega_rad_s: Array, period_s: float) -> Array:
    """Mean force on a load that moves with the motor rigidly, in each period:  |m (i_t ω' + g sin α)|, N, (n,).

    Parameters
    ----------
    model : Model
    omega_rad_s : ndarray (n + 1,)
        Of the motor, at the ends of the periods.
    period_s : float, s
        Sampling period.
    """
    weight = GRAVITY_M_S2 * math.sin(model.get("tilt.angle"))
    return np.asarray(np.abs(model["cart.mass"] * (model["transmission.ratio"] * np.diff(omega_rad_s) / period_s + weight)))


def at_rest(model: Model, position_m: float) -> BodyStates:
    """States of all bodies in static equilibrium.

    Parameters
    ----------
    model : Model
        With any effects.
    position_m : float, m
        Carriage on the axis.
    """
    positions = equilibrium(model, position_m).positions
    unloaded = np.zeros(states_of(model) - len(positions))
    return BodyStates(np.concatenate([positions, unloaded]), np.zeros_like(positions))


def _check_period(model: Model, position_m: float, duration_s: float, substeps: int) -> None:
    """Raise UsageError for a period, a number of steps or a place that means nothing."""
    if not (duration_s > 0.0 and substeps >= 1):
        raise UsageError(f"simulation needs a period above 0 s and at least one sub-step, not {duration_s:g} s and {substeps}")
    if not describes(model, position_m):
        raise UsageError(f"the carriage cannot start at {position_m:g} m: model {model.name!r} has no belt there")


def check_step(model: Model, position_m: float, duration_s: float, substeps: int) -> float:
    """Rate of the model's fastest motion at a place, 1/s, which integration steps must resolve.

    Parameters
    ----------
    model : Model
        With any effects.
    position_m : float, m
        Carriage on the axis.
    duration_s : float, s
        Divided into the steps.
    substeps : int
        Integration steps.

    Raises
    ------
    UsageError
        Where they are too few.
    """
    _check_period(model, position_m, duration_s, substeps)
    rate = fastest_rate(model, operating_point(model, position_m))
    needed = duration_s * rate / LARGEST_STEP
    if substeps < needed:
        raise UsageError(
            f"{substeps} sub-steps in {1e3 * duration_s:g} ms are too few for model {model.name!r}; use {math.ceil(needed)} or more"
        )
    return rate
