"""Rows that are missing, told by the motion, and a motion that is rough by itself."""

from __future__ import annotations

import numpy as np

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
