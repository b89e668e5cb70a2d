"""Share of a Jacobian's squares that is noise: where every model is judged in its own noise, each column holds noise of its own.

    A = Σ ∂ν ∂νᵀ - E Σ ∂(W T ε) ∂(W T ε)ᵀ

W, T as in ``residual.rounding_bias``.  The expectation hangs on which samples are kept, so it is taken by one draw of the noises ε
on the samples as they are; thousands of samples make its scatter small.   Source: method sheet, section 3, "not JᵀJ".
"""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array, IntArray
from beltcomm.compiled import compiled
from beltcomm.fit.likelihood.problem import Problem
from beltcomm.fit.noise.whitening import noises
from beltcomm.fit.residual.segment import Segment, noise_paths_of, whitener_of
from beltcomm.model import Model


def noise_information(problem: Problem, x: Array, weights: Array) -> Array:
    """Expected sum of squares of the module, (p, p), in nats per scaled unknown squared.

    Parameters
    ----------
    x : ndarray
        Scaled unknowns, p of them shared by all segments.
    weights : ndarray
        Of the values of the whitened residual, (n,).
    """
    own = len(problem.free)
    found = np.zeros((own, own))
    moved = [j for j in range(own) if problem.touches_noise[j]]
    if not moved:
        return found
    ahead = [problem.perturb(x, j) for j in moved]
    here = problem.model.with_vector(problem.full(x))
    beside = [problem.model.with_vector(problem.full(other)) for _, other in ahead]
    at = np.array(moved, dtype=np.intp)
    for i, piece in enumerate(problem.pieces):
        if not piece.own_noise:
            continue
        weight = weights[problem.ends[i] : problem.ends[i + 1]]
        base = draw_of_noise(piece, here, i)
        columns = np.stack(
            [weight * (draw_of_noise(piece, other, i) - base) / step for other, (step, _) in zip(beside, ahead, strict=True)], 1
        )
        found[at[:, None], at] += columns.T @ columns
    return found


def draw_of_noise(piece: Segment, model: Model, seed: int) -> Array:
    """One draw, by ``seed``, of the noises of a segment as a model passes them on, over the deviation that it expects; (values,)."""
    along = noise_paths_of(piece, model)
    levels = [noises(path, piece.step_rad, piece.noise_nm, piece.rounding, piece.colour) for path in along.paths]
    f, g, h, d = (np.stack([getattr(path, name) for path, _, _ in levels]) for name in "FGHD")
    variances = levels[0][1]
    drawn = np.random.default_rng(seed).standard_normal((len(piece.keep), len(variances))) * np.sqrt(variances)
    return piece.group_sums(whitener_of(piece, model)(_noise_response(f, g, h, d, along.level, drawn), piece.keep))


@compiled
def _noise_response(f: Array, g: Array, h: Array, d: Array, level: IntArray, drawn: Array) -> Array:
    """e[n], N m at the motor shaft, of drawn noises ε, rad, and w, N m; (n, m) -> (n,)."""
    size = h.shape[1]
    s, moved, out = np.zeros(size), np.zeros(size), np.zeros(drawn.shape[0])
    for n in range(drawn.shape[0]):
        at, total = level[n], 0.0
        for m in range(drawn.shape[1]):
            total += d[at, m] * drawn[n, m]
        for i in range(size):
            total += h[at, i] * s[i]
            value = 0.0
            for m in range(drawn.shape[1]):
                value += g[at, i, m] * drawn[n, m]
            for j in range(size):
                value += f[at, i, j] * s[j]
            moved[i] = value
        out[n] = total
        for i in range(size):
            s[i] = moved[i]
    return out
