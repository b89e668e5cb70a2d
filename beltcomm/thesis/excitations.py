"""Excitations side by side on one axis, each as loud as the limits allow and as long as the others (3.1)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array, rms
from beltcomm.excitation import Excitation, choose, choose_prbs
from beltcomm.fit.model_fit import fit_model
from beltcomm.given import EXCITATION_KINDS, ExcitationKind
from beltcomm.identify.amplitude import AmplitudeStep, MotionLimits, largest_amplitude
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import modes, operating_point, sampled_response
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.response import estimate_response
from beltcomm.response.distortion import distortion
from beltcomm.simulate.forward import simulate_torque

PLANTS = ("g_a", "g_b")
PERIOD_S, SECONDS, PLACE_M = 1e-3, 7.0, 0.25
COUNTS, NOISE_NM = 65536, 6e-3
#: What an excitation may use: travel m, speed m/s, motor torque N m, force in the belt N (90 % of the rig's 100 N).
LIMITS = MotionLimits(0.03, 0.5, 3.1, 90.0)
#: Seeds of the noise; each begins a little further on, so that the encoder rounds otherwise.
SEEDS = (1, 2, 3, 4, 5, 6)
FURTHER_M = 0.37e-6
#: What the fit begins with, as factors of the truth: what data sheets are wrong by.
BEGIN = {"cart.mass": 1.2, "belt_stiffness.stiffness": 0.85, "belt_damping.damping": 1.5, "viscous.damping": 1.5, "coulomb.level": 0.8}
MEANT: Mapping[str, str] = {"cart.mass": "mass", "belt_stiffness.stiffness": "stiffness", "motor.inertia": "inertia"}
#: Band over which responses are compared, over antiresonance and resonance.
BAND = (0.5, 1.2)
#: Orders and clocks of figures 3.1 and 3.2, at the sampling of the source.
SEQUENCES, SOURCE_PERIOD_S = ((7, 128), (7, 64), (9, 64)), 62.5e-6


@dataclass(frozen=True)
class ExcitedAxis:
    """An axis on which the signals are compared, by default as the source's: place m, what a signal may use, counts, seeds of noise."""

    name: str
    model: Model
    place_m: float = PLACE_M
    limits: MotionLimits = LIMITS
    counts: int = COUNTS
    seeds: tuple[int, ...] = ()


@dataclass(frozen=True)
class ExcitationRow:
    """One excitation on one axis.

    Attributes
    ----------
    amplitude_nm : float
        Largest torque that keeps the limits; ``binds`` the limit met.
    seconds : float
        Whole record. travel_m, belt_force_n : caused.
    line_hz : float
        Distance of the lines.
    half_power_hz : float
        Up to where lines have half the power of the strongest octave.
    response_error : float
        Median over the lines of the band of |Ĝ - G|/|G|, G of the moving axis, first seed.
    noise : float
        The same of its standard deviation as estimated.
    deviation : dict of str to float
        By parameter, standard deviation that the fit states, relative, mean over the seeds.
    error : dict of str to float
        rms of its errors.
    errors : dict of str to tuple of float
        They themselves, relative, by seed.
    odd, even : float
        Nonlinearity on silent lines over the linear answer, nan where a signal cannot tell.
    """

    plant: str
    kind: ExcitationKind
    reason: str
    amplitude_nm: float
    binds: str
    seconds: float
    crest_factor: float
    travel_m: float
    belt_force_n: float
    line_hz: float
    half_power_hz: float
    response_error: float
    noise: float
    deviation: Mapping[str, float]
    error: Mapping[str, float]
    errors: Mapping[str, tuple[float, ...]]
    odd: float
    even: float


@dataclass(frozen=True)
class ExcitationStudy:
    """All rows.

    Attributes
    ----------
    spectra : Mapping[str, tuple[ndarray, ndarray]]
        By plant and kind, frequencies Hz and torque of the lines N m, for the figures.
    sequences : tuple of tuple of int
        Order and clock of the PRBS of figures 3.1 and 3.2, at clock_s.
    """

    rows: tuple[ExcitationRow, ...]
    spectra: Mapping[str, tuple[Array, Array]]
    best: Mapping[str, str]
    limits: MotionLimits = LIMITS
    sequences: tuple[tuple[int, int], ...] = SEQUENCES
    clock_s: float = SOURCE_PERIOD_S


def compare(axes: Sequence[ExcitedAxis] = ()) -> ExcitationStudy:
    """Every kind on each axis, without one on both rigs, at equal time and inside the same limits.

    Parameters
    ----------
    axes : sequence of ExcitedAxis
        None compares on both rigs of the source.
    """
    rows, spectra = [], {}
    own = [choose_prbs(PERIOD_S, *_landmarks(axis), SECONDS) for axis in axes]
    axes = axes or [ExcitedAxis(name, load_plant(name).model) for name in PLANTS]
    for axis in axes:
        for kind in EXCITATION_KINDS:
            row, spectrum = _one(axis, kind)
            rows.append(row)
            spectra[f"{axis.name} {kind}"] = spectrum
    best = {axis.name: min((r for r in rows if r.plant == axis.name), key=_score).kind for axis in axes}
    shown = (tuple((one.order, one.clock) for one in own), PERIOD_S) if own else (SEQUENCES, SOURCE_PERIOD_S)
    return ExcitationStudy(tuple(rows), spectra, best, axes[0].limits, *shown)


