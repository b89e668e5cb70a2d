"""A step of the angle that no torque explains, and one that a torque explains which changed within the sample."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.fit.residual.encoder_jumps import CERTAIN, largest_step
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar

SAMPLE_S, INERTIA, ROWS, AT, FINE = 1e-3, 1e-4, 2000, 1200, 8


@pytest.mark.parametrize(("slip", "answer"), [(False, 1.5), (False, -1.5), (True, 1.5), (True, -1.5), (True, 0.0)])
def test_a_torque_that_changes_within_a_sample_is_no_jump_of_the_encoder(slip: bool, answer: float) -> None:
    """One that slips is a jump, whatever the loop answers."""
    rng = np.random.default_rng(2)
    torque = 0.02 * np.sin(np.arange(ROWS * FINE) / 320.0)
    torque[AT * FINE + 1 :] += answer  # an eighth of a sample behind its row, in which it is not read yet
    torque[(AT + 4) * FINE :] -= answer
    speed = np.cumsum(torque) * SAMPLE_S / FINE / INERTIA
    angle = np.concatenate(([0.0], np.cumsum(speed)[:-1])) * SAMPLE_S / FINE
    record = Recording(
        name="trace",
        t_s=SAMPLE_S * np.arange(ROWS),
        torque=torque[::FINE] + rng.normal(0.0, 2e-3, ROWS),
        torque_setpoint=None,
        position=angle[::FINE] + np.where(np.arange(ROWS) > AT, 6e-3 if slip else 0.0, 0.0),
        cart_position_m=None,
        sidecar=Sidecar("trajectory"),
    )
    found = largest_step(record, INERTIA, 1e-4, CERTAIN)
    assert (found is not None) == slip
    assert found is None or abs(found[0] - (AT + 1)) <= 1


def test_a_glitch_of_two_samples_is_no_torque_although_the_loop_answers() -> None:
    """The steps on both sides are off alike, and between them the torque changes suddenly, but their neighbours are off, too."""
    rng = np.random.default_rng(3)
    torque = 0.02 * np.sin(np.arange(ROWS) / 40.0) + rng.normal(0.0, 2e-3, ROWS)
    speed = np.cumsum(torque) * SAMPLE_S / INERTIA
    angle = np.concatenate(([0.0], np.cumsum(speed)[:-1])) * SAMPLE_S
    angle[AT : AT + 2] += 5e-3
    torque[AT + 1 :] -= 0.2
    record = Recording(
        name="trace",
        t_s=SAMPLE_S * np.arange(ROWS),
        torque=torque,
        torque_setpoint=None,
        position=angle,
        cart_position_m=None,
        sidecar=Sidecar("trajectory"),
    )
    assert largest_step(record, INERTIA, 1e-4, CERTAIN) is not None
