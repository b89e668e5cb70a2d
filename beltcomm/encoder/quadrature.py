"""The state machine that turns edges of the channels A and B into increments (6.1), as an FPGA runs it: one compiled step per edge.

Levels (A, B) in forward order: (0, 0), (1, 0), (1, 1), (0, 1), so A leads B when the position rises.  The states S1 to S4 are
these levels met going forward, S8 to S5 the same levels met going in reverse:

==========  ======  ======  ======  ======
levels      (0, 0)  (1, 0)  (1, 1)  (0, 1)
forward     S1      S2      S3      S4
reverse     S8      S7      S6      S5
==========  ======  ======  ======  ======

Forward runs S1 S2 S3 S4 S1, reverse S5 S6 S7 S8 S5 (the printed rule S_i → S_mod(i+1,4) has an S_0).  Debouncing: from S3,
entered from S2, the levels of S2 do not make an increment; only "previous" becomes S7, the same levels in reverse.  Back to S3:
nothing has happened.  On to S8: the motion has reversed, one increment in reverse.  So the count is the true one behind a play
of one increment, and from one increment to the next the axis has moved by exactly one increment, also through a reversal.

Two channels that change in one tick, and an edge to a level that the channel already has (an edge was missed), are invalid: they
are counted, nothing is added to the position, and no time or distance across them is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import compiled
from beltcomm.encoder.edges import Edges
from beltcomm.errors import DataError

IntArray = NDArray[np.int64]

# Places in the decoder's registers.
STATE, PREVIOUS, LEVEL_A, LEVEL_B, DEBOUNCE, COUNT, INVALID = range(7)
#: Tick of the last increment, its direction, ticks between the last two; 0 where not known.
LAST_TICK, LAST_STEP, GAP = 7, 8, 9
#: Since the last sampling instant: increments, tick of the first one, signed increments after the first.
INCREMENTS, FIRST_TICK, STEPS = 10, 11, 12
_EDGE_TICK = 13
_SIZE = 14
_NEVER = -1


def new_decoder(level_a: int = 0, level_b: int = 0, *, debounce: bool = True) -> IntArray:
    """Registers of a state machine that knows the levels it begins with: ndarray (28,), the second half as before the last edge's tick.

    level_a, level_b : 0 or 1.   debounce : False counts every edge, as a plain quadrature counter does.

    The direction before the first edge is unknown; it begins in a forward state, so the play of one increment lies below it.
    """
    registers = np.zeros(2 * _SIZE, dtype=np.int64)
    state = _forward_state(level_a, level_b)
    registers[[STATE, PREVIOUS, LEVEL_A, LEVEL_B, DEBOUNCE]] = state, _before(state), level_a, level_b, debounce
    registers[_EDGE_TICK] = _NEVER
    registers[_SIZE:] = registers[:_SIZE]
    return registers


@compiled
def _forward_state(level_a: int, level_b: int) -> int:
    """S1 to S4 of these levels."""
    return 1 + 2 * level_a if level_a == level_b else 2 + 2 * level_b


@compiled
def _next(state: int) -> int:
    """The state after this one in its cycle, S1..S4 or S5..S8."""
    return state % 4 + 1 if state <= 4 else (state - 4) % 4 + 5


@compiled
def _before(state: int) -> int:
    """The state before this one in its cycle."""
    return (state + 2) % 4 + 1 if state <= 4 else (state - 2) % 4 + 5


@compiled
def take_edge(registers: IntArray, tick: int, channel: int, level: int) -> int:
    """One edge; returns the increment it makes, 1, −1 or 0, and moves ``registers`` on.

    registers : ndarray (28,) of :func:`new_decoder`.   tick : time in ticks, not before the last edge.   channel : 0 for A, 1 for B.
    level : 0 or 1, after the edge.   A second edge in the same tick takes back what the first one made and returns the opposite of that.
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
    returned = 9 - _before(state)  # the levels of the state before, in the other cycle
    if previous == returned:  # it stands there already: back, or on in the other direction
        if here == state:
            registers[PREVIOUS] = _before(state)
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
    registers[STATE], registers[PREVIOUS] = state, _before(state)
    registers[INVALID] += 1
    registers[LAST_TICK] = registers[LAST_STEP] = registers[GAP] = 0
    registers[INCREMENTS] = registers[FIRST_TICK] = registers[STEPS] = 0


@compiled
def close_period(registers: IntArray) -> None:
    """Begin a new sampling period, after all edges up to its instant were taken and the estimators have read the old one."""
    for half in (0, _SIZE):
        registers[half + INCREMENTS] = registers[half + FIRST_TICK] = registers[half + STEPS] = 0


@dataclass(frozen=True)
class Increments:
    """What a state machine made of a record.   tick, step : of each increment, (n,), step 1 or −1, count their running sum.

    invalid : edges that no motion makes, above 0 the position may be wrong by several increments.   edges : edges taken.
    """

    tick: IntArray
    step: IntArray
    invalid: int
    edges: int

    @property
    def count(self) -> int:
        """Increments from the beginning to the end of the record."""
        return int(np.sum(self.step))


def count_increments(edges: Edges, *, debounce: bool = True) -> Increments:
    """All edges of a record through the state machine.   Raises DataError when edges are not in order of time."""
    require_order(edges)
    registers = new_decoder(edges.level_a, edges.level_b, debounce=debounce)
    tick, step = _all_increments(registers, edges.tick, edges.channel, edges.level)
    return Increments(tick, step, int(registers[INVALID]), len(edges.tick))


def require_order(edges: Edges) -> None:
    """Raises DataError when edges are not in order of time."""
    wrong = np.flatnonzero(np.diff(edges.tick) < 0)
    if len(wrong):
        at = int(wrong[0])
        raise DataError(
            f"edge {at + 1} lies at tick {edges.tick[at + 1]}, before edge {at} at tick {edges.tick[at]}; sort the edges by time first"
        )


@compiled
def _all_increments(registers: IntArray, tick: IntArray, channel: IntArray, level: IntArray) -> tuple[IntArray, IntArray]:
    """Ticks and steps of all increments."""
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
