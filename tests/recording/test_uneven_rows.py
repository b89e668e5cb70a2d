"""Rows that are missing, told by the motion, and a motion that is rough by itself; the sample period, whatever the stamps are like."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.recording.checks import long_steps, usual_step
from beltcomm.recording.sampling import uneven_rows

ROWS, PERIOD_S, COUNT_RAD = 8000, 5e-4, 1e-5


def position_of(steps: np.ndarray) -> np.ndarray:
    """In whole counts."""
    return COUNT_RAD * np.round(np.cumsum(steps))


def test_lost_rows_of_a_smooth_motion_are_found_and_those_of_a_rough_one_are_not_made_up() -> None:
    """Steps that differ from their neighbours by anything up to two thirds lose no row; steps of two between equal ones do."""
    random = np.random.default_rng(4)
    t_s = PERIOD_S * np.arange(ROWS)
    smooth = 300.0 * np.sin(2.0 * np.pi * 0.7 * t_s + 0.3)
    lost = np.array([700, 3500, 6300])
    with_lost = smooth.copy()
    with_lost[lost] *= 2.0
    assert set(uneven_rows(t_s, position_of(with_lost)).missing) == set(lost)

    shaken = smooth.copy()
    shaken[5::10] *= random.uniform(0.35, 1.65, len(shaken[5::10]))
    found = uneven_rows(t_s, position_of(shaken))
    assert found.judged > 500
    assert not len(found.missing)
    assert not len(found.repeated)


def test_a_motor_that_swings_from_one_side_to_the_other_repeats_no_row() -> None:
    """As one comes to rest on a stiff belt, sampled some five times in a swing: a small step between four equal ones, twice."""
    t_s = PERIOD_S * np.arange(ROWS)
    steps = 300.0 * np.sin(2.0 * np.pi * 0.7 * t_s + 0.3)
    for row in (2000, 5000):
        steps[row - 4 : row + 8] = [196, -38, 22, 49, -124, -110, -13, -109, -113, 38, 19, -23]
    found = uneven_rows(t_s, position_of(steps))
    assert found.judged > 1000
    assert not len(found.repeated)


def test_swings_of_five_rows_lose_none() -> None:
    """An axis that is shaken on its resonance at 2 kHz: alike in the middle of a swing, one of its steps is the largest."""
    t_s, steps = PERIOD_S * np.arange(ROWS), np.zeros(ROWS)
    for row in (1500, 4500, 6500):
        steps[row : row + 11] = [150, 216, 533, 1300, 1156, 1971, 1210, 1150, 42, -881, -815]
        steps[row + 11 : row + 23] = -np.cumsum(steps[row : row + 11])[-1] / 12
    found = uneven_rows(t_s, position_of(steps))
    assert found.judged < 30
    assert not len(found.missing)


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
