"""Compiled steps of decoder and estimators, as an FPGA and a loop run them; explained in ``quadrature`` and ``estimators``.

All that call each other stand in this one file: the cache of compiled code looks at the file of the caller only, and would keep what
it knows of another file after that has changed.
"""

from __future__ import annotations

import math

import numpy as np

from beltcomm.arrays import Array, IntArray
from beltcomm.compiled import compiled

# Places in the decoder's registers.
STATE, PREVIOUS, LEVEL_A, LEVEL_B, DEBOUNCE, COUNT, INVALID = range(7)
#: Tick of the last increment, its direction, ticks between the last two; 0 where not known.
LAST_TICK, LAST_STEP, GAP = 7, 8, 9
#: Since the last sampling instant: increments, tick of the first one, signed increments after the first.
INCREMENTS, FIRST_TICK, STEPS = 10, 11, 12
_EDGE_TICK = 13
_SIZE = 14
_NEVER = -1
# Places in the state of an estimator.
_COUNT, _VELOCITY, _GATE, _EVENTS = range(4)


def new_decoder(level_a: int = 0, level_b: int = 0, *, debounce: bool = True) -> IntArray:
    """Registers of a state machine that knows the levels it begins with: ndarray (28,), the second half as before the last edge's tick.

    The direction before the first edge is unknown; it begins in a forward state, so the play of one increment lies below it.

    Parameters
    ----------
    level_a, level_b : int
        0 or 1.
    debounce : bool
        False counts every edge, as a plain quadrature counter does.
    """
    registers = np.zeros(2 * _SIZE, dtype=np.int64)
    state = _forward_state(level_a, level_b)
    registers[[STATE, PREVIOUS, LEVEL_A, LEVEL_B, DEBOUNCE]] = state, _previous_state(state), level_a, level_b, debounce
    registers[_EDGE_TICK] = _NEVER
    registers[_SIZE:] = registers[:_SIZE]
    return registers


def new_estimator(velocity_m_s: float = 0.0) -> Array:
    """State of the estimators at count 0: ndarray (4,).

    Count of the last sampling instant; high-pass velocity, low-passed gate and event velocities, m/s.

    Parameters
    ----------
    velocity_m_s : float
        What they read before the first period, m/s.
    """
    return np.array([0.0, velocity_m_s, velocity_m_s, velocity_m_s])


@compiled
def _forward_state(level_a: int, level_b: int) -> int:
    """S1 to S4 of these levels."""
    return 1 + 2 * level_a if level_a == level_b else 2 + 2 * level_b


@compiled
def _next(state: int) -> int:
    """The state after this one in its cycle, S1..S4 or S5..S8."""
    return state % 4 + 1 if state <= 4 else (state - 4) % 4 + 5


@compiled
def _previous_state(state: int) -> int:
    """The state before this one in its cycle."""
    return (state + 2) % 4 + 1 if state <= 4 else (state - 2) % 4 + 5


@compiled
def take_edge(registers: IntArray, tick: int, channel: int, level: int) -> int:
    """One edge; returns the increment it makes, 1, −1 or 0, and moves ``registers`` on.

    A second edge in the same tick takes back what the first one made and returns the opposite of that.

    Parameters
    ----------
    registers : IntArray
        ndarray (28,) of :func:`new_decoder`.
    tick : int
        Time in ticks, not before the last edge.
    channel : int
        0 for A, 1 for B.
    level : int
        0 or 1, after the edge.
    """
    level_a = level if channel == 0 else registers[LEVEL_A]
    level_b = level if channel == 1 else registers[LEVEL_B]
    if tick <= registers[_EDGE_TICK]:
        # The copy stays as it was before this tick: a third edge in it is the same fault once more, not another one.
        count, last = registers[COUNT], registers[_EDGE_TICK]
        registers[:_SIZE] = registers[_SIZE:]
        registers[_EDGE_TICK] = last
        _resynchronise(registers, level_a, level_b)
        return int(registers[COUNT] - count)
    registers[_SIZE:] = registers[:_SIZE]
    registers[_EDGE_TICK] = tick
    if level_a == registers[LEVEL_A] and level_b == registers[LEVEL_B]:
        _resynchronise(registers, level_a, level_b)
        return 0
    registers[LEVEL_A], registers[LEVEL_B] = level_a, level_b
    return _move(registers, tick, _forward_state(level_a, level_b))


