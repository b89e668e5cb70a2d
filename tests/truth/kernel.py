"""The equations of motion and their event-driven integration, compiled.

Between two events every body is either stuck or slides in a known direction, so the right-hand side is smooth and the
classical Runge-Kutta method of order four applies.  An event ends the smooth piece: a sliding body reaches zero speed,
or the force on a stuck body reaches its Coulomb level.  The instant is located by root finding on the integration step
itself, so the order is kept across events.

Bodies: 0 motor (rad), 1 carriage (m), 2 end pulley (m along the belt), 3 driving pulley behind a compliant coupling
(rad at the motor shaft); those a machine does not have never move.  Coordinates, speeds and forces are tuples of four, not
arrays, because compiled code keeps them in registers: four times faster.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Four = tuple[float, float, float, float]
#: Coordinates, speeds, and the forces there without Coulomb friction.
Motion = tuple[Four, Four, Four]
#: Coulomb friction that acts (signed), and 1/inertia, which is 0 for a stuck body.
Contact = tuple[Four, Four]
P = ParamSpec("P")
R = TypeVar("R")

BODIES = 4
MOTOR, CART, END_PULLEY, DRIVING_PULLEY = range(BODIES)
CONSTANT, TWO_STRANDS, THREE_SECTIONS = range(3)  # kinds of belt
FINE, CHATTER, OFF_BELT, NOT_A_NUMBER = range(4)  # outcomes of `advance`

# Places in the parameter vector; inverse inertia and friction take one place per body.
INVERSE_INERTIA = 0
VISCOUS = INVERSE_INERTIA + BODIES
COULOMB = VISCOUS + BODIES
(
    TRANSMISSION,
    GRAVITY_FORCE,
    BELT_KIND,
    STIFFNESS,
    DAMPING,
    SPECIFIC_STIFFNESS,
    SPECIFIC_DAMPING,
    PULLEY_DISTANCE,
    LENGTH_AT_START,
    COUPLED,
    COUPLING_STIFFNESS,
    COUPLING_DAMPING,
    STOP_LOW,
    STOP_HIGH,
    STOP_STIFFNESS,
    STOP_LOSS,
    PARAMETERS,
) = range(COULOMB + BODIES, COULOMB + BODIES + 17)

#: Events within one sub-step before the integration gives up: four bodies change their state once or twice at most.
MOST_EVENTS = 64
#: s, an event is located when the root moves less than this.
EVENT_TIME_TOLERANCE_S = 1e-15


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """``numba.njit`` with its type kept; a division by zero gives inf, found by the check for finite numbers."""
    decorate: Any = numba.njit(cache=True, error_model="numpy")
    result: Callable[P, R] = decorate(function)
    return result


@compiled
def net_forces(q: Four, v: Four, torque: float, p: Array) -> tuple[Four, float]:
    """Force on every body without its Coulomb friction, and the belt force at the driving pulley.

    Two masses (2.25), (2.26); three masses (2.12), (2.14), (2.15); gravity (2.22).
    q, v : coordinates and speeds.   torque : N m at the motor shaft.
    Returns the forces, N m for the rotary bodies and N for the others, and -tau_1/r of (2.17), N, positive when the belt
    pulls the carriage in positive direction.
    """
    lever = p[TRANSMISSION]
    cart, cart_speed = q[CART], v[CART]
    motor_torque = torque - p[VISCOUS + MOTOR] * v[MOTOR]
    transmitted, end_force = 0.0, 0.0
    u, u_speed = lever * q[MOTOR], lever * v[MOTOR]
    if p[COUPLED] != 0.0:
        u, u_speed = lever * q[DRIVING_PULLEY], lever * v[DRIVING_PULLEY]
        twist, twist_rate = q[MOTOR] - q[DRIVING_PULLEY], v[MOTOR] - v[DRIVING_PULLEY]
        transmitted = p[COUPLING_STIFFNESS] * twist + p[COUPLING_DAMPING] * twist_rate

    stretch, rate = u - cart, u_speed - cart_speed
    l1 = p[LENGTH_AT_START] + cart
    if p[BELT_KIND] == CONSTANT:
        belt = p[STIFFNESS] * stretch + p[DAMPING] * rate
        on_cart = belt
    elif p[BELT_KIND] == TWO_STRANDS:
        stiffness = p[SPECIFIC_STIFFNESS] * (1.0 / l1 + 1.0 / (2.0 * p[PULLEY_DISTANCE] - l1))
        belt = stiffness * stretch + p[DAMPING] * rate
        on_cart = belt
    else:
        l3 = p[PULLEY_DISTANCE]
        end, end_speed = q[END_PULLEY], v[END_PULLEY]
        ea, da = p[SPECIFIC_STIFFNESS], p[SPECIFIC_DAMPING]
        section_1 = (ea * stretch + da * rate) / l1
        section_2 = (ea * (end - cart) + da * (end_speed - cart_speed)) / (l3 - l1)
        section_3 = (ea * (u - end) + da * (u_speed - end_speed)) / l3
        belt = section_1 + section_3
        on_cart = section_1 + section_2
        end_force = section_3 - section_2 - p[VISCOUS + END_PULLEY] * end_speed
    on_cart += p[GRAVITY_FORCE] - p[VISCOUS + CART] * cart_speed

    # Hunt-Crossley contact: the damping grows with the depth, so the force does not jump when the carriage touches.
    if cart > p[STOP_HIGH]:
        on_cart -= max(0.0, p[STOP_STIFFNESS] * (cart - p[STOP_HIGH]) * (1.0 + p[STOP_LOSS] * cart_speed))
    elif cart < p[STOP_LOW]:
        on_cart += max(0.0, p[STOP_STIFFNESS] * (p[STOP_LOW] - cart) * (1.0 - p[STOP_LOSS] * cart_speed))

    if p[COUPLED] != 0.0:
        return (motor_torque - transmitted, on_cart, end_force, transmitted - lever * belt), belt
    return (motor_torque - lever * belt, on_cart, end_force, 0.0), belt


@compiled
def along(x: Four, h: float, rate: Four) -> Four:
    """x + h rate."""
    return x[0] + h * rate[0], x[1] + h * rate[1], x[2] + h * rate[2], x[3] + h * rate[3]


@compiled
def accelerations(forces: Four, contact: Contact) -> Four:
    """Acceleration of every body; a stuck body has none."""
    f, (drag, mobility) = forces, contact
    return (
        (f[0] - drag[0]) * mobility[0],
        (f[1] - drag[1]) * mobility[1],
        (f[2] - drag[2]) * mobility[2],
        (f[3] - drag[3]) * mobility[3],
    )


@compiled
def contact_of(slide: Array, p: Array) -> Contact:
    """What friction does to each body while nobody changes between stuck and sliding."""
    i, s = INVERSE_INERTIA, slide
    drag = (s[0] * p[COULOMB], s[1] * p[COULOMB + 1], s[2] * p[COULOMB + 2], s[3] * p[COULOMB + 3])
    mobility = (abs(s[0]) * p[i], abs(s[1]) * p[i + 1], abs(s[2]) * p[i + 2], abs(s[3]) * p[i + 3])
    return drag, mobility


@compiled
def smooth_step(start: Motion, h: float, torque: float, contact: Contact, p: Array) -> Motion:
    """One classical Runge-Kutta step of length h, without events."""
    q, v, forces = start
    a1 = accelerations(forces, contact)
    v2 = along(v, 0.5 * h, a1)
    a2 = accelerations(net_forces(along(q, 0.5 * h, v), v2, torque, p)[0], contact)
    v3 = along(v, 0.5 * h, a2)
    a3 = accelerations(net_forces(along(q, 0.5 * h, v2), v3, torque, p)[0], contact)
    v4 = along(v, h, a3)
    a4 = accelerations(net_forces(along(q, h, v3), v4, torque, p)[0], contact)
    inner = along(a2, 1.0, a3)
    q = along(along(q, h, v), h * h / 6.0, along(inner, 1.0, a1))
    v = along(along(v, h / 3.0, inner), h / 6.0, along(a1, 1.0, a4))
    return q, v, net_forces(q, v, torque, p)[0]


@compiled
def margin(motion: Motion, i: int, slide: Array, p: Array) -> float:
    """Distance of body i from its next event, negative beyond it: its speed, or what its friction still has in hand."""
    if slide[i] != 0.0:
        return float(slide[i] * motion[1][i])
    return float(p[COULOMB + i] - abs(motion[2][i]))


@compiled
def event_time(start: Motion, i: int, end: float, torque: float, contact: Contact, slide: Array, p: Array) -> float:
    """First instant at which the margin of body i is negative, given that it is so at ``end``; s from the start of the step.

    False position with the Illinois weights.  A middle stays one tolerance away from both ends, so that both of them close
    in and the end with the negative margin can be returned: the event has happened there, in floating point as well.
    Where the margin is zero at the start (a body just released) the interval is halved until it is not.
    """
    tolerance = EVENT_TIME_TOLERANCE_S
    low, high = 0.0, end
    at_low = max(0.0, margin(start, i, slide, p))
    at_high = margin(smooth_step(start, high, torque, contact, p), i, slide, p)
    last = 0
    while high - low > 2.0 * tolerance:
        middle = 0.5 * (low + high) if at_low == 0.0 else (low * at_high - high * at_low) / (at_high - at_low)
        middle = min(max(middle, low + tolerance), high - tolerance)
        at_middle = margin(smooth_step(start, middle, torque, contact, p), i, slide, p)
        if at_middle < 0.0:
            high, at_high = middle, at_middle
            at_low = 0.5 * at_low if last < 0 else at_low
            last = -1
        else:
            low, at_low = middle, at_middle
            at_high = 0.5 * at_high if last > 0 else at_high
            last = 1
    return high


@compiled
def dip_time(start: Motion, end: Motion, i: int, h: float, torque: float, contact: Contact, slide: Array, p: Array) -> float:
    """Instant inside a step at which a sliding body dips below zero speed only to come back, 0 when it does not; s.

    A dip needs deceleration at the start, acceleration at the end, and little speed.
    """
    s = slide[i]
    at_start = s * accelerations(start[2], contact)[i]
    if at_start >= 0.0 or s * start[1][i] > -at_start * h:
        return 0.0
    at_end = s * accelerations(end[2], contact)[i]
    if at_end <= 0.0:
        return 0.0
    slowest = float(h * at_start / (at_start - at_end))
    return slowest if s * smooth_step(start, slowest, torque, contact, p)[1][i] < 0.0 else 0.0


@compiled
def next_event(start: Motion, left: float, torque: float, contact: Contact, slide: Array, p: Array) -> tuple[float, int, Motion]:
    """Time to the first event within ``left``, its body (-1 without one) and the motion then.

    A stuck body whose force passes its level and returns within one sub-step is let be: it would move by the fourth order
    of the sub-step, which is the order of the integration itself.
    """
    first, body = left, -1
    end = smooth_step(start, left, torque, contact, p)
    for i in range(BODIES):
        if p[COULOMB + i] == 0.0:
            continue
        until = 0.0
        if margin(end, i, slide, p) < 0.0:
            until = left
        elif slide[i] != 0.0:
            until = dip_time(start, end, i, left, torque, contact, slide, p)
        if until > 0.0:
            at = event_time(start, i, until, torque, contact, slide, p)
            if body < 0 or at < first:
                first, body = at, i
    if body >= 0:
        end = smooth_step(start, first, torque, contact, p)
    return first, body, end


@compiled
def with_zero(x: Four, i: int) -> Four:
    """x with its place i set to zero."""
    return 0.0 if i == 0 else x[0], 0.0 if i == 1 else x[1], 0.0 if i == 2 else x[2], 0.0 if i == 3 else x[3]


@compiled
def settle(force: float, i: int, slide: Array, p: Array) -> None:
    """Decide for a body at rest: stuck while the other forces stay within its level, else off in their direction."""
    slide[i] = 0.0 if abs(force) <= p[COULOMB + i] else math.copysign(1.0, force)


@compiled
def advance(state: Array, p: Array, torque: float, duration: float, longest: float) -> tuple[float, float, float, float, int]:
    """Let a held torque act for ``duration`` in equal sub-steps of at most ``longest``, s; changes ``state`` in place.

    state : (12,), coordinates, speeds, and the direction of motion, +1 or -1, 0 when stuck (of a body without Coulomb
    friction always +1 or -1).   p : the machine.
    Returns motor angle (rad), motor speed (rad/s), carriage displacement (m), belt force (N) and the outcome.
    """
    outcome = FINE
    slide = state[2 * BODIES :]
    q, v = (state[0], state[1], state[2], state[3]), (state[4], state[5], state[6], state[7])
    forces, belt = net_forces(q, v, torque, p)
    for i in range(BODIES):  # the torque may have jumped
        if p[COULOMB + i] > 0.0 and v[i] == 0.0:
            settle(forces[i], i, slide, p)
    contact = contact_of(slide, p)
    motion = (q, v, forces)
    pieces = math.ceil(duration / longest - 1e-9)
    for _ in range(pieces):
        left = duration / pieces
        events = 0
        while left > 0.0 and outcome == FINE:
            passed, body, motion = next_event(motion, left, torque, contact, slide, p)
            left -= passed
            if body >= 0:
                if slide[body] != 0.0:
                    q, v = motion[0], with_zero(motion[1], body)
                    motion = (q, v, net_forces(q, v, torque, p)[0])
                settle(motion[2][body], body, slide, p)
                contact = contact_of(slide, p)
                events += 1
                if events > MOST_EVENTS:
                    outcome = CHATTER
        l1 = p[LENGTH_AT_START] + motion[0][CART]
        if p[BELT_KIND] != CONSTANT and not 0.0 < l1 < p[PULLEY_DISTANCE]:
            outcome = OFF_BELT
            break
    q, v, forces = motion
    for i in range(BODIES):
        state[i], state[BODIES + i] = q[i], v[i]
    belt = net_forces(q, v, torque, p)[1]
    if not math.isfinite(q[MOTOR] + q[CART]):
        outcome = NOT_A_NUMBER
    return q[MOTOR], v[MOTOR], q[CART], belt, outcome
