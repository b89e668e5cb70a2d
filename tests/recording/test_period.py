"""The sample period is that of the clock, whatever its stamps are like."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.recording.checks import long_steps, usual_step

Array = NDArray[np.float64]
EVEN = 1e-3 * np.arange(7000)


def jittering(rms_s: float) -> Array:
    return EVEN + np.random.default_rng(3).normal(0.0, rms_s, len(EVEN))


def without(t_s: Array, *rows: int) -> Array:
    return np.delete(t_s, rows)


@pytest.mark.parametrize("rms_s", [2e-5, 1e-4, 1.4e-4])
def test_jitter_does_not_move_the_period(rms_s: float) -> None:
    assert usual_step(jittering(rms_s)) == pytest.approx(1e-3, rel=5e-5)
    assert usual_step(without(jittering(rms_s), *range(3000, 3400))) == pytest.approx(1e-3, rel=2e-4)


def test_even_stamps_give_the_median_step_to_the_last_bit() -> None:
    assert usual_step(EVEN) == float(np.median(np.diff(EVEN)))
    assert usual_step(without(EVEN, *range(100, 6900, 200))) == pytest.approx(1e-3, rel=1e-12)


def test_stamps_that_are_rounded_coarsely() -> None:
    assert usual_step(np.round(np.arange(6000) / 3000.0, 4)) == pytest.approx(1.0 / 3000.0, rel=1e-4)


def test_a_stamp_that_came_late_is_one_long_step_and_jitter_is_none() -> None:
    assert list(long_steps(jittering(1e-4))) == []
    assert list(long_steps(without(EVEN, 50, 200, 201))) == [49, 198]
