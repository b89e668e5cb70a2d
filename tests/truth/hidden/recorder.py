"""One record, compiled: encoder, controller, drive, machine.  At 1 kHz behind an ideal drive, or as ``drive`` shapes it."""

from __future__ import annotations

import math

import numpy as np

from truth.hidden import drive, laws
from truth.hidden import layout as at
from truth.hidden.compilation import compiled
from truth.hidden.drive import (
    ACTING,
    ACTING_1,
    ACTING_2,
    COMMAND,
    FILTERED_SPEED,
    INTEGRAL,
    LAST_ANGLE,
    MEMORY,
    NOTCH_1,
    NOTCH_2,
    SETPOINT,
    SETPOINT_1,
)
from truth.hidden.kernel import advance
from truth.hidden.layout import Array

__all__ = ["FILTERED_SPEED", "GAINS", "INTEGRAL", "LAST_ANGLE", "MEMORY", "NOTCH_1", "NOTCH_2", "PERIOD_S", "control", "reading", "run"]

#: s, sample period of controller and recording where the instruments say nothing else.
PERIOD_S = 1e-3
#: s, below this a piece of a sample is rounding.
SHORTEST_S = 1e-12
#: Places in the vector of gains.
(KP, KD, KI, SPEED_FILTER, LIMIT, B0, B1, B2, A1, A2, QUANTUM, PERIOD) = range(12)
GAINS = 12


@compiled
def coded(shown: float, quantum: float, p: Array) -> float:
    """A shown angle in whole counts, rad, with codes that stick until the next good one."""
    code = math.floor(shown / quantum + 0.5)
    if p[at.CODE_PERIOD] > 0.0:
        within = (code - p[at.CODE_PLACE]) % p[at.CODE_PERIOD]
        if within < p[at.CODE_WIDTH]:
            code -= within
    return float(code * quantum)


@compiled
def reading(angle: float, quantum: float, p: Array) -> float:
    """Angle that an encoder without interpolation error and noise reports, rad."""
    return coded(laws.encoder(angle, p), quantum, p)


@compiled
def control(angle: float, target: float, target_speed: float, forward: float, gains: Array, memory: Array) -> float:
    """Torque setpoint, N m: position and speed error, integral, notch on the feedback, feedforward, limit with anti-windup."""
    raw = (angle - memory[LAST_ANGLE]) / gains[PERIOD]
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
        memory[INTEGRAL] += gains[KI] * error * gains[PERIOD]
    return torque


