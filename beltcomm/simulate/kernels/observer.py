"""Follows the bodies behind the motor by the torque: an extended Kalman filter inside the kernel that rebuilds their motion.

A carriage that is free in a gap at times strikes its ends sooner or later by chance: rebuilt from the motor's motion alone it soon is
anywhere.  The torque shows every stroke, so what the motor needed corrects where the carriage is, sample by sample:

    ν[n] = e[n] - H s[n],    s[n+1] = F s[n] + K[n] ν[n],    then the part x of s is taken off the motion and set to 0.

e, F, H, s as in ``beltcomm.fit.noise.whitening``; F, H, G, D go from those of an open gap to those of a closed one with the share of the
sample in which it is closed.  Where nothing opens, ν are the same innovations as without it.
Source: Anderson, Moore, Optimal Filtering, 1979, section 8.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import in_lanes
from beltcomm.simulate.kernels.vectors import LANES, aligned_zeros, at, eight, put


class ObserverState(NamedTuple):
    """State with which the kernel follows the bodies; without samples in ``wanted`` it does not.

    Attributes
    ----------
    wanted : ndarray (n,), N m
        Load that the measured torque leaves for everything beyond the motor.
    keep : ndarray (n,) of bool
        Samples that count.
    places : ndarray of int
        Place of each body's position in s, -1 for none; its speed stands ``behind`` places further.
    substeps : int
        Fine steps per sample.
    cart : int
        Place of the carriage's position in s.
    half_gap_m : float, m
        And stiffness : N/m at the belt where it is stiffest: while a torque is passed on the carriage stands half the gap and what the belt
        gives way behind.
    held : ndarray (n,)
        Stiffness at the place of each sample over that one: a belt half as stiff is as one that is closed half of the time.
    spread : ndarray (2,), m² and m²/s²
        Variances of its position and speed once it is lost.
    lost : ndarray (n,) of bool
        Where it was.
    forgets : ndarray (n,) of bool
        Where so little was seen before that it may be anywhere.
    learning : bool
        Whether gains, deviations, shares and losses are worked out, or taken as they are.
    F : ndarray (2, k, k)
    G : ndarray (2, k, m)
    H : ndarray (2, k)
    D : ndarray (2, m)
        Open and closed.
    variances : ndarray (m,)
    P : ndarray (k, k)
        Covariance.
    s, ahead : ndarray (k,)
    gains : ndarray (n, k)
    deviations, shares : ndarray (n,)
    left : ndarray (n,)
        e.
    white : ndarray (n,)
        ν over its deviation.
    room : ndarray
        Memory for learning, see ``learning``; nothing where it is not.
    """

    wanted: Array
    keep: BoolArray
    places: IntArray
    behind: int
    substeps: int
    cart: int
    half_gap_m: float
    stiffness: float
    held: Array
    spread: Array
    lost: BoolArray
    forgets: BoolArray
    learning: bool
    F: Array
    G: Array
    H: Array
    D: Array
    variances: Array
    P: Array
    s: Array
    ahead: Array
    gains: Array
    deviations: Array
    shares: Array
    left: Array
    white: Array
    room: Array


def _no_state() -> ObserverState:
    none, square, cube = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0, 0))
    some, places = np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64)
    at = ObserverState(none, some, places, 0, 1, 0, 0.0, 1.0, none, none, some, some, False, cube, cube, square, square, *(none,) * 10)
    return at._replace(P=square, gains=square)


#: Deviations of an innovation beyond which the carriage is not where it was taken to be.
LOST = 3.5
#: Share of a sample in which a gap is closed up to which the torque is no news of where in the gap the carriage is.
OPEN = 0.05
#: Columns or models in lock step: registers of four, and at most as many as there is room for.
REGISTER, ROOM = 4, 16
#: A watch that sees nothing.
NOTHING = _no_state()


def reset(watch: ObserverState, wanted: Array) -> ObserverState:
    """The state of an observer for another load, nothing found yet.

    Parameters
    ----------
    watch : ObserverState
        Whose gains and shares are kept.
    wanted : ndarray (n,), N m, motor shaft
        Load that the torque leaves for the bodies.
    """
    n = len(wanted)
    return watch._replace(wanted=wanted, s=np.zeros_like(watch.s), left=np.zeros(n), white=np.zeros(n))


def idle() -> ObserverState:
    """A watch that sees one sample, to compile for."""
    one, flag, square = np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros((3, 3))
    known = NOTHING._replace(wanted=one, keep=flag, held=one, lost=flag, forgets=flag, spread=np.zeros(2), variances=one, P=square)
    known = known._replace(F=np.zeros((2, 3, 3)), G=np.zeros((2, 3, 1)), H=np.zeros((2, 3)), D=np.zeros((2, 1)), s=np.zeros(3))
    return known._replace(gains=np.zeros((1, 3)), deviations=one, shares=one, left=one, white=one)


def lanes_for(number: int) -> int:
    """Lanes in lock step that take so many columns or models in rounds as even as possible.

    Parameters
    ----------
    number : int
        Columns or models.

    Returns
    -------
    int
        A multiple of ``REGISTER``.
    """
    return REGISTER * max(1, -(-number // (-(-number // ROOM) * REGISTER))) if number else REGISTER


#: Fields of ``ObserverState`` that the functions below take, in their order.  One by one: out of the tuple, every array would be counted
#: as used and as no longer used at each sample, which took more time than all the rest.
EXPECTED = ("H", "s", "shares")
LEARNED = ("keep", "variances", "gains", "deviations", "shares", "lost", "forgets", "room", "cart", "behind", "spread")
OBSERVED = ("keep", "F", "s", "ahead", "gains", "deviations", "shares", "white")
TAKEN = ("behind", "s")
TOUCHED = ("wanted", "keep", "lost", "deviations", "shares", "half_gap_m", "stiffness", "held")


def expected_innovation(n: int, left: float, H: Array, s: Array, shares: Array) -> float:
    """ν[n], N m.

    Parameters
    ----------
    n : int
        Number of the sample.
    left : float
        e[n], N m.
    H, s, shares : ndarray
        As :class:`ObserverState` has them.
    """
    share, innovation = shares[n], left
    for i in range(s.shape[0]):
        innovation -= (H[0, i] + share * (H[1, i] - H[0, i])) * s[i]
    return innovation


def observe(
    n: int,
    innovation: float,
    keep: BoolArray,
    F: Array,
    s: Array,
    ahead: Array,
    gains: Array,
    deviations: Array,
    shares: Array,
    white: Array,
) -> None:
    """One sample: s[n+1] in place.

    Parameters
    ----------
    n : int
        Number of the sample.
    innovation : float
        ν[n], N m.
    keep : ndarray of bool (n,)
        As :class:`ObserverState` has it.
    F, s, gains, deviations, shares, white : ndarray
        As :class:`ObserverState` has them.
    ahead : ndarray
        Scratch of the size of s.
    """
    size, own, share = s.shape[0], s.shape[0] - 2, shares[n]
    if keep[n]:
        white[n] = innovation / deviations[n]
    else:
        innovation = 0.0
    for i in range(size):
        total = gains[n, i] * innovation
        for j in range(own):
            total += (F[0, i, j] + share * (F[1, i, j] - F[0, i, j])) * s[j]
        ahead[i] = total
    for i in range(size):
        s[i] = ahead[i]


def take_correction(at: int, behind: int, s: Array) -> tuple[float, float]:
    """A body's position and speed in s, 0 in it from now on; 0, 0 for one it does not know.

    Parameters
    ----------
    at : int
        Its place, or -1.
    behind : int
        Places from a position to its speed.
    s : ndarray
        State of the observer; changed in place.
    """
    if at < 0:
        return 0.0, 0.0
    place, speed = s[at], s[at + behind]
    s[at] = s[at + behind] = 0.0
    return place, speed


def contact(
    n: int,
    lever: float,
    stretch: float,
    wanted: Array,
    keep: BoolArray,
    lost: BoolArray,
    deviations: Array,
    shares: Array,
    half_gap_m: float,
    stiffness: float,
    held: Array,
) -> float:
    """By how much the stretch, m, is less than what the torque of sample n tells where the carriage is lost; 0 where it is not.

    While more than noise is passed on, the stretch is half the gap and what the belt gives way.

    Parameters
    ----------
    n : int
        Number of the sample.
    lever : float, m/rad
        From the motor to the belt.
    stretch : float, m
        Of the belt.
    wanted : ndarray (n,), N m, motor shaft
        As :class:`ObserverState` has it.
    keep, lost : ndarray of bool (n,)
        As :class:`ObserverState` has them.
    deviations, shares : ndarray (n,)
        As :class:`ObserverState` has them.
    half_gap_m : float, m
        Half the gap.
    stiffness : float, N/m
        At the belt, where it is stiffest.
    held : ndarray (n,)
        Stiffness at the place of each sample over that.
    """
    if not (keep[n] and lost[n]) or shares[n] > OPEN or abs(wanted[n]) < LOST * deviations[n]:
        return 0.0
    pull = wanted[n] / lever
    return float(math.copysign(half_gap_m, pull) + pull / (held[n] * stiffness) - stretch)


def filter_columns(e: Array, keep: BoolArray, f: Array, h: Array, gains: Array, deviations: Array, shares: Array) -> Array:
    """First-order change of the innovations, over their deviations, by changes e of the residual; (n, k) -> (kept, k).

    Parameters
    ----------
    e : ndarray (n, k)
        Of the residual.
    keep : ndarray of bool (n,)
        Samples that count.
    f, h : ndarray
        F and H, gap open and closed, as in :class:`ObserverState`.
    gains : ndarray
        K, by sample.
    deviations : ndarray (n,)
        Of the innovations.
    shares : ndarray (n,)
        Part of each sample in which the gap is closed.

    Returns
    -------
    ndarray (kept, k), 1
        Rows of the samples that count.
    """
    size, columns = h.shape[1], e.shape[1]
    whole = -(-columns // LANES) * LANES
    padded = e if whole == columns else np.pad(e, ((0, 0), (0, whole - columns)))
    out, states, known = np.empty((np.count_nonzero(keep), whole)), aligned_zeros(2 * size, whole), np.empty((size, size))
    fine = np.ascontiguousarray
    _filter_states(fine(padded), keep, fine(f), fine(h), gains, deviations, shares, states.ravel(), known.ravel(), out)
    return out[:, :columns]


@in_lanes
def _filter_states(
    e: Array,
    keep: BoolArray,
    f: Array,
    h: Array,
    gains: Array,
    deviations: Array,
    shares: Array,
    states: Array,
    known: Array,
    out: Array,
) -> None:
    size, own, columns = h.shape[1], h.shape[1] - 2, e.shape[1]
    here, ahead, number = 0, columns * size, 0  # of the states, each as many numbers as there are columns
    for n in range(e.shape[0]):
        share = shares[n]
        if n == 0 or share != shares[n - 1]:
            for i in range(size):
                known[size * own + i] = h[0, i] + share * (h[1, i] - h[0, i])
                for j in range(own):
                    known[i * own + j] = f[0, i, j] + share * (f[1, i, j] - f[0, i, j])
        for first in range(0, columns, LANES):
            innovation = eight(0.0)
            if keep[n]:
                innovation = at(e, n * columns + first)
                for i in range(size):
                    innovation = innovation - known[size * own + i] * at(states, here + columns * i + first)
                put(out, number * columns + first, innovation / deviations[n])
            for i in range(size):
                total = gains[n, i] * innovation
                for j in range(own):
                    if known[i * own + j] != 0.0:
                        total = total + known[i * own + j] * at(states, here + columns * j + first)
                put(states, ahead + columns * i + first, total)
        number += keep[n]
        here, ahead = ahead, here
