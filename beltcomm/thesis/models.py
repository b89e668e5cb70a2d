"""The models of chapter 2 as pictures and numbers, and two pictures of chapter 3 that need no axis: 2.4, 2.7 to 2.10, 3.7 and 3.9."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.design.design_plant import DesignPlant
from beltcomm.effects.belt_spans import stiffness
from beltcomm.excitation import Excitation, prbs
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import modes, operating_point, state_space
from beltcomm.model.transfer import TwoMass
from beltcomm.response import estimate_response, log_spaced_lines
from beltcomm.simulate.forward import simulate_torque
from beltcomm.thesis.designs import FREQUENCIES, thesis_plants

#: Table A.2: EA in N (the unit is printed as N/m), l3 and the free length at carriage position 0 of the shipped axis, m.
EA_N, L3_M, OFFSET_M = 106_250.0, 0.79, 0.05
TRAVEL_M = np.linspace(0.0, 0.6, 121)
PLACES_M = (0.05, 0.30, 0.55)
FREQ_HZ = np.geomspace(1.0, 1000.0, 1500)
#: Figure 3.7: sampling of the source's own identification as far as it can be concluded (thesis.md, erratum 9), and its PRBS.
FINE_S, ORDER, CLOCK, AMPLITUDE_NM, AVERAGED = 62.5e-6, 7, 128, 0.15, 10
ABOVE_HZ = (500.0, 1500.0)
COUNTS, SEED = 65536, 2
#: Figure 3.9: lines of one second, reduced to so many.
LINES_HZ, REDUCED = np.arange(1.0, 501.0), 30


@dataclass(frozen=True)
class ModelStudy:
    """Comparison of the models of the source.

    Attributes
    ----------
    springs : dict of str to ndarray
        c1, c2, c3 and the replacement c over TRAVEL_M, N/m.
    parameter_sets : dict of str to ComplexArray
        S_A, S_B, S_C, responses at FREQ_HZ.
    published, recomputed : dict of str to tuple of float
        f_r and f_z of all sets, Hz.
    places : dict of float to ComplexArray
        Responses of the rig of its data sheets at three places.
    place_modes : dict of float to tuple of float
        f_r and f_z there, Hz.
    approximations : dict of str to ComplexArray
        (2.40) to (2.42) and the exact (2.39) of S_A.
    cart : dict of str to ComplexArray
        Torque to carriage, to motor angle times i_t, and (2.49), of S_A.
    third_mode_hz : float
        Of the end pulley.
    averaged : dict of int to float
        rms relative error of |h| above 500 Hz with one and with ten periods.
    chosen_hz : ndarray
        Lines of figure 3.9.
    """

    springs: Mapping[str, Array]
    parameter_sets: Mapping[str, ComplexArray]
    published: Mapping[str, tuple[float, float]]
    recomputed: Mapping[str, tuple[float, float]]
    places: Mapping[float, ComplexArray]
    place_modes: Mapping[float, tuple[float, float]]
    approximations: Mapping[str, ComplexArray]
    cart: Mapping[str, ComplexArray]
    third_mode_hz: float
    averaged: Mapping[int, float]
    fine: Mapping[int, tuple[Array, ComplexArray]]
    chosen_hz: Array


def compare() -> ModelStudy:
    """Everything of chapter 2, and figures 3.7 and 3.9."""
    sets = {plant.name: two_mass_of(plant) for plant in thesis_plants()}
    rig = load_plant("egc_70").model
    at = {place: operating_point(rig, place, 1.0) for place in PLACES_M}
    s_a = sets["S_A"]
    fine = _above_500()
    true = state_space(_smooth(), operating_point(_smooth(), 0.3, 1.0))
    averaged = {n: _relative(h, true.sampled(f, FINE_S)[:, 0]) for n, (f, h) in fine.items()}
    held = {place: min(m.freq_hz for m in modes(rig, point, held=("motor",))) for place, point in at.items()}
    return ModelStudy(
        _springs(),
        {name: sets[name].torque_to_angle().response(FREQ_HZ) for name in ("S_A", "S_B", "S_C")},
        FREQUENCIES,
        {name: (two.resonance_hz, two.antiresonance_hz) for name, two in sets.items()},
        {place: state_space(rig, point).response(FREQ_HZ)[:, 0] for place, point in at.items()},
        {place: (min(m.freq_hz for m in modes(rig, point)), held[place]) for place, point in at.items()},
        {
            "(2.39) exact": s_a.torque_to_angle_without_belt_damper().response(FREQ_HZ),
            "(2.40) low": s_a.low_frequency().response(FREQ_HZ),
            "(2.41) high": s_a.high_frequency().response(FREQ_HZ),
            "(2.42) product": s_a.product_form().response(FREQ_HZ),
        },
        {
            "torque to motor, times i_t": s_a.transmission_m_rad * s_a.torque_to_angle().response(FREQ_HZ),
            "torque to cart (2.48)": s_a.torque_to_cart().response(FREQ_HZ),
            "motor to cart (2.49), over i_t": s_a.angle_to_cart().response(FREQ_HZ) / s_a.transmission_m_rad,
        },
        sorted(m.freq_hz for m in modes(rig, at[0.30]))[1],
        averaged,
        fine,
        LINES_HZ[log_spaced_lines(LINES_HZ, REDUCED, 1.0, 500.0)],
    )


def _springs() -> dict[str, Array]:
    """Belt sections of the three-mass model (2.10) and the replacement spring (2.26) over the travel, N/m."""
    l1 = OFFSET_M + TRAVEL_M
    c1, c2, c3 = EA_N / l1, EA_N / (L3_M - l1), np.full(len(l1), EA_N / L3_M)
    replaced = np.array([stiffness(x, EA_N, L3_M, OFFSET_M) for x in TRAVEL_M.tolist()])
    return {"c1": c1, "c2": c2, "c3": c3, "c": replaced}


def two_mass_of(plant: DesignPlant) -> TwoMass:
    """An axis in the source's form, damping at the belt.

    Parameters
    ----------
    plant : DesignPlant
        With its dead time.
    """
    ratio = plant.transmission_m_rad
    at_belt = plant.motor_damping_nm_s_rad / ratio**2
    return TwoMass(
        plant.inertia_kg_m2, plant.mass_kg, plant.stiffness_n_m, at_belt, plant.cart_damping_ns_m, plant.belt_damping_ns_m, ratio
    )


def _smooth() -> Model:
    """G_A without Coulomb friction: figure 3.7 is about noise."""
    return load_plant("g_a").model.with_values({"coulomb.level": 0.0, "cart_friction.level": 0.0})


def _above_500() -> dict[int, tuple[Array, ComplexArray]]:
    """Frequency response above 500 Hz at 16 kHz from one and from ten periods; an encoder's rounding is the noise."""
    signal = prbs(ORDER, CLOCK, 2.0 * AMPLITUDE_NM, FINE_S, AVERAGED)
    moved = simulate_torque(_smooth(), signal.torque, FINE_S, 0.3)
    step = 2.0 * math.pi / COUNTS
    rng = np.random.default_rng(SEED)
    angle = step * np.floor(moved.position_rad / step + rng.random(len(moved.position_rad)))  # dithered by the shaft's own shake
    found = {}
    for n in (1, AVERAGED):
        f, h = _mean_response(signal, angle, n)
        here = (f >= ABOVE_HZ[0]) & (f <= ABOVE_HZ[1])
        found[n] = (f[here], h[here])
    return found


