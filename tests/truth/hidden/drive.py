"""The drive between setpoint and shaft, and what it reports of its torque, compiled.

Setpoint, held over a sample -> whole-sample delay -> steps -> first-order filter in the clock of the samples -> change at a share
of the sample -> slew limit -> continuous first-order filter -> current loop of first or second order -> process torque.

The continuous part is integrated (Runge-Kutta of order four) with steps of 5 us, a tenth of its fastest time; the machine gets mean and
slope over each of its own sub-steps, so that a free motor ends each at its exact speed and angle.  The reading looks back into that
history.
"""

from __future__ import annotations

import math

from truth.hidden.compilation import compiled
from truth.hidden.layout import Array

#: Places in the vector of the instruments.
(SHAPED, DELAY, ALPHA, FILTER_S, LOOP_ORDER, LOOP_S, LOOP_DAMPING, SLEW, PHASE, STEP_NM) = range(10)
(READ_S, LATE, LATCHED, COMMAND_ONLY, LINES, ONCE, ONCE_PHASE, TWICE, TWICE_PHASE) = range(10, 19)
PLACES = 19

#: Places in the memory of the drive: what the controller and the ideal drive know (see ``recorder``), then the shaped torque path.
(INTEGRAL, FILTERED_SPEED, LAST_ANGLE, NOTCH_1, NOTCH_2, SETPOINT, ACTING, ACTING_1, ACTING_2) = range(9)
(SETPOINT_1, COMMAND, SLEWED, SMOOTH, LOOP, LOOP_RATE, CLOCK, MOMENTUM, READ, HEAD) = range(9, 19)
#: History: instants, momentum of the torque and value of the reading's filter there, slope of the torque before; 40 ms at sub-steps
#: of 40 us.
HISTORY = 19
NODES = 1024
MEMORY = HISTORY + 4 * NODES

#: s, so far from its ends a piece of the history is looked at where the torque may jump there.
INSIDE_S = 1e-9
#: s, longest step of the continuous part.
FINE_S = 5e-6
Four = tuple[float, float, float, float]


@compiled
def delayed(memory: Array, d: Array) -> float:
    """Torque that the drive is commanded in a sample whose own setpoint is not yet formed, N m: of one or two samples ago, in steps."""
    command = memory[SETPOINT] if d[DELAY] < 1.5 else memory[SETPOINT_1]
    if d[STEP_NM] > 0.0:
        command = d[STEP_NM] * math.floor(command / d[STEP_NM] + 0.5)
    return float(command)


@compiled
def interpolation(shown: float, d: Array) -> float:
    """Error of an interpolated encoder, rad: once and twice per line of its disc."""
    if d[LINES] <= 0.0:
        return 0.0
    line = d[LINES] * shown
    return float(d[ONCE] * math.sin(line + d[ONCE_PHASE]) + d[TWICE] * math.sin(2.0 * line + d[TWICE_PHASE]))


@compiled
def _rates(x: Four, asked: float, d: Array) -> Four:
    """Derivatives of the filter, the loop, its rate, and of the momentum.   asked : N m, behind the slew limit."""
    smooth, loop, rate, _ = x
    into = smooth if d[FILTER_S] > 0.0 else asked
    smooth_rate = (asked - smooth) / d[FILTER_S] if d[FILTER_S] > 0.0 else 0.0
    if d[LOOP_ORDER] == 1.0:
        return smooth_rate, (into - loop) / d[LOOP_S], 0.0, loop
    if d[LOOP_ORDER] == 2.0:
        return smooth_rate, rate, ((into - loop) / d[LOOP_S] - 2.0 * d[LOOP_DAMPING] * rate) / d[LOOP_S], loop
    return smooth_rate, 0.0, 0.0, into


