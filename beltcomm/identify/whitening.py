"""Whitening: a residual in units of its own noise, sample by sample, whatever samples are left out.

Two noises make the residual e[n] of ``beltcomm.simulate.inverse``: that of the torque signal, w, and the encoder's rounding, q.  The
rounding acts through the second difference of the angle, and through the belt as well, because the counted angle drives the
carriage; at its antiresonance a rounding of 1/65536 of a turn is worth ten times the torque noise.  With x the displacements and
speeds of the bodies behind the motor and rounding linear between the samples,

    x[n+1] = Φ x[n] + Γ_a q[n] + Γ_b q[n+1],
    e[n] = <load(x, q)>[n] + J (q[n+1] - 2 q[n] + q[n-1])/T² - (w[n-1] + w[n])/2,

linearised around sliding.  A Kalman filter predicts e[n] from the kept samples before it; the innovations over their deviation are
white, of variance 1 where the model is right, and their squares sum up to the errors-in-variables likelihood: the rounded
angle in the regressor biases neither the inertia nor the belt's damping.
Source: Anderson, Moore, Optimal Filtering, 1979, sections 5.3 and 10.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import compiled, in_lanes
from beltcomm.linear import matrices, operating_point
from beltcomm.model import Model
from beltcomm.simulate.observer import filtered, lanes_for

Array = NDArray[np.float64]

#: Hz; below it the rounding of a motion at a steady speed may be stronger than white.
SLOW_HZ = 40.0
#: Relative change of the gains from one sample to the next below which they stay as they are.
SETTLED = 1e-8
#: States of the path with one body behind the motor, without slow rounding.
ONE_BODY = 5
#: What is 0 of its F, slow rounding in front: s = (slow rounding, x, v, q, what x and q leave, w).
ONE_BODY_ZEROS = np.array([[0, 1, 1, 1, 1, 1], [0, 0, 0, 0, 1, 1], [0, 0, 0, 0, 1, 1], [0, 1, 1, 1, 1, 1], [0, 0, 0, 0, 1, 1], [1] * 6]) > 0
#: Terms of Taylor's series for a norm below one half: 0.5^15/15! is below the machine precision.
TERMS = 14


@dataclass(frozen=True)
class NoisePath:
    """How the noises reach the residual:  s[n+1] = F s[n] + G (q[n+1], w[n]),   e[n] = H s[n] + D (q[n+1], w[n]).

    s = (x[n], q[n], what x[n-1] and q[n-1] leave of e[n], w[n-1]).   F : (k, k), zero in its last two columns.   G : (k, 2).
    H : (k,).   D : (2,).   begins : (k,), variance of s at the first sample by motion that the record does not show.
    e in N m, q in rad, both at the motor shaft, w in N m.   sample_s : s.
    """

    F: Array
    G: Array
    H: Array
    D: Array
    begins: Array
    sample_s: float


def noise_path(model: Model, position_m: float, sample_s: float, closed: float = 1.0) -> NoisePath:
    """The path of a model linearised with the carriage sliding at a place, m; ``sample_s`` : s.   closed : see ``matrices``.

    The load's triangular mean is exact for rounding linear between the samples:  ∫_0^1 u load du before and ∫_0^1 (1-u) load du after
    a sample, from the first and the second integral of the load.
    """
    linear = matrices(model, operating_point(model, position_m, 1.0), closed=closed)
    motor, behind = 0, np.arange(1, len(linear.bodies))
    n = 2 * len(behind)  # states; then the angle, its rate, the load's integral and that one's integral
    inverse = np.diag(1.0 / np.diag(linear.M)[behind])
    a = np.zeros((n + 4, n + 4))
    a[: n // 2, n // 2 : n] = np.eye(n // 2)
    a[n // 2 : n, : n // 2] = -inverse @ linear.K[np.ix_(behind, behind)]
    a[n // 2 : n, n // 2 : n] = -inverse @ linear.D[np.ix_(behind, behind)]
    a[n // 2 : n, n] = -inverse @ linear.K[behind, motor]
    a[n // 2 : n, n + 1] = -inverse @ linear.D[behind, motor]
    a[n, n + 1] = 1.0
    a[n + 2, : n // 2], a[n + 2, n // 2 : n] = linear.K[motor, behind], linear.D[motor, behind]
    a[n + 2, n], a[n + 2, n + 1] = linear.K[motor, motor], linear.D[motor, motor]
    a[n + 3, n + 2] = 1.0
    moved = exponential(a * sample_s)
    # from (x, angle, rate) to (x, angle before, angle after)
    moved[:, n + 1] /= sample_s
    moved[:, n] -= moved[:, n + 1]
    first, second = moved[n + 2, : n + 2] / sample_s, moved[n + 3, : n + 2] / sample_s**2
    after, before = second, first - second
    g = model[model.bodies()[motor][0]] / sample_s**2
    f, gain, h = np.zeros((n + 3, n + 3)), np.zeros((n + 3, 2)), np.zeros(n + 3)
    f[:n, : n + 1], gain[:n, 0] = moved[:n, : n + 1], moved[:n, n + 1]
    gain[n, 0] = 1.0
    f[n + 1, : n + 1], gain[n + 1, 0] = before[: n + 1], before[n + 1]
    f[n + 1, n] += g
    gain[n + 2, 1] = 1.0
    h[: n + 1] = after[: n + 1]
    h[n] -= 2.0 * g
    h[n + 1], h[n + 2] = 1.0, -0.5
    begins = np.zeros(n + 3)
    for i, (_, body) in zip(behind, model.bodies()[1:], strict=True):
        begins[i - 1] = body.swings**2
        begins[n // 2 + i - 1] = body.swings**2 * linear.K[i, i] / linear.M[i, i]
    path = NoisePath(f, gain, h, np.array([after[n + 1] + g, -0.5]), begins, sample_s)
    return read_late(path, sum(model[f"{e.name}.time"] for e in model.effect_list() if e.slot == "torque_reading"))


def read_late(path: NoisePath, time_s: float) -> NoisePath:
    """The path where the torque is read behind a lag: rounding reaches the residual smoothed, noise of the torque as before.

    y[n] = a y[n-1] + b e[n-1] + c e[n]  with  e = h s + d q,  one more state z[n] = a y[n-1] + b e[n-1]:
    z[n+1] = a z[n] + (a c + b) e[n],   y[n] = z[n] + c e[n]      (straight between the samples, as ``measurement_lag``)
    """
    if time_s < 1e-9:
        return path
    size = len(path.H)
    decay = np.exp(-path.sample_s / time_s)
    share = (1.0 - decay) * time_s / path.sample_s
    c, b = 1.0 - share, share - decay
    needed, torque = path.H.copy(), size - 1  # the torque's own noise, the last state, is read as it is
    needed[torque] = 0.0
    # One state that is always 0 keeps the last two columns empty.
    old, place = np.r_[:torque, torque], np.r_[1 : torque + 1, size + 1]
    f, gain, h = np.zeros((size + 2, size + 2)), np.zeros((size + 2, 2)), np.zeros(size + 2)
    f[np.ix_(place, place)], gain[place] = path.F[np.ix_(old, old)], path.G[old]
    begins = np.zeros(size + 2)
    begins[place] = path.begins[old]
    f[0, 0], gain[0, 0] = decay, (decay * c + b) * path.D[0]
    f[0, place] = (decay * c + b) * needed[old]
    h[0], h[place] = 1.0, c * needed[old]
    h[size + 1] = path.H[torque]
    return NoisePath(f, gain, h, np.array([c * path.D[0], path.D[1]]), begins, path.sample_s)


def exponential(a: Array) -> Array:
    """e^a of a small matrix: scaling, Taylor's series, squaring.

    Not scipy's ``expm``: its linear algebra runs in threads, which on a busy machine wait for each other, 20 ms instead of 0.04 ms.
    Source: Moler, Van Loan, SIAM Review 45 (2003), method 3.
    """
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(a).sum(axis=1).max()), 1e-300))) + 1)
    a = a / 2.0**squarings
    result = term = np.eye(len(a))
    for k in range(1, TERMS + 1):
        term = term @ a / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def whiten(residual: Array, keep: NDArray[np.bool_], path: NoisePath, step_rad: float, noise_nm: float) -> Array:
    """Innovations of the kept samples over their deviation; (n,) N m -> (kept,).   step_rad : rad.   noise_nm : N m rms."""
    return whitener(keep, path, step_rad, noise_nm)(residual, keep)


@dataclass(frozen=True)
class Whitener:
    """The filter of one stretch with its gains worked out: they depend on the noises and on what is kept, not on the residual.

    gains : (n, k).   deviations : (n,), N m, of the innovations.
    """

    path: NoisePath
    gains: Array
    deviations: Array

    def __call__(self, residual: Array, keep: NDArray[np.bool_]) -> Array:
        """Innovations of the kept samples over their deviation; (n,) N m -> (kept,), or (n, k) -> (kept, k).

        ``keep`` : as for :func:`whitener`.
        """
        kept, size = np.count_nonzero(keep), len(self.path.H)
        if residual.ndim == 1:
            out = np.empty(kept)
            _filtered(residual, keep, self.path.F, self.path.H, self.gains, self.deviations, np.zeros((2, size)), out)
            return out
        slow = size - ONE_BODY
        if slow in (0, 1):
            f, h = np.zeros((ONE_BODY + 1, ONE_BODY + 1)), np.zeros(ONE_BODY + 1)
            f[1 - slow :, 1 - slow :], h[1 - slow :] = self.path.F, self.path.H
            if not f[ONE_BODY_ZEROS].any():
                out, columns, lanes = np.empty((kept, residual.shape[1])), np.ascontiguousarray(residual), lanes_for(residual.shape[1])
                _one_body(columns, keep, f, h, self.gains, self.deviations, slow, lanes, np.empty(112), out)
                return out
        f, h = np.stack([self.path.F] * 2), np.stack([self.path.H] * 2)  # one path, however much of a sample nothing is closed
        return filtered(np.ascontiguousarray(residual), keep, f, h, self.gains, self.deviations, np.zeros(len(keep)))


def whitener(
    keep: NDArray[np.bool_], path: NoisePath, step_rad: float, noise_nm: float, shares: tuple[float, float] = (1.0, 0.0)
) -> Whitener:
    """Gains for the kept samples of a stretch.   step_rad : rad.   noise_nm : N m rms.

    shares : of the rounding's variance step²/12 that is white, and that is slow: decaying with ``SLOW_HZ``.
    """
    path, variances, start = noises(path, step_rad, noise_nm, shares)
    size = len(path.H)
    gains, deviations = np.zeros((len(keep), size)), np.ones(len(keep))
    noise, cross, direct = np.zeros((size, size)), np.zeros(size), 0.0
    for g, d, variance in zip(path.G.T, path.D, variances, strict=True):
        noise += (g * variance)[:, None] * g
        cross += g * variance * d
        direct += d * d * variance
    _gains(keep, path.F, path.H, noise, cross, direct, start, np.empty((size, size)), np.empty((2, size)), gains, deviations)
    return Whitener(path, gains, deviations)


def noises(path: NoisePath, step_rad: float, noise_nm: float, shares: tuple[float, float]) -> tuple[NoisePath, Array, Array]:
    """The path with its own state for slow rounding where there is some, variances of the noises, covariance of s at the first sample."""
    fast, slow, torque = shares[0] * step_rad**2 / 12.0, shares[1] * step_rad**2 / 12.0, noise_nm**2
    variances = np.array([fast, torque])
    if slow > 0.0:
        path, variances = with_slow_rounding(path), np.array([fast, slow, torque])
    size = len(path.H)
    start = np.diag(path.begins)
    start[size - 3, size - 3], start[size - 1, size - 1] = fast + slow, torque
    if slow > 0.0:
        start[0, 0] = start[0, size - 3] = start[size - 3, 0] = slow
    return path, variances, start


def with_slow_rounding(path: NoisePath) -> NoisePath:
    """The path for  q = q1 + q2,  q2[n+1] = ρ q2[n] + √(1-ρ²) ν[n+1]:  one more state q2 in front, noises (q1, ν, w)."""
    keeps = math.exp(-math.tau * SLOW_HZ * path.sample_s)
    new = math.sqrt(1.0 - keeps**2)
    size = len(path.H)
    f, g = np.zeros((size + 1, size + 1)), np.zeros((size + 1, 3))
    f[0, 0], f[1:, 0], f[1:, 1:] = keeps, keeps * path.G[:, 0], path.F
    g[0, 1], g[1:, 0], g[1:, 1], g[1:, 2] = new, path.G[:, 0], new * path.G[:, 0], path.G[:, 1]
    d = np.array([path.D[0], new * path.D[0], path.D[1]])
    h, begins = (np.concatenate(([first], old)) for first, old in ((keeps * path.D[0], path.H), (0.0, path.begins)))
    return NoisePath(f, g, h, d, begins, path.sample_s)


@compiled
def _filtered(e: Array, keep: NDArray[np.bool_], f: Array, h: Array, gains: Array, deviations: Array, states: Array, out: Array) -> None:
    # Memory comes from outside, here and below: what fetches it took a quarter of the compilation.
    size, own = h.shape[0], h.shape[0] - 2
    number = 0
    for n in range(e.shape[0]):
        for i in range(size):
            total = 0.0
            for j in range(own):
                total += f[i, j] * states[0, j]
            states[1, i] = total
        if keep[n]:
            innovation = e[n]
            for i in range(size):
                innovation -= h[i] * states[0, i]
            out[number] = innovation / deviations[n]
            number += 1
            for i in range(size):
                states[1, i] += gains[n, i] * innovation
        for i in range(size):
            states[0, i] = states[1, i]


@in_lanes
def _one_body(
    e: Array, keep: NDArray[np.bool_], f: Array, h: Array, gains: Array, deviations: Array, slow: int, lanes: int, s: Array, out: Array
) -> None:
    # The filter of ``filtered`` for a path of one body, without what is always 0.  One block of memory, so that nothing can overlap.
    z, x, v, q, p, w, nu = 0, 16, 32, 48, 64, 80, 96
    hz, hx, hv, hq, hp, hw = h[0], h[1], h[2], h[3], h[4], h[5]
    for begin in range(0, e.shape[1], lanes):
        width = min(lanes, e.shape[1] - begin)
        for c in range(s.shape[0]):
            s[c] = 0.0
        number = 0
        for n in range(e.shape[0]):
            # Gains are 0 where a sample is not kept, as is then its innovation.  f is not read beforehand: last digits would change.
            kept, share, kz = keep[n], 1.0 / deviations[n], slow * gains[n, 0]
            kx, kv, kq, kp, kw = gains[n, slow], gains[n, slow + 1], gains[n, slow + 2], gains[n, slow + 3], gains[n, slow + 4]
            for c in range(width):
                s[nu + c] = e[n, begin + c] if kept else 0.0
            for c in range(lanes):
                sz, sx, sv, sq = s[z + c], s[x + c], s[v + c], s[q + c]
                new = s[nu + c] - hz * sz - hx * sx - hv * sv - hq * sq - hp * s[p + c] - hw * s[w + c]
                s[z + c] = f[0, 0] * sz + kz * new
                s[x + c] = f[1, 0] * sz + f[1, 1] * sx + f[1, 2] * sv + f[1, 3] * sq + kx * new
                s[v + c] = f[2, 0] * sz + f[2, 1] * sx + f[2, 2] * sv + f[2, 3] * sq + kv * new
                s[q + c] = f[3, 0] * sz + kq * new
                s[p + c] = f[4, 0] * sz + f[4, 1] * sx + f[4, 2] * sv + f[4, 3] * sq + kp * new
                s[w + c] = kw * new
                s[nu + c] = share * new
            if kept:
                for c in range(width):
                    out[number, begin + c] = s[nu + c]
                number += 1


@compiled
def _gains(
    keep: NDArray[np.bool_],
    f: Array,
    h: Array,
    noise: Array,
    cross: Array,
    direct: float,
    p: Array,
    fp: Array,
    rows: Array,
    gains: Array,
    deviations: Array,
) -> None:
    """The covariance half of the filter.   noise, cross, direct : G V Gᵀ, G V Dᵀ, D V Dᵀ of the noises' variances V.

    p : (k, k), covariance at the first sample, in place.   fp, rows : (k, k), (2, k), memory.
    In loops: with numpy's functions of rows it took four times as long to compile.
    """
    size, own = h.shape[0], h.shape[0] - 2
    settled = False
    for n in range(keep.shape[0]):
        if settled and keep[n]:
            deviations[n] = deviations[n - 1]
            for i in range(size):
                gains[n, i] = gains[n - 1, i]
            continue
        for i in range(size):
            for j in range(own):
                total = 0.0
                for m in range(own):
                    total += f[i, m] * p[m, j]
                fp[i, j] = total
        variance = direct
        if keep[n]:
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += p[i, j] * h[j]
                rows[0, i] = total
                variance += h[i] * total
            for i in range(size):
                total = cross[i]
                for j in range(own):
                    total += f[i, j] * rows[0, j]
                rows[1, i] = total
                gains[n, i] = total / variance
            deviations[n] = math.sqrt(variance)
            settled, largest = n > 0 and keep[n - 1], 0.0
            for i in range(size):
                largest = max(largest, abs(gains[n, i]))
            for i in range(size):
                if not abs(gains[n, i] - gains[n - 1, i]) <= SETTLED * largest:
                    settled = False
        else:
            settled = False
        for i in range(size):
            for j in range(i + 1):
                total = noise[i, j]
                for m in range(own):
                    total += fp[i, m] * f[j, m]
                if keep[n]:
                    total -= rows[1, i] * rows[1, j] / variance
                p[i, j] = total
                p[j, i] = total
