"""The simulator against scipy's event integration, and its order of convergence, both through stick and slip."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from truth import Axis, ConstantBelt, Coupling, ThreeSectionBelt, TruthPlant, TwoStrandBelt, nominal
from truth.reference_solution import Matrices, simulate

Array = NDArray[np.float64]

#: rad, a hundredth of an increment of the encoder with 65536 counts.
HUNDREDTH_COUNT_RAD = 2.0 * math.pi / 65536 / 100

START_M, OFFSET_M = 0.3, 0.05
TWO_STRANDS = TwoStrandBelt(106250.0, 0.79, OFFSET_M, damping_n_s_m=20.0)
THREE_SECTIONS = ThreeSectionBelt(
    106250.0, 0.79, OFFSET_M, 0.153, specific_damping_n_s=8.0, end_pulley_viscous_n_s_m=1.0, end_pulley_coulomb_n=0.5
)
COUPLING = Coupling(168.75, 23.63e-6, damping_nm_s_rad=1e-3)


def machine(belt: TwoStrandBelt | ThreeSectionBelt, coupling: Coupling | None = None) -> Axis:
    """The rig with the bare carriage, slightly tilted, with friction on everything."""
    return Axis(
        inertia_kg_m2=48.1e-6 if coupling else 71.73e-6,
        mass_kg=0.96,
        transmission_m_rad=0.01242,
        belt=belt,
        viscous_motor_nm_s_rad=2.23e-3,
        coulomb_motor_nm=0.08,
        viscous_cart_n_s_m=1.0,
        coulomb_cart_n=2.8,
        tilt_rad=0.05,
        coupling=coupling,
    )


MACHINES = {
    "g_a": nominal("g_a").axis,
    "g_b": nominal("g_b").axis,
    "two strands": machine(TWO_STRANDS),
    "three masses": machine(THREE_SECTIONS),
    "coupling": machine(THREE_SECTIONS, COUPLING),
}


def torques(n: int, amplitude_nm: float) -> list[float]:
    """Random signs held for two periods: near the breakaway torque, so that bodies stick and slip all the time."""
    signs = np.sign(np.random.default_rng(3).standard_normal(n // 2))
    return [float(x) for x in np.repeat(amplitude_nm * signs, 2)]


def run(axis: Axis, inputs: list[float], longest_substep_s: float) -> tuple[Array, NDArray[np.bool_]]:
    plant = TruthPlant(axis, start_position_m=START_M, longest_substep_s=longest_substep_s)
    states, stuck = [], []
    for torque in inputs:
        plant.step(torque, 1e-3)
        states.append([*plant.coordinates, *plant.speeds])
        stuck.append([*plant.stuck, False])
    return np.array(states), np.array(stuck)


@pytest.mark.parametrize("name", MACHINES)
def test_agrees_with_solve_ivp_through_stick_and_slip(name: str) -> None:
    axis = MACHINES[name]
    inputs = torques(120, 0.15)
    expected, expected_stuck = simulate(axis, OFFSET_M + START_M, inputs, 1e-3)
    changes = np.count_nonzero(np.diff(expected_stuck.astype(int), axis=0))
    assert changes >= 10, "the stretch must stick and slip"

    bodies = Matrices(axis, OFFSET_M + START_M).bodies
    columns = [*bodies, *(4 + b for b in bodies)]
    states, stuck = run(axis, inputs, 62.5e-6)
    np.testing.assert_array_equal(stuck[:, bodies], expected_stuck)
    np.testing.assert_allclose(states[:, 0], expected[:, 0], rtol=0.0, atol=HUNDREDTH_COUNT_RAD)
    np.testing.assert_allclose(states[:, 1], expected[:, 1], rtol=0.0, atol=HUNDREDTH_COUNT_RAD * axis.transmission_m_rad)

    fine, _ = run(axis, inputs, 1e-3 / 512)
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(fine[:, columns] / scale, expected / scale, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_converges_with_order_four_through_stick_and_slip(name: str) -> None:
    inputs = torques(1000, 0.3)
    reference, _ = run(MACHINES[name], inputs, 1e-3 / 256)
    pieces = np.array([8, 16, 32, 64])
    errors = [np.abs(run(MACHINES[name], inputs, 1e-3 / n)[0] - reference)[:, 0].max() for n in pieces]
    order = -np.polyfit(np.log(pieces), np.log(errors), 1)[0]
    assert 3.8 < order < 4.3, f"order {order:.2f}, errors {errors}"


def test_cutting_a_step_changes_nothing() -> None:
    whole, cut = nominal("g_b"), nominal("g_b")
    for torque in torques(500, 0.3):
        whole.step(torque, 1e-3)
        for duration in (250e-6, 62.5e-6, 187.5e-6, 500e-6):
            cut.step(torque, duration)
    assert cut.position_rad == pytest.approx(whole.position_rad, abs=1e-10)
    assert cut.velocity_rad_s == pytest.approx(whole.velocity_rad_s, abs=1e-8)


def test_a_stop_shorter_than_a_substep_is_seen() -> None:
    # The motor swings on the belt around a steady speed; at the bottom of the swing it just touches zero.
    inertia, mass, lever, stiffness, speed = 71.73e-6, 0.96, 0.01242, 222.39e3, 10.0
    rig = Axis(inertia, mass, lever, ConstantBelt(stiffness), coulomb_motor_nm=0.05)
    omega = math.sqrt(stiffness * (lever**2 / inertia + 1.0 / mass))

    def swinging(swing: float, longest_substep_s: float) -> TruthPlant:
        plant = TruthPlant(rig, longest_substep_s=longest_substep_s)
        plant.place((0.0,) * 4, (speed + swing, lever * speed - inertia / lever / mass * swing, 0.0, 0.0))
        return plant

    def touches(swing: float) -> bool:
        plant = swinging(swing, 1e-6)
        plant.step(0.0, 0.9 * math.pi / omega)
        for _ in range(250):
            plant.step(0.0, 2e-6)
            if plant.velocity_rad_s <= 0.0:
                return True
        return False

    low, high = 0.8 * speed, speed
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if touches(middle) else (middle, high)

    dip = 1e-3  # rad/s; with an acceleration that grows by omega² swing it lasts 2 sqrt(2 dip/(omega² swing)) = 35 us
    for end in np.linspace(4.1e-3, 4.2e-3, 9):  # so the bottom falls on different places of a sub-step
        coarse, fine = swinging(high + dip, 62.5e-6), swinging(high + dip, 0.25e-6)
        coarse.step(0.0, float(end))
        fine.step(0.0, float(end))
        assert coarse.velocity_rad_s == pytest.approx(fine.velocity_rad_s, abs=0.1 * dip)
