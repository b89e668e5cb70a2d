"""The drawn machines, the plant's border, and that nothing of the product is in here."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from truth import Axis, ConstantBelt, ThreeSectionBelt, TruthPlant, TwoStrandBelt, draw, geared, nominal

DRAWN = ("inertia_kg_m2", "mass_kg", "stiffness_n_m", "belt_damping_n_s_m", "viscous_nm_s_rad", "coulomb_total_nm")
SENSIBLE = Axis(71.73e-6, 0.96, 0.01242, ConstantBelt(222e3, 20.0))


def test_judge_and_judged_share_no_code() -> None:
    files = sorted(Path(__file__).parent.glob("*.py"))
    assert len(files) >= 8
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("beltcomm") for name in names), f"{file.name} imports the product"


@pytest.mark.parametrize(("name", "resonance", "antiresonance"), [("g_a", 107.16, 19.60), ("g_b", 134.10, 76.60)])
def test_nominal_rig_has_the_published_frequencies(name: str, resonance: float, antiresonance: float) -> None:
    truth = nominal(name).truth
    assert truth["resonance_hz"] == pytest.approx(resonance, abs=0.01)
    assert truth["antiresonance_hz"] == pytest.approx(antiresonance, abs=0.01)


def test_nominal_rig_has_the_friction_of_table_a10() -> None:
    truth = nominal("g_a").truth
    assert truth["coulomb_motor_nm"] == pytest.approx(0.0875)
    assert truth["coulomb_motor_nm"] + 0.01242 * truth["coulomb_cart_n"] == pytest.approx(0.125)
    assert truth["coulomb_total_nm"] == 0.125
    assert truth["viscous_nm_s_rad"] == 2.53e-3


def test_a_gearbox_shifts_inertia_and_friction_by_its_ratio() -> None:
    """Seen from the pulley the whole machine is the rig, a little heavier by the gearbox and slower to start by its seals."""
    rig, ratio = nominal("g_a").truth, 3.0
    plant = geared("g_a", ratio)
    truth = plant.truth
    assert plant.axis.transmission_m_rad == pytest.approx(0.01242 / ratio)
    # motor and coupling at the motor, 48.10 kg mm², pulley 23.63 and gearbox 60 kg mm² behind it
    assert truth["inertia_kg_m2"] == pytest.approx(48.10e-6 + 83.63e-6 / 9.0)
    assert truth["coulomb_cart_n"] == pytest.approx(rig["coulomb_cart_n"])
    assert (truth["coulomb_motor_nm"] - 0.010) * ratio == pytest.approx(rig["coulomb_motor_nm"])
    assert (truth["viscous_nm_s_rad"] - 0.1e-3) * ratio**2 == pytest.approx(rig["viscous_nm_s_rad"])
    assert truth["antiresonance_hz"] == pytest.approx(rig["antiresonance_hz"])
    # (2.44): below the rig's, because the motor is heavier against the belt
    mobility = (0.01242 / ratio) ** 2 / truth["inertia_kg_m2"]
    assert truth["resonance_hz"] == pytest.approx(math.sqrt(203.74e3 * (mobility + 1.0 / 13.44)) / math.tau)


def test_draws_are_uniform_independent_and_repeatable() -> None:
    centre = nominal("g_b").truth
    rng = np.random.default_rng(11)
    factors = np.array([[draw("g_b", rng).truth[n] / centre[n] for n in DRAWN] for _ in range(2000)])
    assert factors.min() >= 0.8
    assert factors.max() <= 1.2
    # Kolmogorov's bound at one in a million per column: 2.7/sqrt(n).
    ordered, grid = np.sort((factors - 0.8) / 0.4, axis=0), (np.arange(2000)[:, None] + 0.5) / 2000
    assert np.abs(ordered - grid).max() < 2.7 / math.sqrt(2000)
    correlation = np.corrcoef(factors.T) - np.eye(len(DRAWN))
    assert np.abs(correlation).max() < 5.0 / math.sqrt(2000)
    first, again, other = (draw("g_a", np.random.default_rng(s)).truth for s in (1, 1, 2))
    assert first == again
    assert first != other


def test_truth_is_what_the_plant_runs_on() -> None:
    plant = draw("g_a", np.random.default_rng(4))
    axis, truth = plant.axis, plant.truth
    assert isinstance(axis.belt, ConstantBelt)
    on_plant = {
        "inertia_kg_m2": axis.inertia_kg_m2,
        "mass_kg": axis.mass_kg,
        "stiffness_n_m": axis.belt.stiffness_n_m,
        "belt_damping_n_s_m": axis.belt.damping_n_s_m,
        "viscous_nm_s_rad": axis.viscous_motor_nm_s_rad,
        "coulomb_motor_nm": axis.coulomb_motor_nm,
        "coulomb_cart_n": axis.coulomb_cart_n,
    }
    assert on_plant == {name: truth[name] for name in on_plant}
    assert axis.transmission_m_rad == 0.01242


def test_equal_inputs_give_equal_bits_whatever_else_runs() -> None:
    def run(plant: TruthPlant, disturber: TruthPlant | None) -> bytes:
        rng = np.random.default_rng(8)
        rows = []
        for torque in rng.uniform(-0.4, 0.4, 1000):
            plant.step(float(torque), 1e-3)
            if disturber:
                disturber.step(float(-torque), 0.7e-3)
            rows.append((plant.position_rad, plant.velocity_rad_s, plant.cart_position_m, plant.belt_force_n))
        return np.array(rows).tobytes()

    assert run(nominal("g_b"), None) == run(nominal("g_b"), nominal("g_a"))


def test_starts_at_rest_with_a_slack_belt() -> None:
    plant = nominal("g_a")
    assert (plant.position_rad, plant.velocity_rad_s, plant.cart_position_m, plant.belt_force_n) == (0.0, 0.0, 0.0, 0.0)
    assert plant.stuck[:2] == (True, True)
    plant.step(0.0, 1.0)
    assert (plant.position_rad, plant.cart_position_m) == (0.0, 0.0)


def test_refuses_steps_and_machines_that_cannot_be() -> None:
    plant = TruthPlant(SENSIBLE)
    with pytest.raises(ValueError, match=r"-0\.001 s"):
        plant.step(0.0, -0.001)
    with pytest.raises(RuntimeError, match="no longer finite"):
        plant.step(math.nan, 1e-3)
    with pytest.raises(ValueError, match="mass_kg = 0"):
        Axis(71.73e-6, 0.0, 0.01242, ConstantBelt(222e3))
    with pytest.raises(ValueError, match="damping_n_s_m = -1"):
        Axis(71.73e-6, 0.96, 0.01242, ConstantBelt(222e3, -1.0))
    with pytest.raises(KeyError):
        nominal("g_c")


@pytest.mark.parametrize("belt", [TwoStrandBelt(106250.0, 0.79, 0.05), ThreeSectionBelt(106250.0, 0.79, 0.05, 0.153)])
def test_refuses_to_leave_the_belt(belt: TwoStrandBelt | ThreeSectionBelt) -> None:
    axis = Axis(71.73e-6, 0.96, 0.01242, belt)
    with pytest.raises(ValueError, match="at the start is outside 0 to"):
        TruthPlant(axis, start_position_m=0.8)
    plant = TruthPlant(axis, start_position_m=0.6)
    plant.place((0.0,) * 4, (5.0 / 0.01242, 5.0, 5.0, 0.0))
    plant.step(0.0, 0.02)  # 0.65 m + 0.1 m
    with pytest.raises(RuntimeError, match="left the belt"):
        plant.step(0.0, 0.02)
