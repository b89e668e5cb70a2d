"""Composition: the compiled kernel says what the laws say, in any order, and is compiled once per machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beltcomm.effects import EFFECTS
from beltcomm.effects.cogging import COUNT
from beltcomm.model import Model, build_model
from beltcomm.model.statics import _smooth_forces
from beltcomm.simulate.forward import simulate_torque
from beltcomm.simulate.kernels import writer
from beltcomm.simulate.kernels.compose import _kernel_source, kernel_for

FULL = ("belt_sections", "coupling", "belt_damping", "viscous", "viscous_cart", "viscous_end_pulley",
        "coulomb", "cart_friction", "presliding_cart", "coulomb_end_pulley", "tilt")  # fmt: skip
HIDDEN = ("belt_stiffness", "stiffness_position", "end_pulley", "payload_mode", "belt_damping", "backlash", "belt_slack", "viscous",
          "warmup", "quadratic_drag", "coulomb", "stribeck", "stribeck_cart", "friction_position", "friction_position_cart", "presliding",
          "constant_offset", "cable_chain", "cogging",
          *(f"cogging_{n}" for n in range(2, COUNT + 1)), "tooth_ripple", "torque_ripple", "torque_saturation", "dead_time", "current_lag",
          "pulley_eccentricity", "pulley_eccentricity_2", "encoder_eccentricity", "encoder_eccentricity_2",
          "encoder_interpolation")  # fmt: skip
SPANS = ("belt_spans", "belt_damping", "viscous_cart")
REAL = ("belt_stiffness", "belt_damping", "elastic_shaft", "viscous", "viscous_asymmetry", "viscous_load", "coulomb", "coulomb_load",
        "friction_dip", "friction_freeform", "holding_brake", "load_friction", "unbalance", "travel_ripple", "measurement_lag",
        "feed_constant", "other_load", "other_load_2", "other_load_3")  # fmt: skip
RIGID = ("rigid_load", "viscous", "coulomb", "tilt", "other_inertia", "other_inertia_2", "other_inertia_3")
CHOSEN = (FULL, HIDDEN, REAL, SPANS, ("belt_stiffness", "cart_friction"), RIGID)
#: An effect that nobody has put among others stands on the plain belt.
COMBINATIONS = (*CHOSEN, *(("belt_stiffness", e.name) for e in EFFECTS if not any(e.name in some for some in CHOSEN)))


def model_of(effects: tuple[str, ...]) -> Model:
    model = build_model("m", effects, {}, base_bodies=("motor",) if "rigid_load" in effects else ("motor", "cart"))
    shown = {"tilt.angle": 0.3, "pulley_eccentricity.sine": 0.01, "pulley_eccentricity.cosine": -0.02, "cogging.sine": 0.1,
             "pulley_eccentricity_2.cosine": 0.004, "encoder_eccentricity_2.sine": 0.001, "end_pulley.split": 0.4,
             "constant_offset.torque": 0.03, "cable_chain.rate": 8.0, "belt_slack.limit": 1e-4, "tooth_ripple.cosine": 0.05,
             "travel_ripple.sine": 3.0, "unbalance.sine": 0.2, "viscous_asymmetry.share": 0.2, "feed_constant.error": 0.01}  # fmt: skip
    return model.with_values({name: value for name, value in shown.items() if name in model.parameters})


@pytest.mark.parametrize("effects", COMBINATIONS, ids=lambda effects: effects[0])
def test_compiled_forces_are_those_of_the_laws(effects: tuple[str, ...]) -> None:
    """Generated and compiled code against the laws called one by one in Python, at random states."""
    model, random = model_of(effects), np.random.default_rng(3)
    bodies = model.bodies()
    scale = np.array([1.0 / model["transmission.ratio"] if body.rotary else 1.0 for _, body in bodies])
    for _ in range(5):
        q = scale * (0.3 + 1e-3 * random.normal(size=len(bodies)))
        v = scale * random.normal(size=len(bodies))
        got = np.empty(len(bodies))
        kernel_for(model).forces(q, v, model.vector(), 1.5, got)
        np.testing.assert_allclose(got, _smooth_forces(model, q, v, 1.5), rtol=1e-9, atol=1e-9)


def test_levels_stand_at_their_bodies() -> None:
    model = build_model("m", FULL, {"coulomb.level": 0.1, "cart_friction.level": 4.0, "coulomb_end_pulley.level": 2.0})
    kernel = kernel_for(model)
    got = np.empty(4)
    kernel.levels(np.zeros(4), np.ones(4), model.vector(), 0.0, got)
    assert dict(zip(kernel.bodies, got.tolist(), strict=True)) == {
        "motor": 0.1, "cart": 4.0, "end_pulley": 2.0, "driving_pulley": 0.0,
    }  # fmt: skip


def test_a_law_at_the_carriage_is_that_of_the_motor() -> None:
    """In newtons at the belt: place, width and speed are those of the motor's part."""
    names = ("belt_stiffness", "stribeck", "stribeck_cart", "friction_position", "friction_position_cart")
    values = {"stribeck.amount": 0.1, "stribeck_cart.amount": 8.0, "stribeck.exponent": 1.5, "friction_position.amount": 0.05,
              "friction_position_cart.amount": 4.0, "friction_position.place": 0.3, "friction_position.width": 0.04}  # fmt: skip
    model, got = build_model("m", names, values), np.empty(2)
    ratio = model["transmission.ratio"]
    for place, speed in ((0.3, 0.0), (0.32, 2.0), (0.5, 1.0), (0.1, 50.0)):
        at, moving = np.array([place / ratio, place]), np.array([speed, speed * ratio])
        kernel_for(model).levels(at, moving, model.vector(), 0.0, got)
        low, near = np.exp(-((speed / model["stribeck.speed_scale"]) ** 1.5)), np.exp(-(((place - 0.3) / 0.04) ** 2))
        np.testing.assert_allclose(got, [0.1 * low + 0.05 * near, 8.0 * low + 4.0 * near], rtol=1e-9, atol=1e-12)


