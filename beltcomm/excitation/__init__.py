"""Torque signals that make an axis show its frequency response.   One file per kind; all torques at the motor shaft."""

from beltcomm.excitation.asked import AS_CHOSEN, AskedExcitation
from beltcomm.excitation.binary import MAXIMAL_TAPS, SHORT_ORDER, PrbsChoice, choose_prbs, gprbs, prbs, prbs_band, prbs_bits
from beltcomm.excitation.choice import Choice, choose
from beltcomm.excitation.record import Excitation, visible_band
from beltcomm.excitation.sines import detection_lines, multisine
from beltcomm.excitation.sweep import chirp

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
    "detection_lines",
    "gprbs",
    "multisine",
    "prbs",
    "prbs_band",
    "prbs_bits",
    "visible_band",
]
