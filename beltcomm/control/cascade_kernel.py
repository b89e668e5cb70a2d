"""The cascade as a servo drive runs it: one compiled step per sampling period.

Numbers are those of ``beltcomm.control.discrete_coefficients``; the state is one array of ten, so that other compiled
code can hold it.  All quantities at the motor shaft.

Sources: figure 4.1, (4.1), (4.3), (4.6), (4.16), (6.1), (6.25), (6.26).
"""

from __future__ import annotations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled

# Places in the state.
_POSITION, _VELOCITY, _REFERENCE, _FILTERED_REFERENCE, _BIQUAD_1, _BIQUAD_2, _INTEGRAL, _ACCELERATION, _LOW_PASS_1, _LOW_PASS_2 = range(10)


def new_state() -> Array:
    """State of a cascade at rest at position 0: ndarray (10,).

    Motor angle of the last step, rad; measured velocity, rad/s; reference velocity of the last step, rad/s; filtered
    reference velocity, rad/s; two states of the prefilter (transposed direct form II), rad/s; integrator x_I, rad;
    reference acceleration of the last step, rad/s²; two states of the additional low-pass, rad/s.
    """
    return np.zeros(10)


@compiled
def reset_state(state: Array, position_rad: float, velocity_rad_s: float = 0.0) -> None:
    """Bring a state to a place, as a drive does when it closes its loop; only the measured velocity is remembered.

    Parameters
    ----------
    state : ndarray (10,)
        As :func:`new_state` has it; changed in place.
    position_rad, velocity_rad_s : float, rad, rad/s, motor shaft
        Of the motor now.
    """
    state[:] = 0.0
    state[_POSITION] = position_rad
    state[_VELOCITY] = state[_REFERENCE] = state[_FILTERED_REFERENCE] = velocity_rad_s


def measured_speed(state: Array) -> float:
    """Speed of the motor as the loop has it, rad/s, behind its filter.

    Parameters
    ----------
    state : ndarray
        (10,), as :func:`new_state` has it.

    Returns
    -------
    float
        rad/s.
    """
    return float(state[_VELOCITY])


@compiled
def begin_ramp(state: Array, velocity_rad_s: float) -> None:
    """Let a reference velocity without feedforward of its acceleration begin as one that has stood for long.

    What the reference was before is no change of it, and its filter holds it already: a drive that changes from a position loop without
    velocity feedforward to a ramp would else ask for standstill first.

    Parameters
    ----------
    state : ndarray (10,)
        As :func:`new_state` has it; changed in place.
    velocity_rad_s : float, rad/s, motor shaft
        Of the reference.
    """
    state[_REFERENCE] = state[_FILTERED_REFERENCE] = velocity_rad_s
    state[_ACCELERATION] = 0.0


@compiled
def cascade_step(
    coefficients: Array,
    state: Array,
    reference_position_rad: float,
    reference_velocity_rad_s: float,
    reference_acceleration_rad_s2: float,
    position_rad: float,
    extra_torque_nm: float,
) -> float:
    """One period of the position cascade; returns the torque setpoint, N m, and moves ``state`` on.

    e = K_PP (φ_d − φ) + filtered K_v ω_d − ω,   τ = PI(prefilter(e)) + feedforward(ω_d, dω_d/dt) + extra, limited.

    The feedforward uses ω_d as it is, not filtered and not times K_v,
    extrapolated by the advance: the torque acts a delay and half a period after it was computed.

    Parameters
    ----------
    coefficients, state : ndarray (23,), (10,)
    reference_position_rad : float, rad
        φ_d, motor shaft.
    reference_velocity_rad_s : float, rad/s
        ω_d.
    reference_acceleration_rad_s2 : float, rad/s²
        dω_d/dt.
    position_rad : float, rad
        φ, as the encoder shows it.
    extra_torque_nm : float, N m
        Added to the loop's, motor shaft.
    """
    error = coefficients[3] * (reference_position_rad - position_rad)
    return _velocity_loop(
        coefficients,
        state,
        error,
        coefficients[15] * reference_velocity_rad_s,
        reference_velocity_rad_s,
        reference_acceleration_rad_s2,
        position_rad,
        extra_torque_nm,
    )


