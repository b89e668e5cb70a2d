"""Which pseudorandom sequence an excitation is: the short ones, one to judge with, and one that spares the resonance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beltcomm.excitation import SHORT_ORDER, PrbsChoice

#: The short excitation: orders and clocks that are tried until the limits allow more than the breakaway torque; a slower clock leaves
#: out the frequencies of a stiff belt, a shorter sequence goes less far.
SHAPES = ((SHORT_ORDER, 2), (SHORT_ORDER, 3), (SHORT_ORDER, 4), (7, 6))
#: An excitation that cannot be louder than this times the friction hardly moves the carriage.
HARDLY = 1.3
#: Resonance over the first zero of a sequence that spares it.
CALM_ZERO = 0.7


def held_choice(choice: PrbsChoice) -> PrbsChoice:
    """Another sequence than the fitted ones, one measured period of it."""
    return replace(choice, order=SHORT_ORDER, clock=choice.clock + 1, repeats=1, reason="another sequence than the fitted ones")


def calmer_choice(choice: PrbsChoice, resonance_hz: float, period_s: float) -> PrbsChoice:
    """A sequence with little at the resonance, so that the belt bears more torque, and a shorter one, so that it goes no further."""
    clock = max(choice.clock, round(CALM_ZERO / (resonance_hz * period_s)))
    order = max(6, choice.order - int(np.ceil(np.log2(clock / choice.clock))))
    repeats = int(choice.repeats * (2**choice.order * choice.clock) / (2**order * clock))
    return replace(choice, order=order, clock=clock, repeats=repeats, reason="little at the resonance, because friction needs more torque")
