"""The loops that run: sampled plant, dead time, velocity filter, prefilter and PI in their discrete form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import (
    Cascade,
    Prefilter,
    pi_response,
    prefilter_coefficients,
    prefilter_response,
    roll_off_coefficients,
    velocity_filter_response,
)
from beltcomm.design.design_plant import DesignPlant

_LOWEST_RAD_S = 0.3


@dataclass(frozen=True)
class SampledPlants:
    """Several plants on one frequency grid each, refined around their own resonance and antiresonance.

    Attributes
    ----------
    plants : tuple of DesignPlant
        Tuple of p plants.
    period_s : float
        T, s.
    omega_rad_s : ndarray (p, n)
        Increasing along the rows, up to π/T.
    response : ComplexArray, (p, n)
        Torque setpoint to sampled motor angle, rad/(N m).
    """

    plants: tuple[DesignPlant, ...]
    period_s: float
    omega_rad_s: Array
    response: ComplexArray


@dataclass(frozen=True)
class LoopShape:
    """The velocity loop without its PI controller, and what is needed to close it.

    Attributes
    ----------
    without_pi : ComplexArray, (p, n)
        Prefilter × plant × velocity estimator, rad/s per N m.
    integrator : ComplexArray
        T/(z − 1), s.
    estimator : ComplexArray
        Motor angle to measured velocity, 1/s.
    resonance_rad_s, antiresonance_rad_s : ndarray (p, 1), rad/s
    """

    omega_rad_s: Array
    without_pi: ComplexArray
    integrator: ComplexArray
    estimator: ComplexArray
    resonance_rad_s: Array
    antiresonance_rad_s: Array

    def rows(self, plants: Sequence[int]) -> LoopShape:
        """The shape of some of the plants, (k, n), in the order wanted."""
        k = list(plants)
        return LoopShape(
            self.omega_rad_s[k],
            self.without_pi[k],
            self.integrator[k],
            self.estimator[k],
            self.resonance_rad_s[k],
            self.antiresonance_rad_s[k],
        )


def sample_plants(plants: Sequence[DesignPlant], period_s: float, points: int) -> SampledPlants:
    """Exact sampled responses of all plants; ``points`` per plant on the log-spaced base grid, as many again around ω_r, ω_z.

    The base grid runs from 0.3 rad/s, below every crossover that commissions an axis, to π/T.

    Parameters
    ----------
    plants : sequence of DesignPlant
        p plants.
    period_s : float, s
        T of the controller.
    points : int
        Of the base grid.

    Returns
    -------
    SampledPlants
        Responses in rad/(N m), (p, n).
    """
    omega = frequencies(plants, period_s, points)
    response = np.array([plant.sampled_response(row, period_s) for plant, row in zip(plants, omega, strict=True)])
    return SampledPlants(tuple(plants), period_s, omega, response)


def loop_shape(sampled: SampledPlants, prefilter: Prefilter, velocity_filter_s: float) -> LoopShape:
    """The shape of the velocity loop with this prefilter and T_R.

    Parameters
    ----------
    sampled : SampledPlants
        p plants.
    prefilter : Prefilter
        In front of the velocity controller.
    velocity_filter_s : float, s
        T_R.

    Returns
    -------
    LoopShape
        Everything of the loop but K_P and K_I.

    Raises
    ------
    UsageError
        For a prefilter above π/T.
    """
    omega, period = sampled.omega_rad_s, sampled.period_s
    estimator = velocity_filter_response(omega, velocity_filter_s, period)
    return LoopShape(
        omega,
        prefilter_response(omega, prefilter, period) * sampled.response * estimator,
        pi_response(omega, 0.0, 1.0, period),
        estimator,
        np.array([[plant.resonance_rad_s] for plant in sampled.plants]),
        np.array([[plant.antiresonance_rad_s] for plant in sampled.plants]),
    )


def open_velocity_loop(shape: LoopShape, kp: float, ki: float) -> ComplexArray:
    """L_ω = PI × prefilter × plant × estimator, ndarray (p, n).

    Parameters
    ----------
    shape : LoopShape
        Of p plants.
    kp, ki : float
        N m s/rad and N m/rad.

    Returns
    -------
    ndarray, (p, n) complex
        Without unit.
    """
    return np.asarray((kp + ki * shape.integrator) * shape.without_pi)


def position_path(velocity_loop: ComplexArray, estimator: ComplexArray) -> ComplexArray:
    """Position loop without K_PP, (4.10) with the prefilter in it: L_ω/(1 + L_ω)/estimator.

    Parameters
    ----------
    velocity_loop, estimator : ndarray, (p, n) complex
        L_ω, and the answer of the velocity measurement to the angle, 1/s.

    Returns
    -------
    ndarray, (p, n) complex
        s.
    """
    return np.asarray(velocity_loop / ((1.0 + velocity_loop) * estimator))


def open_loops(plant: DesignPlant, cascade: Cascade, period_s: float, omega_rad_s: Array) -> tuple[ComplexArray, ComplexArray]:
    """Open velocity loop and open position loop at given frequencies, for plots: two ndarray (n,).

    Margins are read where they equal −1.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
    period_s : float, s
        T of the controller.
    omega_rad_s : ndarray (n,), rad/s
        Above 0, at most π/T.
    """
    sampled = SampledPlants((plant,), period_s, omega_rad_s[None, :], plant.sampled_response(omega_rad_s, period_s)[None, :])
    shape = loop_shape(sampled, cascade.prefilter, cascade.velocity_filter_s)
    velocity = open_velocity_loop(shape, cascade.kp_nm_s_rad, cascade.ki_nm_rad)
    return velocity[0], cascade.kpp_1_s * position_path(velocity, shape.estimator)[0]


def closed_loop_poles(plant: DesignPlant, cascade: Cascade, period_s: float) -> ComplexArray:
    """Poles of the closed cascade without feedforward.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
        K_PP = 0 gives the velocity loop and one pole at 1, the free angle.
    period_s : float, s
        T of the controller.

    Returns
    -------
    ndarray, (N,) complex
        z.
    """
    advance, new, old, whole = plant.sampled(period_s)
    matrix = closed_loop_matrix(advance, new, old, whole, cascade, period_s)
    return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)  # eigvals returns real numbers when all of them are


def closed_loop_matrix(advance: Array, new: Array, old: Array, whole: int, cascade: Cascade, period_s: float) -> Array:
    """One period of the closed cascade for plants sampled as :meth:`DesignPlant.sampled`, (..., N, N) for Φ (..., n, n).

    State: plant (4, or two per body), torque setpoints under way (n + 1), last angle, measured velocity, prefilter (2), integrator,
    additional low-pass (2) where there is one.

    Parameters
    ----------
    advance, new, old : ndarray, (..., n, n) and (..., n)
        Φ, Γ0, Γ1 of :meth:`DesignPlant.sampled`.
    whole : int
        Whole periods of the dead time.
    cascade : Cascade
    period_s : float, s
        T of the controller.

    Returns
    -------
    ndarray, (..., N, N)
        State after a period from the state before it.
    """
    return _period(advance, new, old, whole, cascade, period_s)[..., :-1]


def closed_loop_inputs(plant: DesignPlant, cascade: Cascade, period_s: float) -> tuple[Array, Array, Array]:
    """The closed cascade of one plant with what drives it: x[k+1] = M x[k] + b ω_d[k] + g τ[k].

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
    period_s : float, s
        T of the controller.

    Returns
    -------
    tuple of ndarray (N, N), ndarray (N,), ndarray (N,)
        M as :func:`closed_loop_matrix`; b of a reference velocity, rad/s (a reference angle φ_d enters as K_PP φ_d); g of a torque that
        acts on the motor at once, N m.
    """
    advance, new, old, whole = plant.sampled(period_s)
    period = _period(advance, new, old, whole, cascade, period_s)
    _, at_once, nothing, _ = replace(plant, dead_time_s=0.0).sampled(period_s)
    torque = np.zeros(len(period))
    torque[: len(at_once)] = at_once + nothing
    return period[:, :-1], period[:, -1], torque


def _period(advance: Array, new: Array, old: Array, whole: int, cascade: Cascade, period_s: float) -> Array:
    """One period of the loop applied to the unit vectors of its state, and last to a reference velocity of 1: (..., N, N + 1)."""
    n = advance.shape[-1]
    low_pass = cascade.prefilter.roll_off_rad_s > 0.0
    size = n + whole + 1 + (7 if low_pass else 5)
    state, reference = np.eye(size, size + 1), np.eye(1, size + 1, size)[0]
    plant_state, line, rest = state[:n], state[n : n + 1 + whole], state[n + 1 + whole :]
    last_angle, velocity, memory_1, memory_2, integral = rest[:5]
    lag = cascade.velocity_filter_s
    angle = plant_state[0]
    measured = (lag * velocity + angle - last_angle) / (lag + period_s)
    raw_error = reference - cascade.kpp_1_s * angle - measured
    b0, b1, b2, a1, a2 = prefilter_coefficients(cascade.prefilter, period_s)
    filtered = error = b0 * raw_error + memory_1
    behind = []
    if low_pass:
        c0, c1, c2, d1, d2 = roll_off_coefficients(cascade.prefilter, period_s)
        error = c0 * filtered + rest[5]
        behind = [c1 * filtered - d1 * error + rest[6], c2 * filtered - d2 * error]
    torque = cascade.kp_nm_s_rad * error + cascade.ki_nm_rad * integral
    under_way = np.vstack([torque, line])
    controller = np.vstack(
        [
            under_way[:-1],
            angle,
            measured,
            b1 * raw_error - a1 * filtered + memory_2,
            b2 * raw_error - a2 * filtered,
            integral + period_s * error,
            *behind,
        ]
    )
    moved = advance @ plant_state + new[..., None] * under_way[whole] + old[..., None] * under_way[whole + 1]
    return np.concatenate([moved, np.broadcast_to(controller, (*advance.shape[:-2], *controller.shape))], axis=-2)


def frequencies(plants: Sequence[DesignPlant], period_s: float, points: int) -> Array:
    """Grids (p, k), rad/s: a log-spaced base for all, and around ω_r, ω_z and further modes of each plant offsets that grow from a tenth
    of the half width to a fifth of the frequency.

    Parameters
    ----------
    plants : sequence of DesignPlant
        With equally many bodies.
    period_s : float, s
        T of the controller.
    points : int
        Of each part of the grid, about.
    """
    # A hair below π/T, where the Butterworth filter has a zero and no logarithm.
    nyquist = 0.999 * math.pi / period_s
    modes = np.array([[plant.resonance_rad_s, plant.antiresonance_rad_s, *plant.modes_rad_s] for plant in plants])
    damping = np.array([plant.resonance_damping for plant in plants])
    centre = _folded_frequency(modes, period_s)[..., None]
    nearest = np.broadcast_to(0.1 * np.maximum(damping, 1e-4)[:, None], modes.shape)
    width = centre * np.moveaxis(np.geomspace(nearest, 0.2, points // 4), 0, -1)
    base = np.broadcast_to(np.geomspace(_LOWEST_RAD_S, nyquist, points), (len(plants), points))
    around = np.concatenate([centre - width, centre + width], axis=-1).reshape(len(plants), -1)
    return np.sort(np.clip(np.concatenate([base, around], axis=1), _LOWEST_RAD_S, nyquist), axis=1)


def _folded_frequency(omega_rad_s: Array, period_s: float) -> Array:
    """Alias frequencies after sampling, rad/s."""
    rate = 2.0 * math.pi / period_s
    return np.asarray(np.abs((omega_rad_s + 0.5 * rate) % rate - 0.5 * rate))