@compiled
def torque_over(command: float, duration: float, memory: Array, d: Array) -> tuple[float, float]:
    """Mean (N m) and slope (N m/s, with the same first moment) of the torque while a command is held; moves the states of the drive."""
    if d[SLEW] <= 0.0 and d[FILTER_S] <= 0.0 and d[LOOP_ORDER] == 0.0:
        return command, 0.0
    pieces = math.ceil(duration / FINE_S - 1e-6)
    h = duration / pieces
    x = (memory[SMOOTH], memory[LOOP], memory[LOOP_RATE], 0.0)
    moment = 0.0
    for k in range(pieces):
        begin, end = command, command
        if d[SLEW] > 0.0:
            begin = memory[SLEWED]
            end = begin + min(max(command - begin, -d[SLEW] * h), d[SLEW] * h)
            memory[SLEWED] = end
        total = (0.0, 0.0, 0.0, 0.0)
        stage = x
        for i in range(4):
            asked = begin if i == 0 else end if i == 3 else 0.5 * (begin + end)
            r = _rates(stage, asked, d)
            share = 1.0 / 6.0 if i == 0 or i == 3 else 1.0 / 3.0
            total = (total[0] + share * r[0], total[1] + share * r[1], total[2] + share * r[2], total[3] + share * r[3])
            ahead = h if i == 2 else 0.5 * h
            stage = (x[0] + ahead * r[0], x[1] + ahead * r[1], x[2] + ahead * r[2], x[3] + ahead * r[3])
        moment += h * total[3] * ((k + 0.5) * h - 0.5 * duration)
        x = (x[0] + h * total[0], x[1] + h * total[1], x[2] + h * total[2], x[3] + h * total[3])
    memory[SMOOTH], memory[LOOP], memory[LOOP_RATE] = x[0], x[1], x[2]
    return x[3] / duration, 12.0 * moment / duration**3


@compiled
def remember(torque: float, slope: float, duration: float, memory: Array, d: Array) -> None:
    """Write a torque (mean, N m, and slope, N m/s) that has acted for a time into the history, and into the filter of the reading."""
    memory[CLOCK] += duration
    memory[MOMENTUM] += torque * duration
    if d[READ_S] > 0.0:
        memory[READ] = torque + (memory[READ] - torque) * math.exp(-duration / d[READ_S])
    head = (int(memory[HEAD]) + 1) % NODES
    memory[HEAD] = head
    memory[HISTORY + head] = memory[CLOCK]
    memory[HISTORY + NODES + head] = memory[MOMENTUM]
    memory[HISTORY + 2 * NODES + head] = memory[READ]
    memory[HISTORY + 3 * NODES + head] = slope


@compiled
def at_instant(t: float, memory: Array, d: Array) -> tuple[float, float, float]:
    """Momentum of the torque (N m s), torque (N m), and value of the reading's filter (N m) at an instant of the past."""
    after = int(memory[HEAD])
    before = after
    for _ in range(NODES - 1):
        before = (after - 1) % NODES
        if memory[HISTORY + before] < t or memory[HISTORY + before] >= memory[HISTORY + after]:
            break
        after = before
    length = memory[HISTORY + after] - memory[HISTORY + before]
    if length <= 0.0:  # before the history begins nothing acted
        return 0.0, 0.0, 0.0
    since = min(max(t - memory[HISTORY + before], 0.0), length)
    torque = (memory[HISTORY + NODES + after] - memory[HISTORY + NODES + before]) / length
    filtered = 0.0
    if d[READ_S] > 0.0:
        filtered = torque + (memory[HISTORY + 2 * NODES + before] - torque) * math.exp(-since / d[READ_S])
    slope = memory[HISTORY + 3 * NODES + after]
    momentum = memory[HISTORY + NODES + before] + torque * since + 0.5 * slope * since * (since - length)
    return momentum, torque + slope * (since - 0.5 * length), filtered


@compiled
def behind(dead_time: float, duration: float, memory: Array, d: Array) -> tuple[float, float]:
    """Mean (N m) and slope (N m/s) behind a dead time of the torque over the time that has just ended."""
    end = memory[CLOCK] - dead_time
    begin = end - duration
    mean = (at_instant(end, memory, d)[0] - at_instant(begin, memory, d)[0]) / duration
    inside = min(INSIDE_S, 0.25 * duration)
    rise = at_instant(end - inside, memory, d)[1] - at_instant(begin + inside, memory, d)[1]
    return mean, rise / (duration - 2.0 * inside)


@compiled
def reported(command: float, duration: float, memory: Array, d: Array) -> float:
    """Torque that the drive reports of the sample that has just ended, N m, without noise and steps.

    Its mean over the sample; with a filter the filter's value at the end of the sample; latched the torque at that instant; each
    ``LATE`` samples earlier.   command : of the sample, for a drive that reports nothing else.
    """
    if d[COMMAND_ONLY] > 0.0:
        return command
    end = memory[CLOCK] - d[LATE] * duration
    if d[READ_S] > 0.0:
        return at_instant(end, memory, d)[2]
    if d[LATCHED] > 0.0:
        return at_instant(end - INSIDE_S, memory, d)[1]
    return (at_instant(end, memory, d)[0] - at_instant(end - duration, memory, d)[0]) / duration
