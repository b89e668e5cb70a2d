"""Torque and motion that belong together, and motions that say too little about it."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.arrays import Array
from beltcomm.recording.belonging import belonging

T_S = 1e-3 * np.arange(6000)


def motion(seed: int) -> tuple[Array, Array]:
    """Torque of a motor whose inertia is 1 kg m², and its angle, rad."""
    torque = np.repeat(np.random.default_rng(seed).standard_normal(300), 20)
    speed = 1e-3 * np.cumsum(torque)
    return torque, 1e-3 * np.cumsum(speed - speed.mean())


@pytest.mark.parametrize("seed", range(4))
def test_a_motion_of_a_few_steps_of_the_encoder_is_not_judged(seed: int) -> None:
    """A coarse encoder made a healthy axis that was shaken softly look like one of another time."""
    torque, angle = motion(seed)
    step = float(np.ptp(angle)) / 3.0
    assert belonging(T_S, torque, step * np.round(angle / step)) is None
    found = belonging(T_S, torque, angle)
    assert found is not None
    assert found.consistent


def test_more_steps_are_judged() -> None:
    _, angle = motion(1)
    other, _ = motion(2)
    step = float(np.ptp(angle)) / 300.0
    found = belonging(T_S, other, step * np.round(angle / step))
    assert found is not None
    assert not found.consistent


@pytest.mark.parametrize("seed", range(4))
def test_a_motion_within_the_noise_of_its_angle_is_not_judged_and_one_above_it_is(seed: int) -> None:
    """A quiet excitation behind an encoder with two counts of noise was told to be of another time."""
    (torque, angle), (other, _) = motion(seed), motion(seed + 100)
    noise = np.random.default_rng(seed).standard_normal(len(angle))
    span = float(np.ptp(angle))
    assert belonging(T_S, torque, np.round(angle * 4.0 / span + 2.0 * noise)) is None
    found = belonging(T_S, other, np.round(angle * 400.0 / span + 2.0 * noise))
    assert found is not None
    assert not found.consistent


def one_stroke(begin_s: float, seconds: float) -> tuple[Array, Array]:
    """A single stroke with friction, its torque read in coarse steps: no eighth of the record holds more than one acceleration."""
    acceleration = 30.0 * (np.abs(T_S - begin_s) < 0.2) - 30.0 * (np.abs(T_S - begin_s - seconds) < 0.2)
    speed = 1e-3 * np.cumsum(acceleration)
    torque = acceleration + 4.0 * (speed > 1e-6)
    return 5.0 * np.round(torque / 5.0), 1e-3 * np.cumsum(speed)


@pytest.mark.parametrize(("begin_s", "seconds"), [(1.0, 1.5), (1.1, 3.0), (2.6, 1.5), (0.4, 3.1)])
def test_one_stroke_is_judged_by_all_of_it(begin_s: float, seconds: float) -> None:
    """Healthy moves of a log were left out as of another time: of the accelerations that judged, none had made the numbers."""
    torque, angle = one_stroke(begin_s, seconds)
    found = belonging(T_S, torque, angle)
    assert found is not None
    assert found.consistent


@pytest.mark.parametrize("late", [-700, 500, 1300])
def test_a_stroke_and_the_torque_of_another_time_are_told(late: int) -> None:
    torque, angle = one_stroke(2.0, 1.6)
    found = belonging(T_S, np.roll(torque, late), angle)
    assert found is not None
    assert not found.consistent
