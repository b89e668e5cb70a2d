"""Observers of several stretches in lock step, eight in one register: the same sample as ``observer``, see there for the equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import within_lanes
from beltcomm.simulate.observer import Watch
from beltcomm.simulate.vectors import LANES, Vector, aligned, at, eight, put

Array = NDArray[np.float64]

#: Lanes of one row of memory: two vectors.
WIDTH = 2 * LANES


class Rows(NamedTuple):
    """Where everything of the observers begins in their memory, in rows of ``WIDTH`` lanes; arrays row by row.

    size, own, noises : numbers of the state, of those that last, of the noises.   H, F, G, D : each first open, then what it changes by
    when it closes.   powers, P : ``Watch.variances`` and ``Watch.P``.   states, become : s and what it becomes.   The others are memory.
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
    """Of all lanes.   memory : as ``rows`` say.   passes, reaches : what of F and G is not 0 in all lanes, (size, own), (size, noises)."""

    rows: Rows
    memory: Array
    passes: NDArray[np.bool_]
    reaches: NDArray[np.bool_]


def observers(watches: Sequence[Watch]) -> Observers:
    """The observers of so many lanes, ``WIDTH`` at most, and memory for what they find at each sample."""
    size, noises = len(watches[0].s), len(watches[0].variances)
    own = size - 2

    def changing(matrices: Sequence[Array]) -> Array:
        return np.array([np.stack((pair[0], pair[1] - pair[0])) for pair in matrices])

    F, G = changing([w.F[:, :, :own] for w in watches]), changing([w.G for w in watches])
    H, D = changing([w.H for w in watches]), changing([w.D for w in watches])
    known = (H, F, G, D, np.array([w.variances for w in watches]), np.array([w.P for w in watches]))
    found = (size, size, size, size, size * own, size * noises, noises, size * own, size, size)
    ends = np.cumsum([0, *(array[0].size for array in known), *found])
    rows = Rows(size, own, noises, *(int(end) for end in ends))
    memory = aligned(rows.end, WIDTH)
    for first, array in zip(ends, known, strict=False):
        memory[first : first + array[0].size, : len(watches)] = array.reshape(len(watches), -1).T
    return Observers(rows, memory.ravel(), *(np.any(matrix, axis=(0, 1)) for matrix in (F, G)))


@within_lanes
def expected_eight(rows: Rows, o: Array, base: int, share: Vector, left: Vector, nothing: tuple[int, int]) -> Vector:
    """ν[n] of eight lanes, N m.   left : e[n], N m.   nothing : what of s is 0."""
    for a in range(rows.size):
        if a != nothing[0] and a != nothing[1]:
            h = at(o, WIDTH * (rows.H + a) + base) + share * at(o, WIDTH * (rows.H + rows.size + a) + base)
            left = left - h * at(o, WIDTH * (rows.states + a) + base)
    return left


@within_lanes
def learn_eight(
    rows: Rows, o: Array, passes: NDArray[np.bool_], reaches: NDArray[np.bool_], base: int, share: Vector, kept: Vector
) -> Vector:
    """Gains of a sample, which stand in ``rows.gains``, and the covariance ahead; the variance of ν, (N m)²."""
    size, own, noises = rows.size, rows.own, rows.noises
    F, G, P, f, g = WIDTH * rows.F + base, WIDTH * rows.G + base, WIDTH * rows.P + base, WIDTH * rows.f + base, WIDTH * rows.g + base
    H, D, h, d = WIDTH * rows.H + base, WIDTH * rows.D + base, WIDTH * rows.h + base, WIDTH * rows.d + base
    fp, ph, pull, gains = WIDTH * rows.fp + base, WIDTH * rows.ph + base, WIDTH * rows.pull + base, WIDTH * rows.gains + base
    powers = WIDTH * rows.powers + base
    for a in range(size):
        put(o, h + WIDTH * a, at(o, H + WIDTH * a) + share * at(o, H + WIDTH * (size + a)))
        for m in range(own):
            if passes[a, m]:
                put(o, f + WIDTH * (a * own + m), at(o, F + WIDTH * (a * own + m)) + share * at(o, F + WIDTH * ((size + a) * own + m)))
        for m in range(noises):
            if reaches[a, m]:
                entry = at(o, G + WIDTH * (a * noises + m)) + share * at(o, G + WIDTH * ((size + a) * noises + m))
                put(o, g + WIDTH * (a * noises + m), entry)
    variance = eight(0.0)
    for m in range(noises):
        reading = at(o, D + WIDTH * m) + share * at(o, D + WIDTH * (noises + m))
        put(o, d + WIDTH * m, reading * at(o, powers + WIDTH * m))
        variance = variance + reading * reading * at(o, powers + WIDTH * m)
    for a in range(size):
        total = eight(0.0)
        for e in range(size):
            total = total + at(o, P + WIDTH * (a * size + e)) * at(o, h + WIDTH * e)
        put(o, ph + WIDTH * a, total)
        variance = variance + at(o, h + WIDTH * a) * total
    for a in range(size):
        for e in range(own):
            total = eight(0.0)
            for m in range(own):
                if passes[a, m]:
                    total = total + at(o, f + WIDTH * (a * own + m)) * at(o, P + WIDTH * (m * size + e))
            put(o, fp + WIDTH * (a * own + e), total)
    for a in range(size):
        total = eight(0.0)
        for m in range(noises):
            if reaches[a, m]:
                total = total + at(o, g + WIDTH * (a * noises + m)) * at(o, d + WIDTH * m)
        for m in range(own):
            if passes[a, m]:
                total = total + at(o, f + WIDTH * (a * own + m)) * at(o, ph + WIDTH * m)
        put(o, pull + WIDTH * a, kept * total)
        put(o, gains + WIDTH * a, total / variance)
    for a in range(size):
        for e in range(a + 1):
            total = eight(0.0) - at(o, pull + WIDTH * a) * at(o, gains + WIDTH * e)
            for m in range(noises):
                if reaches[a, m] and reaches[e, m]:
                    spread = at(o, g + WIDTH * (a * noises + m)) * at(o, powers + WIDTH * m)
                    total = total + spread * at(o, g + WIDTH * (e * noises + m))
            for m in range(own):
                if passes[e, m]:
                    total = total + at(o, fp + WIDTH * (a * own + m)) * at(o, f + WIDTH * (e * own + m))
            put(o, P + WIDTH * (a * size + e), total)
            put(o, P + WIDTH * (e * size + a), total)
    return variance


@within_lanes
def observe_eight(
    rows: Rows, o: Array, passes: NDArray[np.bool_], base: int, share: Vector, innovation: Vector, nothing: tuple[int, int]
) -> None:
    """s[n+1] of eight lanes.   innovation : ν[n], N m, 0 where it does not count.   nothing : what of s is 0."""
    size, own = rows.size, rows.own
    F, states, become = WIDTH * rows.F + base, WIDTH * rows.states + base, WIDTH * rows.become + base
    for a in range(size):
        total = at(o, WIDTH * (rows.gains + a) + base) * innovation
        for m in range(own):
            if passes[a, m] and m != nothing[0] and m != nothing[1]:
                entry = at(o, F + WIDTH * (a * own + m)) + share * at(o, F + WIDTH * ((size + a) * own + m))
                total = total + entry * at(o, states + WIDTH * m)
        put(o, become + WIDTH * a, total)
    for a in range(size):
        put(o, states + WIDTH * a, at(o, become + WIDTH * a))
