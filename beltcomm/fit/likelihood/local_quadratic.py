"""The neighbourhood of a minimum: how far the error falls when a torque is added and everything already fitted gives way to it.

    O(C a, c) = min over δ, a of Σ_b n_b φ(|r + c + C a + A δ|²_b / n_b)

A : Jacobian of the whitened residual r with respect to all that was fitted;  c : change by the effect;  C : columns with free
amounts a.  φ is the robust law of ``beltcomm.fit.likelihood.problem``, so the function is minimised by reweighting; every pass needs only
the sums of products of each block.  Finite changes and not derivatives: right for gap and slack, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import compiled
from beltcomm.fit.likelihood.arrowhead import ArrowheadJacobian, arrowhead
from beltcomm.fit.likelihood.problem import Problem

#: Square of the share of a column that is left beside everything fitted, below which it says nothing of its own.
IMITATED = 1e-8
#: Square of a column below which nothing of an effect shows at all.
NOTHING = 1e-200
#: Passes of the reweighting, and the gain below which it ends, nats.
PASSES, ENOUGH = 12, 0.05


@dataclass(frozen=True)
class Near:
    """A minimum in the neighbourhood.

    Attributes
    ----------
    objective : float
        O.
    amounts : ndarray
        A, (k,).
    step : ndarray
        δ in the units of the problem's unknowns, (p,).
    """

    objective: float
    amounts: Array
    step: Array


class LocalQuadratic:
    """The neighbourhood of the unknowns x of a problem, with the residual r found there."""

    def __init__(self, problem: Problem, x: Array, residual: Array) -> None:
        jacobian = problem.jacobian(x)
        norms, own = jacobian.norms(), jacobian.own
        self.moving = np.flatnonzero(norms > 0.0)
        self.norms = norms[self.moving]
        shared = self.moving[self.moving < own]
        border = np.repeat(1.0 / np.maximum(norms[own:], 1e-300), np.diff(jacobian.ends))
        beside = jacobian.columns[:, own] * (border if len(border) else 0.0)
        # Of one layout, here and below, so that ``_products`` is compiled once.
        columns = np.ascontiguousarray(np.column_stack((jacobian.columns[:, shared] / norms[shared], beside)))
        self.jacobian = ArrowheadJacobian(columns, jacobian.ends)
        #: Of the unknowns that all segments share and of one for each segment those that move.
        self.used = np.concatenate((np.arange(len(shared)), len(shared) + self.moving[len(shared) :] - own))
        self.low, self.high = ((bound - x)[self.moving] * self.norms for bound in (problem.low, problem.high))
        self.unknowns = len(x)
        self.starts = np.concatenate((np.flatnonzero(np.diff(problem.blocks, prepend=-1)), [len(residual)])).astype(np.int64)
        # Blocks never cross a segment.
        self.segment = np.searchsorted(jacobian.ends, self.starts[:-1], side="right") - 1 if len(border) else None
        self.count, self.residual = problem.count, residual
        self.active = np.add.reduceat(columns**2, self.starts[:-1]) > 0.0
        self.products = _products(self.starts, self.active, columns, columns)
        here = self.best()
        self.objective = here.objective
        self._prepare_screening(here)

    def _prepare_screening(self, here: Near) -> None:
        """Everything fitted, weighted as at the minimum, for :meth:`rough_gains`."""
        rest = self.residual + self._residual_change(here.step[self.moving] * self.norms)
        means = np.add.reduceat(rest**2, self.starts[:-1]) / self.count
        self.weights = np.repeat(1.0 / np.maximum(means, 1.0), np.diff(self.starts))
        self.weighted = self.jacobian.weighted_rows(self.weights)
        inner, _ = self._summed(1.0 / np.maximum(means, 1.0), self.products, np.zeros(self.products.shape[:2]))
        self.inverse = np.linalg.inv(inner + 1e-12 * np.diag(np.diag(inner)))
        self.rest = rest - self._residual_change(self.inverse @ self.weighted.transpose_times(rest)[self.used])

    def _residual_change(self, place: Array) -> Array:
        """Change of the residual by everything fitted, (p,) -> (n,)."""
        every = np.zeros(self.jacobian.own + len(self.jacobian.ends) - 1)
        every[self.used] = place
        return self.jacobian.times(every)

    def _summed(self, weights: Array, system: Array, slope: Array) -> tuple[Array, Array]:
        """Sums over all blocks, (p + k, p + k) and (p + k,), of (blocks, c, c) and (blocks, c): shared, border, further columns."""
        k, count = self.jacobian.own, len(self.jacobian.ends) - 1
        others = np.delete(np.arange(system.shape[1]), k)
        inner, ahead = np.tensordot(weights, system, 1)[np.ix_(others, others)], (weights @ slope)[others]
        edges, borders = np.zeros((count, system.shape[1])), np.zeros(count)
        if self.segment is not None:
            np.add.at(edges, self.segment, weights[:, None] * system[:, k])
            np.add.at(borders, self.segment, weights * slope[:, k])
        whole = arrowhead(inner, np.column_stack((edges[:, others], edges[:, k])))
        order = np.concatenate((self.used + (self.used >= k) * (len(others) - k), np.arange(k, len(others))))
        return whole[np.ix_(order, order)], np.concatenate((ahead, borders))[order]

    def _by_block(self, place: Array) -> Array:
        """Unknowns that act in each block, of (p + k,): (blocks, c)."""
        k, p = self.jacobian.own, len(self.moving)
        of_stretch = np.zeros(max(len(self.jacobian.ends) - 1, 1))
        of_stretch[self.used[k:] - k] = place[k:p]
        found = np.empty((len(self.count), k + 1 + len(place) - p))
        found[:, :k], found[:, k], found[:, k + 1 :] = place[:k], of_stretch[0 if self.segment is None else self.segment], place[p:]
        return found

    def rough_gains(self, columns: Array, group: int, signed: bool) -> tuple[Array, Array]:
        """Rough fall of O with each group of neighbouring columns, weights as they stand, no bounds.

        Parameters
        ----------
        columns : ndarray, (n, k)
            Changes of the whitened residual.
        group : int
            Neighbouring columns of one group.
        signed : bool
            Amounts below 0 count as well.

        Returns
        -------
        tuple[ndarray, ndarray],
            (k/group,) each: the fall, and how far O would fall if the group were there, with the phase that shows least.
        """
        weighted = columns * self.weights[:, None]
        shared = self.weighted.transpose_times(columns)[self.used]
        slope = weighted.T @ self.rest
        squares, rest = self._squares(weighted, columns, shared)
        drops, powers = np.zeros((2, columns.shape[1] // group))
        for g in range(len(drops)):
            own = slice(g * group, (g + 1) * group)
            square, left = squares[own, own], rest[own, own]
            seen = np.all(np.diag(left) > IMITATED * np.diag(square)) and np.all(np.diag(left) > NOTHING)
            if np.all(np.isfinite(left)) and seen:
                powers[g] = max(float(np.linalg.eigvalsh(left)[0]), 0.0)
                # Sine and cosine of an order may look alike where the axis hardly turns.
                amounts = -np.linalg.pinv(left, rcond=1e-12, hermitian=True) @ slope[own]
                if signed or group > 1 or amounts[0] > 0.0:
                    drops[g] = -float(amounts @ slope[own])
        return drops, powers

    def beside(self, columns: Array) -> Array:
        """Rest of columns of the whitened residual, (n, k), when everything fitted gives way to them, weights as they stand."""
        ways = self.inverse @ self.weighted.transpose_times(columns)[self.used]
        return columns - np.stack([self._residual_change(way) for way in ways.T], axis=1)

    def predicted_residual(self, change: Array, step: Array) -> Array:
        """The residual to first order, (n,), with a change of it and the step of everything fitted that :meth:`best` answers it with."""
        return self.residual + change + self._residual_change(step[self.moving] * self.norms)

    def information(self, columns: Array) -> Array:
        """Fisher information on amounts of columns beside everything fitted, weights as they stand, (n, k) -> (k, k)."""
        weighted, shared = columns * self.weights[:, None], self.weighted.transpose_times(columns)[self.used]
        return self._squares(weighted, columns, shared)[1]

    def _squares(self, weighted: Array, columns: Array, shared: Array) -> tuple[Array, Array]:
        """Products of columns with each other, and what is left of them beside everything fitted; (k, k) each."""
        squares = weighted.T @ columns
        return squares, squares - shared.T @ self.inverse @ shared

    def best(self, change: Array | None = None, columns: Array | None = None) -> Near:
        """The minimum beside a change c of the residual, (n,), and columns C of it, (n, k)."""
        start = self.residual if change is None else self.residual + change
        own = np.zeros((len(start), 0)) if columns is None else columns
        sizes = np.linalg.norm(own, axis=0)
        right = np.ascontiguousarray(np.column_stack((start, own / np.maximum(sizes, 1e-300))))
        if not np.all(np.isfinite(right)):  # no motion of the other bodies follows from these values
            return Near(np.inf, np.zeros(own.shape[1]), np.zeros(self.unknowns))
        every = np.ones((len(self.count), right.shape[1]), dtype=np.bool_)
        cross = _products(self.starts, self.active, self.jacobian.columns, right)
        square = _products(self.starts, every, right, right)
        p, k = self.jacobian.columns.shape[1], own.shape[1]
        system = np.zeros((len(self.count), p + k, p + k))
        system[:, :p, :p] = self.products
        system[:, :p, p:] = cross[:, :, 1:]
        system[:, p:, :p] = cross[:, :, 1:].transpose(0, 2, 1)
        system[:, p:, p:] = square[:, 1:, 1:]
        slope = np.concatenate((cross[:, :, 0], square[:, 1:, 0]), axis=1)
        return self._minimum(system, slope, square[:, 0, 0], sizes)

    def _minimum(self, system: Array, slope: Array, square: Array, sizes: Array) -> Near:
        """Reweighted least squares on the sums of products."""
        p = len(self.moving)
        low = np.concatenate((self.low, np.full(len(sizes), -np.inf)))
        high = np.concatenate((self.high, np.full(len(sizes), np.inf)))
        place = np.zeros(p + len(sizes))
        means = square / self.count
        value = _robust(self.count, means)
        for _ in range(PASSES):
            weights = 1.0 / np.maximum(means, 1.0)
            ahead = _bounded_minimum(*self._summed(weights, system, slope), low, high, p)
            acts = self._by_block(ahead)
            pulled = 2.0 * slope + np.matmul(system, acts[:, :, None])[:, :, 0]
            means_ahead = np.maximum((square + np.sum(pulled * acts, axis=1)) / self.count, 0.0)
            better = _robust(self.count, means_ahead)
            gain = value - better
            if not gain > 0.0:
                break
            place, means, value = ahead, means_ahead, better
            if gain < ENOUGH:
                break
        step = np.zeros(self.unknowns)
        step[self.moving] = place[:p] / self.norms
        return Near(value, place[p:] / np.maximum(sizes, 1e-300), step)


def _bounded_minimum(system: Array, slope: Array, low: Array, high: Array, p: int) -> Array:
    """Minimum of a quadratic form with what runs into a bound held there; columns after the first p that say nothing stay 0."""
    place = np.zeros(len(slope))
    free = np.diag(system) > 0.0
    if len(slope) > p:
        inner = system[:p, :p] + 1e-12 * np.diag(np.diag(system)[:p])
        left = np.diag(system)[p:] - np.einsum("ij,ij->j", system[:p, p:], np.linalg.solve(inner, system[:p, p:]))
        free[p:] &= left > IMITATED * np.diag(system)[p:]
    for _ in range(3):
        index = np.flatnonzero(free)
        held = system[np.ix_(index, ~free)] @ place[~free]
        own = system[np.ix_(index, index)]
        place[index] = np.linalg.solve(own + 1e-12 * np.diag(np.diag(own)), -slope[index] - held)
        outside = free & ((place < low) | (place > high))
        if not outside.any():
            break
        place = np.clip(place, low, high)
        free &= ~outside
    return np.asarray(np.clip(place, low, high))


def _robust(count: Array, means: Array) -> float:
    """O of the module."""
    return float(np.sum(count * np.where(means < 1.0, means, 1.0 + np.log(np.maximum(means, 1.0)))))


def _products(starts: IntArray, active: BoolArray, left: Array, right: Array) -> Array:
    """leftᵀ right of every block, (blocks, left columns, right columns).   active : (blocks, left columns), those that are not zero."""
    shape = (left.shape[1], right.shape[1])
    out = np.zeros((len(starts) - 1, *shape))
    _sum_products(starts, active, left, right, np.zeros(shape[0], dtype=np.int64), np.zeros(shape), out)
    return out


@compiled
def _sum_products(starts: IntArray, active: BoolArray, left: Array, right: Array, used: IntArray, sums: Array, out: Array) -> None:
    width = right.shape[1]
    for b in range(starts.shape[0] - 1):
        count = 0
        for i in range(left.shape[1]):
            if active[b, i]:
                used[count] = i
                count += 1
        for i in range(count):
            for j in range(width):
                sums[i, j] = 0.0
        for n in range(starts[b], starts[b + 1]):
            for i in range(count):
                factor = left[n, used[i]]
                for j in range(width):
                    sums[i, j] += factor * right[n, j]
        for i in range(count):
            for j in range(width):
                out[b, used[i], j] = sums[i, j]
