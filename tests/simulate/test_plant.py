"""The plant behind a virtual drive: same motion as the simulation, relative positions, end stops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model, build_model
from beltcomm.plant import Plant
from beltcomm.simulate.forward import integrate_torque
from beltcomm.simulate.plant import SimulatedPlant

IT, STOP_N_M = 0.01242, 2e5
EFFECTS = ("belt_stiffness", "belt_damping", "viscous", "coulomb", "cart_friction")


def axis(**values: float) -> Model:
    numbers = {"motor.inertia": 71.73e-6, "cart.mass": 13.44, "transmission.ratio": IT, "belt_stiffness.stiffness": 203740.0,
               "belt_damping.damping": 20.0, "viscous.damping": 2.53e-3, "coulomb.level": 0.0875,
               "cart_friction.level": 3.0}  # fmt: skip
    return build_model("axis", EFFECTS, numbers | {name.replace("__", "."): value for name, value in values.items()})


def test_steps_are_those_of_the_simulation() -> None:
    torque = 0.4 * np.sign(np.sin(np.arange(300) / 17.0))
    whole = integrate_torque(axis(), torque, 1e-3, position_m=0.3)
    plant: Plant = SimulatedPlant(axis(), 0.3)
    for n, value in enumerate(torque.tolist()):
        assert plant.position_rad == pytest.approx(whole.position_rad[n] - 0.3 / IT, abs=1e-12)
        assert plant.velocity_rad_s == whole.velocity_rad_s[n]
        assert plant.cart_position_m == pytest.approx(whole.cart_position_m[n] - 0.3, abs=1e-15)
        plant.step(value, 1e-3)
        assert abs(plant.belt_force_n) <= whole.belt_force_n[n]
    assert np.ptp(whole.cart_position_m) > 1e-3, "the test must move the axis"


def test_starts_at_zero_wherever_it_stands_also_tilted() -> None:
    model = axis().with_effect("tilt", {"angle": 0.4})
    plant = SimulatedPlant(model, 0.37)
    assert (plant.position_rad, plant.velocity_rad_s, plant.cart_position_m) == (0.0, 0.0, 0.0)
    assert plant.belt_force_n == pytest.approx(13.44 * 9.80665 * math.sin(0.4), rel=1e-9)


def test_steps_of_any_duration_add_up() -> None:
    """One millisecond in one step or in four quarters of five sub-steps each is the same up to rounding."""
    once, quarters = SimulatedPlant(axis(), 0.3), SimulatedPlant(axis(), 0.3)
    for n in range(100):
        torque = 0.4 if n < 50 else -0.4
        once.step(torque, 1e-3)
        for _ in range(4):
            quarters.step(torque, 0.25e-3)
    assert quarters.position_rad == pytest.approx(once.position_rad, rel=1e-9)
    assert quarters.time_s == pytest.approx(0.1, rel=1e-12)


def test_end_stop_holds_the_axis_where_its_spring_carries_the_motor() -> None:
    """At rest the buffer is pressed by s = τ/(i_t k), less the part d h/(2 m) of it that the splitting of a step leaves."""
    model = axis(coulomb__level=0.0, cart_friction__level=0.0)
    for side, stop in ((1.0, 0.05), (-1.0, -0.04)):
        plant = SimulatedPlant(model, 0.0, end_stops_m=(-0.04, 0.05))
        for _ in range(3000):
            plant.step(side * 0.5, 1e-3)
        pressed = 0.5 / IT / STOP_N_M
        split = 0.3 * 5e-5 * math.sqrt(STOP_N_M / 13.44)
        assert side * (plant.cart_position_m - stop) == pytest.approx(pressed, rel=1.01 * split)
        assert abs(plant.velocity_rad_s) < 1e-3


def test_end_stop_throws_back_with_its_restitution() -> None:
    """A damped spring that pushes only:  v'/v = exp(-ζ/√(1-ζ²) (π - arctan(2 ζ √(1-ζ²)/(1 - 2 ζ²)))), 0.451 for ζ = 0.3.

    Source: Schwager, Pöschel, Granular Matter 9 (2007) 465.
    """
    values = {"motor.inertia": 1e-3, "coulomb.level": 0.0, "transmission.ratio": IT}
    model = build_model("motor", ("coulomb",), values, base_bodies=("motor",))
    plant = SimulatedPlant(model, 0.0, substeps_per_ms=200, end_stops_m=(-0.5, 0.05))
    for _ in range(80):
        plant.step(0.5, 1e-3)
    arrival = plant.velocity_rad_s
    assert arrival == pytest.approx(40.0, rel=1e-9)
    assert plant.cart_position_m < 0.05
    for _ in range(200):
        plant.step(0.0, 1e-3)
    zeta, root = 0.3, math.sqrt(1.0 - 0.3**2)
    restitution = math.exp(-zeta / root * (math.pi - math.atan2(2 * zeta * root, 1 - 2 * zeta**2)))
    assert plant.velocity_rad_s == pytest.approx(-restitution * arrival, rel=5e-3)


def test_far_from_the_stops_they_change_nothing() -> None:
    free, stopped = SimulatedPlant(axis(), 0.3), SimulatedPlant(axis(), 0.3, end_stops_m=(0.0, 0.6))
    for n in range(200):
        for plant in (free, stopped):
            plant.step(0.4 if n < 100 else -0.4, 1e-3)
        assert stopped.position_rad == free.position_rad


def test_impossible_plants_are_refused() -> None:
    with pytest.raises(UsageError, match=r"cannot start at 0\.7 m: its end stops are at 0 and 0.6 m"):
        SimulatedPlant(axis(), 0.7, end_stops_m=(0.0, 0.6))
    with pytest.raises(UsageError, match="too few"):
        SimulatedPlant(axis(), 0.0, substeps_per_ms=1)


def test_leaving_the_model_is_said() -> None:
    model = build_model("by position", ("belt_spans", "belt_damping", "viscous_cart"), {})
    plant = SimulatedPlant(model, 0.1)

    def run_away() -> None:
        for _ in range(1000):
            plant.step(-3.0, 1e-3)

    with pytest.raises(Refused, match="has no belt; give it end stops"):
        run_away()
    assert -0.3 < plant.cart_position_m < -0.19, "it must say so soon after the end of the belt, 0.2 m from the start"
