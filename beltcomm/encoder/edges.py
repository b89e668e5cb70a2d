"""Edges of an incremental encoder that follows a given motion: what a logic sees that looks at both channels once in every tick.

The channels change where the position passes a line of the scale.  Each passage is found by bisection in whole ticks, so an edge
lies in the first tick at which the logic sees the new level, without the error of a sampled motion.

The state machine turns edges of the channels A and B into increments (6.1), as an FPGA runs it: one compiled step per edge.

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

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.encoder.kernel import INVALID, all_increments, new_decoder
from beltcomm.errors import DataError, UsageError

Motion = Callable[[NDArray[Any]], NDArray[Any]]

#: The source's hardware (6.15): m per increment, s per tick.
INCREMENT_M, TICK_S = 2.5e-6, 1e-8
#: Lines after which the errors of a scale repeat (one turn of a disc with 1024 lines, four edges each).
LINES_PER_TURN = 4096
#: Levels of A and B by count modulo 4: A leads when the count rises.
LEVEL_A, LEVEL_B = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])


@dataclass(frozen=True)
class Flaws:
    """Flaws of a real encoder beside its steps.

    Attributes
    ----------
    line_rms : float
        Standard deviation of where the lines lie, in increments, below 0.15; the same at every passage, repeats after LINES_PER_TURN lines.
    bounces : int
        At most so many times a channel falls back after an edge and returns.
    bounce_s : float
        Within this time, and never longer than half the time to the next edge.
    seed : int
        Of both.
    """

    line_rms: float = 0.0
    bounces: int = 0
    bounce_s: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Edges:
    """Edges in order of time.

    Attributes
    ----------
    tick : IntArray, (n,)
        In units of tick_s from the beginning.
    channel : IntArray, (n,)
        0 for A, 1 for B.
    level : IntArray, (n,)
        0 or 1, after the edge.
    level_a, level_b : int
        Before the first edge.
    increment_m : float
        Between edges of the two channels, m.
    """

    tick: IntArray
    channel: IntArray
    level: IntArray
    level_a: int
    level_b: int
    increment_m: float = INCREMENT_M
    tick_s: float = TICK_S


def edges_of(
    motion: Motion,
    duration_s: float,
    *,
    increment_m: float = INCREMENT_M,
    tick_s: float = TICK_S,
    scan_s: float = 1e-4,
    flaws: Flaws | None = None,
) -> Edges:
    """Edges that ``motion`` makes in 0 < t ≤ duration_s.

    Lines lie at the multiples of increment_m.

    Parameters
    ----------
    motion : Motion
        Position in m of times in s, both ndarray of one shape; continuous.
    duration_s : float, s
        Of the record.
    increment_m : float, m
        Δξ_min.
    tick_s : float, s
        Δt_min of the timer.
    scan_s : float
        The motion must not turn twice within twice this time, s.
    flaws : Flaws or None
        Of the encoder; None for an ideal one.

    Raises
    ------
    UsageError
        For a time, length or flaw that is out of range.
    """
    _require(increment_m > 0.0 and tick_s > 0.0, f"increment {increment_m:g} m, tick {tick_s:g} s: both must be above 0")
    _require(duration_s >= 2.0 * tick_s, f"the record lasts {duration_s:g} s, less than two ticks of {tick_s:g} s; make it longer")
    _require(scan_s >= tick_s, f"scan_s is {scan_s:g} s, less than a tick of {tick_s:g} s")
    flaws = flaws or Flaws()
    _require(
        0.0 <= flaws.line_rms < 0.15,
        f"lines off by {flaws.line_rms:g} increments rms would change places; give less than 0.15",
    )
    _require(flaws.bounces >= 0 and flaws.bounce_s >= 0.0, "the number of bounces and their time must not be negative")
    knots = _monotone_knots(motion, duration_s, tick_s, scan_s)
    position = motion(knots * tick_s)
    _require(bool(np.all(np.isfinite(position))), "the motion is not finite at all times; give one that is")
    scale = _Scale(increment_m, flaws)
    counts = scale.count(position)
    moves = np.diff(counts)
    size = np.abs(moves)
    part = np.repeat(np.arange(len(moves)), size)  # the stretch in which each line is passed
    nth = np.arange(len(part)) - np.repeat(np.cumsum(size) - size, size)
    upward = moves[part] > 0
    line = np.where(upward, counts[part] + 1 + nth, counts[part] - nth)
    tick = _first_ticks(motion, tick_s, scale.place(line), upward, knots[part], knots[part + 1])
    # Passing line j from below turns the channel that differs between counts j−1 and j: A for odd j, B for even j.
    channel = np.where(line % 2 == 1, 0, 1)
    start = int(counts[0]) % 4
    if flaws.bounces > 0 and flaws.bounce_s > 0.0:
        tick, channel = _with_bounces(tick, channel, flaws, tick_s)
    return _visible_edges(tick, channel, int(LEVEL_A[start]), int(LEVEL_B[start]), increment_m, tick_s)


class _Scale:
    """Positions of the lines: line j between counts j−1 and j."""

    def __init__(self, increment_m: float, flaws: Flaws) -> None:
        self.increment_m = increment_m
        self.off = np.zeros(LINES_PER_TURN)
        if flaws.line_rms > 0.0:
            rng = np.random.default_rng([flaws.seed, 1])
            self.off = np.clip(rng.normal(0.0, flaws.line_rms, LINES_PER_TURN), -0.45, 0.45)

    def place(self, line: IntArray) -> Array:
        """Position of lines, m."""
        return np.asarray((line + self.off[line % LINES_PER_TURN]) * self.increment_m)

    def count(self, position: NDArray[Any]) -> IntArray:
        """The line at or below each position."""
        count = np.floor(position / self.increment_m).astype(np.int64)
        count -= position < self.place(count)
        return np.asarray(count + (position >= self.place(count + 1)))


def _monotone_knots(motion: Motion, duration_s: float, tick_s: float, scan_s: float) -> IntArray:
    """Ticks between which the motion does not turn: the scan, and every turning point in it."""
    last = int(np.floor(duration_s / tick_s * (1.0 + 1e-12)))
    count = max(int(np.ceil(last * tick_s / scan_s)), 2)
    knots = np.unique(np.round(np.linspace(0, last, count + 1)).astype(np.int64))
    position = motion(knots * tick_s)
    slopes = np.sign(np.diff(position))
    moving = np.maximum.accumulate(np.where(slopes != 0.0, np.arange(len(slopes)), 0))
    slopes = slopes[moving]  # a stretch that ends where it began goes with the one before: it may hold the turning point
    turns = np.flatnonzero(slopes[1:] * slopes[:-1] < 0) + 1
    found = []
    for i in turns:
        sense = -slopes[i - 1]  # a maximum is the minimum of the negative
        bounds = (float(knots[i - 1]), float(knots[i + 1]))
        best = minimize_scalar(
            lambda tick, sense=sense: float(sense * motion(np.array([tick * tick_s]))[0]),
            bounds=bounds,
            method="bounded",
            options={"xatol": 0.1},
        )
        near = np.arange(int(best.x) - 1, int(best.x) + 3)
        near = near[(near > bounds[0]) & (near < bounds[1])]
        if len(near):
            found.append(int(near[np.argmin(sense * motion(near * tick_s))]))
    return np.unique(np.concatenate([knots, np.array(found, dtype=np.int64)]))


def _first_ticks(motion: Motion, tick_s: float, place: Array, upward: BoolArray, before: IntArray, after: IntArray) -> IntArray:
    """The first tick at which the position is past each place, between two ticks that lie on both sides of it."""
    low, high = before.copy(), after.copy()
    while np.any(high - low > 1):
        middle = (low + high) // 2
        past = (motion(middle * tick_s) >= place) == upward
        high, low = np.where(past, middle, high), np.where(past, low, middle)
    return high


def _with_bounces(tick: IntArray, channel: IntArray, flaws: Flaws, tick_s: float) -> tuple[IntArray, IntArray]:
    """The edges with extra pairs after each: the channel falls back and returns."""
    rng = np.random.default_rng([flaws.seed, 2])
    room = np.append(np.diff(tick) // 2, np.iinfo(np.int64).max)
    room = np.minimum(room, int(flaws.bounce_s / tick_s))
    pairs = rng.integers(0, flaws.bounces + 1, len(tick))
    pairs[room < 2] = 0
    source = np.repeat(np.arange(len(tick)), 2 * pairs)
    extra = tick[source] + 1 + np.floor(rng.random(len(source)) * room[source]).astype(np.int64)
    return np.concatenate([tick, extra]), np.concatenate([channel, channel[source]])


def _visible_edges(tick: IntArray, channel: IntArray, level_a: int, level_b: int, increment_m: float, tick_s: float) -> Edges:
    """Changes in order; what happens twice to one channel within a tick is not seen."""
    key, times = np.unique(2 * tick + channel, return_counts=True)
    key = key[times % 2 == 1]
    tick, channel = key // 2, key % 2
    level = np.empty(len(key), dtype=np.int64)
    for which, first in ((0, level_a), (1, level_b)):
        mine = channel == which
        level[mine] = (first + np.arange(1, np.count_nonzero(mine) + 1)) % 2
    return Edges(tick, channel, level, level_a, level_b, increment_m, tick_s)


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise UsageError(otherwise)


@dataclass(frozen=True)
class Increments:
    """Increments that a state machine made of a record.

    Attributes
    ----------
    tick, step : IntArray
        Of each increment, (n,), step 1 or −1, count their running sum.
    invalid : int
        Edges that no motion makes, above 0 the position may be wrong by several increments.
    edges : int
        Edges taken.
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
    """All edges of a record through the state machine.

    Parameters
    ----------
    edges : Edges
        In the order of time.
    debounce : bool
        As of :func:`beltcomm.encoder.kernel.new_decoder`.

    Raises
    ------
    DataError
        When edges are not in order of time.
    """
    require_order(edges)
    registers = new_decoder(edges.level_a, edges.level_b, debounce=debounce)
    tick, step = all_increments(registers, edges.tick, edges.channel, edges.level)
    return Increments(tick, step, int(registers[INVALID]), len(edges.tick))


def require_order(edges: Edges) -> None:
    """Refuse increments that are not in the order of time.

    Parameters
    ----------
    edges : Edges
        Of a record.

    Raises
    ------
    DataError
        When edges are not in order of time.
    """
    wrong = np.flatnonzero(np.diff(edges.tick) < 0)
    if len(wrong):
        at = int(wrong[0])
        raise DataError(
            f"edge {at + 1} lies at tick {edges.tick[at + 1]}, before edge {at} at tick {edges.tick[at]}; sort the edges by time first"
        )
