"""Units as foreign files spell them."""

from __future__ import annotations

import re

from beltcomm.quantities import plain_spelling

#: Spellings of units beside those of :mod:`beltcomm.quantities`: what they are there.
_SPELLINGS = {
    "s": "sec second seconds sek",
    "ms": "msec millis",
    "us": "usec micros",
    "deg": "grad degree degrees °",
    "deg/s": "deg/sec grad/s °/s",
    "rad": "radian radians radiant",
    "rad/s": "rad/sec",
    "rev": "turn turns u umdr revs revolutions",
    "rpm": "u/min upm umin min-1 1/min rev/min r/min tr/min",
    "mm/s": "mm/sec",
    "m": "meter",
    "mm": "millimeter",
    "n": "newton",
    "nm": "n-m n.m newtonmeter newtonmeters newton-meter newton-meters",
    "lbin": "lbfin lb-in lbf-in lb.in in-lb in-lbf inlb inlbs in-lbs",
    "lbft": "lbfft lb-ft lbf-ft lb.ft ft-lb ft-lbf ftlb ftlbs ft-lbs",
    "ozin": "ozfin oz-in ozf-in oz.in in-oz inoz",
    "a": "ampere amperes amp amps arms a_rms aeff a(rms)",
    "°c": "degc celsius",
}
_SPELLED = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings.split()}
COUNTS = ("counts", "count", "cnt", "cts", "inc", "incr", "increments", "inkr", "inkremente", "ticks", "lsb", "pulses", "qc")
PER_CENT = ("%", "percent", "prozent", "%rated")
PER_MILLE = ("‰", "permille", "promille", "0.1%", "permilleofratedtorque", "permilleofratedcurrent")


def plain_unit(text: str) -> str:
    """A unit as :data:`beltcomm.quantities.UNITS` spells it, or as it stands, in small letters without blanks.

    Parameters
    ----------
    text : str
        As the file has it.
    """
    if re.match(r"[\[(]?M(N(?!M)|m\b)", text):  # mega, no milli
        return text
    plain = plain_spelling(text).lower().strip("[]()")
    return _SPELLED.get(plain, plain)
