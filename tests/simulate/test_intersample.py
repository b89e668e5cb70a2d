"""A torque that changes inside the sampling period: means of cells and of the triangle are those of the torque itself."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.simulate.imperfect import CELLS, Intersample

PARTS = 25


def course(seed: int = 1) -> np.ndarray:
    """A torque that is another one in each cell of four periods, as it is over time; (4, CELLS*PARTS)."""
    return np.repeat(np.random.default_rng(seed).normal(size=(4, CELLS)), PARTS, axis=1)


def spread_of(torque: np.ndarray) -> tuple[np.ndarray, Intersample]:
    cells = torque.reshape(len(torque), CELLS, PARTS).mean(axis=2)
    means = cells.mean(axis=1)
    return means, Intersample(cells - means[:, None])


@pytest.mark.parametrize("per_sample", [2, 4, 16, CELLS])
def test_means_of_cells_are_those_of_the_torque(per_sample: int) -> None:
    torque = course()
    means, inside = spread_of(torque)
    assert inside.cells(means, per_sample) == pytest.approx(torque.reshape(4 * per_sample, -1).mean(axis=1), abs=1e-12)


def test_the_mean_with_the_triangular_weight_is_that_of_the_torque() -> None:
    """∫_0^1 u x[n-1](u) du + ∫_0^1 (1-u) x[n](u) du, by sums over the middle of each piece."""
    torque = course()
    means, inside = spread_of(torque)
    u = (np.arange(CELLS * PARTS) + 0.5) / (CELLS * PARTS)
    exact = [np.mean(u * torque[n - 1]) + np.mean((1.0 - u) * torque[n]) for n in (1, 2)]
    held = 0.5 * (means[:2] + means[1:3])
    more = inside.triangular()
    assert held + more[1:3] == pytest.approx(exact, abs=1e-12)
    assert more[[0, 3]] == pytest.approx(0.0, abs=0.0)


def test_a_torque_that_switches_at_a_share_of_the_period_changes_the_triangle_by_half_the_shares() -> None:
    """φ (1 - φ)/2 of the step more, from the rows before; of two periods with one step in each."""
    share, step = 0.25, np.array([0.4, -0.2, 0.3])
    torque = np.where((np.arange(CELLS) + 0.5) / CELLS < share, 0.0, step[:, None])  # from 0 to the step
    means, inside = torque.mean(axis=1), Intersample(torque - torque.mean(axis=1)[:, None])
    assert means == pytest.approx((1.0 - share) * step)
    more = 0.5 * share * (1.0 - share) * (step[0] - step[1])
    assert inside.triangular()[1] == pytest.approx(more, abs=1e-12)


@pytest.mark.parametrize("per_sample", [4, 10, 12, CELLS, 50])
def test_cells_of_any_number_have_the_same_integral(per_sample: int) -> None:
    course = np.random.default_rng(per_sample).normal(size=(3, CELLS))
    torque = course.mean(axis=1)
    found = Intersample(course - torque[:, None]).cells(torque, per_sample).reshape(3, per_sample)
    fine = np.repeat(course, per_sample, axis=1).reshape(3, per_sample, CELLS).mean(axis=2)
    assert found == pytest.approx(fine, abs=1e-12)
