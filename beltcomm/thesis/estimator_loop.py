"""The velocity estimators in the source's position loop: rig G_A with its published Butterworth gains, simulated, edges and all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, IntArray, rms
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, Prefilter, discrete_coefficients, new_state, velocity_step
from beltcomm.encoder.edges import INCREMENT_M
from beltcomm.encoder.estimators import EstimatorSettings, coefficients
from beltcomm.encoder.kernel import (
    COUNT,
    INVALID,
    close_period,
    combined_step,
    event_counter_step,
    gate_step,
    high_pass_step,
    new_decoder,
    new_estimator,
    take_stretch,
)
from beltcomm.model import Model, load_plant
from beltcomm.simulate.plant import SimulatedPlant, substeps_needed
from beltcomm.trajectory import Trajectory, plan_trajectory

#: Gains of G_A with the Butterworth prefilter as published (table A.7), no lag of their own: the estimator has it.
GAINS = Cascade(0.12, 1.39, 6.29, 0.0, Prefilter("butterworth", 123.24), filter_reference=False)
PERIOD_S, DEAD_PERIODS, TORQUE_LIMIT_NM = 1e-3, 1, 3.1
#: The plant is asked for its position so often in a period; between, the position is taken as linear.
PARTS = 10
#: T_R of the source, s.
LAG_S = 2e-3
#: The estimators, and the high-pass with the reference behind the same lag.
VARIANTS = ("high_pass", "high_pass_reference", "event_counter", "gate", "combined")
MOVES: Mapping[str, tuple[float, TrajectoryLimits]] = {
    "0.5 m, T_A": (0.5, TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=45.0, speed_m_s=5.0)),
    "2 mm, 3 mm/s": (0.002, TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=45.0, speed_m_s=0.003)),
}


@dataclass(frozen=True)
class LoopResult:
    """One move with one estimator.

    Attributes
    ----------
    error_m, cart_error_m : float
        Largest |reference − motor| and |reference − cart| while the reference moves, m at the belt.
    torque_step_nm : float
        rms change of the torque from period to period, N m.
    estimate_rms_m_s : float
        Of estimate − true velocity, m/s.
    invalid : int
        Edges that no motion makes.
    """

    error_m: float
    cart_error_m: float
    torque_step_nm: float
    estimate_rms_m_s: float
    invalid: int


def loop_results() -> Mapping[str, Mapping[str, LoopResult]]:
    """Every move with every estimator."""
    model = load_plant("g_a").model
    made = {}
    for name, (length, limits) in MOVES.items():
        trajectory = plan_trajectory(0.05, 0.05 + length, limits, PERIOD_S)
        made[name] = {variant: _run_loop(model, trajectory, variant) for variant in VARIANTS}
    return made


def _run_loop(model: Model, trajectory: Trajectory, variant: str) -> LoopResult:
    """Simulate one move from rest: position gain, velocity PI on the estimate, nonlinear feedforward (4.16), 1 ms dead time."""
    ratio = model["transmission.ratio"]
    settings = EstimatorSettings(period_s=PERIOD_S, lag_s=LAG_S)
    c, state = coefficients(settings), new_estimator()
    start = float(trajectory.position_m[0])
    x_before = 0.3 * INCREMENT_M  # the motor's belt travel since the start; the first line lies a little below
    registers = new_decoder(0, 0)
    plant = SimulatedPlant(model, start, max(PARTS, substeps_needed(model, start)))
    controller, controller_state = discrete_coefficients(GAINS, PERIOD_S, TORQUE_LIMIT_NM), new_state()
    feedforward = _feedforward(model, trajectory)
    reference, speed = trajectory.position_m - start, trajectory.velocity_m_s
    pole = LAG_S / (LAG_S + PERIOD_S) if variant == "high_pass_reference" else 0.0
    compared, travelled, waiting = 0.0, 0.0, [0.0] * DEAD_PERIODS
    motor, cart, torques, wrong = (np.zeros(len(reference)) for _ in range(4))
    for k in range(len(reference)):
        now = k * settings.period_ticks
        velocity = _read(variant, c, state, registers, now)
        close_period(registers)
        motor[k], cart[k] = plant.position_rad * ratio, plant.cart_position_m
        wrong[k] = velocity - plant.velocity_rad_s * ratio
        mean = 0.5 * (speed[k] + speed[max(k - 1, 0)]) if pole else speed[k]
        compared = pole * compared + (1.0 - pole) * mean
        counted = float(registers[COUNT]) * INCREMENT_M
        # The compiled loop differentiates a position without lag: the integral of the estimate gives it back the estimate.
        travelled += PERIOD_S * velocity / ratio
        asked = (compared + GAINS.kpp_1_s * (reference[k] - counted)) / ratio
        torques[k] = velocity_step(controller, controller_state, asked, 0.0, travelled, feedforward[k])
        waiting.append(torques[k])
        torque = waiting.pop(0)
        for part in range(PARTS):
            plant.step(torque, PERIOD_S / PARTS)
            x = 0.3 * INCREMENT_M + plant.position_rad * ratio
            begin = now + part * settings.period_ticks // PARTS
            take_stretch(registers, x_before, x, begin, settings.period_ticks // PARTS, INCREMENT_M)
            x_before = x
    return LoopResult(
        float(np.max(np.abs(reference - motor))),
        float(np.max(np.abs(reference - cart))),
        rms(np.diff(torques - feedforward)),
        rms(wrong),
        int(registers[INVALID]),
    )


def _read(variant: str, c: Array, state: Array, registers: IntArray, now: int) -> float:
    if variant == "event_counter":
        return event_counter_step(c, registers)
    if variant == "gate":
        return gate_step(c, registers, now)
    if variant == "combined":
        return combined_step(c, state, registers, now)
    return high_pass_step(c, state, registers)


def _feedforward(model: Model, trajectory: Trajectory) -> Array:
    """(4.16) with the model's own numbers, for the middle of the period in which the torque acts, N m."""
    ratio = model["transmission.ratio"]
    inertia = model["motor.inertia"] + ratio**2 * model["cart.mass"]
    coulomb = model["coulomb.level"] + ratio * model["cart_friction.level"]
    t = trajectory.t_s + (DEAD_PERIODS + 0.5) * PERIOD_S
    speed = np.interp(t, trajectory.t_s, trajectory.velocity_m_s, right=0.0) / ratio
    acceleration = np.interp(t, trajectory.t_s, trajectory.acceleration_m_s2, right=0.0) / ratio
    return np.asarray(inertia * acceleration + model["viscous.damping"] * speed + coulomb * np.sign(speed))