def _mean_response(signal: Excitation, angle: Array, periods: int) -> tuple[Array, ComplexArray]:
    """Response from so many periods; for one the first of two, because an estimate needs its noise."""
    if periods >= 2:
        whole = estimate_response(signal.torque, angle, FINE_S, signal.period_samples, signal.first_sample)
        return whole.freq_hz, whole.h
    first, n = signal.first_sample, signal.period_samples
    speed = np.diff(angle, prepend=angle[0])[first : first + n]
    freq = np.asarray(np.fft.rfftfreq(n, FINE_S)[1:], dtype=np.float64)
    u = np.fft.rfft(signal.torque[first : first + n])[1:]
    excited = np.abs(u) > 0.05 * np.abs(u).max()
    z = np.exp(2j * np.pi * freq * FINE_S)
    return freq[excited], np.asarray((z / (z - 1.0) * np.fft.rfft(speed)[1:] / np.where(excited, u, 1.0))[excited])


def _relative(h: ComplexArray, true: ComplexArray) -> float:
    """Median relative error."""
    return float(np.median(np.abs(h / true - 1.0)))


def lines(study: ModelStudy) -> list[str]:
    """Numbers of chapter 2."""
    said = [f"{'':5} {'f_r, Hz':>9} {'published':>10} {'f_z, Hz':>9} {'published':>10}   (2.44), (2.45)"]
    for name, (resonance, antiresonance) in study.recomputed.items():
        published = study.published[name]
        said.append(f"{name:5} {resonance:9.2f} {published[0]:10.2f} {antiresonance:9.2f} {published[1]:10.2f}")
    said.append(
        "f_r above the print: i_t of 78 mm a turn, 12.414 mm for 12.42, gives it; of G_B two digits of m_c leave the rest, at f_z 0.4 Hz"
    )
    c = study.springs["c"]
    low = int(np.argmin(c))
    exact, product = study.approximations["(2.39) exact"], study.approximations["(2.42) product"]
    off = np.abs(decibels(product / exact))
    said += [
        f"2.4   replacement stiffness {1e-3 * c[0]:.0f} kN/m at 0, least {1e-3 * c[low]:.0f} at {TRAVEL_M[low]:.2f} m, "
        f"{1e-3 * c[-1]:.0f} at 0.6 m; "
        "identified were 204 and 222: the coupling, stiff to the source, gives 233 in series",
        f"2.7   (2.42) against (2.39) on S_A: at most {np.max(off):.2f} dB, at {FREQ_HZ[int(np.argmax(off))]:.1f} Hz",
        "2.9   "
        + "; ".join(f"at {place:.2f} m f_r {r:.1f}, f_z {z:.1f} Hz" for place, (r, z) in study.place_modes.items())
        + " (rig of the data sheets, three masses and coupling)",
        f"      its next mode lies at {study.third_mode_hz:.0f} Hz (end pulley)",
        f"2.10  torque to cart has no antiresonance: |G| at f_z of S_A {_attenuation(study):.1f} dB above torque to motor",
        f"3.7   above 500 Hz at 16 kHz: median error of one period {100 * study.averaged[1]:.1f} %, of {AVERAGED} "
        f"{100 * study.averaged[AVERAGED]:.1f} %: {study.averaged[1] / study.averaged[AVERAGED]:.2f} times less "
        f"(√{AVERAGED} = {math.sqrt(AVERAGED):.2f}); a sampled response ends at 1/(2 T_s), 3.2 prints 2/T_s (erratum 3)",
        f"3.9   {len(LINES_HZ)} lines reduced to {len(study.chosen_hz)}: {', '.join(f'{f:.0f}' for f in study.chosen_hz[:8])} … "
        f"{study.chosen_hz[-1]:.0f} Hz, all of them lines of the set",
    ]
    return said


def _attenuation(study: ModelStudy) -> float:
    """Level of the carriage's response above the motor's at the antiresonance of S_A, dB."""
    at = int(np.argmin(np.abs(FREQ_HZ - study.recomputed["S_A"][1])))
    motor, cart = study.cart["torque to motor, times i_t"], study.cart["torque to cart (2.48)"]
    return float(decibels(cart[at] / motor[at]))
