"""Update of an observer at a sample: its gain, and the covariance ahead; the state's numbers side by side in registers.

    k = F P h + G V d,    S = h P h + d V d,    P ← F P F' + G V G' - k k'/S

with h, F, G, d at the share of the sample that is closed, V the variances of the noises, P symmetric.   Symbols as in ``observer``.
"""

from __future__ import annotations

import math

from beltcomm.arrays import Array, BoolArray
from beltcomm.compiled import inlined
from beltcomm.simulate.kernels.observer import LOST, ObserverState
from beltcomm.simulate.kernels.vectors import LANES, aligned_zeros, at, eight, put

#: Variance up to which position and speed of a carriage that nothing is seen of may grow, over those of a lost one: three times that of a
#: carriage that is anywhere in its gap.
WIDEST = 4.0
#: The state and the noises of a usual observer, for which the compiler lays out every step; what has more goes through loops.
SIZE, NOISES = 8, 5


def with_memory(watch: ObserverState) -> ObserverState:
    """The watch with memory for what :func:`learn` needs: rows of so many numbers as fill whole registers, ``SIZE`` or more.

    h, then what it changes by when the gap closes; the columns of F and of G, each likewise; P; memory for h, F, G at a share, F P, P h
    and k; last d, likewise, and the variances of the noises.

    Parameters
    ----------
    watch : ObserverState
    """
    size, noises = max(SIZE, len(watch.s)), max(NOISES, len(watch.variances))
    own, wide = size - 2, -(-size // LANES) * LANES
    memory = aligned_zeros(2 + 3 * (own + noises) + 2 * size + 3 + -(-3 * noises // wide), wide)
    first = 0
    for pair, rows in ((watch.H[:, None], 1), (watch.F[:, :, :-2].swapaxes(1, 2), own), (watch.G.swapaxes(1, 2), noises)):
        for part in (pair[0], pair[1] - pair[0]):
            memory[first : first + len(part), : part.shape[1]] = part
            first += rows
    memory[first : first + len(watch.P), : len(watch.P)] = watch.P
    flat = memory.ravel()
    for place, part in enumerate((watch.D[0], watch.D[1] - watch.D[0], watch.variances)):
        flat[len(flat) - (3 - place) * noises :][: len(part)] = part
    return watch._replace(room=flat)


@inlined
def _results(size: int, noises: int, wide: int) -> tuple[int, int]:
    """Offsets of P and k."""
    P = (2 + 2 * (size - 2) + 2 * noises) * wide
    return P, P + (size + 1 + size - 2 + noises + size + 1) * wide


@inlined
def _predict_covariance(size: int, noises: int, wide: int, share: float, keep: bool, room: Array) -> float:
    """k and the covariance ahead, which stand in ``room``; variance of ν, (N m)², 0 where it does not count.

    ``wide``: numbers in a row of ``room``; ``share`` of the sample in which the gap is closed; ``keep``: the sample counts.
    """
    own, variance = size - 2, 0.0
    P, k = _results(size, noises, wide)
    F, h = 2 * wide, P + size * wide
    G = F + 2 * own * wide
    f, d = h + wide, room.shape[0] - 3 * noises
    g = f + own * wide
    fp = g + noises * wide
    ph = fp + size * wide
    for b in range(0, wide, LANES):
        put(room, h + b, at(room, b) + share * at(room, wide + b))
        for m in range(own):
            put(room, f + m * wide + b, at(room, F + m * wide + b) + share * at(room, F + (own + m) * wide + b))
        for m in range(noises):
            put(room, g + m * wide + b, at(room, G + m * wide + b) + share * at(room, G + (noises + m) * wide + b))
    for b in range(0, wide, LANES):  # once all of f stands there
        for i in range(size):
            total = eight(0.0)
            for m in range(own):
                total = total + room[f + m * wide + i] * at(room, P + m * wide + b)
            put(room, fp + i * wide + b, total)
    if keep:
        for b in range(0, wide, LANES):
            total = eight(0.0)
            for m in range(size):
                total = total + room[h + m] * at(room, P + m * wide + b)
            put(room, ph + b, total)
        for i in range(size):
            variance += room[h + i] * room[ph + i]
        for b in range(0, wide, LANES):
            total = eight(0.0)
            for m in range(own):
                total = total + room[ph + m] * at(room, f + m * wide + b)
            for m in range(noises):
                reading = room[d + m] + share * room[d + noises + m]
                total = total + reading * room[d + 2 * noises + m] * at(room, g + m * wide + b)
                if b == 0:
                    variance += reading * reading * room[d + 2 * noises + m]
            put(room, k + b, total)
    sure = -1.0 / variance if variance > 0.0 else 0.0
    for i in range(size):
        for b in range(0, wide, LANES):
            total = sure * room[k + i] * at(room, k + b)
            for m in range(noises):
                total = total + room[g + m * wide + i] * room[d + 2 * noises + m] * at(room, g + m * wide + b)
            for m in range(own):
                total = total + room[fp + i * wide + m] * at(room, f + m * wide + b)
            put(room, P + i * wide + b, total)
    for i in range(size):
        for m in range(i):
            room[P + i * wide + m] = room[P + m * wide + i]  # symmetric to the last digit, or it drifts
    return variance


@inlined
def limit_variance(values: Array, first: int, row: int, column: int, size: int, place: int, most: float) -> None:
    """A covariance whose state at ``place`` has no more variance than ``most``: its row and column are scaled, correlations stay.

    Between open and closed the linearised motion is one of changing stiffness, which swings itself up: in 0.7 s of a transient that does
    not count, deviations of 10 µm grew to kilometres, and beside such numbers the variance of ν was rounding, below zero.  The gap holds
    the carriage.

    Parameters
    ----------
    values : ndarray
        Memory that holds it from ``first`` on.
    first : int
        Place of the covariance in the memory.
    row, column : int
        Numbers from one row and one column to the next.
    size : int
        Of the covariance.
    place : int
        Number of the state.
    most : float
        0 where nothing opens.
    """
    variance = values[first + place * (row + column)]
    if 0.0 < most < variance:
        factor = math.sqrt(most / variance)
        for i in range(size):
            values[first + place * row + i * column] *= factor
            values[first + i * row + place * column] *= factor


def learn(
    n: int,
    innovation: float,
    keep: BoolArray,
    variances: Array,
    gains: Array,
    deviations: Array,
    shares: Array,
    lost: BoolArray,
    forgets: BoolArray,
    room: Array,
    cart: int,
    behind: int,
    spread: Array,
) -> None:
    """Gain and deviation of sample n, and the covariance ahead.

    Parameters
    ----------
    n : int
        Number of the sample.
    innovation : float, N m
        Beyond ``LOST`` deviations the carriage is lost.
    keep : ndarray of bool (n,)
        As :class:`ObserverState` has it.
    variances, gains, deviations, shares : ndarray
        As :class:`ObserverState` has them; filled for sample n.
    lost, forgets : ndarray of bool (n,)
        As :class:`ObserverState` has them.
    room : ndarray
        Memory, of :func:`with_memory`.
    cart, behind : int
        Places in s, as :class:`ObserverState` has them.
    spread : ndarray (2,), m² and m²/s²
        As :class:`ObserverState` has it.
    """
    size, noises = gains.shape[1], variances.shape[0]
    if size <= SIZE and noises <= NOISES:
        size, noises, wide = SIZE, NOISES, SIZE
        variance = _predict_covariance(SIZE, NOISES, SIZE, shares[n], keep[n], room)
    else:
        size, noises = max(size, SIZE), max(noises, NOISES)
        wide = (size + LANES - 1) // LANES * LANES
        variance = _predict_covariance(size, noises, wide, shares[n], keep[n], room)
    P, k = _results(size, noises, wide)
    if keep[n]:
        deviations[n] = math.sqrt(variance)
        lost[n] = abs(innovation) > LOST * deviations[n]
        for i in range(gains.shape[1]):
            gains[n, i] = room[k + i] / variance
    else:
        limit_variance(room, P, wide, 1, size, cart, WIDEST * spread[0])
        limit_variance(room, P, wide, 1, size, cart + behind, WIDEST * spread[1])
    if lost[n] or forgets[n]:
        room[P + cart * wide + cart] += spread[0]
        room[P + (cart + behind) * wide + cart + behind] += spread[1]