@compiled
def _move(registers: IntArray, tick: int, forward: int) -> int:
    """A change of one channel, to the levels of the forward state ``forward``."""
    state, previous = registers[STATE], registers[PREVIOUS]
    sense = 1 if state <= 4 else -1
    here = forward if sense == 1 else 9 - forward
    returned = 9 - _previous_state(state)  # the levels of the state before, in the other cycle
    if previous == returned:  # it stands there already: back, or on in the other direction
        if here == state:
            registers[PREVIOUS] = _previous_state(state)
            return 0
        registers[PREVIOUS], registers[STATE] = returned, 9 - here
        return _count(registers, tick, -sense)
    if here == _next(state):
        registers[PREVIOUS], registers[STATE] = state, here
        return _count(registers, tick, sense)
    if registers[DEBOUNCE] != 0:
        registers[PREVIOUS] = returned
        return 0
    registers[PREVIOUS], registers[STATE] = 9 - state, returned
    return _count(registers, tick, -sense)


@compiled
def _count(registers: IntArray, tick: int, step: int) -> int:
    """One increment more: position, times between increments, what the period holds."""
    registers[COUNT] += step
    registers[GAP] = tick - registers[LAST_TICK] if registers[LAST_STEP] != 0 else 0
    registers[LAST_TICK], registers[LAST_STEP] = tick, step
    if registers[INCREMENTS] == 0:
        registers[FIRST_TICK] = tick
    else:
        registers[STEPS] += step
    registers[INCREMENTS] += 1
    return step


@compiled
def _resynchronise(registers: IntArray, level_a: int, level_b: int) -> None:
    """After an invalid edge: go on from these levels in the direction so far; nothing before it is measured from."""
    forward = _forward_state(level_a, level_b)
    state = forward if registers[STATE] <= 4 else 9 - forward
    registers[LEVEL_A], registers[LEVEL_B] = level_a, level_b
    registers[STATE], registers[PREVIOUS] = state, _previous_state(state)
    registers[INVALID] += 1
    registers[LAST_TICK] = registers[LAST_STEP] = registers[GAP] = 0
    registers[INCREMENTS] = registers[FIRST_TICK] = registers[STEPS] = 0


@compiled
def close_period(registers: IntArray) -> None:
    """Begin a new sampling period, after all edges up to its instant were taken and the estimators have read the old one.

    Parameters
    ----------
    registers : ndarray of int
        Of all estimators, two halves; changed in place.
    """
    for half in (0, _SIZE):
        registers[half + INCREMENTS] = registers[half + FIRST_TICK] = registers[half + STEPS] = 0


@compiled
def take_stretch(registers: IntArray, before_m: float, after_m: float, begin_tick: int, ticks: int, increment_m: float) -> None:
    """The edges of a stretch with constant velocity, for loops whose plant gives its position at instants.

    Parameters
    ----------
    registers : ndarray of int
        Of all estimators; changed in place.
    before_m, after_m : float, m
        At begin_tick and ``ticks`` later; the levels in ``registers`` are those of before_m.
    begin_tick : int
        At which the stretch begins.
    ticks : int
        That it lasts.
    increment_m : float, m
        Δξ_min.
    """
    line, last = math.floor(before_m / increment_m), math.floor(after_m / increment_m)
    while line != last:
        up = last > line
        crossed = line + 1 if up else line
        tick = begin_tick + math.ceil((crossed * increment_m - before_m) / (after_m - before_m) * ticks)
        line += 1 if up else -1
        place = line % 4
        if crossed % 2 == 1:
            take_edge(registers, tick, 0, 1 if place == 1 or place == 2 else 0)
        else:
            take_edge(registers, tick, 1, 1 if place >= 2 else 0)


@compiled
def all_increments(registers: IntArray, tick: IntArray, channel: IntArray, level: IntArray) -> tuple[IntArray, IntArray]:
    """Ticks and steps of all increments.

    Parameters
    ----------
    registers : ndarray of int
        Of the decoder; changed in place.
    tick : ndarray of int (n,)
        Of the edges, in their order.
    channel, level : ndarray of int (n,)
        Of the edges.
    """
    ticks, steps = np.zeros(len(tick), dtype=np.int64), np.zeros(len(tick), dtype=np.int64)
    n = 0
    for i in range(len(tick)):
        step = take_edge(registers, tick[i], channel[i], level[i])
        if step == 0:
            continue
        if n > 0 and ticks[n - 1] == tick[i]:  # taken back by a second edge in its tick
            n -= 1
            continue
        ticks[n], steps[n] = tick[i], step
        n += 1
    return ticks[:n].copy(), steps[:n].copy()


