"""Screening beside a fitted model: against plain least squares, and with columns that cannot be told apart."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from beltcomm.fit.likelihood.arrowhead import ArrowheadJacobian
from beltcomm.fit.likelihood.local_quadratic import LocalQuadratic
from beltcomm.fit.likelihood.problem import Problem

SAMPLES, BLOCKS = 4000, 20


def beside(seed: int) -> tuple[LocalQuadratic, np.ndarray, np.ndarray]:
    """A fit of two columns to loud noise, all blocks alike: then O is N (1 + ln(rest²/N))."""
    rng = np.random.default_rng(seed)
    known = rng.normal(size=(SAMPLES, 2))
    residual = 3.0 * rng.normal(size=SAMPLES)
    residual -= known @ np.linalg.lstsq(known, residual, rcond=None)[0]
    blocks = np.repeat(np.arange(BLOCKS), SAMPLES // BLOCKS)
    jacobian = ArrowheadJacobian(np.pad(known, ((0, 0), (0, 1))), np.zeros(1, dtype=np.intp))
    problem = SimpleNamespace(
        jacobian=lambda _x: jacobian, low=np.full(2, -9.0), high=np.full(2, 9.0), blocks=blocks, count=np.bincount(blocks).astype(float)
    )
    return LocalQuadratic(cast("Problem", problem), np.zeros(2), residual), known, residual


def test_a_pair_of_columns_promises_what_least_squares_says() -> None:
    near, known, residual = beside(1)
    pair = np.random.default_rng(2).normal(size=(SAMPLES, 2)) + 0.02 * residual[:, None]
    weights = np.repeat(1.0 / np.maximum([np.mean(r**2) for r in residual.reshape(BLOCKS, -1)], 1.0), SAMPLES // BLOCKS)
    root = np.sqrt(weights)[:, None]
    both = np.column_stack((known, pair)) * root
    wanted = residual * root[:, 0]
    left = [np.sum((wanted - c @ np.linalg.lstsq(c, wanted, rcond=None)[0]) ** 2) for c in (known * root, both)]
    # Its weights are those of the blocks after a reweighting, which ends when it gains less than 0.05 nats: a share of 0.05/N of O.
    assert near.rough_gains(pair, 2, True)[0][0] == pytest.approx(left[0] - left[1], rel=1e-3)


@pytest.mark.parametrize("factor", [1.0, -2.0, 0.0])
def test_a_pair_that_looks_alike_promises_what_one_does(factor: float) -> None:
    """Sine and cosine of an order on an axis that hardly turns; a cosine that is not there promises nothing."""
    near, _, residual = beside(1)
    one = np.random.default_rng(3).normal(size=SAMPLES) + 0.02 * residual
    alone = near.rough_gains(one[:, None], 1, True)[0][0]
    together = near.rough_gains(np.stack([one, factor * one], axis=1), 2, True)[0][0]
    assert alone > 1.0
    assert together == pytest.approx(alone if factor else 0.0, rel=1e-6)


def test_an_unknown_of_each_stretch_counts_as_one_of_all_that_is_zero_elsewhere() -> None:
    """Bounds that bind, blocks of unequal loudness, a stretch whose own unknown moves nothing."""
    rng, segments = np.random.default_rng(4), 4
    columns, ends = rng.normal(size=(SAMPLES, 3)), np.linspace(0, SAMPLES, segments + 1).astype(np.intp)
    columns[ends[1] : ends[2], 2] = 0.0
    written_out = np.zeros((SAMPLES, 2 + segments))
    written_out[:, :2] = columns[:, :2]
    for i in range(segments):
        written_out[ends[i] : ends[i + 1], 2 + i] = columns[ends[i] : ends[i + 1], 2]
    blocks = np.repeat(np.arange(BLOCKS), SAMPLES // BLOCKS)
    residual = rng.normal(size=SAMPLES) * rng.uniform(0.5, 3.0, BLOCKS)[blocks] + 0.3 * columns[:, 2]
    bounds = {"low": np.full(2 + segments, -0.2), "high": np.full(2 + segments, 9.0)}
    change, extra = 0.2 * rng.normal(size=SAMPLES), rng.normal(size=(SAMPLES, 2)) + 0.05 * residual[:, None]
    found = []
    for jacobian in (ArrowheadJacobian(columns, ends), ArrowheadJacobian(np.pad(written_out, ((0, 0), (0, 1))), ends[:1])):
        problem = SimpleNamespace(jacobian=lambda _x, j=jacobian: j, blocks=blocks, count=np.bincount(blocks).astype(float), **bounds)
        near = LocalQuadratic(cast("Problem", problem), np.zeros(2 + segments), residual)
        best = near.best(change, extra)
        found.append((near.objective, best.objective, best.amounts, best.step, *near.rough_gains(extra, 2, True), near.rest))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    assert np.any(found[0][3] == -0.2), "a bound binds"
    assert found[0][3][3] == 0.0, "what moves nothing does not move"
