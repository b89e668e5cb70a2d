"""What of a model's effects reaches the loop, and the torque that is sent along."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure, Prefilter
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.feedforward import compensated_effects, compensation
from beltcomm.design.structure import _in_loop, late_s, loop_model
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import operating_point, state_space
from beltcomm.rundata.analyse import design_plants, with_feedforward
from beltcomm.trajectory import plan_trajectory
from beltcomm.verify import Loop, predict_move

STRUCTURE = CascadeStructure("thesis", 1e-3, ("none", "notch", "butterworth"), True, True, True)
CASCADE = Cascade(0.0885, 0.4, 14.8, 0.004, Prefilter("butterworth", 2.0 * np.pi * 19.6), filter_reference=True)
PERIOD_S = 1e-3


def rig(effect: str = "", **values: float) -> Model:
    model = load_plant("g_a").model
    return model.with_effect(effect, values) if effect else model


def plant_of(model: Model) -> DesignPlant:
    return design_plants(model, [0.3], [model["cart.mass"]], 0.0, 0.0)[0]


@pytest.mark.parametrize("effect", ["cogging", "stribeck", "friction_position", "constant_offset", "torque_saturation", "cable_chain"])
def test_what_is_outside_the_loop_changes_no_plant(effect: str) -> None:
    assert "viscous" in _in_loop(rig(effect)).effects
    assert plant_of(rig(effect)) == plant_of(rig())


def test_late_torque_is_dead_time() -> None:
    model = rig("dead_time", time=6e-4).with_effect("current_lag", {"time": 3e-4})
    assert late_s(model) == pytest.approx(9e-4)
    assert plant_of(model).dead_time_s == pytest.approx(9e-4)
    assert with_feedforward(CASCADE, model, STRUCTURE, 1e-3).feedforward.advance_s == pytest.approx(1e-3 + 9e-4 + 0.5e-3)


def test_stiffness_by_position_is_that_of_the_place() -> None:
    model = load_plant("g_a").model.without_effect("belt_stiffness")
    model = model.with_effect("belt_spans", {"specific_stiffness": 106250.0, "pulley_distance": 0.79, "offset": 0.05})
    assert loop_model(model, 0.02).stiffness_n_m > 1.5 * loop_model(model, 0.3).stiffness_n_m


def test_a_payload_on_a_spring_is_in_the_response() -> None:
    model = rig("payload_mode", stiffness=2e4, damping=20.0)
    plant = plant_of(model)
    assert plant.bodies is not None
    freq = np.geomspace(2.0, 200.0, 60)
    frictionless = model.with_values({"viscous.damping": 0.0})
    expected = state_space(frictionless, operating_point(frictionless, 0.3, 1.0)).sampled(freq, PERIOD_S)[:, 0]
    found = plant.sampled_response(2.0 * np.pi * freq, PERIOD_S)
    assert np.max(np.abs(found / expected - 1.0)) < 1e-6


def test_bodies_and_two_masses_are_one_plant() -> None:
    two = plant_of(rig())
    light = plant_of(rig("payload_mode", stiffness=1e7, damping=100.0).with_values({"payload.mass": 1e-3}))
    omega = np.geomspace(5.0, 800.0, 50)
    ratio = light.sampled_response(omega, PERIOD_S) / two.sampled_response(omega, PERIOD_S)
    assert np.max(np.abs(ratio - 1.0)) < 5e-3


MANY = {
    "cogging": {"order": 6.0, "sine": 0.03, "cosine": 0.02},
    "stribeck": {"amount": 0.03, "speed_scale": 5.0},
    "friction_position": {"amount": 0.05, "place": 0.25, "width": 0.04},
    "cable_chain": {"rate": 15.0, "offset": -3.0},
    "quadratic_drag": {"factor": 4.0},
    "torque_saturation": {"loss": 0.15, "peak": 2.0},
}


def test_what_is_sent_along_lowers_the_error() -> None:
    model = rig()
    for effect, values in MANY.items():
        model = model.with_effect(effect, values)
    assert set(compensated_effects(model)) == set(MANY)
    cascade = with_feedforward(CASCADE, model, STRUCTURE, 1e-3)
    move = plan_trajectory(0.0, 0.5, TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=7.0, speed_m_s=1.3), PERIOD_S)
    along = compensation(model, cascade.feedforward, move, PERIOD_S)
    errors = []
    for extra in (None, along):
        path = predict_move(model, cascade, move, Loop(STRUCTURE, 1e-3, 3.1, 65536), extra_torque_nm=extra)
        errors.append(float(np.sqrt(np.mean((move.position_m - path.motor_m) ** 2))))
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("effect", MANY)
def test_every_map_is_sent_along(effect: str) -> None:
    model = rig(effect, **MANY[effect])
    cascade = with_feedforward(CASCADE, model, STRUCTURE, 1e-3)
    move = plan_trajectory(0.0, 0.5, TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=7.0, speed_m_s=1.3), PERIOD_S)
    assert 0.01 < np.max(np.abs(compensation(model, cascade.feedforward, move, PERIOD_S))) < 0.5


def test_the_base_model_needs_nothing_along() -> None:
    model = rig()
    cascade = with_feedforward(CASCADE, model, STRUCTURE, 1e-3)
    move = plan_trajectory(0.0, 0.3, TrajectoryLimits(jerk_m_s3=200.0, acceleration_m_s2=7.0, speed_m_s=1.0), PERIOD_S)
    assert compensated_effects(model) == ()
    assert not np.any(np.abs(compensation(model, cascade.feedforward, move, PERIOD_S)) > 1e-12)


def test_a_constant_torque_is_in_the_drives_own_feedforward() -> None:
    cascade = with_feedforward(CASCADE, rig("constant_offset", torque=0.03), STRUCTURE, 1e-3)
    assert cascade.feedforward.offset_nm == pytest.approx(0.03)
