"""One record at 1 kHz, compiled: encoder, controller, dead time of the setpoint, machine."""

from __future__ import annotations

import math

import numpy as np

from truth.hidden import laws
from truth.hidden import layout as at
from truth.hidden.compilation import compiled
from truth.hidden.kernel import advance
from truth.hidden.layout import Array

#: s, sample period of controller and recording.
PERIOD_S = 1e-3
#: Places in the vector of gains.
(KP, KD, KI, SPEED_FILTER, LIMIT, B0, B1, B2, A1, A2, QUANTUM) = range(11)
GAINS = 11
#: Places in the memory of the drive: controller, last setpoints (newest first), last reported torques without noise.
(INTEGRAL, FILTERED_SPEED, LAST_ANGLE, NOTCH_1, NOTCH_2, SETPOINT, ACTING, ACTING_1, ACTING_2) = range(9)
MEMORY = 9


@compiled
def reading(angle: float, quantum: float, p: Array) -> float:
    """Angle that the encoder reports, rad: disc error, whole counts, and codes that stick until the next good one."""
    code = math.floor(laws.encoder(angle, p) / quantum + 0.5)
    if p[at.CODE_PERIOD] > 0.0:
        within = (code - p[at.CODE_PLACE]) % p[at.CODE_PERIOD]
        if within < p[at.CODE_WIDTH]:
            code -= within
    return float(code * quantum)


@compiled
def control(angle: float, target: float, target_speed: float, forward: float, gains: Array, memory: Array) -> float:
    """Torque setpoint, N m: position and speed error, integral, notch on the feedback, feedforward, limit with anti-windup."""
    raw = (angle - memory[LAST_ANGLE]) / PERIOD_S
    memory[LAST_ANGLE] = angle
    memory[FILTERED_SPEED] += gains[SPEED_FILTER] * (raw - memory[FILTERED_SPEED])
    error = target - angle
    asked = gains[KP] * error + gains[KD] * (target_speed - memory[FILTERED_SPEED]) + memory[INTEGRAL]
    notched = gains[B0] * asked + memory[NOTCH_1]
    memory[NOTCH_1] = gains[B1] * asked - gains[A1] * notched + memory[NOTCH_2]
    memory[NOTCH_2] = gains[B2] * asked - gains[A2] * notched
    wanted = notched + forward
    torque = min(max(wanted, -gains[LIMIT]), gains[LIMIT])
    if torque == wanted or error * wanted < 0.0:
        memory[INTEGRAL] += gains[KI] * error * PERIOD_S
    return torque


@compiled
def run(
    s: Array, p: Array, bursts: Array, gains: Array, memory: Array, target: Array, forward: Array, fine: Array, longest: float
) -> tuple[Array, Array, Array]:
    """Run the machine for len(forward) samples; changes s and memory in place.

    target : (n, 2), angle rad and speed rad/s.   forward : (n,), N m, added to the feedback.
    fine : (n * m,) takes the angle that the encoder disc shows at m instants per sample, or (0,).
    Returns position (rad), torque setpoint (N m), acting torque as the drive knows it (N m), each (n,).
    """
    n = forward.shape[0]
    positions, setpoints, torques = np.empty(n), np.empty(n), np.empty(n)
    per_sample = fine.shape[0] // n
    pieces = max(per_sample, 1)
    late = p[at.DEAD_TIME] / PERIOD_S
    whole = int(late)
    split = (late - whole) * PERIOD_S
    for i in range(n):
        angle = reading(s[at.ANGLE], gains[QUANTUM], p)
        acting = memory[SETPOINT]
        memory[SETPOINT] = control(angle, target[i, 0], target[i, 1], forward[i], gains, memory)
        positions[i], setpoints[i], torques[i] = angle, memory[SETPOINT], acting
        memory[ACTING_2], memory[ACTING_1], memory[ACTING] = memory[ACTING_1], memory[ACTING], acting
        now, before = (acting, memory[ACTING_1]) if whole == 0 else (memory[ACTING_1], memory[ACTING_2])
        for j in range(2 * pieces):  # each piece before and after the instant at which the dead time ends
            begin, end = (j // 2) * PERIOD_S / pieces, (j // 2 + 1) * PERIOD_S / pieces
            cut = min(max(split, begin), end)
            if j % 2 == 0 and per_sample > 0:
                fine[i * per_sample + j // 2] = laws.encoder(s[at.ANGLE], p)
            advance(s, p, bursts, before if j % 2 == 0 else now, cut - begin if j % 2 == 0 else end - cut, longest)
    return positions, setpoints, torques
