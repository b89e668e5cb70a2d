"""Margins of a given cascade on given plants: the proof of a design, and the judgement of foreign gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.control import Cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import (
    SampledPlants,
    closed_loop_poles,
    loop_shape,
    open_velocity_loop,
    position_path,
    sample_plants,
)

#: Grid points per plant of a proof: neighbours 0.7 % apart, the interpolation error of a margin is below 0.01 degrees.
PROOF_POINTS = 1600


@dataclass(frozen=True)
class Margins:
    """Margins of one plant with one cascade, sampled, delayed and filtered as it runs.

    Attributes
    ----------
    stable, velocity_stable : bool
        All poles of the cascade, and of the velocity loop alone, inside the unit circle.
    phase_margin_deg : float
        Smallest over all crossovers of the velocity loop; inf without any.
    crossover_rad_s : float
        Highest; nan.
    gain_margin_db : float
        Smallest gain factor above 1 to a crossing of the negative axis.
    suppression_db : float
        Largest open-loop gain at and above the resonance and at any local peak.
    sensitivity_db : float
        Max |1/(1 + L)|. position_* : the same of the position loop.
    damping : float
        Smallest damping ratio of the poles of the cascade (a resonance that the loop leaves alone counts too).
    """

    plant: str
    stable: bool
    velocity_stable: bool
    phase_margin_deg: float
    crossover_rad_s: float
    gain_margin_db: float
    suppression_db: float
    sensitivity_db: float
    position_phase_margin_deg: float
    position_crossover_rad_s: float
    position_gain_margin_db: float
    position_sensitivity_db: float
    damping: float

    @property
    def least_gain_margin_db(self) -> float:
        """Smaller gain margin of both loops, dB."""
        return min(self.gain_margin_db, self.position_gain_margin_db)

    @property
    def most_sensitivity_db(self) -> float:
        """Larger sensitivity of both loops, dB."""
        return max(self.sensitivity_db, self.position_sensitivity_db)


@dataclass(frozen=True)
class WorstMargins:
    """The least favourable margins of a cascade over all variants; bandwidths of both loops, Hz.

    A bandwidth is the highest of all variants, in motion; at rest the lowest, with the friction of a standstill.
    """

    phase_margin_deg: float
    position_phase_margin_deg: float
    suppression_db: float
    gain_margin_db: float
    sensitivity_db: float
    bandwidth_hz: float
    position_bandwidth_hz: float
    bandwidth_at_rest_hz: float
    position_bandwidth_at_rest_hz: float
    stable: bool


def worst_of(margins: Sequence[Margins]) -> WorstMargins:
    """The least favourable of all variants, margin by margin.

    Parameters
    ----------
    margins : sequence of Margins
        One for each variant of the plant.

    Returns
    -------
    WorstMargins
        A bandwidth is nan where no variant has a crossover.
    """
    found = [[getattr(one, f"{loop}crossover_rad_s") / math.tau for one in margins] for loop in ("", "position_")]
    velocity, position = ([hz for hz in one if math.isfinite(hz)] or [math.nan] for one in found)
    return WorstMargins(
        min(one.phase_margin_deg for one in margins),
        min(one.position_phase_margin_deg for one in margins),
        max(one.suppression_db for one in margins),
        min(one.least_gain_margin_db for one in margins),
        max(one.most_sensitivity_db for one in margins),
        max(velocity),
        max(position),
        min(velocity),
        min(position),
        all(one.stable and one.velocity_stable for one in margins),
    )


def margins(cascade: Cascade, plants: Sequence[DesignPlant], period_s: float) -> tuple[Margins, ...]:
    """Margins of ``cascade`` on every plant.

    Parameters
    ----------
    cascade : Cascade
    plants : sequence of DesignPlant
        Each with its dead time.
    period_s : float, s
        Sampling period of the drive's loops.

    Raises
    ------
    UsageError
        For a prefilter above π/T.
    """
    return margins_on(cascade, sample_plants(plants, period_s, PROOF_POINTS))


def margins_on(cascade: Cascade, sampled: SampledPlants) -> tuple[Margins, ...]:
    """Margins of a cascade on plants that are sampled already, see :func:`margins`.

    Parameters
    ----------
    cascade : Cascade
    sampled : SampledPlants
        With the controller's period.
    """
    shape = loop_shape(sampled, cascade.prefilter, cascade.velocity_filter_s)
    velocity = open_velocity_loop(shape, cascade.kp_nm_s_rad, cascade.ki_nm_rad)
    position = cascade.kpp_1_s * position_path(velocity, shape.estimator)
    peaks = resonance_or_peak(velocity, shape.omega_rad_s, shape.resonance_rad_s)
    result = []
    for k, plant in enumerate(sampled.plants):
        omega = shape.omega_rad_s[k]
        margin, crossover = phase_margin(omega, velocity[k])
        position_margin, position_crossover = phase_margin(omega, position[k])
        velocity_stable, _ = _stability(plant, replace(cascade, kpp_1_s=0.0), sampled.period_s)
        stable, damping = _stability(plant, cascade, sampled.period_s)
        result.append(
            Margins(
                plant.name,
                stable,
                velocity_stable,
                margin,
                crossover,
                gain_margin_db(velocity[k]),
                _db(np.max(np.abs(velocity[k])[peaks[k]], initial=0.0)),
                -_db(np.min(np.abs(1.0 + velocity[k]))),
                position_margin,
                position_crossover,
                gain_margin_db(position[k]),
                -_db(np.min(np.abs(1.0 + position[k]))),
                damping,
            )
        )
    return tuple(result)


def resonance_or_peak(loop: ComplexArray, omega_rad_s: Array, resonance_rad_s: Array) -> BoolArray:
    """Frequencies at which the suppression is asked: at and above the resonance, and at every local peak of the gain.

    Of a resonance beyond what the loop samples, the upper half of that: the highest frequency alone says nothing, the sampling makes a
    zero there.

    Parameters
    ----------
    loop : ndarray, (..., n) complex
        Open velocity loop.
    omega_rad_s, resonance_rad_s : ndarray, (..., n) and (..., 1)
        Frequencies, and the plant's resonance.

    Returns
    -------
    ndarray of bool
        In the shape of ``loop``.
    """
    level, highest = np.abs(loop), omega_rad_s[..., -1:]
    peak = np.zeros(loop.shape, dtype=bool)
    peak[..., 1:-1] = (level[..., 1:-1] > level[..., :-2]) & (level[..., 1:-1] >= level[..., 2:])
    return np.asarray(peak | (omega_rad_s >= np.where(resonance_rad_s > highest, 0.5 * highest, resonance_rad_s)))


def phase_margin(omega_rad_s: Array, loop: ComplexArray) -> tuple[float, float]:
    """Smallest distance of a loop's phase to ±180 deg over all crossovers, and the highest crossover.

    A distance has no sign: that the loop is stable at all is a matter of its poles.

    Parameters
    ----------
    omega_rad_s : ndarray, (n,)
        Ascending.
    loop : ndarray, (n,) complex
        Open loop.

    Returns
    -------
    tuple of float
        deg and rad/s; (inf, nan) without a crossover.
    """
    level = np.log(np.maximum(np.abs(loop), 1e-300))
    at = np.flatnonzero((level[:-1] > 0.0) != (level[1:] > 0.0))
    if not len(at):
        return math.inf, math.nan
    share = level[at] / (level[at] - level[at + 1])
    turn = np.angle(loop[at + 1] / loop[at])
    angle = np.angle(-loop[at]) + share * turn
    distance = np.abs((angle + math.pi) % (2.0 * math.pi) - math.pi)
    crossover = omega_rad_s[at] * (omega_rad_s[at + 1] / omega_rad_s[at]) ** share
    return math.degrees(float(np.min(distance))), float(crossover[-1])


def gain_margin_db(loop: ComplexArray) -> float:
    """Smallest gain factor above 1 that brings a loop to −1.

    Parameters
    ----------
    loop : ndarray, (n,) complex
        Open loop.

    Returns
    -------
    float, dB
        inf when it never crosses the negative real axis.
    """
    left = (loop.real[:-1] < 0.0) & (loop.real[1:] < 0.0)
    at = np.flatnonzero(left & ((loop.imag[:-1] > 0.0) != (loop.imag[1:] > 0.0)))
    share = loop.imag[at] / (loop.imag[at] - loop.imag[at + 1])
    crossing = np.abs(loop.real[at] + share * (loop.real[at + 1] - loop.real[at]))
    return -_db(np.max(crossing[crossing < 1.0], initial=0.0))


def _stability(plant: DesignPlant, cascade: Cascade, period_s: float) -> tuple[bool, float]:
    """True if all poles lie inside the unit circle, and their smallest damping ratio.

    With K_PP = 0 the free angle's pole at 1 is no matter of the velocity loop and is left out.
    """
    poles = closed_loop_poles(plant, cascade, period_s)
    if cascade.kpp_1_s == 0.0:
        poles = np.delete(poles, np.argmin(np.abs(poles - 1.0)))
    exponent = np.log(np.where(np.abs(poles) > 1e-12, poles, 1e-12))
    damping = float(np.min(-exponent.real / np.maximum(np.abs(exponent), 1e-12)))
    return bool(np.max(np.abs(poles)) < 1.0), damping


def _db(ratio: float | np.floating) -> float:
    return 20.0 * math.log10(ratio) if ratio > 0.0 else -math.inf
