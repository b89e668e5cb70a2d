"""The gains with the largest K_I K_PP that meet a specification on all plants, for one prefilter and one T_R.

With the integral time T_N = K_P/K_I held, K_P only scales the velocity loop, L = K_P L1.  Then every condition at every
frequency forbids one interval of K_P, and no loop has to be computed to test a K_P against all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.control import CascadeStructure
from beltcomm.design.loops import LoopShape, position_path
from beltcomm.design.margins import resonance_or_peak
from beltcomm.design.specification import Specification

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_COARSE_TN, _COARSE_KP = 40, 18
_ZOOMS, _ZOOM_POINTS = 3, 7


@dataclass(frozen=True)
class Gains:
    """K_P, N m s/rad; T_N = K_P/K_I, s; K_PP, 1/s."""

    kp: float
    tn: float
    kpp: float

    @property
    def stiffness(self) -> float:
        """K_I K_PP, N m/(rad s): how fast the torque grows on a position error that stays."""
        return self.kp / self.tn * self.kpp


def best_gains(shape: LoopShape, period_s: float, structure: CascadeStructure, specification: Specification) -> Gains | None:
    """Largest K_I K_PP that meets the specification inside the drive's bounds; None when nothing does.

    A coarse log-spaced search over T_N and K_P, then three times a finer one around the best; K_PP follows in closed form.
    """
    tn_low, tn_high = integral_time_bounds(structure, period_s)
    if tn_low > tn_high:
        return None
    tn_grid = np.geomspace(tn_low, tn_high, _COARSE_TN) if tn_high > tn_low else np.array([tn_low])
    best = _best_on(shape, structure, specification, tn_grid, None)
    ratio_tn = float(tn_grid[1] / tn_grid[0]) if len(tn_grid) > 1 else 1.0
    ratio_kp = 100.0 ** (1.0 / (_COARSE_KP - 1))
    for _ in range(_ZOOMS):
        if best is None:
            return None
        step = np.linspace(-1.0, 1.0, _ZOOM_POINTS)
        around_tn = np.unique(np.clip(best.tn * ratio_tn**step, tn_low, tn_high))
        finer = _best_on(shape, structure, specification, around_tn, best.kp * ratio_kp**step)
        if finer is not None and finer.stiffness > best.stiffness:
            best = finer
        ratio_tn, ratio_kp = ratio_tn ** (1.0 / 3.0), ratio_kp ** (1.0 / 3.0)
    return best


def integral_time_bounds(structure: CascadeStructure, period_s: float) -> tuple[float, float]:
    """Range of T_N, s: the drive's, else from two periods (faster, PI is an integrator) to 5 s (slower, it is none)."""
    low = max(structure.lowest.get("integral_time_s", 0.0), 2.0 * period_s)
    return low, min(structure.highest.get("integral_time_s", math.inf), 5.0)


def highest_position_gain(path: ComplexArray, specification: Specification) -> Array:
    """Largest K_PP for which every plant's position loop K_PP × path meets phase margin, gain margin and sensitivity.

    path : ndarray (..., p, n), see ``loops.position_path``.   Returns ndarray (...), 1/s; 0 where no K_PP does.
    The gain stays below 1 from the first frequency on at which the phase margin is used up; no crossover can follow.
    """
    level = np.abs(path)
    allowed = math.radians(180.0 - specification.position_phase_margin_deg)
    angle = np.angle(path)
    used_up = np.logical_or.accumulate((angle < -allowed) | (angle > 0.5 * math.pi), axis=-1)
    turn = _level_at_turn(level, angle, -allowed, used_up)
    bound = 1.0 / np.max(np.maximum(np.max(np.where(used_up, level, 1e-300), axis=-1), turn), axis=-1)

    bound_s = sensitivity_bound(specification)
    low, _ = _sensitivity_interval(path, level, bound_s)
    bound = np.minimum(bound, np.min(low, axis=(-2, -1)))

    left = (path.real[..., :-1] < 0.0) & ((path.imag[..., :-1] > 0.0) != (path.imag[..., 1:] > 0.0))
    crossing = np.max(np.where(left, np.maximum(level[..., :-1], level[..., 1:]), 1e-300), axis=(-2, -1))
    bound = np.minimum(bound, 10.0 ** (-specification.gain_margin_db / 20.0) / crossing)
    # With the margin used up from the lowest frequency on, a tiny K_PP would pass; it would be no position loop.
    return np.where(used_up[..., 0].any(axis=-1), 0.0, bound)


def sensitivity_bound(specification: Specification) -> float:
    """Smallest allowed |1 + L|."""
    return float(10.0 ** (-specification.sensitivity_db / 20.0))


