"""First root at which a polynomial falls below zero, with none overlooked."""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import in_lanes

#: Highest power of a polynomial.
DEGREE = 15
#: What is returned where there is no root.
NEVER = 2.0
#: In parts of the interval: two roots closer than this only touch.
_TOUCH = 1e-13
_STEPS = 60


def _binomials() -> Array:
    table = np.zeros((DEGREE + 1, DEGREE + 1))
    table[:, 0] = 1.0
    for row in range(1, DEGREE + 1):
        table[row, 1:] = table[row - 1, 1:] + table[row - 1, :-1]
    return table


_BINOMIAL = _binomials()


@in_lanes
def value(p: Array, s: float) -> float:
    """Value of a polynomial: Σ p_k s^k.

    Parameters
    ----------
    p : ndarray (k,)
        Coefficients, the constant first.
    s : float
        Where it is asked.
    """
    found = 0.0
    for k in range(p.shape[0] - 1, -1, -1):
        found = found * s + p[k]
    return found


@in_lanes
def first_root(p: Array, moved: Array) -> float:
    """Smallest s in 0..1 behind which sum p_k s^k is negative; ``NEVER`` where it stays.

    Zero where it begins below zero, or leaves a zero downwards; a root at 0 from which it rises is none.

    Parameters
    ----------
    p : ndarray (k,)
        Coefficients, the constant first.
    moved : ndarray (DEGREE + 1,)
        Scratch.
    """
    low, degree = 0, p.shape[0] - 1
    while low <= degree and p[low] == 0.0:
        low += 1
    if low > degree:
        return NEVER
    if p[low] < 0.0:
        return 0.0
    least, steepest, end = p[low], 0.0, p[low]
    for k in range(low + 1, degree + 1):
        least += min(p[k], 0.0)
        end += p[k]
        if k > low + 1:
            steepest += (k - low) * max(p[k], 0.0)
    if least > 0.0:
        return NEVER
    if low < degree and p[low + 1] + steepest < 0.0:  # it falls all the way
        return _between(p, low, 0.0, 1.0) if end < 0.0 else NEVER
    return _search_root(p, low, moved)


@in_lanes
def _search_root(p: Array, low: int, moved: Array) -> float:
    """First root of p/s^low, which is positive at 0.

    Descartes' rule on the Bernstein form: no change of sign, no root; one, one root; more, half the interval.
    """
    top = p.shape[0] - 1 - low
    left, width = 0.0, 1.0
    while left < 1.0:
        for k in range(top + 1):
            moved[k] = p[low + k]
        if left > 0.0:
            for i in range(top):
                for k in range(top - 1, i - 1, -1):
                    moved[k] += left * moved[k + 1]
        if moved[0] <= 0.0:
            return left
        scale = 1.0
        for k in range(top + 1):
            moved[k] *= scale
            scale *= width
        changes, sign = 0, 1.0
        for j in range(1, top + 1):
            bernstein = 0.0
            for i in range(j + 1):
                bernstein += _BINOMIAL[j, i] / _BINOMIAL[top, i] * moved[i]
            if bernstein * sign < 0.0:
                changes, sign = changes + 1, -sign
        if changes == 1:
            return _between(p, low, left, min(left + width, 1.0))
        if changes == 0 or width < _TOUCH:
            left += width
            width = min(2.0 * width, 1.0 - left)
        else:
            width *= 0.5
    return NEVER


@in_lanes
def _between(p: Array, low: int, left: float, right: float) -> float:
    """The only root of p/s^low there, which is positive on the left; Newton's steps kept inside."""
    s = 0.5 * (left + right)
    for _ in range(_STEPS):
        found, rise = 0.0, 0.0
        for k in range(p.shape[0] - 1, low - 1, -1):
            rise = rise * s + found
            found = found * s + p[k]
        if found > 0.0:
            left = s
        else:
            right = s
        new = s - found / rise if rise < 0.0 else left - 1.0
        if abs(new - s) <= 1e-9 * s:  # the next one would differ by the square of that
            return float(new)
        s = new if left < new < right else 0.5 * (left + right)
        if right - left <= 1e-16 * right:
            break
    return float(s)


@in_lanes
def largest(p: Array, upto: float) -> float:
    """Largest |p| over 0..upto of a polynomial that turns once there at most; off by 1e-9 of its change.

    Parameters
    ----------
    p : ndarray (k,)
        Coefficients, the constant first.
    upto : float
        End of the range.
    """
    end, rise = 0.0, 0.0
    for k in range(p.shape[0] - 1, -1, -1):
        rise = rise * upto + end
        end = end * upto + p[k]
    peak = float(max(abs(p[0]), abs(end)))
    start = p[1]
    if start * rise >= 0.0 or max(start * p[0], start * end) <= 0.0:
        return peak
    left, right, s = 0.0, upto, upto * start / (start - rise)
    for _ in range(_STEPS):
        found, first, half = 0.0, 0.0, 0.0
        for k in range(p.shape[0] - 1, -1, -1):
            half = half * s + first
            first = first * s + found
            found = found * s + p[k]
        if first * start > 0.0:
            left = s
        else:
            right = s
        step = 0.5 * first / half if half != 0.0 else upto
        if abs(step) < 1e-3:  # the parabola there leaves out the cube of that
            return max(peak, float(abs(found - 0.5 * first * step)))
        s -= step
        if not left < s < right:
            s = 0.5 * (left + right)
    return peak
