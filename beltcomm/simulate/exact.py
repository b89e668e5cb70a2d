"""Models that are simulated without an integrator, and their matrices; see ``exact_kernel`` for how."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import cast

import numpy as np

from beltcomm.arrays import Array
from beltcomm.effects import DRIVING_END
from beltcomm.model import Model
from beltcomm.model.linear import acts_on, carriage_of, matrices, operating_point, stretch_of, values_of
from beltcomm.simulate.kernels.exact_kernel import REACH, LinearAxis, Tables, runner
from beltcomm.simulate.kernels.first_root import DEGREE

#: Slots that act before the acting torque or after the true motion: no part of the equations of motion.
_OUTSIDE = ("torque_delay", "torque_reading", "sensor")


def is_exact(model: Model) -> bool:
    """True if the motion of a model is solved exactly: all its laws linear but for friction of constant level.  Decided here only.

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return all(effect.linear or effect.slot in _OUTSIDE for effect in model.effect_list())


def exact_record(model: Model, start: Array, torque: Array, period_s: float) -> tuple[Array, Array]:
    """Motion under torques, (n,), N m, each held for ``period_s``.

    Parameters
    ----------
    model : Model
    start : ndarray (2 bodies,)
        Positions and speeds.
    torque : ndarray (n,), N m, motor shaft
        Each held for a period.
    period_s : float, s
        Sampling period.

    Returns
    -------
    tuple of ndarray, (4, n)
        Motor angle and speed, carriage, m, at the start of each period and the largest |belt force| in it, N; state at the end. The model
        must be one that :func:`is_exact`.
    """
    axis, pieces, known = _prepare(_Case(model.base_bodies, model.effects, model.vector().tobytes(), period_s, model))
    state, out = start.copy(), np.empty((4, torque.size))
    # Two masses, or any number of them.
    if not runner(2 if len(axis.lightness) == 2 else 0)(axis, known, pieces, state, torque, *out):
        raise RuntimeError(f"friction of model {model.name!r} let go and held without end near {axis.lever * state[axis.cart]:g} m")
    return out, state


@dataclass(frozen=True)
class _Case:
    """Key of the tables of a model, and the model."""

    base_bodies: tuple[str, ...]
    effects: tuple[str, ...]
    values: bytes
    period_s: float
    model: Model = field(compare=False)


@lru_cache(maxsize=64)
def _prepare(case: _Case) -> tuple[LinearAxis, int, Tables]:
    """Equations of motion, pieces of a period, tables; kept, since the same axis is often simulated under many torques."""
    axis, rate = _linear_axis(case.model)
    pieces = max(1, math.ceil(rate * case.period_s / REACH))
    return axis, pieces, _tables(axis, case.period_s / pieces)


def _linear_axis(model: Model) -> tuple[LinearAxis, float]:
    """The equations of motion, and a rate that none of its motions exceeds, 1/s."""
    moving = matrices(model, operating_point(model, 0.0, 1.0))
    constant, level, belt = np.zeros((3, len(moving.bodies)))
    belt = np.concatenate([belt, belt])
    for effect in model.effect_list():
        values = values_of(model, effect, 0.0)
        if effect.slot in ("force", "friction_level"):
            i, lever = acts_on(model, effect)
            law = cast("Callable[..., float]", effect.law)
            (level if effect.slot == "friction_level" else constant)[i] += lever * law(0.0, 0.0, 0.0, *values)
        for element in effect.elements:
            if element.ends == (DRIVING_END, "cart"):
                belt += np.outer(element.slope(0.0, *values), stretch_of(model, element)).ravel()
    level = np.maximum(level, 0.0)
    inertia = np.diag(moving.M).copy()
    cart = carriage_of(moving.bodies)
    lever = model["transmission.ratio"] if model.bodies()[cart][1].rotary else 1.0
    scale = 1.0 / np.sqrt(np.outer(inertia, inertia))
    # An eigenvalue of l² + l D + K is at most the positive root of l² = l |D| + |K|.
    half, square = 0.5 * np.linalg.norm(moving.D * scale, 2), np.linalg.norm(moving.K * scale, 2)
    rate = float(half + math.sqrt(half**2 + square))
    smooth = -np.hstack([moving.K, moving.D])
    return LinearAxis(1.0 / inertia, smooth, constant, level, np.flatnonzero(level > 0.0), belt, cart, lever), rate


def _tables(axis: LinearAxis, piece_s: float) -> Tables:
    """Tables for pieces of ``piece_s``: a watched row c gives c A^(k-1) piece_s^k/k!.

    A second derivative of at most b passes b/8 below the chord over 0..1.
    """
    n, watched = len(axis.lightness), len(axis.rubbing)
    size, sets = 2 * n, 1 << watched
    stuck = (np.arange(sets)[:, None] >> np.arange(watched)) & 1
    A = np.zeros((sets, size, size))
    A[:, :n, n:] = np.eye(n)
    A[:, n:] = axis.smooth * axis.lightness[:, None]
    row = np.empty((sets, watched + 1 + size, size))
    for j, body in enumerate(axis.rubbing):
        held = stuck[:, j] == 1
        A[held, body] = A[held, n + body] = 0.0
        row[:, j] = np.where(held[:, None], axis.smooth[body], np.eye(size)[n + body])
    row[:, watched], row[:, watched + 1 :] = axis.belt, np.eye(size)
    series = np.zeros((sets, watched + 1 + size, size, DEGREE + 1))
    for k in range(1, DEGREE + 1):
        row = row * (piece_s / k)
        series[..., k] = row
        row = row @ A
    powers = np.arange(DEGREE + 1)
    doubt = np.abs(series[:, :watched]) @ (0.125 * powers * (powers - 1.0))
    flow = series[:, watched + 1 :].sum(axis=-1)
    return Tables(flow, series, doubt)
