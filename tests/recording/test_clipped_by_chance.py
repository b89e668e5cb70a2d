"""A torque whose largest values repeat by chance is not one that was cut off; the readings are made here, by NumPy alone."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.recording.checks import clipped_share

#: Finer than a third of the noise's median deviation: where steps are coarser, values at rest repeat as well, and the check says nothing.
STEPS_NM = (0.3e-3, 0.6e-3)


def reading(seed: int, step_nm: float) -> tuple[np.ndarray, np.ndarray]:
    """A setpoint of slow waves and what is read of it, N m: noise of 6 mN m, rounded."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) * 1e-3
    setpoint = 0.4 * np.sin(2.0 * np.pi * rng.uniform(0.5, 5.0) * t + rng.uniform(0.0, 6.0))
    return setpoint, step_nm * np.round((setpoint + rng.normal(0.0, 6e-3, len(t))) / step_nm)


@pytest.mark.parametrize("step_nm", STEPS_NM)
def test_largest_values_that_repeat_by_chance(step_nm: float) -> None:
    found = [clipped_share(read, setpoint, None) for setpoint, read in (reading(seed, step_nm) for seed in range(300))]
    assert found == [0.0] * 300


def test_three_equal_peaks_under_noise_are_chance() -> None:
    setpoint, read = reading(7, STEPS_NM[1])
    at = int(np.argmin(setpoint))
    read[at - 1 : at + 2] = read.min()
    assert clipped_share(read, setpoint, None) == 0.0


@pytest.mark.parametrize("step_nm", STEPS_NM)
def test_a_setpoint_that_was_cut_off_with_it_is_still_seen(step_nm: float) -> None:
    for seed in range(20):
        setpoint, read = reading(seed, step_nm)
        limit = step_nm * round(0.38 / step_nm)
        cut = np.clip(read, -limit, limit)
        assert clipped_share(cut, np.clip(setpoint, -limit, limit), None) > 0.02
