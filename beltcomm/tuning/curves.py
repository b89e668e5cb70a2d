"""Curves of one loop on one plant: open loops, steps of the reference, a step of torque at the motor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.control import Cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import closed_loop_inputs, frequencies, open_loops

#: Points of the open loops before refinement, of the responses over time; N m of the torque step at the motor.
_LINES, _MOMENTS = 160, 240
DISTURBANCE_NM = 0.1
#: s, spans to choose from, and how many time constants of position loop and integrator they show.
SPANS_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_TIME_CONSTANTS = 6.0


@dataclass(frozen=True)
class OpenLoops:
    """Gain, dB, and phase, deg, unwrapped from 0, of the open velocity and position loop over freq_hz; ndarray (n,)."""

    freq_hz: Array
    velocity_db: Array
    velocity_deg: Array
    position_db: Array
    position_deg: Array


@dataclass(frozen=True)
class Responses:
    """Over t_s, ndarray (n,).

    Attributes
    ----------
    position : ndarray
        Motor angle on a step of its reference, without feedforward, as a share of it.
    velocity : ndarray
        The same of the velocity loop alone, the step not filtered.
    disturbance_m : ndarray
        Motor, at the carriage, on ``DISTURBANCE_NM`` at the motor, m.
    """

    t_s: Array
    position: Array
    velocity: Array
    disturbance_m: Array


def open_loop_curves(plant: DesignPlant, cascade: Cascade, period_s: float) -> OpenLoops:
    """Both open loops on a grid that is fine around resonance and antiresonance, up to π/T.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
    period_s : float, s
        T of the controller.
    """
    omega = frequencies([plant], period_s, _LINES)[0]
    omega = np.unique(omega[omega >= 1.0])
    velocity, position = open_loops(plant, cascade, period_s, omega)
    return OpenLoops(omega / (2.0 * math.pi), *_bode(velocity), *_bode(position))


def span_s(cascade: Cascade) -> float:
    """Time within which the loop has settled, from ``SPANS_S``.

    Parameters
    ----------
    cascade : Cascade
    """
    slowest = max(1.0 / cascade.kpp_1_s, cascade.kp_nm_s_rad / cascade.ki_nm_rad / 3.0)
    return next((span for span in SPANS_S if span >= _TIME_CONSTANTS * slowest), SPANS_S[-1])


def responses(plant: DesignPlant, cascade: Cascade, period_s: float, span: float) -> Responses:
    """Steps at t = 0 of the linear loop, exactly sampled, every so many periods that some 240 are left.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
    period_s : float, s
        T of the controller.
    span : float, s
        That is shown.
    """
    stride = max(round(span / period_s / _MOMENTS), 1)
    count = round(span / period_s / stride) + 1
    matrix, reference, torque = closed_loop_inputs(plant, cascade, period_s)
    position = _stepped(matrix, cascade.kpp_1_s * reference, stride, count)[:, 0]
    disturbance = _stepped(matrix, DISTURBANCE_NM * torque, stride, count)[:, 0]
    alone, reference, _ = closed_loop_inputs(plant, replace(cascade, kpp_1_s=0.0), period_s)
    velocity = _stepped(alone, reference, stride, count)[:, _speed(plant)]
    return Responses(period_s * stride * np.arange(count, dtype=np.float64), position, velocity, plant.transmission_m_rad * disturbance)


def _stepped(matrix: Array, column: Array, stride: int, count: int) -> Array:
    """States (count, N) of x[k+1] = M x[k] + column from rest, every ``stride`` steps."""
    n = len(column)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n], block[n, n] = matrix, column, 1.0
    leap = np.linalg.matrix_power(block, stride)
    states, state = np.zeros((count, n + 1)), np.eye(1, n + 1, n)[0]
    for k in range(count):
        states[k] = state
        state = leap @ state
    return states[:, :n]


def _speed(plant: DesignPlant) -> int:
    """Place of the motor's speed in the plant's state."""
    return 1 if plant.bodies is None else len(plant.state_space()[1]) // 2


def _bode(loop: ComplexArray) -> tuple[Array, Array]:
    """Gain, dB, and phase, deg, the first within 0 .. −360."""
    phase = np.degrees(np.unwrap(np.angle(loop)))
    return decibels(loop), phase - 360.0 * math.ceil(phase[0] / 360.0 - 0.125)