def _best_on(
    shape: LoopShape, structure: CascadeStructure, specification: Specification, tn_grid: Array, kp_grid: Array | None
) -> Gains | None:
    best = None
    for tn in tn_grid:
        unit = (1.0 + shape.integrator / tn) * shape.without_pi
        top = _highest_kp(unit, shape, structure, specification, float(tn))
        bottom = max(structure.lowest.get("kp_nm_s_rad", 0.0), structure.lowest.get("ki_nm_rad", 0.0) * tn)
        if top <= bottom:
            continue
        grid = np.geomspace(max(bottom, 0.01 * top), top, _COARSE_KP) if kp_grid is None else np.minimum(kp_grid, top)
        allowed = _velocity_allowed(unit, np.unique(grid[grid >= bottom]), specification)
        if not len(allowed):
            continue
        velocity = allowed[:, None, None] * unit
        kpp = np.minimum(
            highest_position_gain(position_path(velocity, shape.estimator), specification),
            structure.highest.get("kpp_1_s", math.inf),
        )
        kpp[kpp < max(structure.lowest.get("kpp_1_s", 0.0), structure.steps.get("kpp_1_s", 0.0))] = 0.0
        k = int(np.argmax(allowed * kpp))
        found = Gains(float(allowed[k]), float(tn), float(kpp[k]))
        if found.kpp > 0.0 and (best is None or found.stiffness > best.stiffness):
            best = found
    return best


def _highest_kp(
    unit: ComplexArray, shape: LoopShape, structure: CascadeStructure, specification: Specification, tn: float
) -> float:
    """K_P that the resonance suppression and the drive's bounds allow at this T_N."""
    peaks = resonance_or_peak(unit, shape.omega_rad_s, shape.resonance_rad_s)
    top = 10.0 ** (specification.suppression_db / 20.0) / float(np.max(np.where(peaks, np.abs(unit), 1e-300)))
    return float(min(top, structure.highest.get("kp_nm_s_rad", math.inf), structure.highest.get("ki_nm_rad", math.inf) * tn))


def _velocity_allowed(unit: ComplexArray, kp: Array, specification: Specification) -> Array:
    """Those of ``kp`` whose only crossover lies where the phase margin holds, outside every interval forbidden otherwise.

    The phase of the loop may lie below the margin at low frequencies (an integrator and no friction), holds it in one
    window and loses it for good; a crossover in that window alone is a stable loop, wherever the phase wraps beyond.
    """
    level = np.abs(unit)
    angle = np.angle(unit)
    limit = math.radians(specification.phase_margin_deg) - math.pi
    begun = np.logical_or.accumulate((angle > limit) & (angle < 0.5 * math.pi), axis=-1)
    if not begun[:, -1].all():
        return kp[:0]
    over = np.logical_or.accumulate(begun & ((angle < limit) | (angle > 0.5 * math.pi)), axis=-1)
    lowest = 1.0 / np.min(np.where(begun, np.inf, level), axis=-1)
    lowest = np.maximum(lowest, 1.0 / _level_at_turn(level, angle, limit, begun))
    highest = 1.0 / np.maximum(np.max(np.where(over, level, 1e-300), axis=-1), _level_at_turn(level, angle, limit, over))
    kp = kp[(kp > np.max(lowest)) & (kp < np.min(highest))]

    left = (unit.real[:, :-1] < 0.0) & ((unit.imag[:, :-1] > 0.0) != (unit.imag[:, 1:] > 0.0))
    crossing = np.maximum(level[:, :-1], level[:, 1:])[left]
    gain_margin = (10.0 ** (-specification.gain_margin_db / 20.0) / crossing, 1.0 / crossing)
    intervals = (_sensitivity_interval(unit, level, sensitivity_bound(specification)), gain_margin)
    lows = np.concatenate([low.ravel() for low, _ in intervals])
    highs = np.concatenate([high.ravel() for _, high in intervals])
    real = lows < highs
    return kp[_outside(kp, lows[real], highs[real])]


def _level_at_turn(level: Array, angle: Array, limit: float, after: NDArray[np.bool_]) -> Array:
    """Gain where the angle passes ``limit``, between the last point before and the first point in ``after``; shape (..., p).

    Without interpolation the grid would cost up to a degree.  The gain at the first point where ``after`` starts there, or
    where the angle jumps; the gain at the end where it never starts.
    """
    at = np.where(after[..., -1], np.argmax(after, axis=-1), after.shape[-1] - 1)
    here, before = at[..., None], np.maximum(at - 1, 0)[..., None]
    angle_1, angle_0 = (np.take_along_axis(angle, k, axis=-1)[..., 0] for k in (here, before))
    level_1, level_0 = (np.take_along_axis(level, k, axis=-1)[..., 0] for k in (here, before))
    change = angle_1 - angle_0
    passes = ((angle_0 - limit) * (angle_1 - limit) < 0.0) & (np.abs(change) < 1.0)
    share = np.where(passes, (limit - angle_0) / np.where(passes, change, 1.0), 1.0)
    return np.asarray(level_0 * (level_1 / level_0) ** share)


def _sensitivity_interval(unit: ComplexArray, level: Array, bound: float) -> tuple[Array, Array]:
    """K between which |1 + K unit| < bound, per frequency; (inf, -inf) where it never is.

    |unit|² K² + 2 Re(unit) K + 1 − bound² = 0.
    """
    square, real = level * level, unit.real
    discriminant = real * real - square * (1.0 - bound * bound)
    some = (discriminant > 0.0) & (real < 0.0)
    root = np.sqrt(np.where(some, discriminant, 0.0))
    return np.where(some, (-real - root) / square, np.inf), np.where(some, (-real + root) / square, -np.inf)


def _outside(values: Array, lows: Array, highs: Array) -> NDArray[np.bool_]:
    """Whether each value lies in no interval: as many have ended below it as have begun."""
    begun = np.searchsorted(np.sort(lows), values, side="left")
    ended = np.searchsorted(np.sort(highs), values, side="right")
    return np.asarray(begun == ended)
