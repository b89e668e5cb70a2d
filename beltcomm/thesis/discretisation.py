"""The discrete cascade against the continuous design it stands for: parts at crossover and resonance, and the margins of the loops.

Plant G_A and the solutions of (4.7) to (4.9), (4.13) on it; T = 0.4 ms, 1 ms and 6.4 ms.

The deviations have bounds in closed form.  With θ = ωT and s = jω, for 0 < θ < π:

- velocity filter (6.1) by backward differences: s becomes σ = (1 − z⁻¹)/T, and with Re σ ≥ 0
  |G_d/G_c − 1| = |σ/s − 1|/|1 + σ T_R| ≤ θ/2;
- PI with the forward-Euler integrator (6.25):  PI_d − PI_c = K_I T (−1/2 + j (1/θ − cot(θ/2)/2)), whose second term lies below θ/π²;
- prefilter, prewarped bilinear transform: G_d(ω) = G_c(ω'),  ω' = ω_0 tan(θ/2)/tan(ω_0 T/2), hence |ln(G_d/G_c)| ≤ Λ |ln(ω'/ω)| with
  Λ the largest |d ln G_c/d ln ω| between ω and ω', in closed form by :func:`_steepest`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import Cascade, Prefilter, pi_response, prefilter_response, velocity_filter_response
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.margins import Margins, margins
from beltcomm.design.prefilters import continuous_prefilter
from beltcomm.design.thesis import ThesisDesign, ThesisMargins, thesis_design, thesis_margins
from beltcomm.errors import UsageError
from beltcomm.thesis.designs import VELOCITY_FILTER_S, thesis_plants

#: T, s: a fast drive, the product's own, and the slowest position loop of a common drive.
PERIODS_S = (0.4e-3, 1e-3, 6.4e-3)
PARTS = ("velocity filter", "PI", "prefilter")


@dataclass(frozen=True)
class DiscretisationError:
    """Discrete over continuous at one frequency.   ``error`` |G_d/G_c − 1| never exceeds ``bound``; nan where the loop cannot have it."""

    part: str
    period_s: float
    where: str
    omega_rad_s: float
    gain_db: float
    phase_deg: float
    error: float
    bound: float


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one design in loops of T.

    Attributes
    ----------
    sampled : Margins or None
        None with the reason in ``refusal`` where the prefilter does not fit.
    expected_deg : float
        Phase that the parts and the hold of T/2 take at the continuous crossover, to be lost from the velocity margin.
    """

    prefilter: str
    period_s: float
    continuous: ThesisMargins
    sampled: Margins | None
    expected_deg: float
    refusal: str = ""


@dataclass(frozen=True)
class Discretisation:
    """Everything the topic compares."""

    plant: DesignPlant
    notch: ThesisDesign
    butterworth: ThesisDesign
    differences: tuple[DiscretisationError, ...]
    loops: tuple[LoopMargins, ...]


def compare() -> Discretisation:
    """Differences of the parts of both designs, and what they cost in margin."""
    plant = thesis_plants()[0]
    found = {kind: thesis_design(plant, kind, VELOCITY_FILTER_S) for kind in ("notch", "butterworth")}
    differences = [row for design in found.values() for period in PERIODS_S for row in differences_of(plant, design, period)]
    loops = [loop_margins(plant, design, period) for design in found.values() for period in PERIODS_S]
    return Discretisation(plant, found["notch"], found["butterworth"], tuple(differences), tuple(loops))


def ratio(part: str, cascade: Cascade, omega_rad_s: Array, period_s: float) -> tuple[ComplexArray, Array]:
    """G_d/G_c of a part at frequencies (n,), rad/s, and the bound of its distance from 1; (n,) each.

    Parameters
    ----------
    part : str
        Of ``PARTS``.
    cascade : Cascade
    omega_rad_s : ndarray (n,), rad/s
        Above 0.
    period_s : float, s
        T of the controller.

    Raises
    ------
    UsageError
        For a frequency, or a prefilter, at or beyond π/T.
    """
    s = 1j * omega_rad_s
    if part == "velocity filter":
        lag = cascade.velocity_filter_s
        bound = _velocity_filter_bound(omega_rad_s, period_s)
        return np.asarray(velocity_filter_response(omega_rad_s, lag, period_s) * (1.0 + s * lag) / s), bound
    if part == "PI":
        kp, ki = cascade.kp_nm_s_rad, cascade.ki_nm_rad
        return np.asarray(pi_response(omega_rad_s, kp, ki, period_s) / (kp + ki / s)), _pi_bound(omega_rad_s, kp, ki, period_s)
    bound = _prefilter_bound(omega_rad_s, cascade.prefilter, period_s)
    discrete = prefilter_response(omega_rad_s, cascade.prefilter, period_s)
    return np.asarray(discrete / continuous_prefilter(omega_rad_s, cascade.prefilter)), bound


