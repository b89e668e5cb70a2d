"""A drive that changes its torque between two samples: found in setpoint and torque, and the model is right again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from beltcomm.fit.within import change_of, taps
from beltcomm.simulate.change import Change
from scipy.signal import lfilter

from beltcomm.axis import load_axis
from beltcomm.identify.final import final_model
from beltcomm.session.delivered import delivered
from identify.records import COUNTS, NOISE_NM, Recorder, true_model
from truth.rigs import draw

AXIS = load_axis("egc-70-600")


def noisy(setpoint: np.ndarray, shares: list[float]) -> np.ndarray:
    """The setpoint through a short filter, with the noise of a drive's torque."""
    return np.asarray(lfilter(shares, [1.0], setpoint)) + np.random.default_rng(2).normal(0.0, NOISE_NM, len(setpoint))


@pytest.fixture(scope="module")
def setpoint() -> np.ndarray:
    return np.repeat(np.random.default_rng(1).choice([-0.2, 0.2], 2000), 2)


@pytest.mark.parametrize(("late", "gain", "share"), [(1, 1.0, 0.57), (2, 1.0, 0.08), (0, 0.8, 0.3), (1, 1.0, 0.95)])
def test_two_neighbouring_periods_share_a_setpoint(setpoint: np.ndarray, late: int, gain: float, share: float) -> None:
    found = taps(setpoint, noisy(setpoint, [*[0.0] * late, gain * (1.0 - share), gain * share]))
    assert found == (late, pytest.approx(gain, rel=0.01), pytest.approx(share, abs=0.005))


@pytest.mark.parametrize("shares", [[0.0, 1.0], [0.0, 0.5, 0.3, 0.2], [0.0, 0.1, 0.1], [0.0, 0.0, -1.0]])
def test_whole_periods_lags_and_other_signs_are_none(setpoint: np.ndarray, shares: list[float]) -> None:
    assert taps(setpoint, noisy(setpoint, shares)) is None


def test_a_setpoint_that_tells_nothing_is_none() -> None:
    times = 1e-3 * np.arange(4000)
    assert taps(np.sin(3.0 * times), noisy(np.sin(3.0 * times), [0.4, 0.6])) is None
    assert taps(np.zeros(4000), noisy(np.zeros(4000), [0.4, 0.6])) is None


def test_means_of_cells_and_of_the_triangle_are_those_of_the_torque_itself() -> None:
    """Against sums over a thousand points of each period of the torque that changes at a third of it."""
    share, torque, before = 1.0 / 3.0, np.array([0.3, -0.1, 0.2, 0.4]), np.array([0.0, 0.5, -0.4, 0.1])
    change, u = Change(share, before), (np.arange(1200) + 0.5) / 1200
    course = torque[:, None] + before[:, None] * ((u < share) - share)
    assert change.cells(torque, 8).reshape(4, 8) == pytest.approx(course.reshape(4, 8, 150).mean(axis=2), abs=1e-12)
    mean = [np.mean(u * course[n - 1]) + np.mean((1.0 - u) * course[n]) for n in (1, 2)]
    held = 0.5 * (torque[:2] + torque[1:3])
    assert held + change.triangular()[1:3] == pytest.approx(mean, abs=1e-6)


def test_an_axis_behind_a_drive_that_switches_between_samples_is_identified() -> None:
    """1.57 ms from setpoint to torque: without the setpoint nobody knows of it, and more than twice the noise is left."""
    plant, recorder = draw("g_b", np.random.default_rng(21)), Recorder(seed=21, delay_s=1.57e-3)
    records = [recorder.shaken(plant, 0.3, 3), recorder.stroked(plant, (0.1, 0.5), 0.2)]
    told = final_model(records, AXIS, COUNTS).fit
    untold = final_model([replace(r, torque_setpoint=None) for r in records], AXIS, COUNTS).fit
    inertia = told.model.parameters["motor.inertia"]
    assert told.misfit < 1.2
    assert untold.misfit > 3.0
    assert inertia.value == pytest.approx(true_model(plant)["motor.inertia"], abs=2.0 * inertia.interval)


def test_what_such_a_drive_delivers_is_all_that_was_asked_for() -> None:
    recorder = Recorder(seed=3, delay_s=1.5e-3)
    found = delivered(recorder.shaken(draw("g_b", np.random.default_rng(3)), 0.3, 2))
    assert found is not None
    assert found.share == pytest.approx(1.0, abs=0.02)
    assert found.sound


def test_a_record_without_a_setpoint_or_with_gaps_is_held() -> None:
    record = Recorder(seed=3, delay_s=1.5e-3).shaken(draw("g_b", np.random.default_rng(3)), 0.3, 2)
    assert change_of(record) is not None
    assert change_of(replace(record, torque_setpoint=None)) is None
    times = record.t_s + 5.0 * (np.arange(len(record.t_s)) > 900)
    assert change_of(replace(record, t_s=times)) is None
