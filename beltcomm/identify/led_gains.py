"""Gains as they really are in a drive, from one move with a led reference: small steps at standstill tell them to a few percent only.

    τ = K_P [K_PP (ε + ∫ε dt/T_N) - (ω + ∫ω dt/T_N)] + c,      ε = r - φ,   T_N = K_P/K_I as documented

is linear in K_P K_PP, K_P and c.  It is evaluated at every run of the loop, between the rows along a smooth path, and held against the
torque that the loop asked for last before each row was taken: rows that are far apart know nothing of what the loop did meanwhile.  A led
reference makes ε and ω large and the law tell them apart to a thousandth; an error of a percent in either is a millimetre of such a move.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Half interval, relative, above which a move tells nothing of the gains; and how far they may be off what was measured before.
KNOWN_TO, BELIEVED = 0.02, 0.2
FEWEST_ROWS = 8


@dataclass(frozen=True)
class GainFactors:
    """Gains in the drive over what they are taken for.

    Attributes
    ----------
    kp, kpp : float
        Of K_P (and K_I, which goes with it) and of K_PP.
    kp_interval, kpp_interval : float
        95 %, of the factors.
    """

    kp: float
    kpp: float
    kp_interval: float
    kpp_interval: float

    def of(self, cascade: Cascade) -> Cascade:
        """A controller as it really is in the drive."""
        return replace(
            cascade,
            kp_nm_s_rad=self.kp * cascade.kp_nm_s_rad,
            ki_nm_rad=self.kp * cascade.ki_nm_rad,
            kpp_1_s=self.kpp * cascade.kpp_1_s,
        )

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)


def gain_factors(
    recording: Recording, lead_rad: Array, cascade: Cascade, structure: CascadeStructure, delay_s: float, unsure: float = 0.0
) -> GainFactors | None:
    """The factors by a record; None where it does not tell them.

    Parameters
    ----------
    recording : Recording
        Of a move in the drive's position loop, whose reference is where the axis was to be.
    lead_rad : ndarray (n,), rad, motor shaft
        By which the reference in the loop was ahead of that, at the samples of the record from its first on.
    cascade : Cascade
        That the drive is taken to run.
    structure : CascadeStructure
    delay_s : float, s
        Torque setpoint to acting torque.
    unsure : float
        Relative half interval of what the gains are taken for.

    Returns
    -------
    GainFactors or None
    """
    if recording.reference_position is None or cascade.ki_nm_rad <= 0.0:
        return None
    period, loop_s, filter_s = recording.sample_period_s, min(structure.period_s, recording.sample_period_s), cascade.velocity_filter_s
    at = np.rint((recording.t_s - recording.t_s[0]) / period)  # rows may have been lost
    if len(lead_rad) <= at[-1] or len(at) < FEWEST_ROWS:
        return None
    every = np.arange(at[-1] + 1.0)
    asked_rad = np.interp(every, at, recording.reference_position) + lead_rad[: len(every)]
    loops = np.arange(0.0, every[-1] + 0.5 * loop_s / period, loop_s / period)
    position = CubicSpline(at, recording.position)(loops) if loop_s < period else np.interp(loops, at, recording.position)
    off = np.interp(loops, every, asked_rad) - position
    off = np.sign(off) * np.maximum(np.abs(off) - structure.dead_zone_rad, 0.0)
    speed = filtered_speed(position, loop_s, filter_s)
    reset_s = cascade.kp_nm_s_rad / cascade.ki_nm_rad
    terms = [one + loop_s * (np.cumsum(one) - one) / reset_s for one in (off, speed)]
    # a row tells the torque in the last run of the loop before the next
    seen = every + 1.0 - (delay_s + 0.5 * loop_s) / period
    inside = (seen >= 0.0) & (seen <= loops[-1])
    asked, answered = (np.interp(seen[inside], loops, one) for one in terms)
    torque = np.interp(every, at, recording.torque)[inside]
    law = np.stack([asked, -answered, np.ones(len(asked))], axis=1)
    solved = np.linalg.lstsq(law, torque, rcond=None)[0]
    both, kp = float(solved[0]), float(solved[1])
    rest = torque - law @ solved
    spread = np.linalg.pinv(law.T @ law) * float(rest @ rest) / max(len(law) - 3, 1)
    if not (kp > 0.0 and both > 0.0):
        return None
    kpp = both / kp
    gradient = np.array([1.0 / kp, -both / kp**2, 0.0])
    found = GainFactors(
        float(kp / cascade.kp_nm_s_rad),
        float(kpp / cascade.kpp_1_s),
        float(NORMAL_95 * math.sqrt(spread[1, 1]) / cascade.kp_nm_s_rad),
        float(NORMAL_95 * math.sqrt(gradient @ spread @ gradient) / cascade.kpp_1_s),
    )
    known = max(found.kp_interval, found.kpp_interval) < KNOWN_TO
    return found if known and max(abs(found.kp - 1.0), abs(found.kpp - 1.0)) < BELIEVED + unsure else None


def filtered_speed(position: Array, loop_s: float, filter_s: float) -> Array:
    """Speed as a drive measures it from its position (6.1): the difference of each run of the loop behind a first-order lag, from rest.

    Parameters
    ----------
    position : ndarray (n,), rad
        In every run of the loop.
    loop_s, filter_s : float, s
        Period of the loop, time constant of the lag.

    Returns
    -------
    ndarray (n,), rad/s
    """
    speed, before = np.empty(len(position)), 0.0
    for k, step in enumerate(np.diff(position, prepend=position[0])):
        speed[k] = before = (filter_s * before + step) / (filter_s + loop_s)
    return speed
