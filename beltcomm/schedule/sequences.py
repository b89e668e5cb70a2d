"""Pseudorandom sequences of the excitations: the short ones, one to judge with, and one that spares the resonance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from beltcomm.excitation import SHORT_ORDER, Excitation, PrbsChoice, prbs

#: The short excitation: orders and s of a bit that are tried until the limits allow more than the breakaway torque; a slower clock leaves
#: out the frequencies of a stiff belt, a shorter sequence goes less far.
SHAPES = ((SHORT_ORDER, 2e-3), (SHORT_ORDER, 3e-3), (SHORT_ORDER, 4e-3), (7, 6e-3))
#: The same where samples come so seldom that the first of these bits is one sample: what to take from the order that then takes as long as
#: the first sequence, and clocks; at last shorter ones, which go less far.  No shorter one than of order 5.
SLOW_SHAPES = ((0, 1), (1, 2), (1, 3), (1, 1), (2, 1))
LEAST_ORDER = 5
#: Rows without which a short excitation says too little, and by what a whole number of its periods may exceed them.
FEWEST_ROWS, MOST_OVER_FEWEST = 400, 1.3
#: s: of the short excitation, and of the rest before and after it.
SHORT_S, EXCITATION_REST_S = 3.0, 1.0
#: An excitation that cannot be louder than this times the friction hardly moves the carriage.
HARDLY = 1.3
#: Resonance over the first zero of a sequence that spares it.
CALM_ZERO = 0.7

#: m, largest travel of an excitation around its place: the stiffness is taken as constant there.
EXCITATION_TRAVEL_M = 0.03
#: s: where samples come more seldom, that travel is longer in proportion: neither the sequence nor a stop turns the carriage round sooner.
WIDER_FROM_S = 2e-3


def excitation_travel_m(period_s: float) -> float:
    """Largest travel of an excitation around its place where samples come every ``period_s``, m.

    Parameters
    ----------
    period_s : float, s
        Sampling period.
    """
    return EXCITATION_TRAVEL_M * max(period_s / WIDER_FROM_S, 1.0)


def shapes_at(period_s: float) -> tuple[tuple[int, int], ...]:
    """Orders and clocks of the short excitation where samples come every ``period_s``, in the order in which they are tried.

    Parameters
    ----------
    period_s : float, s
        Sampling period.

    Returns
    -------
    tuple of tuple of int
        Order, and samples for each bit.
    """
    wanted = tuple((order, round(bit_s / period_s)) for order, bit_s in SHAPES)
    if wanted[0][1] > 1:
        return wanted
    order = round(math.log2(2**SHORT_ORDER * SHAPES[0][1] / period_s))
    return tuple(dict.fromkeys((max(order - less, LEAST_ORDER), clock) for less, clock in SLOW_SHAPES))


def short_sequence(order: int, clock: int, amplitude_nm: float, period_s: float, torque_step_nm: float = 0.0) -> Excitation:
    """The short excitation with an amplitude: a run-in, and as many periods as make ``FEWEST_ROWS``.

    Parameters
    ----------
    order : int
        Of the shift register.
    clock : int
        Samples for each bit.
    amplitude_nm : float, N m, motor shaft
        Half of the swing.
    period_s : float, s
        Sampling period.
    torque_step_nm : float, N m
        Resolution of the drive's torque setpoint, 0 for none.
    """
    repeats = max(1, math.ceil(FEWEST_ROWS / ((2**order - 1) * clock)) - 1)
    return prbs(order, clock, 2.0 * amplitude_nm, period_s, repeats, torque_step_nm=torque_step_nm)


def short_seconds(period_s: float) -> float:
    """Usual upper bound of the duration of a short excitation, s.

    Parameters
    ----------
    period_s : float, s
        Sampling period.
    """
    return max(SHORT_S, MOST_OVER_FEWEST * FEWEST_ROWS * period_s + EXCITATION_REST_S)


def held_choice(choice: PrbsChoice) -> PrbsChoice:
    """Another sequence than the fitted ones, one measured period of it, for a record that is held out.

    Parameters
    ----------
    choice : PrbsChoice
        Of the fitted ones.
    """
    return replace(choice, order=SHORT_ORDER, clock=choice.clock + 1, repeats=1, reason="another sequence than the fitted ones")


def calmer_choice(choice: PrbsChoice, resonance_hz: float, period_s: float) -> PrbsChoice:
    """A sequence with little at the resonance, so that the belt bears more torque, and a shorter one, so that it goes no further.

    Parameters
    ----------
    choice : PrbsChoice
        That needs too much of the belt.
    resonance_hz : float, Hz
        Of the belt.
    period_s : float, s
        Sampling period.
    """
    clock = max(choice.clock, round(CALM_ZERO / (resonance_hz * period_s)))
    order = max(6, choice.order - int(np.ceil(np.log2(clock / choice.clock))))
    repeats = int(choice.repeats * (2**choice.order * choice.clock) / (2**order * clock))
    return replace(choice, order=order, clock=clock, repeats=repeats, reason="little at the resonance, because friction needs more torque")
