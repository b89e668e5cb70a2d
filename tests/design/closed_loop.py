"""An independent time simulation of plant and compiled cascade, to judge margins by what happens.

Shares nothing with ``beltcomm.design``: the plant is scipy's discretisation of the equations of motion at a tenth of the
period, the dead time a queue of such sub-steps, the controller the compiled step that the virtual drive runs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from beltcomm.control import Cascade, cascade_step, discrete_coefficients, new_state, velocity_step
from beltcomm.design.design_plant import DesignPlant

PERIOD = 1e-3
SUB_STEPS = 10


def run(plant: DesignPlant, cascade: Cascade, samples: int, dead_time_s: float, *, velocity_loop: bool = False) -> NDArray[np.float64]:
    """Motor speed (velocity loop) or motor angle (cascade) per period after a step of its reference; no limits, no friction."""
    theta, i, m, c = plant.inertia_kg_m2, plant.transmission_m_rad, plant.mass_kg, plant.stiffness_n_m
    d, dm, dc = plant.belt_damping_ns_m, plant.motor_damping_nm_s_rad, plant.cart_damping_ns_m
    # States: motor angle, motor speed, carriage position, carriage speed.
    A = np.array(
        [
            [0, 1, 0, 0],
            [-i * i * c / theta, -(dm + i * i * d) / theta, i * c / theta, i * d / theta],
            [0, 0, 0, 1],
            [i * c / m, i * d / m, -c / m, -(d + dc) / m],
        ]
    )
    B = np.array([[0], [1 / theta], [0], [0]])
    Phi, Gamma, *_ = signal.cont2discrete((A, B, np.eye(4), np.zeros((4, 1))), PERIOD / SUB_STEPS)
    queue = [0.0] * round(dead_time_s / PERIOD * SUB_STEPS)
    coefficients, state = discrete_coefficients(cascade, PERIOD, 1e12), new_state()
    x = np.zeros(4)
    out = np.zeros(samples)
    for k in range(samples):
        out[k] = x[1] if velocity_loop else x[0]
        if velocity_loop:
            torque = velocity_step(coefficients, state, 1.0, 0.0, x[0], 0.0)
        else:
            torque = cascade_step(coefficients, state, 1.0, 0.0, 0.0, x[0], 0.0)
        queue += [torque] * SUB_STEPS
        for _ in range(SUB_STEPS):
            x = Phi @ x + Gamma[:, 0] * queue.pop(0)
    return out


def growth_per_second(out: NDArray[np.float64], settled: float) -> float:
    """Rate at which the deviation from ``settled`` grows over the second half of a run, 1/s."""
    deviation = np.abs(out - settled)
    quarter = len(out) // 4
    early, late = deviation[2 * quarter : 3 * quarter].max(), deviation[3 * quarter :].max()
    return float(np.log(late / early) / (quarter * PERIOD))
