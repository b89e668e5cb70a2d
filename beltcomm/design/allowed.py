"""Gains K with which every loop K L1 keeps its margins: each condition at each frequency forbids one interval of K."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.compiled import compiled
from beltcomm.design.loops import LoopShape
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
        """Allowed ones among gains.

        Parameters
        ----------
        gains : ndarray, (m,)
            K > 0.

        Returns
        -------
        ndarray, (k,)
            In their order.
        """
        place = np.searchsorted(self.lows, gains) - 1
        inside = (place >= 0) & (gains < np.append(self.highs, 0.0)[place])
        return gains[(gains < self.top) & ~inside]

    def highest(self, limit: float) -> float:
        """Largest allowed gain up to ``limit``.

        Parameters
        ----------
        limit : float
            In the unit of the gains.

        Returns
        -------
        float
            At the lower edge of a forbidden range that holds the limit.
        """
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
