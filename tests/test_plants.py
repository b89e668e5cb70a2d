"""The plants that are shipped: each loads; those of belts are the rigs of the thesis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from beltcomm.axis import load_axis
from beltcomm.model import load_plant
from beltcomm.model.linear import matrices, modes, operating_point
from beltcomm.model.transfer import two_mass

PLANTS = sorted(path.stem for path in (Path(__file__).parent.parent / "configs" / "plants").glob("*.yaml"))
IT = 0.01242
#: Axes of other kinds, of our own numbers.
OTHER_KINDS = ["ball_screw", "coupled_load", "linear_motor", "rack", "torque_table"]


def test_all_are_there() -> None:
    assert sorted({"egc_70", "g_a", "g_a_25deg", "g_b", "g_b_vertical", "s_a", "s_b", "s_c", *OTHER_KINDS}) == PLANTS


@pytest.mark.parametrize("name", PLANTS)
def test_loads_and_says_where_each_number_is_from(name: str) -> None:
    plant = load_plant(name)
    assert plant.model.name == name
    assert plant.model.source
    assert plant.setpoint_delay_s == 1e-3
    if name not in OTHER_KINDS:
        assert (plant.torque_noise_nm, plant.counts_per_rev) == (6e-3, 65536)
    for value in plant.model.parameters.values():
        assert value.origin
        assert value.interval is None
    path = Path(__file__).parent.parent / "configs" / "plants" / f"{name}.yaml"
    for item in yaml.safe_load(path.read_text(encoding="utf-8"))["parameters"].values():
        assert set(item) == {"value", "unit", "side", "low", "high", "interval", "origin"}


@pytest.mark.parametrize("name", OTHER_KINDS)
def test_a_plant_of_another_kind_is_the_machine_of_its_axis_file(name: str) -> None:
    """Of which a commissioning starts, so a slip in either would look like one of the tool's."""
    plant, axis = load_plant(name), load_axis(name.replace("_", "-"))
    model = plant.model
    assert plant.counts_per_rev == axis.motor.encoder_counts_per_rev
    assert 5e-4 < plant.torque_noise_nm / axis.motor.rated_torque_nm < 5e-3
    assert model["transmission.ratio"] == pytest.approx(axis.transmission_m_rad, rel=1e-6)
    if axis.rigid:
        assert model.base_bodies == ("motor",)
        assert model["motor.inertia"] > axis.motor_side_inertia_kg_m2  # its load is in it
    else:
        assert model["motor.inertia"] == pytest.approx(axis.motor_side_inertia_kg_m2, rel=1e-6)
        assert model["belt_stiffness.stiffness"] == pytest.approx(axis.belt_stiffness_n_m(0.0), rel=0.15)  # a sheet is not exact


@pytest.mark.parametrize(
    ("name", "resonance_hz", "antiresonance_hz", "tolerance"),
    [
        ("g_a", 107.16, 19.60, 0.005 / 19.60),  # recomputed in thesis.md, section 3, to 0.01 Hz
        ("g_b", 134.10, 76.60, 0.005 / 76.60),
        ("s_a", 133.83, 22.51, 0.005 / 22.51),
        ("s_b", 149.85, 71.17, 5e-4),  # as published; the thesis's printed frequencies are all 0.04 % low
        ("s_c", 423.05, 71.17, 5e-4),
    ],
)
def test_resonances_are_those_of_the_tables(name: str, resonance_hz: float, antiresonance_hz: float, tolerance: float) -> None:
    model = load_plant(name).model
    parameters = two_mass(model, operating_point(model, 0.5, 1.0))
    assert parameters.resonance_hz == pytest.approx(resonance_hz, rel=tolerance)
    assert parameters.antiresonance_hz == pytest.approx(antiresonance_hz, rel=tolerance)
    assert parameters.belt_damping_n_s_m == pytest.approx(20.0, rel=1e-9)


@pytest.mark.parametrize("name", ["s_a", "s_b", "s_c"])
def test_simulation_plants_have_the_damping_of_the_tables_at_the_belt(name: str) -> None:
    model = load_plant(name).model
    parameters = two_mass(model, operating_point(model, 0.0))
    assert parameters.motor_damping_n_s_m == pytest.approx(100.0, rel=1e-9)
    assert parameters.cart_damping_n_s_m == pytest.approx(100.0, rel=1e-9)


@pytest.mark.parametrize(("name", "viscous", "coulomb"), [("g_a", 2.53e-3, 0.125), ("g_b", 2.23e-3, 0.115), ("egc_70", 2.53e-3, 0.125)])
def test_friction_is_that_of_table_a10(name: str, viscous: float, coulomb: float) -> None:
    model = load_plant(name).model
    assert model["viscous.damping"] == viscous
    assert model["coulomb.level"] == pytest.approx(0.7 * coulomb)
    assert IT * model["cart_friction.level"] == pytest.approx(0.3 * coulomb, rel=1e-6)
    assert model["transmission.ratio"] == IT


@pytest.mark.parametrize(("name", "rig", "tilt_deg"), [("g_a_25deg", "g_a", 25.0), ("g_b_vertical", "g_b", 90.0)])
def test_tilted_rigs_are_the_level_ones_with_tilt_and_brake(name: str, rig: str, tilt_deg: float) -> None:
    tilted, level = load_plant(name), load_plant(rig)
    assert tilted.model.without_effect("tilt").parameters == level.model.parameters
    assert np.degrees(tilted.model["tilt.angle"]) == pytest.approx(tilt_deg, rel=1e-12)
    assert (tilted.brake_torque_nm, tilted.brake_time_s) == (2.0, 0.02)
    assert level.brake_torque_nm == 0.0


def test_full_rig_has_the_inertia_of_the_data_sheets() -> None:
    model = load_plant("egc_70").model
    assert model["motor.inertia"] + model["driving_pulley.inertia"] == pytest.approx(71.73e-6, rel=1e-9)
    assert model["end_pulley.mass"] * IT**2 == pytest.approx(23.63e-6, rel=1e-5)


def test_full_rig_has_its_end_pulley_mode_where_the_thesis_sheet_puts_it() -> None:
    """304 to 324 Hz, the coupling's own mode at 510 to 550 Hz (thesis.md, section 1), at l1 = 0.55 m."""
    model = load_plant("egc_70").model
    frequencies = [mode.freq_hz for mode in modes(model, operating_point(model, 0.5, 1.0))]
    assert len(frequencies) == 3
    assert 304.0 < frequencies[1] < 324.0
    assert 510.0 < frequencies[2] < 550.0


def test_full_rig_is_as_soft_as_belt_and_coupling_in_series() -> None:
    """1/c = 1/(EA/l1 + EA/(2 l3 - l1)) + i_t²/K = 1/233 kN/m at l1 = 0.55 m (thesis.md, section 1)."""
    model = load_plant("egc_70").model
    held = matrices(model, operating_point(model, 0.5, 1.0)).hold(("motor",))
    cart = held.bodies.index("cart")
    deflection = np.linalg.inv(held.K)[cart, cart]
    belt = 106250.0 * (1.0 / 0.55 + 1.0 / (2 * 0.79 - 0.55))
    assert 1.0 / deflection == pytest.approx(1.0 / (1.0 / belt + IT**2 / 168.75), rel=1e-9)
    assert 1.0 / deflection == pytest.approx(233e3, rel=2e-3)
