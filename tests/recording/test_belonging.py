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