@compiled
def velocity_step(
    coefficients: Array,
    state: Array,
    reference_velocity_rad_s: float,
    reference_acceleration_rad_s2: float,
    position_rad: float,
    extra_torque_nm: float,
) -> float:
    """One period of the velocity loop alone, as :func:`cascade_step` with K_PP = 0 and K_v = 1.

    Parameters
    ----------
    coefficients, state : ndarray (23,), (10,)
        As for :func:`cascade_step`; the state moves on.
    reference_velocity_rad_s, reference_acceleration_rad_s2 : float, rad/s, rad/s²
        The velocity asked for is the setpoint itself, not a feedforward.
    position_rad : float, rad
        Of the motor.
    extra_torque_nm : float, N m
        Added to the loop's, motor shaft.

    Returns
    -------
    float, N m
        Torque setpoint at the motor shaft.
    """
    return _velocity_loop(
        coefficients,
        state,
        0.0,
        reference_velocity_rad_s,
        reference_velocity_rad_s,
        reference_acceleration_rad_s2,
        position_rad,
        extra_torque_nm,
    )


@compiled
def _velocity_loop(
    coefficients: Array,
    state: Array,
    position_term: float,
    compared_velocity: float,
    reference_velocity: float,
    reference_acceleration: float,
    position: float,
    extra_torque: float,
) -> float:
    period, kp, ki, lag = coefficients[0], coefficients[1], coefficients[2], coefficients[4]
    pole = lag / (lag + period)
    state[_VELOCITY] = pole * state[_VELOCITY] + (1.0 - pole) * (position - state[_POSITION]) / period
    state[_POSITION] = position

    if coefficients[5] != 0.0:
        mean = 0.5 * (compared_velocity + state[_REFERENCE])
        state[_FILTERED_REFERENCE] = pole * state[_FILTERED_REFERENCE] + (1.0 - pole) * mean
    else:
        state[_FILTERED_REFERENCE] = compared_velocity
    state[_REFERENCE] = compared_velocity

    raw_error = position_term + state[_FILTERED_REFERENCE] - state[_VELOCITY]
    error = coefficients[6] * raw_error + state[_BIQUAD_1]
    state[_BIQUAD_1] = coefficients[7] * raw_error - coefficients[9] * error + state[_BIQUAD_2]
    state[_BIQUAD_2] = coefficients[8] * raw_error - coefficients[10] * error
    filtered = error
    error = coefficients[18] * filtered + state[_LOW_PASS_1]
    state[_LOW_PASS_1] = coefficients[19] * filtered - coefficients[21] * error + state[_LOW_PASS_2]
    state[_LOW_PASS_2] = coefficients[20] * filtered - coefficients[22] * error

    # The acceleration arrives as the difference quotient of the velocity, so it is half a period old; its own change carries
    # both ahead.  Along a jerk-limited reference that is exact but for the samples at which the jerk switches.
    ahead = coefficients[17] / period
    change = reference_acceleration - state[_ACCELERATION]
    state[_ACCELERATION] = reference_acceleration
    if ahead > 0.0:
        reference_velocity += coefficients[17] * (reference_acceleration + 0.5 * (1.0 + ahead) * change)
        reference_acceleration += (0.5 + ahead) * change

    feedforward = (
        coefficients[11] * reference_acceleration
        + coefficients[12] * reference_velocity
        + coefficients[13] * np.sign(reference_velocity)
        + coefficients[14]
        + extra_torque
    )
    limit = coefficients[16]
    demand = kp * error + ki * state[_INTEGRAL] + feedforward

    # (6.26).  τ_d[k+1] in its condition is the torque that this error would lead to with the integrator moved on; taken
    # literally with e[k+1] and τ_FF[k+1] a step of the feedforward would wind the integrator up instead of down.
    integral = state[_INTEGRAL] + period * error
    next_demand = kp * error + ki * integral + feedforward
    if ki > 0.0:
        # Where the error or the feedforward alone exceed the limit, (6.26) as printed charges the integrator the other way, and the
        # axis is pushed on when it should brake (a quick stop from 0.7 m/s first accelerated).  So it is only ever discharged.
        before = state[_INTEGRAL]
        if next_demand >= limit and error > 0.0:
            integral = min(integral, max((limit - kp * error - feedforward) / ki, min(before, 0.0)))
        elif next_demand <= -limit and error < 0.0:
            integral = max(integral, min((-limit - kp * error - feedforward) / ki, max(before, 0.0)))
    state[_INTEGRAL] = integral
    return float(min(max(demand, -limit), limit))
