"""A Jacobian with a border against the same matrix written out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from beltcomm.fit.likelihood.arrowhead import ArrowheadJacobian


@pytest.mark.parametrize("lengths", [(5, 0, 7, 3), ()])
def test_it_does_what_the_matrix_written_out_does(lengths: tuple[int, ...]) -> None:
    """A stretch without rows has an unknown too; an axis without a carriage has none of any stretch."""
    rng, rows = np.random.default_rng(1), sum(lengths) or 15
    columns, ends = rng.normal(size=(rows, 4)), np.cumsum((0, *lengths))
    dense = np.zeros((rows, 3 + len(lengths)))
    dense[:, :3] = columns[:, :3]
    for i, (first, last) in enumerate(pairwise(ends)):
        dense[first:last, 3 + i] = columns[first:last, 3]
    weights, y = rng.uniform(0.5, 1.0, rows), rng.normal(size=3 + len(lengths))
    found, dense = ArrowheadJacobian(columns, ends).weighted_rows(weights), dense * weights[:, None]
    np.testing.assert_allclose(found.times(y), dense @ y, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.information(), dense.T @ dense, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.norms(), np.linalg.norm(dense, axis=0), rtol=1e-12)
    for right in (rng.normal(size=rows), rng.normal(size=(rows, 2))):
        np.testing.assert_allclose(found.transpose_times(right), dense.T @ right, rtol=1e-12, atol=1e-12)
