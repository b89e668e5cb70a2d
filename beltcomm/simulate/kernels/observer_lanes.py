"""Observers of several stretches in lock step, eight in one register: the same sample as ``observer``, see there for the equations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import within_lanes
from beltcomm.simulate.kernels.learning import WIDEST, limit_variance
from beltcomm.simulate.kernels.observer import LOST, OPEN, ObserverState
from beltcomm.simulate.kernels.pieces import ABSURD_NM
from beltcomm.simulate.kernels.vectors import LANES, Vector, aligned_zeros, at, eight, flag_at, number_at, put, set_flag, set_number

#: Rows of the memory of a loop in lock step that :func:`advance_sample` knows.
NEW, SHUT, SHARE, KEPT, DEVIATION, VARIANCE, HALF, STIFFNESS, WANDER, HURRY, LEVER, ASTRAY, AIM = range(0, 13 * LANES, LANES)
#: The first row that it does not know.
OWN = 13


class LaneRows(NamedTuple):
    """Layout of the observers' memory, in rows of ``LANES`` lanes; arrays row by row.

    The others are memory.

    Attributes
    ----------
    size, own, noises : int
        Numbers of the state, of those that last, of the noises.
    H, F, G, D : int
        Each first open, then what it changes by when it closes.
    powers, P : int
        ``variances`` and ``P`` of ``ObserverState``.
    states, become : int
        s and what it becomes.
    """

    size: int
    own: int
    noises: int
    H: int
    F: int
    G: int
    D: int
    powers: int
    P: int
    states: int
    become: int
    gains: int
    h: int
    f: int
    g: int
    d: int
    fp: int
    ph: int
    pull: int
    end: int


class Observers(NamedTuple):
    """Of all lanes.

    Attributes
    ----------
    memory : ndarray
        As ``rows`` say.
    passes, reaches : ndarray of bool
        What of F and G is not 0 in all lanes, (size, own), (size, noises).
    """

    rows: LaneRows
    memory: Array
    passes: BoolArray
    reaches: BoolArray


def observed_rows(watch: ObserverState) -> tuple[float, ...]:
    """Values of the rows ``HALF`` to ``HURRY``.

    Parameters
    ----------
    watch : ObserverState
    """
    return (watch.half_gap_m, watch.stiffness, *watch.spread)


def observers(watches: Sequence[ObserverState]) -> Observers:
    """The observers of so many lanes, ``LANES`` at most, and memory for what they find at each sample.

    Parameters
    ----------
    watches : sequence of ObserverState
        One for each lane.
    """
    size, noises = len(watches[0].s), len(watches[0].variances)
    own = size - 2
    counts = (2 * size, 2 * size * own, 2 * size * noises, 2 * noises, noises, size * size)
    found = (size, size, size, size, size * own, size * noises, noises, size * own, size, size)
    ends = [0, *accumulate((*counts, *found))]
    rows = LaneRows(size, own, noises, *ends)
    memory = aligned_zeros(rows.end, LANES)
    known: dict[tuple[int, int], Array] = {}  # lanes that share an observer
    for lane, watch in enumerate(watches):
        key = id(watch.F), id(watch.P)
        if key not in known:
            known[key] = _lay_out(watch, own)
        memory[: rows.states, lane] = known[key]
    used = (memory != 0.0).any(axis=1)
    passes, reaches = (used[first:end].reshape(2, size, -1).any(axis=0) for first, end in ((rows.F, rows.G), (rows.G, rows.D)))
    return Observers(rows, memory.ravel(), passes, reaches)


def _lay_out(watch: ObserverState, own: int) -> Array:
    """Values of the rows ``H`` to ``P``."""
    pairs = ((pair[0], pair[1] - pair[0]) for pair in (watch.H, watch.F[:, :, :own], watch.G, watch.D))
    return np.concatenate([*(part.ravel() for pair in pairs for part in pair), watch.variances, watch.P.ravel()])


@within_lanes
def _expected_eight(rows: LaneRows, o: Array, share: Vector, left: Vector, nothing: tuple[int, int]) -> Vector:
    """ν[n] of eight lanes, N m, ``left`` being e[n], N m, and ``nothing`` what of s is 0."""
    for a in range(rows.size):
        if a != nothing[0] and a != nothing[1]:
            h = at(o, LANES * (rows.H + a)) + share * at(o, LANES * (rows.H + rows.size + a))
            left = left - h * at(o, LANES * (rows.states + a))
    return left


@within_lanes
def _learn_eight(rows: LaneRows, o: Array, passes: BoolArray, reaches: BoolArray, share: Vector, kept: Vector) -> Vector:
    """Gains of a sample, which stand in ``rows.gains``, and the covariance ahead; the variance of ν, (N m)²."""
    size, own, noises = rows.size, rows.own, rows.noises
    F, G, P, f, g = LANES * rows.F, LANES * rows.G, LANES * rows.P, LANES * rows.f, LANES * rows.g
    H, D, h, d = LANES * rows.H, LANES * rows.D, LANES * rows.h, LANES * rows.d
    fp, ph, pull, gains = LANES * rows.fp, LANES * rows.ph, LANES * rows.pull, LANES * rows.gains
    powers = LANES * rows.powers
    for a in range(size):
        put(o, h + LANES * a, at(o, H + LANES * a) + share * at(o, H + LANES * (size + a)))
        for m in range(own):
            if passes[a, m]:
                put(o, f + LANES * (a * own + m), at(o, F + LANES * (a * own + m)) + share * at(o, F + LANES * ((size + a) * own + m)))
        for m in range(noises):
            if reaches[a, m]:
                entry = at(o, G + LANES * (a * noises + m)) + share * at(o, G + LANES * ((size + a) * noises + m))
                put(o, g + LANES * (a * noises + m), entry)
    variance = eight(0.0)
    for m in range(noises):
        reading = at(o, D + LANES * m) + share * at(o, D + LANES * (noises + m))
        put(o, d + LANES * m, reading * at(o, powers + LANES * m))
        variance = variance + reading * reading * at(o, powers + LANES * m)
    for a in range(size):
        total = eight(0.0)
        for e in range(size):
            total = total + at(o, P + LANES * (a * size + e)) * at(o, h + LANES * e)
        put(o, ph + LANES * a, total)
        variance = variance + at(o, h + LANES * a) * total
    for a in range(size):
        for e in range(own):
            total = eight(0.0)
            for m in range(own):
                if passes[a, m]:
                    total = total + at(o, f + LANES * (a * own + m)) * at(o, P + LANES * (m * size + e))
            put(o, fp + LANES * (a * own + e), total)
    for a in range(size):
        total = eight(0.0)
        for m in range(noises):
            if reaches[a, m]:
                total = total + at(o, g + LANES * (a * noises + m)) * at(o, d + LANES * m)
        for m in range(own):
            if passes[a, m]:
                total = total + at(o, f + LANES * (a * own + m)) * at(o, ph + LANES * m)
        put(o, pull + LANES * a, kept * total)
        put(o, gains + LANES * a, total / variance)
    for a in range(size):
        for e in range(a + 1):
            total = eight(0.0) - at(o, pull + LANES * a) * at(o, gains + LANES * e)
            for m in range(noises):
                if reaches[a, m] and reaches[e, m]:
                    spread = at(o, g + LANES * (a * noises + m)) * at(o, powers + LANES * m)
                    total = total + spread * at(o, g + LANES * (e * noises + m))
            for m in range(own):
                if passes[e, m]:
                    total = total + at(o, fp + LANES * (a * own + m)) * at(o, f + LANES * (e * own + m))
            put(o, P + LANES * (a * size + e), total)
            put(o, P + LANES * (e * size + a), total)
    return variance


@within_lanes
def _observe_eight(rows: LaneRows, o: Array, passes: BoolArray, share: Vector, innovation: Vector, nothing: tuple[int, int]) -> None:
    """s[n+1] of eight lanes by ν[n], N m, 0 where it does not count; ``nothing`` is what of s is 0."""
    size, own = rows.size, rows.own
    F, states, become = LANES * rows.F, LANES * rows.states, LANES * rows.become
    for a in range(size):
        total = at(o, LANES * (rows.gains + a)) * innovation
        for m in range(own):
            if passes[a, m] and m != nothing[0] and m != nothing[1]:
                entry = at(o, F + LANES * (a * own + m)) + share * at(o, F + LANES * ((size + a) * own + m))
                total = total + entry * at(o, states + LANES * m)
        put(o, become + LANES * a, total)
    for a in range(size):
        put(o, states + LANES * a, at(o, become + LANES * a))


@within_lanes
def advance_sample(
    n: int,
    active: int,
    substeps: int,
    learning: bool,
    where: IntArray,
    s: Array,
    rows: LaneRows,
    o: Array,
    passes: BoolArray,
    reaches: BoolArray,
    carriage: tuple[int, int],
) -> None:
    """One sample of all lanes: what the observers find, and ahead in ``rows.states`` by what the bodies are to be corrected.

    Parameters
    ----------
    n : int
        Number of the sample.
    active : int
        Lanes that go on.
    substeps : int
        Fine steps per sample.
    learning : bool
        True if gains are worked out.
    where : ndarray (12, lanes) of int
        Addresses of motion and watch, as ``lock_step`` lays them out.
    s : ndarray
        Rows of this file's names: the load's mean, N m, in ``NEW`` and the sum of the closed shares in ``SHUT`` are read; where ``ASTRAY``
        is 1 the carriage is lost, and is to stand so far, ``AIM``, m, behind the belt's end that a lever ``LEVER``, m/rad, drives.
    rows : LaneRows
        Of the observers' memory.
    o : ndarray
        Memory of the observers; changed in place.
    passes, reaches : ndarray of bool
        As of :class:`Observers`.
    carriage : tuple of int
        See ``_expected_eight``.
    """
    for c in range(LANES):
        place = n if c < active else 0  # a lane beside the others that go on
        value = s[NEW + c]
        value = value if abs(value) < ABSURD_NM else ABSURD_NM
        s[NEW + c] = value - number_at(where[2, c], place) if n > 0 else 0.0
        s[KEPT + c] = 1.0 if flag_at(where[3, c], place) else 0.0
        s[SHARE + c] = number_at(where[4, c], place) * (s[SHUT + c] / substeps) if learning else number_at(where[9, c], place)
        s[SHUT + c] = 0.0
    for c in range(active):
        set_number(where[10, c], n, s[NEW + c])
    put(s, NEW, _expected_eight(rows, o, at(s, SHARE), at(s, NEW), carriage))
    gains = LANES * rows.gains
    if learning:
        put(s, VARIANCE, _learn_eight(rows, o, passes, reaches, at(s, SHARE), at(s, KEPT)))
        for c in range(active):
            set_number(where[9, c], n, s[SHARE + c])
            if s[KEPT + c] > 0.0:
                s[DEVIATION + c] = math.sqrt(s[VARIANCE + c])
                set_number(where[8, c], n, s[DEVIATION + c])
                set_flag(where[5, c], n, 1 if abs(s[NEW + c]) > LOST * s[DEVIATION + c] else 0)
                for a in range(rows.size):
                    set_number(where[7, c], n * rows.size + a, o[gains + LANES * a + c])
            else:
                first, row = LANES * rows.P + c, LANES * rows.size
                limit_variance(o, first, row, LANES, rows.size, carriage[0], WIDEST * s[WANDER + c])
                limit_variance(o, first, row, LANES, rows.size, carriage[1], WIDEST * s[HURRY + c])
            if flag_at(where[5, c], n) or flag_at(where[6, c], n):
                o[LANES * (rows.P + carriage[0] * (rows.size + 1)) + c] += s[WANDER + c]
                o[LANES * (rows.P + carriage[1] * (rows.size + 1)) + c] += s[HURRY + c]
    elif _have_same_array(where[7], active):
        for a in range(rows.size):
            put(o, gains + LANES * a, eight(number_at(where[7, 0], n * rows.size + a)))
    else:
        for c in range(active):
            for a in range(rows.size):
                o[gains + LANES * a + c] = number_at(where[7, c], n * rows.size + a)
    for c in range(active):
        s[DEVIATION + c] = number_at(where[8, c], n)
        if s[KEPT + c] > 0.0:
            set_number(where[11, c], n, s[NEW + c] / s[DEVIATION + c])
    _observe_eight(rows, o, passes, at(s, SHARE), at(s, KEPT) * at(s, NEW), carriage)
    for c in range(active):  # ``contact``
        wanted = number_at(where[2, c], n)
        astray = s[KEPT + c] > 0.0 and flag_at(where[5, c], n) > 0
        s[ASTRAY + c] = 1.0 if astray and s[SHARE + c] <= OPEN and abs(wanted) >= LOST * s[DEVIATION + c] else 0.0
        pull = wanted / s[LEVER + c]
        s[AIM + c] = math.copysign(s[HALF + c], pull) + pull / (number_at(where[4, c], n) * s[STIFFNESS + c])


@within_lanes
def _have_same_array(addresses: IntArray, active: int) -> bool:
    """True if all lanes have the same array."""
    same = True
    for c in range(1, active):
        same &= addresses[c] == addresses[0]
    return same


@within_lanes
def brought(i: int, active: int, where: IntArray, lengths: IntArray, course: Array) -> None:
    """The next steps of each lane's motion, a lane beside the other.

    Parameters
    ----------
    i : int
        First step.
    active : int
        Lanes that go on.
    where : ndarray of int
        Addresses of motion and watch, as of :func:`advance_sample`.
    lengths : ndarray of int
        Steps of each lane.
    course : ndarray (2, steps, lanes)
        Angle and speed.
    """
    for kind in range(2):
        if _have_same_array(where[kind], active):
            for e in range(min(course.shape[1], lengths[0] - i)):
                put(course, LANES * (kind * course.shape[1] + e), eight(number_at(where[kind, 0], i + e)))
            continue
        for c in range(active):
            first = where[kind, c]
            for e in range(min(course.shape[1], lengths[c] - i)):
                course[kind, e, c] = number_at(first, i + e)