@compiled
def high_pass_step(c: Array, state: Array, registers: IntArray) -> float:
    """(6.1) by backward differences, of the counted position: (1 − z⁻¹)/(T_R + T_s − T_R z⁻¹).

    Parameters
    ----------
    c, state, registers : ndarray (9,), (4,), (28,)

    Returns
    -------
    float, m/s
    """
    difference = (registers[COUNT] - state[_COUNT]) * c[0] / c[2]
    state[_COUNT] = registers[COUNT]
    state[_VELOCITY] = c[3] * state[_VELOCITY] + (1.0 - c[3]) * difference
    return float(state[_VELOCITY])


@compiled
def event_counter_step(c: Array, registers: IntArray) -> float:
    """(6.4): increments after the first of the period over the time from first to last; 0 below two increments.

    Parameters
    ----------
    c, registers : ndarray (9,), (28,)

    Returns
    -------
    float, m/s
    """
    if registers[INCREMENTS] < 2:
        return 0.0
    return float(registers[STEPS] * c[0] / ((registers[LAST_TICK] - registers[FIRST_TICK]) * c[1]))


@compiled
def gate_step(c: Array, registers: IntArray, now_tick: int) -> float:
    """(6.14) with (6.17): one increment over the time between the last two, less while no new one comes, 0 from T_out on.

    Parameters
    ----------
    c, registers : ndarray (9,), (28,)
    now_tick : int
        The sampling instant, in ticks. 0 as long as two increments in a row are not known.

    Returns
    -------
    float, m/s
    """
    waited = now_tick - registers[LAST_TICK]
    if registers[GAP] == 0 or registers[GAP] >= c[6] or waited >= c[6]:
        return 0.0
    ticks = float(registers[GAP])
    if c[7] == 2.0:
        ticks = max(ticks, float(waited))
    elif c[7] == 1.0 and waited > c[5]:
        ticks = float(waited)
    return float(registers[LAST_STEP] * c[0] / (ticks * c[1]))


@compiled
def _switching_weight(speed: float, crossing: float) -> float:
    """(6.20): share of the event counter, 0 up to half the crossing of the methods, 1 from one and a half on.   Both m/s, speed ≥ 0."""
    if speed <= 0.5 * crossing:
        return 0.0
    if speed >= 1.5 * crossing:
        return 1.0
    return float(0.5 * (1.0 - np.sin(np.pi * speed / crossing)))


@compiled
def combined_step(c: Array, state: Array, registers: IntArray, now_tick: int) -> float:
    """(6.21): gate measurement and event counter, low-passed alike, then weighted by (6.20) with |ξ_l|.

    Parameters
    ----------
    c, state, registers : ndarray (9,), (4,), (28,)
    now_tick : int
        The sampling instant, in ticks.

    Returns
    -------
    float, m/s
    """
    gate = gate_step(c, registers, now_tick)
    events = event_counter_step(c, registers)
    if registers[INCREMENTS] < 2 and c[8] != 0.0:
        events = gate
    state[_GATE] = c[4] * state[_GATE] + (1.0 - c[4]) * gate
    state[_EVENTS] = c[4] * state[_EVENTS] + (1.0 - c[4]) * events
    weight = _switching_weight(abs(state[_GATE]), 2.0 * c[0] / (c[2] - c[1]))
    return float((1.0 - weight) * state[_GATE] + weight * state[_EVENTS])


@compiled
def run_record(c: Array, state: Array, registers: IntArray, tick: IntArray, channel: IntArray, level: IntArray, periods: int) -> Array:
    """Count, increments, and the four velocities at each sampling instant: ndarray (periods, 6).

    Parameters
    ----------
    c : ndarray (9,)
        Numbers of :func:`beltcomm.encoder.estimators.coefficients`.
    state : ndarray
        Of the filters; changed in place.
    registers : ndarray of int
        Of decoder and estimators; changed in place.
    tick : ndarray of int (n,)
        Of the edges, in their order.
    channel, level : ndarray of int (n,)
        Of the edges.
    periods : int
        Sampling periods of the record.
    """
    table = np.zeros((periods, 6))
    i = 0
    for k in range(periods):
        now = int((k + 1) * c[5])
        while i < len(tick) and tick[i] <= now:
            take_edge(registers, tick[i], channel[i], level[i])
            i += 1
        table[k, 0] = registers[COUNT]
        table[k, 1] = registers[INCREMENTS]
        table[k, 2] = high_pass_step(c, state, registers)
        table[k, 3] = event_counter_step(c, registers)
        table[k, 4] = gate_step(c, registers, now)
        table[k, 5] = combined_step(c, state, registers, now)
        close_period(registers)
    return table
