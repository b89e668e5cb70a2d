"""Laws for eight values in a register, against the same laws for one; those registers, against numpy."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from beltcomm.arrays import Array
from beltcomm.compiled import in_lanes
from beltcomm.effects._corner import ramp, ramp_slope
from beltcomm.effects.presliding import _friction_share
from beltcomm.effects.quadratic_drag import _force as drag
from beltcomm.effects.travel_ripple import _force as ripple
from beltcomm.simulate.kernels.branchless import in_vectors
from beltcomm.simulate.kernels.learning import learn
from beltcomm.simulate.kernels.pieces import stick_or_slide
from beltcomm.simulate.kernels.vectors import LANES, aligned_zeros, at, eight, put
from beltcomm.simulate.kernels.writer import _modules_of


def nested(x: float, y: float) -> float:
    """Every way in which a law may choose."""
    z = min(x, 0.5) + max(y, -0.5)
    if x < 0.0 or y == 1.0:
        w = z * y
        if w > 1.0:
            return w
        return -w
    elif y <= 0.0:
        return math.pow(abs(y), 1.5) * math.exp(-x)
    return z if x != y else math.cos(x)


def looped(x: float) -> float:
    for _ in range(2):
        x *= 2.0
    return x


def set_in_a_branch(x: float) -> float:
    y = 1.0
    if x > 0.0:
        y = 2.0
    return x * y


def overwritten(x: float) -> float:
    y = 1.0
    if x > 0.0:
        y = 2.0 * x
        return y
    return x * y


def both(x: float, y: float) -> float:
    return x if x > 0.0 and y > 0.0 else y


GRID = np.array([-2.0, -0.7, -0.04, 0.0, 0.04, 0.3, 1.0, 2.5])


@pytest.mark.parametrize(
    ("law", "rest"),
    [
        (nested, ()),
        (ramp, ()),
        (ramp_slope, ()),
        (_friction_share, (0.3,)),
        (stick_or_slide, (0.4, 0.1)),
        (drag, (0.0, 3.0)),
        (ripple, (0.0, 0.7, 1.0, 0.5)),
    ],
    ids=["nested", "ramp", "its slope", "turned", "stick or slide", "drag", "ripple"],
)
def test_a_law_says_the_same_of_eight(law: Callable[..., float], rest: tuple[float, ...]) -> None:
    written = in_vectors(law)
    y_of = {ramp: 0.2, ramp_slope: 0.2}
    plain: Callable[..., float] = getattr(law, "py_func", law)

    def call(x: Array, y: Array, more: Array, out: Array) -> None:
        put(out, 0, _with(at(x, 0), at(y, 0), more))

    _with: Any = {
        0: in_lanes(lambda a, b, m: written(a, b)),
        1: in_lanes(lambda a, b, m: written(a, b, m[0])),
        2: in_lanes(lambda a, b, m: written(a, b, m[0], m[1])),
        4: in_lanes(lambda a, b, m: written(a, b, m[0], m[1], m[2], m[3])),
    }[len(rest)]
    kernel = in_lanes(call)
    out, more = aligned_zeros(1, LANES)[0], np.array([*rest, 0.0])
    for y in [y_of[law]] if law in y_of else GRID:
        kernel(GRID, np.full(LANES, y), more, out)
        right = [plain(float(x), float(y), *rest) for x in GRID]
        np.testing.assert_allclose(out, right, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("law", [looped, set_in_a_branch, overwritten])
def test_what_cannot_be_written_without_branches_is_refused(law: Callable[..., float]) -> None:
    with pytest.raises(ValueError, match=f"{law.__name__} cannot be written without branches"):
        in_vectors(law)


def test_both_is_no_alternative_that_vectors_know() -> None:
    with pytest.raises(ValueError, match="`or`"):
        in_vectors(both)


def test_nothing_is_eight_zeros() -> None:
    @in_lanes
    def kernel(out: Array) -> None:
        put(out, 0, -eight(0.0))

    out = np.ones(LANES)
    kernel(out)
    assert not out.any()


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