def differences_of(plant: DesignPlant, design: ThesisDesign, period_s: float) -> Iterator[DiscretisationError]:
    """Difference of each discrete part of a design from the continuous one, at the crossover and at the resonance.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    design : ThesisDesign
        Continuous.
    period_s : float, s
        T of the controller.
    """
    kind = design.cascade.prefilter.kind
    for part in PARTS:
        name = f"{kind} filter" if part == "prefilter" else f"{part}, {kind} design"
        for where, omega in (("crossover", design.crossover_rad_s), ("resonance", plant.resonance_rad_s)):
            try:
                values, bounds = ratio(part, design.cascade, np.array([omega]), period_s)
            except UsageError:
                yield DiscretisationError(name, period_s, where, omega, math.nan, math.nan, math.nan, math.nan)
                continue
            value = complex(values[0])
            gain_db, phase_deg = 20.0 * math.log10(abs(value)), math.degrees(math.atan2(value.imag, value.real))
            yield DiscretisationError(name, period_s, where, omega, gain_db, phase_deg, abs(value - 1.0), float(bounds[0]))


def loop_margins(plant: DesignPlant, design: ThesisDesign, period_s: float) -> LoopMargins:
    """Margins of a design in a loop of T, beside those of the continuous one.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    design : ThesisDesign
        Continuous.
    period_s : float, s
        T of the controller.
    """
    cascade, kind = design.cascade, design.cascade.prefilter.kind
    continuous = thesis_margins(plant, cascade)
    try:
        (sampled,) = margins(cascade, [plant], period_s)
        at = np.array([design.crossover_rad_s])
        phase = sum(float(np.angle(ratio(part, cascade, at, period_s)[0][0])) for part in PARTS)
    except UsageError as error:
        return LoopMargins(kind, period_s, continuous, None, math.nan, str(error))
    return LoopMargins(kind, period_s, continuous, sampled, math.degrees(0.5 * design.crossover_rad_s * period_s - phase))


def lines(study: Discretisation) -> list[str]:
    """The tables, with what they mean."""
    text = difference_lines("G_A", study.plant, study.differences)
    text += [
        "  The velocity filter lags by T/2 at low frequencies, so T_R + T/2 in all; the PI lags by K_I T/2 over its gain;",
        "  prewarping makes the prefilter exact at its own frequency w_0; far below, it stands about (w_0 T)^2/12 too high on the axis.",
        "",
        *loop_lines(study.loops),
    ]
    folded = abs(2.0 * math.pi / PERIODS_S[-1] - study.plant.resonance_rad_s) / (2.0 * math.pi)
    text += [
        "  Expected is the phase of the three parts and of the hold at the continuous crossover.",
        "  Suppression differs even for short T: the sampled loop has the plant (2.38), whose resonance on G_A is 2.1 dB above (2.42)'s;",
        f"  in a loop of {1e3 * PERIODS_S[-1]:g} ms it appears folded, at {folded:.0f} Hz.",
    ]
    return text


def difference_lines(name: str, plant: DesignPlant, differences: Sequence[DiscretisationError]) -> list[str]:
    """Differences of the parts as a table.

    Parameters
    ----------
    name : str
        Of the design, for the title.
    plant : DesignPlant
        With its dead time.
    differences : sequence of DiscretisationError
        In their order.
    """
    resonance = f"{plant.resonance_rad_s / math.tau:.1f} Hz"
    text = [f"Discrete over continuous, at the crossover and at the resonance ({resonance}) of {name}; error |G_d/G_c - 1| and its bound:"]
    text.append(f"  {'':36} {'T':>7} {'at':10} {'gain':>10} {'phase':>11} {'error':>9} {'bound':>9}")
    for d in differences:
        head = f"  {d.part:36} {1e3 * d.period_s:4.1f} ms {d.where:10}"
        if math.isnan(d.error):
            text.append(f"{head} not in a loop that slow: pi/T is {math.pi / d.period_s:.0f} rad/s")
        else:
            text.append(f"{head} {d.gain_db:+7.3f} dB {d.phase_deg:+7.2f} deg {d.error:9.5f} {d.bound:9.5f}")
    return text


def loop_lines(loops: Sequence[LoopMargins]) -> list[str]:
    """Margins of the loops as a table.

    Parameters
    ----------
    loops : sequence of LoopMargins
        In their order.
    """
    text = [
        "What that costs: margins of the continuous loop, and of the sampled loop with its hold (design and drive use this one):",
        f"  {'':12} {'T':>7} {'velocity':>18} {'lost':>9} {'expected':>9} {'position':>18} {'suppression':>22}",
    ]
    for row in loops:
        head = f"  {row.prefilter:12} {1e3 * row.period_s:4.1f} ms"
        if row.sampled is None:
            text.append(f"{head} {row.refusal}")
            continue
        c, s = row.continuous, row.sampled
        verdict = "" if s.stable and s.velocity_stable else "  UNSTABLE"
        text.append(
            f"{head} {c.phase_margin_deg:6.1f} -> {s.phase_margin_deg:5.1f} deg {c.phase_margin_deg - s.phase_margin_deg:5.1f} deg "
            f"{row.expected_deg:5.1f} deg {c.position_phase_margin_deg:6.1f} -> {s.position_phase_margin_deg:5.1f} deg "
            f"{c.suppression_db:7.1f} -> {s.suppression_db:6.1f} dB{verdict}"
        )
    return text


