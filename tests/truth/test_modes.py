"""Linear motion of the axes with belt sections by position, against matrices written apart from the kernel."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh, expm

from truth import Axis, Coupling, ThreeSectionBelt, TruthPlant, TwoStrandBelt
from truth.reference_solution import Matrices

OFFSET_M, START_M = 0.05, 0.5
#: m, so small that the stiffness does not change: 1e-9 of the belt length.
TINY = 1e-10


def machine(damped: float, *, end_pulley: bool = True, coupled: bool = False) -> Axis:
    """The rig with the bare carriage; ``damped`` 1 or 0 switches every damper and viscous friction on or off."""
    section = ThreeSectionBelt(106250.0, 0.79, OFFSET_M, 0.153, damped * 8.0, end_pulley_viscous_n_s_m=damped * 3.0)
    return Axis(
        inertia_kg_m2=48.1e-6 if coupled else 71.73e-6,
        mass_kg=0.96,
        transmission_m_rad=0.01242,
        belt=section if end_pulley else TwoStrandBelt(106250.0, 0.79, OFFSET_M, damped * 20.0),
        viscous_motor_nm_s_rad=damped * 2.5e-3,
        viscous_cart_n_s_m=damped * 15.0,
        coupling=Coupling(168.75, 23.63e-6, damped * 1e-2) if coupled else None,
    )


FREE, DAMPED = (
    {
        "two strands": machine(damped, end_pulley=False),
        "three masses": machine(damped),
        "coupled two strands": machine(damped, end_pulley=False, coupled=True),
        "coupling": machine(damped, coupled=True),
    }
    for damped in (0.0, 1.0)
)


def places(values: NDArray[np.float64], bodies: list[int]) -> tuple[float, ...]:
    """Values of the bodies there are, in the four places of the plant."""
    result = np.zeros(4)
    result[bodies] = values
    return tuple(float(x) for x in result)


@pytest.mark.parametrize("name", FREE)
def test_every_mode_repeats_with_its_own_frequency(name: str) -> None:
    m = Matrices(FREE[name], OFFSET_M + START_M)
    squares, shapes = eigh(m.at(0.0)[0], np.diag(m.mass))
    modes = [(math.sqrt(w2), shape) for w2, shape in zip(squares, shapes.T, strict=True) if w2 > 1.0]
    assert len(modes) == len(m.bodies) - 1  # and the rigid body
    for omega, shape in modes:
        plant = TruthPlant(FREE[name], start_position_m=START_M, longest_substep_s=2e-6)
        start = TINY * shape / np.abs(shape).max()
        plant.place(places(start, m.bodies), (0.0,) * 4)
        for i in range(1, 41):
            plant.step(0.0, math.pi / (4.0 * omega))
            now = np.array(plant.coordinates)[m.bodies]
            np.testing.assert_allclose(now, start * math.cos(math.pi / 4.0 * i), rtol=0.0, atol=1e-7 * TINY)


@pytest.mark.parametrize("name", DAMPED)
def test_damped_motion_follows_the_matrix_exponential(name: str) -> None:
    m = Matrices(DAMPED[name], OFFSET_M + START_M)
    n = len(m.bodies)
    stiffness, damping = m.at(0.0)
    inverse = np.diag(1.0 / m.mass)
    system = np.zeros((2 * n + 1, 2 * n + 1))
    system[:n, n : 2 * n] = np.eye(n)
    system[n : 2 * n, :n], system[n : 2 * n, n : 2 * n] = -inverse @ stiffness, -inverse @ damping
    system[n : 2 * n, -1] = inverse @ m.input  # the last state is the held torque
    plant = TruthPlant(DAMPED[name], start_position_m=START_M, longest_substep_s=10e-6)
    rng = np.random.default_rng(5)
    q, v, torque = TINY * rng.standard_normal(n), 1000.0 * TINY * rng.standard_normal(n), 1e3 * TINY
    plant.place(places(q, m.bodies), places(v, m.bodies))
    state = np.concatenate([q, v, [torque]])
    transition = expm(1e-3 * system)
    scale = np.abs(state)
    for _ in range(100):
        plant.step(torque, 1e-3)
        state = transition @ state
        scale = np.maximum(scale, np.abs(state))
        now = np.array([*plant.coordinates, *plant.speeds])[[*m.bodies, *(4 + b for b in m.bodies)]]
        np.testing.assert_allclose(now / scale[:-1], state[:-1] / scale[:-1], rtol=0.0, atol=1e-6)


def test_two_strands_are_as_stiff_as_the_thesis_belt() -> None:
    # thesis.md, 1: 106 250 N and l3 = 0.79 m give 296 kN/m at l1 = 0.55 m.
    held = Axis(71.73e-6, 0.96, 0.01242, TwoStrandBelt(106250.0, 0.79, OFFSET_M), coulomb_motor_nm=1.0)
    plant = TruthPlant(held, start_position_m=START_M)
    plant.place((0.0, TINY, 0.0, 0.0), (0.0,) * 4)
    assert -plant.belt_force_n / TINY == pytest.approx(296e3, rel=2e-3)


def test_belt_force_of_three_sections_is_what_the_pulley_feels() -> None:
    # With everything held, the torque the motor needs for its displacement is i_t times the belt force.
    axis = FREE["three masses"]
    m = Matrices(axis, OFFSET_M + START_M)
    plant = TruthPlant(axis, start_position_m=START_M)
    q = np.array([1e-3, -2e-6, 3e-6])
    plant.place(places(q, m.bodies), (0.0,) * 4)
    assert 0.01242 * plant.belt_force_n == pytest.approx((m.at(q[1])[0] @ q)[0], rel=1e-12)