def _landmarks(axis: ExcitedAxis) -> tuple[float, float]:
    """Antiresonance and resonance at the place, Hz."""
    at = operating_point(axis.model, axis.place_m, 1.0)
    low, high = (min(m.freq_hz for m in modes(axis.model, at, held=held)) for held in (("motor",), ()))
    return low, high


def _score(row: ExcitationRow) -> float:
    """Geometric mean of the relative errors of mass, stiffness and inertia: what counts, not what a fit says of itself."""
    return math.exp(float(np.mean([math.log(row.error[name]) for name in MEANT])))


def _factor(row: ExcitationRow, other: ExcitationRow) -> tuple[float, float]:
    """Score of one row over that of another, and the factor by which the few seeds leave that open with 95 %.

    q = score/score,   s² = (n - 1)/n Σ (ln q_(i) - mean)²,   q_(i) without seed i of both (they share its noise);   e^(t s), Student, n - 1
    Source: jackknife, Efron, Tibshirani, An Introduction to the Bootstrap (1993), section 11.
    """
    table = np.array([[r.errors[name] for name in MEANT] for r in (row, other)])
    n = table.shape[-1]

    def logarithm(kept: Array) -> float:
        by_row = np.mean(0.5 * np.log(np.mean(kept**2, axis=-1)), axis=-1)
        return float(by_row[0] - by_row[1])

    without = np.array([logarithm(np.delete(table, i, axis=-1)) for i in range(n)])
    deviation = math.sqrt((n - 1) / n * float(np.sum((without - without.mean()) ** 2)))
    return math.exp(logarithm(table)), math.exp(float(stdtrit(n - 1, 0.975)) * deviation)


def _one(axis: ExcitedAxis, kind: ExcitationKind) -> tuple[ExcitationRow, tuple[Array, Array]]:
    """One excitation on one axis."""
    model, place_m = axis.model, axis.place_m
    at = operating_point(model, place_m, 1.0)
    low, high = _landmarks(axis)
    choice = choose(kind, PERIOD_S, low, high, SECONDS)
    shape = choice.excitation(1.0, PERIOD_S)
    step: AmplitudeStep = largest_amplitude(
        [model], shape.torque / shape.amplitude_nm, PERIOD_S, place_m, axis.limits, axis.limits.torque_nm
    )
    signal = choice.excitation(
        step.amplitude_nm * step.amplitude_nm / choice.excitation(step.amplitude_nm, PERIOD_S).amplitude_nm, PERIOD_S
    )
    records = [_make_recording(axis, signal, seed) for seed in axis.seeds or SEEDS]
    start = model.with_values({n: f * model[n] for n, f in BEGIN.items() if n in model.parameters}, "start")
    fits = [fit_model([record], start, counts_per_rev=axis.counts) for record in records]
    deviation = {n: float(np.mean([(f.model.parameters[n].interval or math.inf) / f.quantile for f in fits])) / model[n] for n in MEANT}
    errors = {n: tuple(f.model[n] / model[n] - 1.0 for f in fits) for n in MEANT}
    error = {n: float(np.sqrt(np.mean(np.square(errors[n])))) for n in MEANT}
    record = records[0]
    answer = estimate_response(record.torque, record.position, PERIOD_S, signal.period_samples, signal.first_sample)
    band = (answer.freq_hz >= BAND[0] * low) & (answer.freq_hz <= BAND[1] * high)
    true = sampled_response(model, at, answer.freq_hz[band], PERIOD_S)
    odd = even = math.nan
    if kind == "multisine":
        split = distortion(record.torque, record.position, PERIOD_S, signal.period_samples, signal.first_sample)
        inside = (split.freq_hz >= BAND[0] * low) & (split.freq_hz <= BAND[1] * high)
        linear = rms(split.speed[inside])
        odd, even = (s.rms(BAND[0] * low, BAND[1] * high) / linear for s in (split.odd, split.even))
    moved = simulate_torque(model, signal.torque, PERIOD_S, place_m)
    lines = np.abs(np.fft.rfft(signal.period)) / signal.period_samples
    freq = np.asarray(np.fft.rfftfreq(signal.period_samples, PERIOD_S), dtype=np.float64)
    row = ExcitationRow(
        axis.name,
        kind,
        choice.reason,
        signal.amplitude_nm,
        step.binds,
        signal.duration_s,
        signal.crest_factor,
        float(np.max(np.abs(moved.cart_position_m - place_m))),
        float(np.max(moved.belt_force_n)),
        float(freq[1]) * (2.0 if signal.lines else 1.0),
        _half_power_hz(freq, lines),
        float(np.median(np.abs(answer.h[band] / true - 1.0))),
        float(np.median(answer.noise[band] / np.abs(answer.h[band]))),
        deviation,
        error,
        errors,
        odd,
        even,
    )
    return row, (np.asarray(freq[1:]), np.asarray(lines[1:]))