def _velocity_filter_bound(omega_rad_s: Array, period_s: float) -> Array:
    """Bound of |G_d/G_c − 1| of the velocity filter, for any T_R: ωT/2, (n,), up to π/T."""
    return np.asarray(0.5 * _theta(omega_rad_s, period_s))


def _pi_bound(omega_rad_s: Array, kp_nm_s_rad: float, ki_nm_rad: float, period_s: float) -> Array:
    """Bound of |PI_d/PI_c − 1|:  K_I T √(1/4 + (θ/π²)²)/√(K_P² + K_I²/ω²), (n,), up to π/T."""
    theta = _theta(omega_rad_s, period_s)
    difference = ki_nm_rad * period_s * np.hypot(0.5, theta / math.pi**2)
    return np.asarray(difference / np.hypot(kp_nm_s_rad, ki_nm_rad / omega_rad_s))


def _prefilter_bound(omega_rad_s: Array, prefilter: Prefilter, period_s: float) -> Array:
    """Bound of |G_d/G_c − 1| of a prefilter:  exp(Λ |ln(ω'/ω)|) − 1, (n,); 0 at its own frequency, UsageError for one beyond π/T."""
    if prefilter.roll_off_rad_s > 0.0:
        parts = (replace(prefilter, roll_off_rad_s=0.0), Prefilter("butterworth", prefilter.roll_off_rad_s))
        return np.asarray(np.prod([1.0 + _prefilter_bound(omega_rad_s, part, period_s) for part in parts], axis=0) - 1.0)
    if prefilter.kind == "none":
        return np.zeros_like(omega_rad_s)
    moved = _warped_frequency(omega_rad_s, prefilter, period_s)
    slope = _steepest(prefilter, np.minimum(omega_rad_s, moved), np.maximum(omega_rad_s, moved))
    return np.asarray(np.expm1(slope * np.abs(np.log(moved / omega_rad_s))))


def _warped_frequency(omega_rad_s: Array, prefilter: Prefilter, period_s: float) -> Array:
    """ω', where the continuous prefilter has the value that the discrete one has at ω, rad/s."""
    omega_0 = prefilter.omega_rad_s
    _theta(np.array([omega_0]), period_s)
    return np.asarray(omega_0 * np.tan(0.5 * _theta(omega_rad_s, period_s)) / math.tan(0.5 * omega_0 * period_s))


def _steepest(prefilter: Prefilter, low_rad_s: Array, high_rad_s: Array) -> Array:
    """Λ: bound of |d ln G_c/d ln ω| between two frequencies each, (n,), rad/s; (n,).

    With y = (ω/ω_0)² its square is, for (4.3), (2y + 4y²)/(1 + y²), which rises up to y = 2 + √5 and falls from there.   For (4.1)
    numerator (ε = 1/d_n²) and denominator (ε = d_n²) count apart, each with the square (4y² + 4εy)/((1 − y)² + 4εy), which rises up to
    y = (1 + √((1 − ε)(1 + 3ε)))/(2 − 3ε) for ε < 2/3, and for ever otherwise.   The largest value is at that y, or at the nearer end.
    """
    low, high = (np.square(omega / prefilter.omega_rad_s) for omega in (low_rad_s, high_rad_s))
    if prefilter.kind == "butterworth":
        y = np.clip(2.0 + math.sqrt(5.0), low, high)
        return np.asarray(np.sqrt((2.0 * y + 4.0 * y * y) / (1.0 + y * y)))
    return _steepest_quadratic(prefilter.d_n**-2, low, high) + _steepest_quadratic(prefilter.d_n**2, low, high)


def _steepest_quadratic(epsilon: float, low: Array, high: Array) -> Array:
    top = math.inf
    if epsilon < 2.0 / 3.0:
        top = (1.0 + math.sqrt((1.0 - epsilon) * (1.0 + 3.0 * epsilon))) / (2.0 - 3.0 * epsilon)
    y = np.clip(top, low, high)
    return np.asarray(np.sqrt((4.0 * y * y + 4.0 * epsilon * y) / ((1.0 - y) ** 2 + 4.0 * epsilon * y)))


def _theta(omega_rad_s: Array, period_s: float) -> Array:
    theta = np.asarray(omega_rad_s * period_s)
    if not np.all((theta > 0.0) & (theta < math.pi)):
        raise UsageError(
            f"a loop of {period_s:g} s knows frequencies above 0 and below {math.pi / period_s:.6g} rad/s only; choose one there"
        )
    return theta
