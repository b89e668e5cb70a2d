"""Eight neighbours in one register, against numpy."""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import in_lanes
from beltcomm.simulate.kernels.learning import learn
from beltcomm.simulate.kernels.vectors import LANES, aligned_zeros, at, eight, put
from beltcomm.simulate.kernels.writer import _modules_of


@in_lanes
def _polynomial(a: Array, b: Array, out: Array) -> None:
    total = eight(1.0)
    for row in range(0, a.shape[0] * LANES, LANES):
        total = total + at(a, row) * at(b, row) - 0.5 * at(b, row) * 3.0 / (at(a, row) + eight(2.0))
    put(out, LANES, total)


def test_every_operation_is_that_of_each_neighbour() -> None:
    random = np.random.default_rng(3)
    a, b = random.random((2, 5, LANES))
    out = aligned_zeros(3, LANES)
    assert out.ctypes.data % (8 * LANES) == 0
    assert not out.any()
    _polynomial(a, b, out)
    right = 1.0 + (a * b - 1.5 * b / (a + 2.0)).sum(axis=0)
    np.testing.assert_allclose(out[1], right, rtol=1e-14)
    assert not out[[0, 2]].any()


def test_a_kernel_knows_what_its_laws_are_made_of() -> None:
    """Machine code of a kernel is kept under a hash of them: also of what stands behind an operation of vectors."""
    assert {"beltcomm.simulate.kernels.learning", "beltcomm.simulate.kernels.vectors"} <= _modules_of(learn)