def _make_recording(axis: ExcitedAxis, signal: Excitation, seed: int) -> Recording:
    """The record of an excitation as a drive gives it: counted angle, torque with noise."""
    moved = simulate_torque(axis.model, signal.torque, PERIOD_S, axis.place_m + seed * FURTHER_M)
    step = 2.0 * math.pi / axis.counts
    note = ExcitationNote(signal.kind, signal.amplitude_nm, signal.period_samples, signal.first_sample)
    noise = NOISE_NM * np.random.default_rng(seed).normal(size=len(signal.torque))
    position = np.floor(moved.position_rad / step + 0.5) * step
    return Recording(
        f"{signal.kind}_{seed}", moved.t_s, signal.torque + noise, position, sidecar=Sidecar("frf", axis.place_m, excitation=note)
    )


def _half_power_hz(freq_hz: Array, lines: Array) -> float:
    """Highest third of an octave whose mean power is at least half of the strongest one's, Hz."""
    edges = np.geomspace(max(freq_hz[1], 2.0), freq_hz[-1], 1 + round(3.0 * math.log2(freq_hz[-1] / max(freq_hz[1], 2.0))))
    power = []
    for a, b in itertools.pairwise(edges):
        here = (freq_hz >= a) & (freq_hz < b)
        power.append(float(np.mean(lines[here] ** 2)) if here.any() else 0.0)
    return float(edges[1 + max(i for i, p in enumerate(power) if p >= 0.5 * max(power))])


def _verdict(plant: str, rows: Sequence[ExcitationRow]) -> str:
    """Excitation with the smallest errors, and those that the seeds cannot tell from it."""
    best = min(rows, key=_score)
    others = {r.kind: _factor(r, best) for r in rows if r is not best}
    worse = [f"{kind} {q:.2f} times (1/{open_:.2f} to {open_:.2f} times that)" for kind, (q, open_) in others.items() if q > open_]
    alike = [f"{kind} {q:.2f} times" for kind, (q, open_) in others.items() if q <= open_]
    said = f"{plant}: {best.kind} has the smallest errors of mass, stiffness and inertia at equal time"
    if alike:
        said += f", not to be told apart over {len(best.errors['cart.mass'])} seeds from {', '.join(alike)} as much"
    return said + (f"; larger beyond the scatter are {', '.join(worse)}" if worse else "")


def lines(study: ExcitationStudy) -> list[str]:
    """The table and what it says."""
    head = f"{'':10} {'±N m':>6} {'crest':>5} {'s':>5} {'travel':>8} {'belt':>6} {'lines':>7} {'to':>7} {'|ΔG|/G':>7} {'noise':>7}"
    head += "".join(f" {word:>10}" for word in MEANT.values()) + "   odd    even"
    said: list[str] = []
    for plant in dict.fromkeys(row.plant for row in study.rows):
        rows: Sequence[ExcitationRow] = [r for r in study.rows if r.plant == plant]
        said += [
            f"{plant}: each signal as loud as {study.limits.belt_force_n:.0f} N in the belt and {1e3 * study.limits.travel_m:.0f} mm allow",
            head,
        ]
        for r in rows:
            numbers = "".join(f" {100 * r.deviation[n]:4.2f}/{100 * r.error[n]:4.2f}%" for n in MEANT)
            shown = "      -      -" if math.isnan(r.odd) else f" {100 * r.odd:5.1f}% {100 * r.even:5.1f}%"
            said.append(
                f"{r.kind:10} {r.amplitude_nm:6.3f} {r.crest_factor:5.2f} {r.seconds:5.2f} {1e3 * r.travel_m:5.1f} mm "
                f"{r.belt_force_n:4.0f} N "
                f"{r.line_hz:4.2f} Hz {r.half_power_hz:4.0f} Hz {100 * r.response_error:6.1f}% {100 * r.noise:6.2f}%{numbers}{shown}"
            )
        said.append(_verdict(plant, rows))
    if study.sequences != SEQUENCES:
        for order, clock in study.sequences:
            zero, spacing = 1.0 / (clock * study.clock_s), 1.0 / ((2**order - 1) * clock * study.clock_s)
            said.append(f"PRBS of order {order}, clock {clock}: first zero (3.5) {zero:.4g} Hz, lowest line (3.6) {spacing:.3g} Hz")
    said.append("PRBS: as printed (3.4) keeps a mean, and the carriage drifts; here it is taken away, begun at mean momentum (erratum 10)")
    seeds = len(study.rows[0].errors["cart.mass"])
    said.append(f"mass, stiffness, inertia: standard deviation as the fit states it / rms of its errors over {seeds} seeds of the noise")
    said.append(
        "|ΔG|/G: friction seen as damping, in every signal; noise: what its scatter between periods says; odd, even: on silent lines"
    )
    return said
