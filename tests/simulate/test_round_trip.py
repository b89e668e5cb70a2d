"""Every effect forward and backward: the inverse finds the torque that the forward simulation was given, and only with the effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.effects import EFFECTS, AxisSummary, Effect
from beltcomm.model import Model, build_model
from beltcomm.simulate.forward import simulate_torque
from beltcomm.simulate.imperfect import angle_sensor
from beltcomm.simulate.inverse import fine_load, reconstruct, torque_residuals
from simulate.reading import torque_as_read

T, RATIO = 1e-3, 0.0125
BASE = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb")
VALUES = {"motor.inertia": 7e-5, "cart.mass": 4.0, "transmission.ratio": RATIO, "belt_stiffness.stiffness": 2e5, 
          "belt_damping.damping": 25.0, "viscous.damping": 2e-3, "viscous_cart.damping": 4.0, "coulomb.level": 0.1}  # fmt: skip
GROUND = AxisSummary(7e-5, 4.0, 2e5, 25.0, 0.1, RATIO, 0.2, 0.7, 35.6, 26, 2.0, 150.0, 0.05, 1.1)
#: Axes without a belt: what the effects of a turning load stand on, and a linear axis for what needs no motor angle.
SHAFT = {"load.inertia": 6e-5, "elastic_shaft.stiffness": 8.0, "elastic_shaft.damping": 2e-3}
ON_RIGID = {
    "elastic_shaft": (),
    "coulomb_load": ("elastic_shaft",),
    "viscous_load": ("elastic_shaft",),
    "travel_ripple": (),
    "unbalance": (),
}
#: What an effect needs beside the base; what is no effect.
STANDS_ON = {
    "presliding_cart": ("cart_friction",), "stribeck_cart": ("stribeck",), "friction_position_cart": ("friction_position",),
}  # fmt: skip
BESIDE = {"cart_friction.level": 3.0, "stribeck.amount": 0.0, "friction_position.amount": 0.0, "friction_position.place": 0.4}
KNOWN = ("motor", "cart", "transmission")
#: What is tried only after another effect was named, at a size that shows.
AFTERWARDS = {"stribeck_cart": {"amount": 4.0}, "friction_position_cart": {"amount": 4.0}}
#: A tilt pulls the resting carriage at the start, see ``SHIFTED``; nothing can be moved so that it does not.
PULLING = ("tilt",)
NAMED = [e for e in EFFECTS if e.trials is not None or e.name in AFTERWARDS]
TRIED = [e for e in NAMED if e.name not in PULLING and not e.name.rpartition("_")[2].isdigit()]


#: Effects of friction show at creeping speed, at the place where the record is made.
SLOW = {"stribeck", "friction_position", "presliding", "presliding_cart", "friction_dip", *AFTERWARDS}
#: A resting carriage must not be pulled at the start: the inverse would have to be told how far the belt is stretched.
SHIFTED = {"cable_chain": {"rate": 8.0, "offset": -8.0 * 0.4}, "friction_position": {"amount": 0.04, "place": 0.4, "width": 0.05}}


def torque_of(samples: int, slow: bool) -> np.ndarray:
    """Slow and fast parts, so that all speeds and both directions occur; the same in every run."""
    random, t = np.random.default_rng(5), T * np.arange(samples)
    if slow:
        return 0.17 * np.sin(2 * np.pi * 1.7 * t)
    return 0.9 * np.sin(2 * np.pi * 1.3 * t) + 0.6 * np.sign(np.sin(2 * np.pi * 31.0 * t)) + 0.4 * random.normal(size=samples)


def base_for(effect: Effect) -> Model:
    if effect.name not in ON_RIGID:
        effects = (*(name for name in BASE if name != effect.name), *STANDS_ON.get(effect.name, ()))
        values = {name: value for name, value in {**VALUES, **BESIDE}.items() if name.split(".")[0] in (*effects, *KNOWN)}
        return build_model("base", effects, values)
    effects = ("viscous", "coulomb", *ON_RIGID[effect.name])
    values = {name: value for name, value in {**VALUES, **SHAFT}.items() if name.split(".")[0] in (*effects, "motor", "transmission")}
    values |= {"load.inertia": SHAFT["load.inertia"]} if ON_RIGID[effect.name] else {}
    return build_model("base", effects, values, base_bodies=("motor",))


def with_trial(base: Model, effect: Effect) -> Model:
    if effect.trials is None:
        return base.with_effect(effect.name, AFTERWARDS[effect.name])
    side = "load" if effect.name == "travel_ripple" else "motor"
    trials = effect.trials(replace(GROUND, belt=effect.name not in ON_RIGID, side=side))
    return base.with_effect(effect.name, SHIFTED.get(effect.name, trials[len(trials) // 2].values))


def left_over(model: Model, judges: tuple[Model, ...], slow: bool) -> list[float]:
    """rms of the residual of each judge, N m, where the motor of the model moves."""
    torque = torque_of(1200, slow)
    out = simulate_torque(model, torque, T, position_m=0.4, substeps=160)
    shown = np.array(list(map(angle_sensor(model), out.position_rad.tolist())))
    torque = torque_as_read(model, torque, T)
    rough = reconstruct(shown, torque, T, 7e-5, start_rad=float(shown[0]), substeps=32)
    found = []
    for judge in judges:
        load, _ = fine_load(judge, rough)
        motion = reconstruct(shown, torque, T, 7e-5, start_rad=float(shown[0]), substeps=32, load=load)
        speed = np.abs(motion.omega).reshape(-1)
        least = 0.02 if slow else 0.5
        moving = np.array([speed[max(k * 32 - 64, 0) : k * 32 + 65].min() > least for k in range(1200)])
        residual = torque_residuals(judge, motion, torque, [judge.vector()], [0.0])[0][300:-2]
        found.append(float(np.sqrt(np.mean(residual[moving[300:-2]] ** 2))))
    return found


@pytest.mark.parametrize("effect", TRIED, ids=lambda effect: effect.name)
def test_inverse_of_the_simulation_is_the_torque(effect: Effect) -> None:
    base = base_for(effect)
    model = with_trial(base, effect)
    without, with_it = left_over(model, (base, model), effect.name in SLOW)
    assert without > 1e-3
    assert with_it < 0.05 * without
