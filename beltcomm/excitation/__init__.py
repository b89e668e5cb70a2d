"""Torque signals that make an axis show its frequency response.   One file per kind; all torques at the motor shaft."""

from beltcomm.excitation.binary import MAXIMAL_TAPS, SHORT_ORDER, PrbsChoice, choose_prbs, gprbs, prbs, prbs_bits
from beltcomm.excitation.choice import AS_CHOSEN, AskedExcitation, Choice, choose
from beltcomm.excitation.record import Excitation, visible_band
from beltcomm.excitation.sines import chirp, multisine

__all__ = [
    "AS_CHOSEN",
    "MAXIMAL_TAPS",
    "SHORT_ORDER",
    "AskedExcitation",
    "Choice",
    "Excitation",
    "PrbsChoice",
    "chirp",
    "choose",
    "choose_prbs",
    "gprbs",
    "multisine",
    "prbs",
    "prbs_bits",
    "visible_band",
]