def test_the_order_of_effects_does_not_matter() -> None:
    effects = ("belt_stiffness", "cart_friction")
    torque = 0.2 * np.sign(np.sin(np.arange(300) / 11.0))
    one, other = (simulate_torque(model_of(order), torque, 1e-3) for order in (effects, effects[::-1]))
    np.testing.assert_allclose(one.position_rad, other.position_rad, rtol=1e-9, atol=1e-12)


def test_an_end_pulley_without_mass_is_the_spring_by_position() -> None:
    """Three masses with a light end pulley move as the two-mass model with the replacement stiffness (2.26)."""
    belt = {"specific_stiffness": 106250.0, "pulley_distance": 0.79, "offset": 0.05}
    two = build_model("two", SPANS, {f"belt_spans.{k}": x for k, x in belt.items()}
                      | {"belt_damping.damping": 0.0, "viscous_cart.damping": 5.0})  # fmt: skip
    values = {f"belt_sections.{name}": x for name, x in belt.items()} | {
        "end_pulley.mass": 1e-3, "belt_sections.specific_damping": 0.0, "coupling.stiffness": 1e4, "coupling.damping": 0.0,
        "belt_damping.damping": 0.0, "driving_pulley.inertia": 2e-5, "motor.inertia": 3e-5, "viscous_cart.damping": 5.0,
        "viscous.damping": 0.0, "viscous_end_pulley.damping": 0.0, "coulomb.level": 0.0,
        "cart_friction.level": 0.0, "coulomb_end_pulley.level": 0.0,
    }  # fmt: skip
    three = build_model("three", FULL, values)
    torque = 0.1 * np.sin(2 * np.pi * 10.0 * np.arange(200) / 1e3)
    a = simulate_torque(two, torque, 1e-3, position_m=0.3, substeps=200)
    b = simulate_torque(three, torque, 1e-3, position_m=0.3, substeps=200)
    travel = np.ptp(a.cart_position_m)
    np.testing.assert_allclose(a.cart_position_m, b.cart_position_m, atol=5e-3 * travel)


def test_a_changed_law_gets_another_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    combination = (("motor", "cart"), ("belt_stiffness", "cart_friction"))
    before = _kernel_source(*combination)
    assert _kernel_source(*combination) == before
    read = writer.inspect.getsource
    monkeypatch.setattr(writer.inspect, "getsource", lambda module: read(module).replace("return level_", "return 2 * level_"))
    assert _kernel_source(*combination) != before


def test_a_second_process_compiles_nothing(tmp_path: Path) -> None:
    script = (
        "from beltcomm.model import build_model\n"
        "from beltcomm.simulate.kernels.compose import kernel_for\n"
        "import numpy as np\n"
        "model = build_model('m', ('belt_stiffness',), {})\n"
        "kernel = kernel_for(model)\n"
        "kernel.advance(np.zeros(2), np.zeros(2), model.vector(), 0.1, 0.0, 5e-5, 20)\n"
        "print(sum(kernel.advance.stats.cache_hits.values()), sum(kernel.advance.stats.cache_misses.values()))\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": ""}

    def hits_and_misses() -> list[int]:
        done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
        return [int(word) for word in done.stdout.split()]

    assert hits_and_misses() == [0, 1]
    assert hits_and_misses() == [1, 0]
