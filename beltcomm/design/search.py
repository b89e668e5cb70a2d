"""The gains with the largest K_I K_PP that meet a specification on all plants, for one prefilter and one T_R.

With the integral time T_N = K_P/K_I held, K_P only scales the velocity loop, L = K_P L1.  Then every condition at every
frequency forbids one interval of K_P, and no loop has to be computed to test a K_P against all of them.  K_PP scales the
position loop likewise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.compiled import compiled
from beltcomm.control import CascadeStructure
from beltcomm.design.loops import LoopShape, position_path
from beltcomm.design.margins import resonance_or_peak
from beltcomm.design.specification import Specification

#: Change of the phase between two points below which it does not turn, and gain below which there is none.
_NO_TURN, _NOTHING = 1e-12, 1e-300


@dataclass(frozen=True)
class AllowedGains:
    """Gains below ``top`` and in none of the intervals.

    Attributes
    ----------
    lows, highs : ndarray (m,)
        Sorted, disjoint.
    """

    top: float
    lows: Array
    highs: Array

    def of(self, gains: Array) -> Array:
        """Allowed ones among gains above 0, in their order."""
        place = np.searchsorted(self.lows, gains) - 1
        inside = (place >= 0) & (gains < np.append(self.highs, 0.0)[place])
        return gains[(gains < self.top) & ~inside]

    def highest(self, limit: float) -> float:
        """Largest allowed gain up to ``limit``: at the lower edge of a forbidden range that holds it."""
        gain = min(self.top, limit)
        place = int(np.searchsorted(self.lows, gain)) - 1
        return float(self.lows[place]) if place >= 0 and gain < self.highs[place] else gain


def allowed_gains(unit: ComplexArray, shape: LoopShape, phase_margin_deg: float, specification: Specification) -> AllowedGains | None:
    """Gains K for which every loop K × unit meets its margins.

    A crossover may lie where the unwrapped phase holds the margin, below the antiresonance; from the last such frequency on
    the gain stays below 1, so that no phase that wraps beyond is taken for a margin.

    Parameters
    ----------
    unit : ndarray, (p, n) complex
        Open loops of p plants with gain 1.
    shape : LoopShape
        Of the same plants, for frequencies and antiresonances.
    phase_margin_deg : float, deg
        In place of that of ``specification``.
    specification : Specification
        Gain margin and sensitivity.

    Returns
    -------
    AllowedGains or None
        None when there are none.
    """
    bounds = (
        math.radians(phase_margin_deg) - math.pi,
        10.0 ** (-specification.gain_margin_db / 20.0),
        10.0 ** (-specification.sensitivity_db / 20.0),
    )
    lows, highs = np.empty((2, 3 * unit.size))
    below = shape.omega_rad_s < shape.antiresonance_rad_s
    top, number = _forbidden(np.ascontiguousarray(unit), below, *bounds, lows, highs)
    return AllowedGains(top, *_union(lows[:number], highs[:number])) if top > 0.0 else None


@compiled
def _forbidden(
    unit: ComplexArray, below: BoolArray, limit: float, gain_share: float, bound: float, lows: Array, highs: Array
) -> tuple[float, int]:
    """Gain that none may reach, and how many intervals below it are forbidden, in ``lows`` and ``highs``; 0 where no gain is allowed.

    below : (p, n), frequencies below the antiresonance.   limit : rad, phase that holds the margin.   gain_share : of the gain at a
    crossing of the negative axis.   bound : of |1 + K unit|.
    """
    plants, points = unit.shape
    # The phase is needed up to the first point above every plant's antiresonance; angles are what costs here.
    n = 0
    for r in range(plants):
        count = 0
        for k in range(points):
            count += below[r, k]
        n = max(n, min(count + 1, points))
    n = max(n, 2)
    level, phase, holds, turn = np.empty(points), np.empty(n), np.zeros(n, dtype=np.bool_), np.empty(n)
    largest, number = _NOTHING, 0
    for r in range(plants):
        last, wrapped, before = -1, 0.0, 0.0
        for k in range(points):
            level[k] = max(math.sqrt(unit[r, k].real ** 2 + unit[r, k].imag ** 2), _NOTHING)
        for k in range(n):
            angle = math.atan2(unit[r, k].imag, unit[r, k].real)
            if k == 0:
                # A loop that starts a little below −180 deg is a lag of more than that, not a lead.
                wrapped = -2.0 * math.pi if angle > 0.5 * math.pi else 0.0
            elif abs(angle - before) >= math.pi:
                wrapped -= math.copysign(2.0 * math.pi, angle - before)
            before = angle
            phase[k] = angle + wrapped
            holds[k] = phase[k] > limit and below[r, k]
            if holds[k]:
                last = k
        if last < 0:
            return 0.0, 0
        for k in range(n - 1):
            # Where the phase passes the limit between two points: without this a grid would cost up to a degree of margin.
            change = phase[k + 1] - phase[k]
            share = (limit - phase[k]) / (change if abs(change) >= _NO_TURN else _NO_TURN)
            turn[k] = level[k] * (level[k + 1] / level[k]) ** min(max(share, 0.0), 1.0)
        # From the last frequency that holds: the gain there, at the turn just beyond, and everywhere above.
        last = min(last, n - 2)
        largest = max(largest, turn[last])
        for k in range(last + 1, points):
            largest = max(largest, level[k])
        # Below it, the gain must not be 1 where the margin fails: from point to point, or to the turn between them.
        for k in range(last):
            if holds[k] and holds[k + 1]:
                continue
            first = turn[k] if holds[k] else level[k]
            second = turn[k] if holds[k + 1] else level[k + 1]
            lows[number], highs[number] = 1.0 / max(first, second), 1.0 / min(first, second)
            number += 1
        for k in range(points):
            real, imag = unit[r, k].real, unit[r, k].imag
            if real >= 0.0:
                continue
            if k + 1 < points and (imag > 0.0) != (unit[r, k + 1].imag > 0.0):
                crossing = max(level[k], level[k + 1])
                lows[number], highs[number] = gain_share / crossing, 1.0 / crossing
                number += 1
            if abs(imag) < bound * level[k]:
                # |unit|² K² + 2 Re(unit) K + 1 − bound² = 0
                square = level[k] ** 2
                root = math.sqrt(max(real * real - square * (1.0 - bound * bound), 0.0))
                lows[number], highs[number] = (-real - root) / square, (-real + root) / square
                number += 1
    top, kept = 1.0 / largest, 0
    for i in range(number):
        if lows[i] < top:
            lows[kept], highs[kept] = lows[i], highs[i]
            kept += 1
    return top, kept


def _union(lows: Array, highs: Array) -> tuple[Array, Array]:
    """The union of the intervals as sorted, disjoint ones."""
    if not len(lows):
        return lows, highs
    order = np.argsort(lows)
    lows, reach = lows[order], np.maximum.accumulate(highs[order])
    starts = np.append(True, lows[1:] > reach[:-1])
    return lows[starts], reach[np.append(starts[1:], True)]


_COARSE_TN, _COARSE_KP = 30, 18
_ZOOM_POINTS = 7


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


def best_gains(
    shape: LoopShape, period_s: float, structure: CascadeStructure, specification: Specification, zooms: int = 3
) -> Gains | None:
    """Largest K_I K_PP that meets the specification inside the drive's bounds.

    A coarse log-spaced search over T_N and K_P, then ``zooms`` times a finer one around the best; K_PP follows in closed form.

    Parameters
    ----------
    shape : LoopShape
        Of all plants, with prefilter and T_R.
    period_s : float, s
        T of the controller.
    structure : CascadeStructure
        With the bounds of the drive.
    specification : Specification
    zooms : int
        Finer searches.

    Returns
    -------
    Gains or None
        None when nothing meets it.
    """
    tn_low, tn_high = integral_time_bounds(structure, period_s)
    if tn_low > tn_high:
        return None
    tn_grid = np.geomspace(tn_low, tn_high, _COARSE_TN) if tn_high > tn_low else np.array([tn_low])
    best = _best_on(shape, structure, specification, tn_grid, None)
    ratio_tn = float(tn_grid[1] / tn_grid[0]) if len(tn_grid) > 1 else 1.0
    ratio_kp = 100.0 ** (1.0 / (_COARSE_KP - 1))
    for _ in range(zooms):
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
    """Range of T_N: the drive's, else from two periods (faster, PI is an integrator) to 5 s (slower, it is none).

    Parameters
    ----------
    structure : CascadeStructure
        With the bounds of the drive.
    period_s : float, s
        T of the controller.

    Returns
    -------
    tuple of float
        Lowest and highest, s.
    """
    low = max(structure.lowest.get("integral_time_s", 0.0), 2.0 * period_s)
    return low, min(structure.highest.get("integral_time_s", math.inf), 5.0)


def highest_position_gain(path: ComplexArray, shape: LoopShape, specification: Specification, limit: float) -> float:
    """Largest K_PP up to ``limit`` for which all position loops K_PP × path meet phase margin, gain margin and sensitivity.

    Parameters
    ----------
    path : ComplexArray, (p, n)
        See ``loops.position_path``.
    shape : LoopShape
        Of p plants.
    specification : Specification
        Margins to be kept.
    limit : float, 1/s
        Largest K_PP that is asked.

    Returns
    -------
    float
        K_PP, 1/s; 0 where no K_PP does.
    """
    allowed = allowed_gains(path, shape, specification.position_phase_margin_deg, specification)
    return allowed.highest(limit) if allowed is not None else 0.0


def _best_on(
    shape: LoopShape, structure: CascadeStructure, specification: Specification, tn_grid: Array, kp_grid: Array | None
) -> Gains | None:
    best = None
    highest_kpp = structure.highest.get("kpp_1_s", math.inf)
    extremes = shape.rows([0, -1])
    least_kpp = max(structure.lowest.get("kpp_1_s", 0.0), structure.steps.get("kpp_1_s", 0.0))
    for tn in tn_grid:
        unit = unit_loop(shape, tn)
        top = _highest_kp(unit, shape, structure, specification, float(tn))
        velocity_allowed = allowed_gains(unit, shape, specification.phase_margin_deg, specification)
        if velocity_allowed is None:
            continue
        if not np.any(shape.resonance_rad_s <= shape.omega_rad_s[..., -1:]):  # nothing to suppress: what the margins allow binds
            top = min(top, velocity_allowed.top)
        bottom = max(structure.lowest.get("kp_nm_s_rad", 0.0), structure.lowest.get("ki_nm_rad", 0.0) * tn)
        if top <= bottom:
            continue
        grid = np.geomspace(max(bottom, 0.01 * top), top, _COARSE_KP) if kp_grid is None else np.minimum(kp_grid, top)
        for kp in velocity_allowed.of(np.unique(grid[grid >= bottom]))[::-1]:
            # More plants only lower K_PP: a K_P that two of them already reject need not be tried on all.
            for part in (extremes, shape):
                path = position_path(kp * unit_loop(part, tn), part.estimator)
                found = Gains(float(kp), float(tn), highest_position_gain(path, part, specification, highest_kpp))
                better = found.kpp >= least_kpp and found.stiffness > (best.stiffness if best is not None else 0.0)
                if not better:
                    break
            if better:
                best = found
    return best


def unit_loop(shape: LoopShape, tn: float) -> ComplexArray:
    """Open velocity loop for K_P = 1 N m s/rad.

    Parameters
    ----------
    shape : LoopShape
        Of p plants.
    tn : float, s
        Integral time K_P/K_I.

    Returns
    -------
    ndarray, (p, n) complex
        Per N m s/rad of K_P.
    """
    return np.asarray((1.0 + shape.integrator / tn) * shape.without_pi)


def _highest_kp(unit: ComplexArray, shape: LoopShape, structure: CascadeStructure, specification: Specification, tn: float) -> float:
    """K_P, N m s/rad, that the resonance suppression and the drive's bounds allow at this T_N; ``unit``: the loops for K_P = 1, (p, n)."""
    peaks = resonance_or_peak(unit, shape.omega_rad_s, shape.resonance_rad_s)
    top = 10.0 ** (specification.suppression_db / 20.0) / float(np.max(np.where(peaks, np.abs(unit), 1e-300)))
    return float(min(top, structure.highest.get("kp_nm_s_rad", math.inf), structure.highest.get("ki_nm_rad", math.inf) * tn))
