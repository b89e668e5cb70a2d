"""What the records themselves tell of their noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.noise.angle import apparent_step
from beltcomm.recording import Recording
from identify.records import NOISE_NM, STEP_RAD, Recorder
from truth.rigs import draw


def noisy(record: Recording, counts: float) -> Recording:
    """The angle with a noise before it was rounded; it is rounded twice, which adds another twelfth."""
    angle = record.position + STEP_RAD * counts * np.random.default_rng(3).normal(size=len(record.position))
    return replace(record, position=STEP_RAD * np.floor(angle / STEP_RAD))


@pytest.mark.parametrize("counts", [1.0, 3.0])
def test_noise_of_the_angle_counts_as_a_larger_step(counts: float) -> None:
    stroke = Recorder(1).stroked(draw("g_b", np.random.default_rng(1)), (0.1, 0.3), 1.0)
    assert apparent_step([stroke], STEP_RAD, NOISE_NM) == STEP_RAD
    true = STEP_RAD * math.sqrt(2.0 + 12.0 * counts**2)
    assert apparent_step([noisy(stroke, counts)], STEP_RAD, NOISE_NM) == pytest.approx(true, rel=0.15)


def test_a_motion_that_is_shaken_all_the_time_is_no_noise_of_its_angle() -> None:
    """Excited without a rest, an angle is as rough as fourteen counts of noise: so a healthy axis left 0.19 times the noise.

    What no torque moves of it is noise there, too: an axis that follows its command, noise and all, was taken for one of 1435 counts.
    """
    record = Recorder(2).shaken(draw("g_b", np.random.default_rng(2)), 0.3, 4)
    shaken = slice(300, 4300)
    part = replace(
        record,
        t_s=record.t_s[shaken],
        torque=record.torque[shaken],
        torque_setpoint=None,
        position=record.position[shaken],
        cart_position_m=None,
    )
    assert apparent_step([part], STEP_RAD, NOISE_NM) == STEP_RAD
    true = STEP_RAD * math.sqrt(2.0 + 12.0 * 14.0**2)
    assert apparent_step([noisy(part, 14.0)], STEP_RAD, NOISE_NM) == pytest.approx(true, rel=0.15)