@compiled
def hold(acting: float, s: Array, p: Array, bursts: Array, period: float, memory: Array, fine: Array, longest: float) -> None:
    """One sample of an ideal drive: the torque is held from end to end; the dead time of the machine is cut exactly.

    fine : (m,) takes the shown angle at m instants, or (0,).
    """
    pieces = max(fine.shape[0], 1)
    late = p[at.DEAD_TIME] / period
    whole = int(late)
    split = (late - whole) * period
    memory[ACTING_2], memory[ACTING_1], memory[ACTING] = memory[ACTING_1], memory[ACTING], acting
    now, before = (acting, memory[ACTING_1]) if whole == 0 else (memory[ACTING_1], memory[ACTING_2])
    for j in range(2 * pieces):  # each piece before and after the instant at which the dead time ends
        begin, end = (j // 2) * period / pieces, (j // 2 + 1) * period / pieces
        cut = min(max(split, begin), end)
        if j % 2 == 0 and fine.shape[0] > 0:
            fine[j // 2] = laws.encoder(s[at.ANGLE], p)
        advance(s, p, bursts, before if j % 2 == 0 else now, 0.0, cut - begin if j % 2 == 0 else end - cut, longest)


@compiled
def shape(
    command: float,
    process: float,
    s: Array,
    p: Array,
    bursts: Array,
    duration: float,
    memory: Array,
    d: Array,
    fine: Array,
    fine_torque: Array,
    longest: float,
) -> float:
    """One sample of a drive with a torque path of its own; returns the mean of the torque that acts before the machine's dead time.

    command : N m, from ``PHASE`` of the sample on; before it that of the last sample.   process : N m, acts over the sample.
    fine, fine_torque : (m,) shown angle at m instants and mean torque from each to the next, or (0,).
    """
    if d[drive.ALPHA] < 1.0:
        command = memory[COMMAND] + d[drive.ALPHA] * (command - memory[COMMAND])
    pieces = fine.shape[0] if fine.shape[0] > 0 else math.ceil(duration / longest - 1e-6)
    start, split = memory[drive.MOMENTUM], d[drive.PHASE] * duration
    # the command changes at the split; behind the dead time the torque jumps where a sample began and where a command changed
    late, late_split = p[at.DEAD_TIME] % duration, (p[at.DEAD_TIME] + split) % duration
    first, last = min(split, late, late_split), max(split, late, late_split)
    middle = split + late + late_split - first - last
    for j in range(4 * pieces):
        begin, end = (j // 4) * duration / pieces, (j // 4 + 1) * duration / pieces
        if j % 4 == 0 and fine.shape[0] > 0:
            fine[j // 4] = laws.encoder(s[at.ANGLE], p)
        low = begin if j % 4 == 0 else first if j % 4 == 1 else middle if j % 4 == 2 else last
        high = first if j % 4 == 0 else middle if j % 4 == 1 else last if j % 4 == 2 else end
        low, high = min(max(low, begin), end), min(max(high, begin), end)
        h = high - low
        if h < SHORTEST_S:
            continue
        torque, slope = drive.torque_over(memory[COMMAND] if 0.5 * (low + high) < split else command, h, memory, d)
        torque += process
        drive.remember(torque, slope, h, memory, d)
        if fine.shape[0] > 0:
            fine_torque[j // 4] += torque * h / (end - begin)
        if p[at.DEAD_TIME] > 0.0:
            torque, slope = drive.behind(p[at.DEAD_TIME], h, memory, d)
        advance(s, p, bursts, torque, slope, h, longest)
    memory[COMMAND] = command
    return (memory[drive.MOMENTUM] - start) / duration


@compiled
def run(
    s: Array,
    p: Array,
    bursts: Array,
    gains: Array,
    memory: Array,
    d: Array,
    target: Array,
    forward: Array,
    unsteady: Array,
    fine: Array,
    fine_torque: Array,
    longest: float,
) -> tuple[Array, Array, Array, Array]:
    """Run the machine for len(forward) samples; changes s and memory in place.

    d : (drive.PLACES,), the instruments.   target : (n, 2), angle rad and speed rad/s.   forward : (n,), N m, added to the feedback.
    unsteady : (n, 3), length of each sample s, process torque N m, noise of the angle rad.
    fine, fine_torque : (n * m,) take the angle that the encoder disc shows at m instants per sample and the mean torque from each to
    the next, or (0,).
    Returns position (rad), torque setpoint (N m), torque that the drive reports without its noise (N m), acting torque (N m), each (n,).
    """
    n = forward.shape[0]
    positions, setpoints, torques, actings = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    m = fine.shape[0] // n
    for i in range(n):
        shown = laws.encoder(s[at.ANGLE], p)
        angle = coded(shown + drive.interpolation(shown, d) + unsteady[i, 2], gains[QUANTUM], p)
        acting = drive.delayed(memory, d)
        memory[SETPOINT_1] = memory[SETPOINT]
        memory[SETPOINT] = control(angle, target[i, 0], target[i, 1], forward[i], gains, memory)
        positions[i], setpoints[i], torques[i] = angle, memory[SETPOINT], acting
        here, torque_here = fine[i * m : (i + 1) * m], fine_torque[i * m : (i + 1) * m]
        if d[drive.SHAPED] > 0.0:
            acting = shape(acting, unsteady[i, 1], s, p, bursts, unsteady[i, 0], memory, d, here, torque_here, longest)
            torques[i] = drive.reported(memory[COMMAND], unsteady[i, 0], memory, d)
        else:
            hold(acting, s, p, bursts, gains[PERIOD], memory, here, longest)
            torque_here[:] = acting
        actings[i] = acting
    return positions, setpoints, torques, actings
