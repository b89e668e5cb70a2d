"""A Jacobian whose last unknowns, a start offset of each segment, act on the rows of their own segment alone.

    J = (A, diag(b_1, ..., b_m)),   A : (n, k),   b_i : the rows of segment i

Written out it would grow with the square of the number of records, and sums of its products with the cube.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array


@dataclass(frozen=True)
class ArrowheadJacobian:
    """Jacobian with shared columns and one border column per segment.

    Attributes
    ----------
    columns : ndarray (n, k + 1)
        A and b.
    ends : ndarray (m + 1,) of int
        Rows between which the segments lie; (1,) where none has an unknown of its own.
    """

    columns: Array
    ends: NDArray[np.intp]

    @property
    def own(self) -> int:
        """Number of unknowns that all segments share, k."""
        return int(self.columns.shape[1]) - 1

    def weighted_rows(self, weights: Array) -> ArrowheadJacobian:
        """Every row times its weight, (n,)."""
        return ArrowheadJacobian(self.columns * weights[:, None], self.ends)

    def times(self, y: Array) -> Array:
        """J y, (k + m,) -> (n,), of the shared unknowns, then one for each segment."""
        moved = self.columns[:, :-1] @ y[: self.own]
        for i, here in enumerate(self.segments()):
            moved[here] += self.columns[here, -1] * y[self.own + i]
        return np.asarray(moved)

    def transpose_times(self, right: Array) -> Array:
        """Jᵀ right, (n,) -> (k + m,) or (n, c) -> (k + m, c)."""
        border = [self.columns[here, -1] @ right[here] for here in self.segments()]
        return np.concatenate((self.columns[:, :-1].T @ right, np.reshape(border, (len(border), *right.shape[1:]))))

    def information(self) -> Array:
        """Jᵀ J, (k + m, k + m)."""
        inner = self.columns[:, :-1].T @ self.columns[:, :-1]
        edges = [self.columns[here].T @ self.columns[here, -1] for here in self.segments()]
        return arrowhead(inner, np.reshape(edges, (len(edges), self.own + 1)))

    def norms(self) -> Array:
        """Lengths of the columns of J, (k + m,)."""
        border = [float(np.linalg.norm(self.columns[here, -1])) for here in self.segments()]
        return np.concatenate((np.linalg.norm(self.columns[:, :-1], axis=0), np.array(border)))

    def segments(self) -> list[slice]:
        """Rows of each segment that has an unknown of its own."""
        return [slice(int(a), int(b)) for a, b in pairwise(self.ends)]


def arrowhead(inner: Array, edges: Array) -> Array:
    """The whole symmetric matrix from its corner and its border.

    Parameters
    ----------
    inner, edges : ndarray, (k, k) and (m, k + 1)
        The corner, and the rows of the border with their diagonal.

    Returns
    -------
    ndarray, (k + m, k + m)
        Zero between the segments.
    """
    k, m = len(inner), len(edges)
    whole = np.zeros((k + m, k + m))
    whole[:k, :k] = inner
    whole[k:, :k], whole[:k, k:] = edges[:, :k], edges[:, :k].T
    whole[np.arange(k, k + m), np.arange(k, k + m)] = edges[:, k]
    return whole
