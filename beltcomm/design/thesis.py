"""The thesis's controller design as printed: equalities (4.7) to (4.9), (4.13), (4.14) on the continuous plant (2.42).

Kept for comparison with the published numbers; the product's own design is :mod:`beltcomm.design.cascade`.  Two printed
faults are mended: phases are unwrapped (a solver otherwise takes a wrapped phase above the antiresonance for a margin), and the
closed velocity loop (4.10) contains the prefilter that figure 4.6 shows (thesis sheet, errata 12).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import Cascade, Prefilter, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.prefilters import butterworth_cutoff_rad_s, continuous_prefilter, notch_width
from beltcomm.errors import Refused


@dataclass(frozen=True)
class ThesisDesign:
    """Gains that meet (4.7) to (4.9) and (4.13), and the two crossovers ω_c and ω_c,φ, rad/s."""

    cascade: Cascade
    crossover_rad_s: float
    position_crossover_rad_s: float


@dataclass(frozen=True)
class ThesisMargins:
    """Margins of given gains on the continuous plant.

    phase_margin_deg at crossover_rad_s of the velocity loop;

    Attributes
    ----------
    suppression_db : float
        |G_PI G_ω| at ω_r (4.7); position_phase_margin_deg at position_crossover_rad_s.
    """

    phase_margin_deg: float
    crossover_rad_s: float
    suppression_db: float
    position_phase_margin_deg: float
    position_crossover_rad_s: float


def thesis_design(
    plant: DesignPlant,
    kind: PrefilterKind | Prefilter,
    velocity_filter_s: float = 0.002,
    phase_margin_deg: float = 60.0,
    suppression_db: float = -10.0,
    position_phase_margin_deg: float = 80.0,
) -> ThesisDesign:
    """Solve (4.7) to (4.9) for K_P, K_I, ω_c and (4.13), (4.14) for K_PP.

    Of several solutions the one with the largest K_I K_PP.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    kind : PrefilterKind or Prefilter
        Of the prefilter, laid out by −6 dB (notch) or −3 dB (Butterworth) at the antiresonance; or a prefilter as it is.
    velocity_filter_s : float, s
        T_R.
    phase_margin_deg : float, deg
        Of the velocity loop.
    suppression_db : float, dB
        Of the open velocity loop at the resonance.
    position_phase_margin_deg : float, deg
        Of the position loop.

    Raises
    ------
    Refused
        When none exists, with the reason.
    """
    prefilter = kind if isinstance(kind, Prefilter) else thesis_prefilter(plant, kind)
    omega = np.geomspace(0.02 * plant.antiresonance_rad_s, plant.antiresonance_rad_s, 4000)
    excess = _pi_lag(plant, prefilter, velocity_filter_s, phase_margin_deg, omega)
    # Beyond the first frequency where nothing is left for the integrator, a margin could only come from a wrapped phase.
    ends = np.flatnonzero(excess <= 0.0)
    before_end = np.arange(len(omega)) < (ends[0] if len(ends) else len(omega))
    grid = omega[before_end & (excess < 0.5 * math.pi)]
    if not len(grid):
        raise Refused(f"no crossover below the antiresonance leaves a phase margin of {phase_margin_deg:g} deg; ask for less")

    resonance = plant.resonance_rad_s
    peak = float(abs(_loop_without_pi(plant, prefilter, velocity_filter_s, np.array([resonance]))[0]))

    def levels(crossovers: Array) -> Array:
        kp, ki = _pi_for_crossover(plant, prefilter, velocity_filter_s, phase_margin_deg, crossovers)
        return np.asarray(20.0 * np.log10(np.hypot(kp, ki / resonance) * peak) - suppression_db)

    def suppression(crossover: float) -> float:
        return float(levels(np.array([crossover]))[0])

    level = levels(grid)
    signs = np.flatnonzero(np.diff(np.sign(level)) != 0.0)
    if not len(signs):
        behind = "without a prefilter" if prefilter.kind == "none" else f"behind the {prefilter.kind} prefilter"
        raise Refused(
            f"no PI controller {behind} meets {suppression_db:g} dB at the resonance exactly: at "
            f"{grid[-1]:.3g} rad/s, where the phase margin of {phase_margin_deg:g} deg leaves nothing for the integrator, the "
            f"resonance lies at {level[-1] + suppression_db:.1f} dB; ask for an inequality (beltcomm design) or less margin"
        )
    designs = []
    for k in signs:
        crossover = brentq(suppression, grid[k], grid[k + 1], xtol=1e-12 * grid[k], rtol=1e-14)
        pair = _pi_for_crossover(plant, prefilter, velocity_filter_s, phase_margin_deg, np.array([crossover]))
        kp, ki = float(pair[0][0]), float(pair[1][0])
        kpp, position_crossover = _position_gain(plant, prefilter, velocity_filter_s, kp, ki, position_phase_margin_deg)
        designs.append(ThesisDesign(Cascade(kp, ki, kpp, velocity_filter_s, prefilter), crossover, position_crossover))
    return max(designs, key=lambda design: design.cascade.ki_nm_rad * design.cascade.kpp_1_s)


def thesis_prefilter(plant: DesignPlant, kind: PrefilterKind) -> Prefilter:
    """Prefilter with the thesis's attenuation at the antiresonance: −6 dB (notch), −3 dB (Butterworth).

    Parameters
    ----------
    plant : DesignPlant
        With resonance and antiresonance.
    kind : PrefilterKind
        "none", "butterworth" or "notch".

    Returns
    -------
    Prefilter
        The notch stands on the resonance.
    """
    if kind == "notch":
        width = notch_width(plant.resonance_rad_s, plant.antiresonance_rad_s, -6.0)
        return Prefilter("notch", plant.resonance_rad_s, width)
    if kind == "butterworth":
        return Prefilter("butterworth", butterworth_cutoff_rad_s(plant.antiresonance_rad_s, -3.0))
    return Prefilter()


def thesis_margins(plant: DesignPlant, cascade: Cascade) -> ThesisMargins:
    """Margins of given gains on (2.42) with dead time and (6.1): the check of tables A.6 and A.7.

    The first crossover counts.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
        Gains, prefilter and T_R.

    Returns
    -------
    ThesisMargins
        deg, rad/s and dB.

    Raises
    ------
    Refused
        When a loop has none between 0.1 rad/s and the resonance.
    """
    at = np.array([plant.resonance_rad_s])
    margin, crossover = _first_margin(lambda omega: velocity_loop(plant, cascade, omega), plant.resonance_rad_s)
    position_margin, position_crossover = _first_margin(lambda omega: position_loop(plant, cascade, omega), plant.resonance_rad_s)
    suppression_db = 20.0 * math.log10(abs(velocity_loop(plant, cascade, at)[0]))
    return ThesisMargins(margin, crossover, suppression_db, position_margin, position_crossover)


def velocity_loop(plant: DesignPlant, cascade: Cascade, omega_rad_s: Array) -> ComplexArray:
    """Open velocity loop G_PI G_ω of figure 4.5, s = jω.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
    omega_rad_s : ndarray (n,), rad/s
        Above 0.

    References
    ----------
    (4.5), (4.6).
    """
    return _velocity_loop(plant, cascade.prefilter, cascade.velocity_filter_s, cascade.kp_nm_s_rad, cascade.ki_nm_rad, omega_rad_s)


def position_loop(plant: DesignPlant, cascade: Cascade, omega_rad_s: Array) -> ComplexArray:
    """Open position loop K_PP G_ω,cl of figure 4.7, s = jω.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    cascade : Cascade
        Gains, prefilter and T_R.
    omega_rad_s : ndarray
        Above 0.

    Returns
    -------
    ndarray of complex
        In the shape of ``omega_rad_s``.

    References
    ----------
    Thesis (4.10), (4.11).
    """
    closed = _closed_velocity_loop(plant, cascade.prefilter, cascade.velocity_filter_s, cascade.kp_nm_s_rad, cascade.ki_nm_rad, omega_rad_s)
    return np.asarray(cascade.kpp_1_s * closed)


def _loop_without_pi(plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, omega: Array) -> ComplexArray:
    """G_ω of (4.5)."""
    estimator = 1j * omega / (1j * omega * velocity_filter_s + 1.0)
    return np.asarray(continuous_prefilter(omega, prefilter) * plant.continuous_response(omega) * estimator)


def _velocity_loop(plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, kp: float, ki: float, omega: Array) -> ComplexArray:
    return np.asarray((kp + ki / (1j * omega)) * _loop_without_pi(plant, prefilter, velocity_filter_s, omega))


def _closed_velocity_loop(
    plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, kp: float, ki: float, omega: Array
) -> ComplexArray:
    """G_ω,cl of (4.10) with the prefilter in it: from velocity error setpoint to motor angle, s."""
    loop = _velocity_loop(plant, prefilter, velocity_filter_s, kp, ki, omega)
    return np.asarray(loop / (1.0 + loop) * (1j * omega * velocity_filter_s + 1.0) / (1j * omega))


def _pi_lag(plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, margin_deg: float, omega: Array) -> Array:
    """Phase, rad, that the margin leaves for the integrator: atan(K_I/(K_P ω)) of (4.9)."""
    phase = np.unwrap(np.angle(_loop_without_pi(plant, prefilter, velocity_filter_s, omega)))
    return np.asarray(phase + math.pi - math.radians(margin_deg))


def _pi_for_crossover(
    plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, margin_deg: float, crossover: Array
) -> tuple[Array, Array]:
    """K_P, K_I of (4.8), (4.9) at given crossovers below the antiresonance, where the principal phase is the unwrapped one; (n,) each."""
    without = _loop_without_pi(plant, prefilter, velocity_filter_s, crossover)
    lag = np.angle(without) + math.pi - math.radians(margin_deg)
    return np.asarray(np.cos(lag) / np.abs(without)), np.asarray(np.sin(lag) / np.abs(without) * crossover)


def _position_gain(
    plant: DesignPlant, prefilter: Prefilter, velocity_filter_s: float, kp: float, ki: float, margin_deg: float
) -> tuple[float, float]:
    """K_PP (4.14) and ω_c,φ: the first frequency at which the unwrapped phase of (4.10) comes down to −π + margin (4.13)."""
    omega = np.geomspace(0.1, plant.resonance_rad_s, 20000)
    closed = _closed_velocity_loop(plant, prefilter, velocity_filter_s, kp, ki, omega)
    room = np.unwrap(np.angle(closed)) + math.pi - math.radians(margin_deg)
    below = np.flatnonzero(room < 0.0)
    if not len(below) or below[0] == 0:
        raise Refused(f"the position loop has no frequency with a phase margin of exactly {margin_deg:g} deg; ask for another")
    k = int(below[0])
    start, base = omega[k - 1], closed[k - 1]

    def room_at(frequency: float) -> float:
        here = _closed_velocity_loop(plant, prefilter, velocity_filter_s, kp, ki, np.array([frequency]))[0]
        return float(room[k - 1] + np.angle(here / base))

    crossover = float(brentq(room_at, start, omega[k], xtol=1e-12 * start, rtol=1e-14))
    at = np.array([crossover])
    return 1.0 / float(abs(_closed_velocity_loop(plant, prefilter, velocity_filter_s, kp, ki, at)[0])), crossover


def _first_margin(loop: Callable[[Array], ComplexArray], highest: float) -> tuple[float, float]:
    """Phase margin, deg, and frequency, rad/s, of the first crossover from above to below 1, between 0.1 rad/s and ``highest``."""
    omega = np.geomspace(0.1, highest, 20000)
    response = loop(omega)
    level = np.log(np.maximum(np.abs(response), 1e-300))
    falls = np.flatnonzero((level[:-1] > 0.0) & (level[1:] <= 0.0))
    if not len(falls):
        raise Refused(f"the loop gain does not fall through 1 between {omega[0]:.3g} and {omega[-1]:.3g} rad/s")
    k = int(falls[0])

    def level_at(frequency: float) -> float:
        return math.log(abs(loop(np.array([frequency]))[0]))

    crossover = float(brentq(level_at, omega[k], omega[k + 1], xtol=1e-12 * omega[k], rtol=1e-14))
    phase = float(np.unwrap(np.angle(response[: k + 1]))[k] + np.angle(loop(np.array([crossover]))[0] / response[k]))
    return math.degrees(phase + math.pi), crossover
