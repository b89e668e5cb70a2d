"""How sure the parameters of a model are together."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import UsageError


@dataclass(frozen=True)
class Covariance:
    """Covariance of fitted parameters, without regard to bounds, which their intervals know of: else no sum would be known.

    Attributes
    ----------
    names : tuple of str
        Full names of k parameters.
    matrix : ndarray (k, k)
        In their units.
    freedom : float
        Degrees of freedom, Student; inf is normal.
    """

    names: tuple[str, ...]
    matrix: Array
    freedom: float

    def without(self, names: Collection[str]) -> Covariance:
        """Covariance of the parameters that are left."""
        at = [i for i, name in enumerate(self.names) if name not in names]
        return Covariance(tuple(self.names[i] for i in at), self.matrix[np.ix_(at, at)], self.freedom)

    def of(self, names: Sequence[str]) -> Array:
        """Covariance matrix in another order, (n, n); 0 for a parameter that is not among them."""
        whole, at = np.zeros((len(names), len(names))), [i for i, name in enumerate(names) if name in self.names]
        own = [self.names.index(names[i]) for i in at]
        whole[np.ix_(at, at)] = self.matrix[np.ix_(own, own)]
        return whole

    def correlation(self, names: Sequence[str]) -> Array:
        """Correlation matrix in another order, (n, n); 0 for a parameter that is not among them."""
        matrix = self.of(names)
        deviation = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        return np.asarray(matrix / np.outer(deviation, deviation))

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary for YAML: the lower triangle, row by row."""
        rows = [[float(value) for value in row[: i + 1]] for i, row in enumerate(self.matrix)]
        return {"names": list(self.names), "rows": rows, "freedom": None if math.isinf(self.freedom) else float(self.freedom)}


def covariance_from_dict(data: Mapping[str, Any] | None) -> Covariance | None:
    """Inverse of :meth:`Covariance.to_dict`; None for None.

    Parameters
    ----------
    data : mapping or None
        As read from YAML or JSON.

    Raises
    ------
    UsageError
        For a triangle of another size or of what is no number.
    """
    if data is None:
        return None
    names, rows = tuple(map(str, data["names"])), data["rows"]
    if [len(row) for row in rows] != list(range(1, len(names) + 1)):
        raise UsageError(f"the covariance of {len(names)} parameters has rows of {', '.join(str(len(row)) for row in rows) or 'none'}")
    lower = np.zeros((len(names), len(names)))
    for i, row in enumerate(rows):
        lower[i, : i + 1] = row
    matrix = lower + lower.T - np.diag(np.diag(lower))
    freedom = math.inf if data.get("freedom") is None else float(data["freedom"])
    if not (np.all(np.isfinite(matrix)) and np.all(np.diag(matrix) >= 0.0) and freedom > 0.0):
        raise UsageError("the covariance holds what is no finite number, a variance below 0, or no degrees of freedom")
    return Covariance(names, matrix, freedom)
