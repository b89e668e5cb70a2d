"""Whitening: a residual in units of its own noise, sample by sample, whatever samples are left out.

Two noises make the residual e[n] of ``beltcomm.simulate.inverse``: that of the torque signal, w, and the encoder's rounding, q.  The
rounding acts through the second difference of the angle, and through the belt as well, because the counted angle drives the
carriage; at its antiresonance a rounding of 1/65536 of a turn is worth ten times the torque noise (``propagation``).  A Kalman filter
predicts e[n] from the kept samples before it; the innovations over their deviation are white, of variance 1 where the model is right,
and their squares sum up to the errors-in-variables likelihood: the rounded angle in the regressor biases neither the inertia nor the
belt's damping.
Source: Anderson, Moore, Optimal Filtering, 1979, sections 5.3 and 10.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import compiled, in_lanes, inlined
from beltcomm.fit.noise.colour import WHITE_NOISE, NoiseColour, filter_states
from beltcomm.fit.noise.propagation import KEPT, SLOW, NoisePath, NoiseSchedule
from beltcomm.simulate.kernels.observer import filter_columns, lanes_for

#: Hz; below it the rounding of a motion at a steady speed may be stronger than white.
SLOW_HZ = 40.0
#: Relative change of the gains from one sample to the next below which they stay as they are.
SETTLED = 1e-8
#: States of the path with one body behind the motor, without slow rounding.
ONE_BODY = 7
#: What may differ from 0 of its F, slow rounding in front: s = (slow rounding, x, v, c before, here and after, what x and c leave, w).
ONE_BODY_FULL = np.zeros((8, 8), dtype=np.bool_)
ONE_BODY_FULL[[1, 2, 6], :6] = ONE_BODY_FULL[[0, 3, 4, 5, 5, 5], [0, 4, 5, 0, 4, 5]] = True


@dataclass(frozen=True)
class Whitener:
    """The filter of one segment with its gains worked out: they depend on the noises and on what is kept, not on the residual.

    Attributes
    ----------
    F : ndarray
        (levels, k, k) and H : (levels, k), of the noise paths.
    level : ndarray (n,) of int
        Which of them holds.
    gains : ndarray (n, k)
    deviations : ndarray (n,), N m
        Of the innovations.
    """

    F: Array
    H: Array
    level: IntArray
    gains: Array
    deviations: Array

    def __call__(self, residual: Array, keep: BoolArray) -> Array:
        """Innovations of the kept samples over their deviation; (n,) N m -> (kept,), or (n, k) -> (kept, k).

        ``keep`` : as for :func:`whitener`.
        """
        kept = np.count_nonzero(keep)
        if residual.ndim == 1:
            out = np.empty(kept)
            _filter_innovations(
                residual, keep, self.F, self.H, self.level, self.gains, self.deviations, np.zeros((2, self.H.shape[1])), out
            )
            return out
        levels, slow = len(self.H), self.H.shape[1] - ONE_BODY
        if slow in (0, 1):
            f, h = np.zeros((levels, ONE_BODY + 1, ONE_BODY + 1)), np.zeros((levels, ONE_BODY + 1))
            f[:, 1 - slow :, 1 - slow :], h[:, 1 - slow :] = self.F, self.H
            if not f[:, ~ONE_BODY_FULL].any():
                out, columns, lanes = np.empty((kept, residual.shape[1])), np.ascontiguousarray(residual), lanes_for(residual.shape[1])
                _one_body(columns, keep, f, h, self.level, self.gains, self.deviations, slow, lanes, np.empty(144), out)
                return out
        if levels > 1:
            return np.stack([self(np.ascontiguousarray(column), keep) for column in residual.T], axis=1)
        f, h = np.concatenate([self.F] * 2), np.concatenate([self.H] * 2)  # one path, however much of a sample nothing is closed
        return filter_columns(np.ascontiguousarray(residual), keep, f, h, self.gains, self.deviations, np.zeros(len(keep)))


def whitener(
    keep: BoolArray,
    way: NoiseSchedule,
    step_rad: float,
    noise_nm: float,
    shares: tuple[float, float] = (1.0, 0.0),
    colour: NoiseColour = WHITE_NOISE,
) -> Whitener:
    """Gains for the kept samples of a segment.

    Parameters
    ----------
    keep : ndarray of bool (n,)
        Samples that count.
    way : NoiseSchedule
        Path that holds at each sample.
    step_rad : float, rad
    noise_nm : float
        N m rms.
    shares : tuple of float
        Of the rounding's variance step²/12 that is white, and that is slow: decaying with ``SLOW_HZ``.
    colour : NoiseColour
        Of the torque's noise.
    """
    levels = [noises(path, step_rad, noise_nm, shares, colour) for path in way.paths]
    _, variances, start = levels[way.level[0]]
    paths = [path for path, _, _ in levels]
    gains, deviations = gains_of(keep, paths, way.level, variances, start)
    return Whitener(np.stack([path.F for path in paths]), np.stack([path.H for path in paths]), way.level, gains, deviations)


def gains_of(keep: BoolArray, paths: Sequence[NoisePath], level: IntArray, variances: Array, start: Array) -> tuple[Array, Array]:
    """Gains, (n, k), and deviations of the innovations, (n,), N m.

    Parameters
    ----------
    keep : ndarray of bool (n,)
        Samples that count.
    paths : sequence of NoisePath
        Of the noises to the residual.
    level : ndarray (n,) of int
        Which path holds.
    variances : ndarray
        Of the noises.
    start : ndarray (k, k)
        Covariance of the state at the first sample.
    """
    f, g, h, d = (np.stack([getattr(path, name) for path in paths]) for name in "FGHD")
    size = h.shape[1]
    gains, deviations = np.zeros((len(keep), size)), np.ones(len(keep))
    noise, cross, direct = np.zeros((len(h), size, size)), np.zeros((len(h), size)), np.zeros(len(h))
    for m, variance in enumerate(variances):
        noise += (g[:, :, m] * variance)[:, :, None] * g[:, None, :, m]
        cross += g[:, :, m] * variance * d[:, m, None]
        direct += d[:, m] * d[:, m] * variance
    ahead, spread = _powers(f, noise, _longest_gap(keep))
    _gains(size)(keep, f, h, cross, direct, level, ahead, spread, start, gains, deviations)
    return gains, deviations


def _longest_gap(keep: BoolArray) -> int:
    """Samples of the longest stretch of which none is kept."""
    kept = np.flatnonzero(np.concatenate(([True], keep, [True])))
    return int(np.diff(kept).max()) - 1


def _powers(f: Array, noise: Array, samples: int) -> tuple[Array, Array]:
    """F of 1, 2, 4, ... samples and the covariance they add, (levels, powers, k, k) each, up to a stretch of some samples."""
    ahead, spread = [f], [noise]
    with np.errstate(all="ignore"):  # a model that is tried may not be stable: its likelihood is no number then, and it is not taken
        while 2 ** len(ahead) <= samples:
            one, own = ahead[-1], spread[-1]
            ahead.append(one @ one)
            spread.append(one @ own @ one.transpose(0, 2, 1) + own)
    return np.stack(ahead, axis=1), np.stack(spread, axis=1)


@lru_cache(maxsize=KEPT)  # the segments of a record share what is worked out of a path
def noises(
    path: NoisePath,
    step_rad: float,
    noise_nm: float,
    shares: tuple[float, float],
    colour: NoiseColour = WHITE_NOISE,
    *,
    alike: bool = False,
) -> tuple[NoisePath, Array, Array]:
    """The path with its own states for slow rounding and coloured noise, variances of the noises, covariance of s at the first sample.

    Parameters
    ----------
    path : NoisePath
        Of the noises to the residual.
    step_rad : float, rad
    noise_nm : float, N m rms
        Of the torque.
    shares : tuple of float
        As of :func:`whitener`.
    colour : NoiseColour
        Of the torque's noise.
    alike : bool
        Whether it has that state in any case, so that the paths of all records have one size.
    """
    fast, slow, torque = shares[0] * step_rad**2 / 12.0, shares[1] * step_rad**2 / 12.0, noise_nm**2
    variances = np.array([fast, torque])
    if slow > 0.0 or alike:
        path, variances = _with_slow_rounding(path), np.array([fast, slow, torque])
    start = path.begins @ np.array([1.0, fast, slow, 0.0 if colour.numerator else torque])
    if slow > 0.0 or alike:
        start[0] = start[:, 0] = slow * np.diag(path.begins[:, :, SLOW])
        start[0, 0] = slow
    if colour.numerator:
        path, own = _with_filtered_torque(path, colour)
        start = _with_states_in_front(start, len(own))
        start[: len(own), : len(own)] = torque * own
    elif colour.pole != 0.0:
        path, start = _with_coloured_torque(path, colour.pole), _with_states_in_front(start)
        start[0, 0] = start[0, -1] = start[-1, 0] = torque
    return path, variances, start


def _with_coloured_torque(path: NoisePath, colour: float) -> NoisePath:
    """Noise path for a torque noise of first order with ``colour`` ρ.

    w[n] = ρ w[n-1] + √(1-ρ²) ν[n]:  one more state w[n-1] in front, noises (…, ν).
    """
    new, size, last = math.sqrt(1.0 - colour**2), len(path.H), path.G.shape[1] - 1
    f, g = np.zeros((size + 1, size + 1)), np.zeros((size + 1, path.G.shape[1]))
    f[0, 0], f[1:, 0], f[1:, 1:] = colour, colour * path.G[:, last], path.F
    g[0, last], g[1:] = new, path.G
    g[1:, last] *= new
    d, h = path.D.copy(), np.concatenate(([colour * path.D[last]], path.H))
    d[last] *= new
    return NoisePath(f, g, h, d, _with_states_in_front(path.begins), path.sample_s)


def _with_filtered_torque(path: NoisePath, colour: NoiseColour) -> tuple[NoisePath, Array]:
    """Noise path for a torque noise behind a law b(z)/a(z), with its states in front, noises (…, ν); and the covariance of those states."""
    own_f, own_g, covariance = filter_states(colour)
    size, own, last = len(path.H), len(own_g), path.G.shape[1] - 1
    f, g = np.zeros((size + own, size + own)), np.zeros((size + own, last + 1))
    f[:own, :own], f[own:, own:] = own_f, path.F
    g[:own, last], g[own:, :last] = own_g, path.G[:, :last]
    d, h = path.D.copy(), np.concatenate((np.eye(own)[0], path.H))
    d[last] = colour.numerator[0]
    return NoisePath(f, g, h, d, _with_states_in_front(path.begins, own), path.sample_s), covariance


def _with_slow_rounding(path: NoisePath) -> NoisePath:
    """The path for  q = q1 + q2,  q2[n+1] = ρ q2[n] + √(1-ρ²) ν[n+1]:  one more state q2 in front, noises (q1, ν, w)."""
    keeps = math.exp(-math.tau * SLOW_HZ * path.sample_s)
    new = math.sqrt(1.0 - keeps**2)
    size = len(path.H)
    f, g = np.zeros((size + 1, size + 1)), np.zeros((size + 1, 3))
    f[0, 0], f[1:, 0], f[1:, 1:] = keeps, keeps * path.G[:, 0], path.F
    g[0, 1], g[1:, 0], g[1:, 1], g[1:, 2] = new, path.G[:, 0], new * path.G[:, 0], path.G[:, 1]
    d = np.array([path.D[0], new * path.D[0], path.D[1]])
    h = np.concatenate(([keeps * path.D[0]], path.H))
    return NoisePath(f, g, h, d, _with_states_in_front(path.begins), path.sample_s)


@compiled
def _filter_innovations(
    e: Array,
    keep: BoolArray,
    f: Array,
    h: Array,
    level: IntArray,
    gains: Array,
    deviations: Array,
    states: Array,
    out: Array,
) -> None:
    # Memory comes from outside, here and below: what fetches it took a quarter of the compilation.
    size, own = h.shape[1], h.shape[1] - 2
    number = 0
    for n in range(e.shape[0]):
        at = level[n]
        for i in range(size):
            total = 0.0
            for j in range(own):
                total += f[at, i, j] * states[0, j]
            states[1, i] = total
        if keep[n]:
            innovation = e[n]
            for i in range(size):
                innovation -= h[at, i] * states[0, i]
            out[number] = innovation / deviations[n]
            number += 1
            for i in range(size):
                states[1, i] += gains[n, i] * innovation
        for i in range(size):
            states[0, i] = states[1, i]


@inlined
def _row(f: Array, at: int, i: int, sz: float, sx: float, sv: float, sb: float, sq: float, sy: float) -> float:
    return float(f[at, i, 0] * sz + f[at, i, 1] * sx + f[at, i, 2] * sv + f[at, i, 3] * sb + f[at, i, 4] * sq + f[at, i, 5] * sy)


@in_lanes
def _one_body(
    e: Array,
    keep: BoolArray,
    f: Array,
    h: Array,
    level: IntArray,
    gains: Array,
    deviations: Array,
    slow: int,
    lanes: int,
    s: Array,
    out: Array,
) -> None:
    # The filter of ``filtered`` for a path of one body, without what is always 0.  One block of memory, so that nothing can overlap.
    z, x, v, b, q, y, p, w, nu = 0, 16, 32, 48, 64, 80, 96, 112, 128
    for begin in range(0, e.shape[1], lanes):
        width = min(lanes, e.shape[1] - begin)
        for c in range(s.shape[0]):
            s[c] = 0.0
        number = 0
        for n in range(e.shape[0]):
            # Gains are 0 where a sample is not kept, as is then its innovation.
            at, kept, share, kz = level[n], keep[n], 1.0 / deviations[n], slow * gains[n, 0]
            kx, kv, kb, kq = gains[n, slow], gains[n, slow + 1], gains[n, slow + 2], gains[n, slow + 3]
            ky, kp, kw = gains[n, slow + 4], gains[n, slow + 5], gains[n, slow + 6]
            for c in range(width):
                s[nu + c] = e[n, begin + c] if kept else 0.0
            for c in range(lanes):
                sz, sx, sv, sb, sq, sy = s[z + c], s[x + c], s[v + c], s[b + c], s[q + c], s[y + c]
                new = s[nu + c] - h[at, 0] * sz - h[at, 1] * sx - h[at, 2] * sv - h[at, 3] * sb - h[at, 4] * sq - h[at, 5] * sy
                new -= h[at, 6] * s[p + c] + h[at, 7] * s[w + c]
                s[z + c] = f[at, 0, 0] * sz + kz * new
                s[x + c] = _row(f, at, 1, sz, sx, sv, sb, sq, sy) + kx * new
                s[v + c] = _row(f, at, 2, sz, sx, sv, sb, sq, sy) + kv * new
                s[b + c] = f[at, 3, 4] * sq + kb * new
                s[q + c] = f[at, 4, 5] * sy + kq * new
                s[y + c] = f[at, 5, 0] * sz + f[at, 5, 4] * sq + f[at, 5, 5] * sy + ky * new
                s[p + c] = _row(f, at, 6, sz, sx, sv, sb, sq, sy) + kp * new
                s[w + c] = kw * new
                s[nu + c] = share * new
            if kept:
                for c in range(width):
                    out[number, begin + c] = s[nu + c]
                number += 1


@cache
def _gains(size: int) -> Callable[..., None]:
    """The covariance half of the filter for one number of states: laid out for it, it takes 0.6 of the time."""

    @in_lanes
    def gains_of_size(
        keep: BoolArray,
        f: Array,
        h: Array,
        cross: Array,
        direct: Array,
        level: IntArray,
        ahead: Array,
        spread: Array,
        start: Array,
        gains: Array,
        deviations: Array,
    ) -> None:
        # cross, direct : G V Dᵀ, D V Dᵀ of each level, V the noises' variances.   ahead, spread : ``_powers``.   start : covariance.
        # In loops: with numpy's functions of rows it took four times as long to compile.
        own = size - 2
        settled, at, n = False, -1, 0
        p, fp, rows = start.copy(), np.empty((size, size)), np.empty((2, size))
        while n < keep.shape[0]:
            if level[n] != at:
                settled, at = False, level[n]
            if settled and keep[n]:
                deviations[n] = deviations[n - 1]
                for i in range(size):
                    gains[n, i] = gains[n - 1, i]
                n += 1
                continue
            samples = 1
            if keep[n]:
                variance = direct[at]
                for i in range(size):
                    total = 0.0
                    for j in range(size):
                        total += p[i, j] * h[at, j]
                    rows[0, i] = total
                    variance += h[at, i] * total
                for i in range(size):
                    total = cross[at, i]
                    for j in range(own):
                        total += f[at, i, j] * rows[0, j]
                    rows[1, i] = total
                    gains[n, i] = total / variance
                deviations[n] = math.sqrt(variance)
                settled, largest = n > 0 and keep[n - 1] and level[n - 1] == at, 0.0
                for i in range(size):
                    largest = max(largest, abs(gains[n, i]))
                for i in range(size):
                    if not abs(gains[n, i] - gains[n - 1, i]) <= SETTLED * largest:
                        settled = False
            else:
                settled = False
                for i in range(size):
                    rows[1, i] = 0.0
                while n + samples < keep.shape[0] and not keep[n + samples] and level[n + samples] == at:
                    samples += 1
            power, left = 0, samples
            while left:  # nothing is learned from samples that are not kept: they are passed in powers of two
                if left & 1:
                    for i in range(size):
                        for j in range(own):
                            fp[i, j] = 0.0
                        for m in range(own):
                            factor = ahead[at, power, i, m]
                            if factor != 0.0:  # most are 0
                                for j in range(own):
                                    fp[i, j] += factor * p[m, j]
                    for i in range(size):
                        for j in range(size):
                            p[i, j] = spread[at, power, i, j] - rows[1, i] * gains[n, j]
                    for j in range(size):
                        for m in range(own):
                            factor = ahead[at, power, j, m]
                            if factor != 0.0:
                                for i in range(size):
                                    p[j, i] += factor * fp[i, m]
                power, left = power + 1, left >> 1
            n += samples

    return gains_of_size


def _with_states_in_front(covariance: Array, number: int = 1) -> Array:
    """A covariance of states, (k, k) or ``NoisePath.begins``, with more of them in front, 0 at the first sample."""
    size = len(covariance) + number  # not by ``numpy.pad``, which takes ten times as long
    found = np.zeros((size, size, *covariance.shape[2:]))
    found[number:, number:] = covariance
    return found
