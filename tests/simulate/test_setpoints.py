"""Setpoints that come more seldom than the loop runs: against an interpolator written out by hand, for drawn pairs of periods."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.simulate.loop import SetpointGrid


def by_hand(values: np.ndarray, ratio: int) -> np.ndarray:
    """A drive's linear interpolation, loop by loop: a setpoint is reached in the last loop before the next one."""
    at, out = float(values[0]), []
    for value in values:
        step = (value - at) / ratio
        for _ in range(ratio):
            at += step
            out.append(at)
    return np.array(out)


@pytest.mark.parametrize("seed", range(8))
def test_a_loop_reaches_each_setpoint_before_the_next_one_comes(seed: int) -> None:
    random = np.random.default_rng(seed)
    ratio, count = int(random.integers(1, 21)), int(random.integers(5, 60))
    loop_s = float(random.choice([62.5e-6, 2e-4, 4e-4, 1e-3]))
    values = np.cumsum(random.normal(0.0, 1.0, count))
    grid = SetpointGrid(ratio * loop_s, loop_s, count)
    hand = by_hand(values, ratio)
    np.testing.assert_allclose(grid.on_loop(values), hand[: len(grid.on_loop(values))], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(grid.in_loop(values), hand[::ratio], rtol=1e-9, atol=1e-9)
    assert grid.lag_s == pytest.approx((ratio - 1) * loop_s)
    held = grid.zero_order_hold(values)
    np.testing.assert_array_equal(held, np.repeat(values, ratio)[: len(held)])
    ramp = np.arange(len(held), dtype=np.float64)
    np.testing.assert_allclose(grid.at_samples(ramp), ratio * np.arange(count))
    np.testing.assert_array_equal(grid.latest(ramp), ratio * np.arange(count))


def test_where_the_periods_are_one_nothing_is_touched() -> None:
    values, grid = np.arange(5.0), SetpointGrid(1e-3, 1e-3, 5)
    for found in (
        grid.on_loop(values),
        grid.zero_order_hold(values),
        grid.in_loop(values),
        grid.at_samples(values),
        grid.latest(values),
        grid.along(values),
    ):
        assert found is values


def test_a_loop_slower_than_its_setpoints_takes_the_latest() -> None:
    values, grid = np.arange(9.0), SetpointGrid(0.5e-3, 1e-3, 9)
    np.testing.assert_allclose(grid.on_loop(values), [0, 2, 4, 6, 8])
    np.testing.assert_allclose(grid.in_loop(values), values)
