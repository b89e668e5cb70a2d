"""A linear axis with set-valued friction under held torques, without an integrator: compiled.

Between two changes of what sticks and which way the rest slides, with x the positions q and then the speeds of all bodies,

    x' = A x + B u,    x(t) = x + F(t) w,    w = x',    F(t) = sum A^(k-1) t^k/k!,  k = 1 .. DEGREE

u : held torque, constant forces, and friction of constant sign.  Everything that is watched, a speed, a force that must not pass a friction
level, the belt's force, is a row times x, so along the motion it is a polynomial in t whose coefficients are rows times w, kept in
tables.  The motion is cut into pieces so short that the series is exact to rounding.  A piece in which no watched value can reach zero, by
a bound on its second derivative, is one product with a matrix; in any other the first root is found and the axis goes on from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, IntArray
from beltcomm.compiled import in_lanes
from beltcomm.simulate.kernels.first_root import DEGREE, NEVER, first_root, largest, value

#: Largest (length of a piece x fastest rate): the series leaves out REACH^16/16! of the motion, 5e-14.
REACH = 1.0
#: Changes between sticking and sliding within a piece, beyond any that was ever seen (6).
_MOST_EVENTS = 1000


class LinearAxis(NamedTuple):
    """n bodies, driven one first.

    Attributes
    ----------
    lightness : ndarray (n,)
        1/inertia.
    smooth : ndarray (n, 2 n)
        N m or N by positions and speeds.
    constant : ndarray (n,)
        The rest.
    level : ndarray (n,)
        Friction; rubbing : bodies where it is above 0.
    belt : ndarray (2 n,)
        Belt force by positions and speeds, N.
    cart, lever
        Body whose position times lever is the carriage's.
    """

    lightness: Array
    smooth: Array
    constant: Array
    level: Array
    rubbing: IntArray
    belt: Array
    cart: int
    lever: float


class Scratch(NamedTuple):
    """Room that no piece need ask for: rates, a polynomial, another one, and for each body that rubs what ``through`` keeps of it."""

    w: Array
    p: Array
    moved: Array
    kept: Array
    fresh: Array


class Tables(NamedTuple):
    """For pieces of one length, by which bodies stick (bit j: the j-th of those that rub).

    Attributes
    ----------
    flow : ndarray (sets, 2 n, 2 n)
        F(piece_s).
    series : ndarray (sets, rows, 2 n, DEGREE + 1)
        Times w the coefficients of (t/piece_s)^k of what is watched, of the belt's force, and of x.
    doubt : ndarray (sets, watched, 2 n)
        Times |w| how far what is watched may pass below its chord.
    """

    flow: Array
    series: Array
    doubt: Array


@in_lanes
def _copy(source: Array, target: Array) -> None:
    """Copy an array, as an assignment of slices does, at once."""
    for c in range(target.shape[0]):
        target[c] = source[c]


@in_lanes
def _smooth_forces(a: LinearAxis, n: int, x: Array, f: Array) -> None:
    """Force on each body but for motor torque and friction."""
    for i in range(n):
        total = a.constant[i]
        for c in range(2 * n):
            total += a.smooth[i, c] * x[c]
        f[i] = total


@in_lanes
def _rates(a: LinearAxis, n: int, x: Array, f: Array, torque: float, slide: Array, w: Array) -> int:
    """w = x' and the number of the set that sticks; ``slide`` of those that rub: +1 or -1, 0 where stuck."""
    for i in range(n):
        w[i] = x[n + i]
        w[n + i] = f[i]
    w[n] += torque
    stuck = 0
    for j in range(slide.shape[0]):
        i = a.rubbing[j]
        if slide[j] == 0.0:
            stuck |= 1 << j
            w[i] = w[n + i] = 0.0
        else:
            w[n + i] -= slide[j] * a.level[i]
    for i in range(n):
        w[n + i] *= a.lightness[i]
    return stuck


@in_lanes
def _strand_of(a: LinearAxis, n: int, x: Array) -> float:
    """Belt force, N; of the rates, its rate."""
    total = 0.0
    for c in range(2 * n):
        total += a.belt[c] * x[c]
    return total


@in_lanes
def _direction_from_rest(push: float, level: float) -> float:
    """Direction in which a body at rest is pushed away; 0 where it is held."""
    return 0.0 if abs(push) <= level else math.copysign(1.0, push)


@in_lanes
def _polynomial(series: Array, stuck: int, row: int, w: Array, share: float, start: float, p: Array) -> None:
    """Polynomial over 0..1 of a watched quantity along a share of a piece, into ``p``."""
    for k in range(DEGREE + 1):
        p[k] = 0.0
    for c in range(w.shape[0]):
        for k in range(DEGREE + 1):
            p[k] += series[stuck, row, c, k] * w[c]
    p[0] = start
    if share < 1.0:
        scale = 1.0
        for k in range(1, DEGREE + 1):
            scale *= share
            p[k] *= scale


