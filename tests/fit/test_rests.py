"""A motor that sticks for part of a sample: how it rests and breaks away is worked out from the torque that is left for friction."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.fit.residual.reversals import _rest
from beltcomm.fit.residual.segment import segments
from identify.records import NOISE_NM, PERIOD_S, STEP_RAD, Recorder, true_model
from truth.rigs import nominal

STEP_S, LEVEL = 1e-3 / 16, 1500.0  # s; friction over inertia, rad/s²


def stop_and_go(side: float, stops_s: float, rests_s: float, *, through: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speed at the fine points, torque left for friction over its level, and the friction's direction, means over each fine step.

    A motor comes to standstill at 3000 rad/s², rests on 0.4 of the friction that there is, and breaks away with 2000 rad/s² on the same
    side, or ``through`` on the other.
    """
    t = STEP_S * np.arange(160)
    goes_s, on = stops_s + rests_s, -side if through else side
    omega = side * 3000.0 * np.maximum(stops_s - t, 0.0) + on * 2000.0 * np.maximum(t - goes_s, 0.0)
    moving, going = (np.clip((x - t[:-1]) / STEP_S, 0.0, 1.0) for x in (stops_s, goes_s))
    torque = side * (1.0 - 3000.0 / LEVEL) * moving + 0.4 * on * (going - moving) + on * (1.0 + 2000.0 / LEVEL) * (1.0 - going)
    friction = side * moving + 0.4 * on * (going - moving) + on * (1.0 - going)
    return omega, torque, friction


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("through", [False, True])
@pytest.mark.parametrize(
    ("stops_s", "rests_s"), [(48 * STEP_S, 16 * STEP_S), (48.3 * STEP_S, 15.7 * STEP_S), (48.9 * STEP_S, 0.1 * STEP_S)]
)
def test_friction_of_a_motor_that_rests_is_what_holds_it(side: float, through: bool, stops_s: float, rests_s: float) -> None:
    omega, left, friction = stop_and_go(side, stops_s, rests_s, through=through)
    slow = np.abs(omega) < 0.5
    doubtful = slow | np.roll(slow, 1) | np.roll(slow, -1)
    found = np.full(len(left), np.nan)
    _rest(omega, left, doubtful, LEVEL * STEP_S, 0.5, found)
    inside = doubtful[:-1] & doubtful[1:]
    np.testing.assert_array_equal(np.isfinite(found), inside)
    # What breaks away within a step is taken at its mean; here the torque turns at a point of the grid.
    np.testing.assert_allclose(found[inside], friction[inside], atol=1e-9)


def test_a_motor_that_is_seen_to_move_between_two_rests_does_not_rest() -> None:
    omega = np.array([3.0, 0.1, 0.0, 0.1, 3.0, 0.3, 0.2, 0.0])
    found = np.full(7, np.nan)
    _rest(omega, np.full(7, 0.2), np.array([True] * 8), 1.0, 0.5, found)
    assert found[2:4] == pytest.approx([0.2, 0.2]), "it has come to rest"
    assert found[4] == 1.0


def test_the_path_of_a_motor_that_sticks_is_that_of_the_independent_simulator() -> None:
    """Between the samples, against the truth stepped sixteen times as often; with friction that only chatters there it is 150 urad off."""
    record = Recorder(noise_nm=0.0, counts=2**34, delay_s=0.0).shaken(nominal("g_a"), 0.28, 2)
    plant = nominal("g_a")
    model = true_model(plant)
    (piece,) = segments(record, model, STEP_RAD, NOISE_NM, fitted=True, reversals=True)
    assert record.torque_setpoint is not None
    path = [plant.position_rad]
    for torque in record.torque_setpoint[:-1]:
        for _ in range(piece.motion.substeps):
            plant.step(float(torque), PERIOD_S / piece.motion.substeps)
            path.append(plant.position_rad)
    assert np.mean(~piece.keep[600:]) > 0.1, "samples in which it may have stuck"
    off = (piece.motion.theta - piece.motion.theta[0]) - (np.array(path) - path[0])
    assert np.abs(off).max() < 6e-5
    assert np.sqrt(np.mean(off**2)) < 4e-6
