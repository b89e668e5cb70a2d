"""Setpoints that end: what the axis does then, by hand on a rigid one, and what makes it worse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.control import Cascade, Feedforward, Prefilter
from beltcomm.model import load_plant
from beltcomm.simulate.loop import LoopDrive
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import References, StopReaction, predict_stop_out_of_move, total_friction, total_inertia, total_viscous

PERIOD_S = 1e-3
DRIVE = LoopDrive(PERIOD_S, PERIOD_S, 3.1, 65536)
SPEED_M_S, FROM_M = 0.8, 0.1
AT_ONCE = StopReaction(0.0, 0.0, 0.05, 4.0)
MODEL = load_plant("g_a").model
RATIO = MODEL["transmission.ratio"]
FORWARD = Feedforward(total_inertia(MODEL), total_viscous(MODEL), total_friction(MODEL), 0.0, 1.0, 1.5e-3)
CASCADE = Cascade(0.056, 0.145, 9.8, 2e-3, Prefilter("butterworth", 90.0), FORWARD, filter_reference=True)


def references(rise_s: float = 0.15) -> References:
    """A speed that rises smoothly to its top and stays."""
    t = PERIOD_S * np.arange(600)
    speed = SPEED_M_S / RATIO * 0.5 * (1.0 - np.cos(math.pi * np.clip(t / rise_s, 0.0, 1.0)))
    return References(np.concatenate(([0.0], np.cumsum(speed)[:-1])) * PERIOD_S, speed, np.zeros(len(t)))


def lost(at: int, reaction: StopReaction) -> tuple[float, float]:
    stop = predict_stop_out_of_move(SimulatedPlant(MODEL, FROM_M), CASCADE, references(), at, DRIVE, reaction)
    return stop.belt_force_n, stop.way_m


def test_from_constant_speed_it_is_a_stop_along_the_ramp() -> None:
    force, way = lost(500, AT_ONCE)
    ramp = SPEED_M_S**2 / (2.0 * AT_ONCE.deceleration_m_s2)
    assert way == pytest.approx(ramp, abs=SPEED_M_S * 0.035)
    # the swing of a belt that is to brake its carriage, and friction that helps
    assert 0.9 * MODEL["cart.mass"] * AT_ONCE.deceleration_m_s2 < force < 2.2 * MODEL["cart.mass"] * AT_ONCE.deceleration_m_s2


def test_it_is_worst_out_of_an_acceleration_and_the_longer_it_lasts_unnoticed() -> None:
    steady, rising = lost(500, AT_ONCE)[0], lost(75, AT_ONCE)[0]
    assert rising > steady
    by_window = lost(500, StopReaction(2e-3 / RATIO, 3e-3, 0.05, 4.0))[0]
    by_guard = lost(500, StopReaction(math.inf, 3e-3, 0.05, 4.0))[0]
    assert steady <= by_window < by_guard


def test_a_following_error_that_lasts_is_noticed_before_the_guard_time() -> None:
    """2 mm at 0.8 m/s and 3 ms more: some 6 ms, where the guard time is ten times that."""
    long = StopReaction(2e-3 / RATIO, 3e-3, 0.2, 4.0)
    assert lost(500, long) == lost(500, StopReaction(2e-3 / RATIO, 3e-3, 0.05, 4.0))


def test_the_torque_sent_along_stays() -> None:
    sent = references()
    pushed = References(sent.position_rad, sent.speed_rad_s, np.full(len(sent.added_nm), 0.2))
    held = pushed.lost_at(300, 5)
    assert [len(values) for values in held] == [305, 305, 305]
    assert set(held[2][300:]) == {0.2}
    assert set(held[0][300:]) == {sent.position_rad[299]}
    assert set(held[1][300:]) == {sent.speed_rad_s[299]}
