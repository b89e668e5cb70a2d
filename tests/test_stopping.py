"""Ways and forces of a stop: by hand, and against the independent truth simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.control import Cascade, Prefilter
from beltcomm.machine.machine import Machine
from beltcomm.simulate.stopping import (
    SWING,
    Braking,
    _predict_stop,
    braked_by_friction,
    braked_by_loop,
    braked_by_unknown_gains,
    first_deceleration,
    rigid_deceleration,
    total_friction,
    total_inertia,
)
from identify.records import true_model
from truth.rigs import TRANSMISSION_M_RAD, nominal

AXIS = load_axis("egc-70-600")
#: Velocity loops near those that the design finds for the two rigs.
LOOPS = {
    "g_a": Cascade(0.09, 0.37, 15.0, 0.004, Prefilter("butterworth", 123.0)),
    "g_b": Cascade(0.0213, 0.196, 41.0, 0.004, Prefilter("notch", 842.0, 1.6)),
}
DRIVE = {"position_m": 0.0, "period_s": 1e-3, "delay_s": 1e-3, "torque_limit_nm": 3.1, "counts_per_rev": 65536}


@pytest.mark.parametrize(
    ("mass_kg", "torque_nm", "swing", "value", "binds"),
    [
        (13.44, 3.1, 1.0, 100.0 / 13.44, "100 N feed force on 13.4 kg"),
        (13.44, 3.1, SWING, 50.0 / 13.44, "100 N feed force"),
        (0.96, 3.1, 1.0, 50.0, "50 m/s²"),
        (5.0, 0.5, 1.0, 0.5 / (71.73e-6 / 0.01242 + 0.01242 * 5.0), "0.5 N m of motor torque"),
    ],
)
def test_the_limit_that_binds_a_rigid_stop(mass_kg: float, torque_nm: float, swing: float, value: float, binds: str) -> None:
    found = rigid_deceleration(AXIS, mass_kg, torque_nm, swing)
    assert found.value_m_s2 == pytest.approx(value, rel=1e-3)
    assert binds in found.binds


def test_before_the_carriage_is_weighed_the_heaviest_one_counts() -> None:
    """30 kg and a belt that swings to twice the force: 100 N/60 kg; a heavier one that the data sheet states counts more."""
    assert first_deceleration(AXIS, 3.1).value_m_s2 == pytest.approx(100.0 / 60.0)
    heavy = replace(AXIS, payload=replace(AXIS.payload, mass_kg=80.0))
    assert first_deceleration(heavy, 3.1).value_m_s2 == pytest.approx(100.0 / 160.0)


def test_the_way_is_that_of_a_lag_and_a_ramp() -> None:
    braking = Braking(5.0, 0.02)
    assert braking.way_m(-1.0) == braking.way_m(1.0) == pytest.approx(0.02 + 0.1)
    assert braking.way_m(1.0, 5.0) == pytest.approx(1.1 * 0.02 + 1.1**2 / 10.0)  # still speeding up for 20 ms
    assert braking.way_m(1.0, -5.0) == braking.way_m(1.0)
    assert Braking(5.0, 0.02, 0.01).way_m(1.0, -5.0) == braking.way_m(1.05)  # the ramp begins at the speed of 10 ms ago
    assert (Braking(0.0, 0.1).way_m(0.0), Braking(0.0, 0.1).way_m(0.1)) == (0.0, math.inf)
    assert Braking(0.0, 0.1, besides=braking).way_m(1.0) == braking.way_m(1.0)
    x, v = np.array([0.1, 0.15, 0.2]), np.array([-1.0, 0.0, 0.5])
    assert Braking(5.0, 0.0).span_m(x, v, 1e-3) == (pytest.approx(0.0), pytest.approx(0.225))


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_friction_alone_stops_the_axis_where_it_is_counted_on(rig: str) -> None:
    """Coasting of the truth from 0.2 m/s without torque: less than counted, by what its viscous friction takes away."""
    plant, speed = nominal(rig), 0.2
    plant.place((0.0, 0.0, 0.0, 0.0), (speed / TRANSMISSION_M_RAD, speed, 0.0, 0.0))
    for _ in range(2000):
        plant.step(0.0, 1e-3)
    model = true_model(plant)
    counted = braked_by_friction(model, total_friction(model), 0.0).way_m(speed)
    assert 0.8 * counted < plant.cart_position_m < counted


@pytest.mark.parametrize(("kp", "ki"), [(0.002, 0.02), (0.002, 0.0), (0.0, 0.02), (0.05, 0.02), (0.05, 5.0)])
def test_a_velocity_loop_of_any_gains_swings_out_by_less_than_counted(kp: float, ki: float) -> None:
    model = true_model(nominal("g_a"))
    inertia, speed = total_inertia(model), 20.0  # rad/s
    angle, velocity, furthest, step = 0.0, speed, 0.0, 1e-5
    for _ in range(200_000):
        velocity -= step * (kp * velocity + ki * angle) / inertia
        angle += step * velocity
        furthest = max(furthest, angle)
    braking = braked_by_unknown_gains(model, kp, ki, math.inf, 0.0)
    counted = braking.way_m(speed * TRANSMISSION_M_RAD)
    assert 0.3 * counted < TRANSMISSION_M_RAD * furthest <= 1.0001 * counted


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_the_hardest_stop_that_the_belt_bears(rig: str) -> None:
    """Just within the 100 N out of acceleration, or bound by it; 10 % harder is too much or not allowed.  Lower speeds need no more way."""
    model, speed = true_model(nominal(rig)), 1.3
    braking, stop = braked_by_loop([model], LOOPS[rig], AXIS, speed, reaction_s=0.005, **DRIVE)
    out_of = {"acceleration_m_s2": braking.acceleration_m_s2, **DRIVE}
    harder = _predict_stop(model, LOOPS[rig], speed, 1.1 * braking.deceleration_m_s2, **out_of)
    assert stop.belt_force_n <= min(100.0, SWING * model["cart.mass"] * braking.deceleration_m_s2)
    assert harder.belt_force_n > 100.0 or braking.deceleration_m_s2 == pytest.approx(50.0)
    for lower in (0.1, 0.4, 0.8, 1.3):
        slow = _predict_stop(model, LOOPS[rig], lower, braking.deceleration_m_s2, **DRIVE)
        assert slow.way_m <= braking.way_m(lower)
    assert -_predict_stop(model, LOOPS[rig], -speed, braking.deceleration_m_s2, **DRIVE).way_m == pytest.approx(-stop.way_m, rel=1e-3)


@pytest.mark.parametrize(
    ("own_rad_s2", "counted", "said"), [(500.0, 5.0, ""), (300.0, 3.0, "its own way"), (900.0, 5.0, "load the belt more")]
)
def test_stops_are_counted_with_the_quick_stop_that_the_drive_really_has(own_rad_s2: float, counted: float, said: str) -> None:
    machine: Any = object.__new__(Machine)
    machine.ratio, remarks = 0.01, []
    machine.drive = SimpleNamespace(quick_stop_rad_s2=lambda _limits: own_rad_s2)
    machine.envelope, machine.drive_limits, machine.remark = lambda: None, lambda _envelope: None, remarks.append
    machine.brake_with(Braking(5.0, 0.02))
    assert machine.braking.deceleration_m_s2 == pytest.approx(counted)
    assert machine.deceleration_m_s2 == 5.0
    assert all(said in one for one in remarks)
    assert bool(remarks) is bool(said)
