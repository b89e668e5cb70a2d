"""A payload that swings on the carriage."""

from __future__ import annotations

import math
from collections.abc import Mapping

from beltcomm.effects._effect import AxisSummary, Body, Effect, Element, Parameter, Trial

#: Damping ratio up to which something swings that can be seen as a mode: half way to where nothing swings any more.
SWINGING = 0.5
#: 1/m²; and share by which a spring on trial hardens at the largest acceleration at most: a soft one that swings by centimetres would
#: begin so much stiffer that the fit stays there.
USUAL_HARDENING, STIFFER = 1e3, 0.002


def _force(stretch: float, rate: float, x: float, stiffness: float, damping: float, hardening: float) -> float:
    """Force between carriage and payload:  stiffness stretch (1 + hardening stretch²) + damping rate, N."""
    return stiffness * stretch * (1.0 + hardening * stretch * stretch) + damping * rate


def _slope(x: float, stiffness: float, damping: float, hardening: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m) of small swings."""
    return stiffness, damping


def _trials(ground: AxisSummary) -> list[Trial]:
    """A third of the carriage on springs from 5 Hz to three quarters of the antiresonance and beyond, lightly damped."""
    low, high = 4.0, 1.5 * max(ground.antiresonance_hz, 12.0)
    mass = 0.35 * ground.mass
    found = []
    for i in range(18):
        omega = 2.0 * math.pi * low * (high / low) ** (i / 17.0)
        stretch = ground.peak_force_n / (ground.mass * omega**2)  # by the largest acceleration
        hardening = min(USUAL_HARDENING, STIFFER / stretch**2)
        found.append(Trial({"payload.mass": mass, "stiffness": mass * omega**2, "damping": 0.08 * mass * omega, "hardening": hardening}))
    return found


def implausible(values: Mapping[str, float]) -> str:
    """Sentence on a payload that does not swing at all: a belt that creeps was imitated by such a payload with a damping ratio of 1.8.

    Parameters
    ----------
    values : mapping of str to float
        ``damping``, N s/m, ``stiffness``, N/m, and ``payload.mass``, kg.

    Returns
    -------
    str
        "" for one that swings.
    """
    ratio = values["damping"] / (2.0 * math.sqrt(values["stiffness"] * values["payload.mass"]))
    return f"a payload that creeps back instead of swinging (damping ratio {ratio:.2g})" if ratio > SWINGING else ""


EFFECT = Effect(
    name="payload_mode",
    slot="body",
    title="payload that swings",
    parameters=(
        Parameter("stiffness", "N/m", "cart", 2e4, 1.0, 1e8, "spring between carriage and payload"),
        Parameter("damping", "N s/m", "cart", 10.0, 0.0, 1e5, "damper between carriage and payload"),
        Parameter("hardening", "1/m2", "cart", USUAL_HARDENING, 0.0, 1e7, "how much the spring stiffens with the square of its stretch"),
    ),
    bodies=(
        Body("payload", Parameter("mass", "kg", "cart", 0.5, 1e-3, 1e3, "mass that swings; the carriage keeps the rest"), swings=2e-3),
    ),
    elements=(Element(("cart", "payload"), _force, _slope),),
    trials=_trials,
    unlikely=implausible,
    seen="a second notch and peak in the frequency response; ringing after moves at low frequency",
    causes="soft gripper, mast, liquid",
    check="mounting screws; knock on the payload and listen",
    remedy="stiffen the gripper or mast, tighten its screws, baffles in a tank; else move with less jerk",
    alike={
        "end_pulley": "take the payload off: its mode goes, that of the end pulley stays",
        "coupling": "take the payload off: its mode goes, that of the coupling stays",
    },
    source="(2.25) with one more mass",
)
