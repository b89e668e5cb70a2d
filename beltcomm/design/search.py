"""The gains with the largest K_I K_PP that meet a specification on all plants, for one prefilter and one T_R.

With the integral time T_N = K_P/K_I held, K_P only scales the velocity loop, L = K_P L1.  Then every condition at every
frequency forbids one interval of K_P, and no loop has to be computed to test a K_P against all of them.  K_PP scales the
position loop likewise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import CascadeStructure
from beltcomm.design.allowed import allowed_gains
from beltcomm.design.loops import LoopShape, position_path
from beltcomm.design.margins import resonance_or_peak
from beltcomm.design.specification import Specification

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
    """K_P that the resonance suppression and the drive's bounds allow at this T_N.

    Parameters
    ----------
    unit : ndarray, (p, n) complex
        Loops for K_P = 1.
    shape : LoopShape
        Of the same plants.
    structure : CascadeStructure
        With the bounds of the drive.
    specification : Specification
        With the suppression.
    tn : float, s
        Integral time.

    Returns
    -------
    float, N m s/rad
        At the motor shaft.
    """
    peaks = resonance_or_peak(unit, shape.omega_rad_s, shape.resonance_rad_s)
    top = 10.0 ** (specification.suppression_db / 20.0) / float(np.max(np.where(peaks, np.abs(unit), 1e-300)))
    return float(min(top, structure.highest.get("kp_nm_s_rad", math.inf), structure.highest.get("ki_nm_rad", math.inf) * tn))
