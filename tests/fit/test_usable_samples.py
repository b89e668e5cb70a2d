"""Slow motion of which friction is known: a motor that cogs goes on unevenly, one that sticks or turns does not go on."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.fit.residual.usable_samples import CREEP_S, creeping_samples, samples_between_counts, shaken_samples, sparse_creep

PERIOD_S, STEP_RAD = 1e-3, 2e-3
TIME_S = np.arange(0.0, 2.0, PERIOD_S)
INSIDE = slice(2 * round(CREEP_S / PERIOD_S), -2 * round(CREEP_S / PERIOD_S))


def counted(angle: np.ndarray) -> np.ndarray:
    """Angle in whole steps of the encoder."""
    return np.floor(angle / STEP_RAD) * STEP_RAD


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_even_creep_counts_with_an_even_speed(side: float) -> None:
    creeps, even = creeping_samples(counted(side * 0.2 * TIME_S), PERIOD_S, STEP_RAD)
    assert creeps[INSIDE].all()
    assert even[INSIDE].all()


def test_a_cogging_motor_goes_on_unevenly() -> None:
    creeps, even = creeping_samples(counted(1.0 * TIME_S + 0.03 * np.sin(2.0 * np.pi * 4.0 * TIME_S)), PERIOD_S, STEP_RAD)
    assert creeps[INSIDE].mean() > 0.95
    assert even[INSIDE].mean() < 0.6


def test_a_motor_that_stops_in_between_may_be_stuck() -> None:
    """Evenly on its way but for one stop as long as two parts, so that one of them lies in it."""
    stopped = np.where(TIME_S < 1.0, TIME_S, np.maximum(TIME_S - CREEP_S, 1.0))
    creeps, _ = creeping_samples(counted(0.5 * stopped), PERIOD_S, STEP_RAD)
    assert not creeps[np.abs(TIME_S - 1.0 - 0.5 * CREEP_S) < 0.5 * CREEP_S].any()
    assert creeps[INSIDE][:500].all()


def test_a_motor_about_to_turn_does_not_count() -> None:
    creeps, _ = creeping_samples(counted(-4.0 * (TIME_S - 1.0) ** 2), PERIOD_S, STEP_RAD)
    assert not creeps[np.abs(TIME_S - 1.0) < 0.9 * CREEP_S].any()


def test_an_angle_that_swings_between_its_counts_tells_no_friction() -> None:
    slow = 0.1 * TIME_S
    swings = slow + STEP_RAD * np.sin(2.0 * np.pi * 50.0 * TIME_S)
    assert samples_between_counts(swings, counted(slow), STEP_RAD)[INSIDE].mean() > 0.95
    assert not samples_between_counts(slow, counted(slow), STEP_RAD).any()
    lively = slow + 20.0 * STEP_RAD * np.sin(2.0 * np.pi * 50.0 * TIME_S)
    assert not samples_between_counts(lively, counted(lively), STEP_RAD).any()


def test_a_setpoint_that_jumps_at_every_count_shakes_a_creeping_motor() -> None:
    """Its speed of 0.2 rad/s is stopped by a jump of 0.1 N m over a sample; the same motor at 2 rad/s hardly feels it."""
    inertia, setpoint = 5e-4, np.where(np.arange(len(TIME_S)) % 10 == 0, 0.1, 0.0)
    assert shaken_samples(counted(0.2 * TIME_S), setpoint, inertia, PERIOD_S)[INSIDE].all()
    assert not shaken_samples(counted(2.0 * TIME_S), setpoint, inertia, PERIOD_S)[INSIDE].any()
    assert not shaken_samples(counted(0.2 * TIME_S), np.full(len(TIME_S), 0.1), inertia, PERIOD_S).any()


def test_of_an_even_creep_that_counts_in_part_nothing_counts() -> None:
    """Which samples count the steps of the encoder say then; a motor that vibrates on its way, as under an excitation, is another case."""
    counts_in_part, all_count = np.arange(len(TIME_S)) % 3 == 0, np.ones(len(TIME_S), dtype=bool)
    _, creeping = creeping_samples(counted(0.2 * TIME_S), PERIOD_S, STEP_RAD)
    assert sparse_creep(creeping, counts_in_part, PERIOD_S)[INSIDE].all()
    assert not sparse_creep(creeping, all_count, PERIOD_S)[INSIDE].any()
    _, vibrating = creeping_samples(counted(0.2 * TIME_S + 3.0 * STEP_RAD * np.sin(2.0 * np.pi * 15.0 * TIME_S)), PERIOD_S, STEP_RAD)
    assert not sparse_creep(vibrating, counts_in_part, PERIOD_S).any()