@in_lanes
def _advance_piece(
    a: LinearAxis, t: Tables, n: int, x: Array, f: Array, torque: float, slide: Array, doubtful: Array, y: Array, after: Array, s: Scratch
) -> float:
    """One piece with all that happens in it, x, f and slide in place; the largest |belt force|, NaN where events do not end.

    ``doubtful`` of those that rub: 0 where nothing can happen; ``y``, ``after``: x and f at its end when nothing happens.
    """
    watched = slide.shape[0]
    w, p, moved, kept, fresh = s
    for j in range(watched):
        kept[j] = fresh[j] = 0.0
    share, peak = 1.0, 0.0
    for event in range(_MOST_EVENTS):
        stuck = _rates(a, n, x, f, torque, slide, w)
        first, body = NEVER, -1
        for j in range(watched):
            if (event == 0 and doubtful[j] == 0.0) or kept[j] != 0.0:
                continue
            i = a.rubbing[j]
            start = x[n + i] if slide[j] != 0.0 else f[i] + (torque if i == 0 else 0.0)
            _polynomial(t.series, stuck, j, w, share, start, p)
            at = NEVER
            if slide[j] != 0.0:
                for k in range(DEGREE + 1):
                    p[k] *= slide[j]
                if fresh[j] != 0.0:  # it was let go where its force passes its level: what is left of it is rounding
                    p[1] = max(p[1], 0.0)
                at = first_root(p, moved)
            else:
                p[0] += a.level[i]
                at = first_root(p, moved)
                for k in range(DEGREE + 1):
                    p[k] = -p[k]
                p[0] += 2.0 * a.level[i]
                at = min(at, first_root(p, moved))
            if at < first:
                first, body = at, j
        part = min(first, 1.0)
        _polynomial(t.series, stuck, watched, w, share, _strand_of(a, n, x), p)
        peak = max(peak, largest(p, part))
        if body < 0 and event == 0:
            _copy(y, x)
            _copy(after, f)
            return peak
        for c in range(2 * n):
            _polynomial(t.series, stuck, watched + 1 + c, w, share, x[c], p)
            y[c] = value(p, part)
        _copy(y, x)
        if body < 0:
            _smooth_forces(a, n, x, f)
            return peak
        share *= 1.0 - part
        again = fresh[body] != 0.0 and part == 0.0
        if part > 0.0:
            for j in range(watched):
                fresh[j] = 0.0
        i = a.rubbing[body]
        x[n + i] = 0.0
        _smooth_forces(a, n, x, f)
        push = f[i] + (torque if i == 0 else 0.0)
        if slide[body] == 0.0:
            slide[body], fresh[body] = math.copysign(1.0, push), 1.0
        elif again:  # its force only touched its level
            slide[body], kept[body] = 0.0, 1.0
        else:
            slide[body] = _direction_from_rest(push, a.level[i])
    return math.nan


#: (axis, tables, pieces, state, torques, theta, omega, cart, belt) -> whether all events came to an end.
Run = Callable[[LinearAxis, Tables, int, Array, Array, Array, Array, Array, Array], bool]


@lru_cache
def runner(bodies: int) -> Run:
    """``run`` for so many bodies, 0 for any: loops of a known length are twice as fast, and each takes seconds to compile.

    Parameters
    ----------
    bodies : int
        Of the model.
    """

    @in_lanes
    def run(a: LinearAxis, t: Tables, pieces: int, x: Array, torques: Array, theta: Array, omega: Array, cart: Array, belt: Array) -> bool:
        """A whole record, each torque held for ``pieces`` pieces: state at the start of each and the largest |belt force| in it.

        Parameters
        ----------
        x : ndarray (2 n,)
            Moved on.

        Returns
        -------
        bool
            Whether all events came to an end.
        """
        n, watched = bodies if bodies > 0 else a.lightness.shape[0], a.rubbing.shape[0]
        size = 2 * n
        f, after = np.empty(n), np.empty(n)
        w, y, end = np.empty(size), np.empty(size), np.empty(size)
        slide, doubtful = np.zeros(watched), np.zeros(watched)
        p = np.empty(DEGREE + 1)
        scratch = Scratch(w, p, np.empty(DEGREE + 1), np.empty(watched), np.empty(watched))
        for j in range(watched):
            speed = x[n + a.rubbing[j]]
            slide[j] = math.copysign(1.0, speed) if speed != 0.0 else 0.0
        _smooth_forces(a, n, x, f)
        strand = _strand_of(a, n, x)
        for k in range(torques.shape[0]):
            torque = torques[k]
            theta[k], omega[k], cart[k] = x[0], x[n], a.lever * x[a.cart]
            for j in range(watched):
                i = a.rubbing[j]
                if x[n + i] == 0.0:  # the torque may have jumped
                    slide[j] = _direction_from_rest(f[i] + (torque if i == 0 else 0.0), a.level[i])
            peak = abs(strand)
            for _ in range(pieces):
                stuck = _rates(a, n, x, f, torque, slide, w)
                for i in range(size):
                    total = x[i]
                    for c in range(size):
                        total += t.flow[stuck, i, c] * w[c]
                    y[i] = total
                _smooth_forces(a, n, y, after)
                calm = True
                for j in range(watched):
                    i = a.rubbing[j]
                    doubt = 0.0
                    for c in range(size):
                        doubt += t.doubt[stuck, j, c] * abs(w[c])
                    if slide[j] == 0.0:
                        push = torque if i == 0 else 0.0
                        left = a.level[i] - max(abs(f[i] + push), abs(after[i] + push))
                    else:
                        left = min(slide[j] * x[n + i], slide[j] * y[n + i])
                    doubtful[j] = 0.0 if left > doubt else 1.0
                    calm = calm and left > doubt
                if calm:
                    start, rise = strand, _strand_of(a, n, w)
                    _rates(a, n, y, after, torque, slide, end)
                    strand, fall = _strand_of(a, n, y), _strand_of(a, n, end)
                    peak = max(peak, abs(strand))
                    if rise * fall < 0.0 and max(rise * start, rise * strand) > 0.0:
                        _polynomial(t.series, stuck, watched, w, 1.0, start, p)
                        peak = max(peak, largest(p, 1.0))
                    _copy(y, x)
                    _copy(after, f)
                else:
                    peak = max(peak, _advance_piece(a, t, n, x, f, torque, slide, doubtful, y, after, scratch))
                    strand = _strand_of(a, n, x)
                    if math.isnan(peak):
                        return False
            belt[k] = peak
        return True

    return run
