"""Margins judged by what happens: a loop is pushed a little inside and a little beyond each margin and simulated."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from beltcomm.control import Cascade, Prefilter
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import closed_loop_poles, open_loops
from beltcomm.design.margins import margins
from design.closed_loop import PERIOD, growth_per_second, run

RATIO = 0.01242
#: G_A with the friction of the moving axis, and G_B with a dead time that is no whole number of periods.
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 2.53e-3, 0.0, 20.0, 1e-3, "G_A")
G_B = DesignPlant(71.73e-6, RATIO, 0.96, 222.39e3, 2.23e-3, 0.0, 20.0, 1.4e-3, "G_B")
LOOP_A = Cascade(0.10, 1.0, 9.0, 0.002, Prefilter("butterworth", 123.27))
LOOP_B = Cascade(0.017, 0.4, 20.0, 0.002, Prefilter("notch", 842.0, 2.0))
LOOP_PLAIN = Cascade(0.004, 0.05, 5.0, 0.002)
CASES = [(G_A, LOOP_A), (G_B, LOOP_B), (G_B, LOOP_PLAIN)]
IDS = ["G_A butterworth", "G_B notch", "G_B none"]


def independent_loops(plant: DesignPlant, cascade: Cascade, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Open velocity and position loop from (2.38) summed over aliases and scipy's filters."""
    i2, m, theta, c = RATIO**2, plant.mass_kg, plant.inertia_kg_m2, plant.stiffness_n_m
    d, dc, dm = plant.belt_damping_ns_m, plant.cart_damping_ns_m, plant.motor_damping_nm_s_rad / i2
    k = np.arange(-500, 501)
    s = 1j * (omega[:, None] + 2.0 * np.pi / PERIOD * k)
    a2 = c * (theta + i2 * m) + i2 * (d * dm + d * dc + dm * dc)
    bottom = [m * theta, i2 * m * (d + dm) + theta * (d + dc), a2, i2 * c * (dc + dm), 0.0]
    hold = (1.0 - np.exp(-s * PERIOD)) / s * np.exp(-s * plant.dead_time_s)
    sampled = (np.polyval([m, d + dc, c], s) / np.polyval(bottom, s) * hold).sum(axis=1) / PERIOD
    w0, dn = cascade.prefilter.omega_rad_s, cascade.prefilter.d_n
    analog = {
        "none": ([1.0], [1.0]),
        "notch": ([1.0, 2.0 / max(dn, 1e-9) * w0, w0**2], [1.0, 2.0 * dn * w0, w0**2]),
        "butterworth": ([w0**2], [1.0, np.sqrt(2.0) * w0, w0**2]),
    }[cascade.prefilter.kind]
    rate = 0.5 * w0 / np.tan(0.5 * w0 * PERIOD) if w0 else 1.0 / PERIOD
    _, prefilter = signal.freqz(*signal.bilinear(*analog, fs=rate), worN=omega * PERIOD)
    lag = cascade.velocity_filter_s
    _, estimator = signal.freqz([1.0, -1.0], [lag + PERIOD, -lag], worN=omega * PERIOD)
    kp, ki = cascade.kp_nm_s_rad, cascade.ki_nm_rad
    _, pi = signal.freqz([kp, ki * PERIOD - kp], [1.0, -1.0], worN=omega * PERIOD)
    velocity = pi * prefilter * sampled * estimator
    return velocity, cascade.kpp_1_s * pi * prefilter * sampled / (1.0 + velocity)


@pytest.mark.parametrize(("plant", "cascade"), CASES, ids=IDS)
def test_open_loops_and_sensitivities_agree_with_independent_formulas(plant: DesignPlant, cascade: Cascade) -> None:
    around_resonance = plant.resonance_rad_s * np.linspace(0.9, 1.1, 300)
    omega = np.sort(np.append(np.geomspace(1.0, 0.99 * np.pi / PERIOD, 700), around_resonance))
    velocity, position = independent_loops(plant, cascade, omega)
    measured = open_loops(plant, cascade, PERIOD, omega)
    np.testing.assert_allclose(measured[0], velocity, rtol=1e-5)
    np.testing.assert_allclose(measured[1], position, rtol=1e-5)
    (one,) = margins(cascade, [plant], PERIOD)
    # Neighbours at most 1.1 % apart, 0.07 % at the resonance: a maximum of |S| is missed by less than 0.01 dB.
    assert one.sensitivity_db == pytest.approx(-20 * math.log10(np.min(np.abs(1.0 + velocity))), abs=0.01)
    assert one.position_sensitivity_db == pytest.approx(-20 * math.log10(np.min(np.abs(1.0 + position))), abs=0.01)


@pytest.mark.parametrize(("plant", "cascade"), CASES, ids=IDS)
def test_phase_margin_is_the_extra_dead_time_that_brings_the_velocity_loop_to_the_edge(plant: DesignPlant, cascade: Cascade) -> None:
    (one,) = margins(cascade, [plant], PERIOD)
    edge = math.radians(one.phase_margin_deg) / one.crossover_rad_s
    assert one.velocity_stable
    for share, sign in ((0.97, -1.0), (1.03, 1.0)):
        out = run(plant, cascade, 2000, plant.dead_time_s + share * edge, velocity_loop=True)
        assert sign * growth_per_second(out, 1.0) > 0.0


@pytest.mark.parametrize(("plant", "cascade"), CASES, ids=IDS)
def test_gain_margin_is_the_factor_that_brings_the_velocity_loop_to_the_edge(plant: DesignPlant, cascade: Cascade) -> None:
    (one,) = margins(cascade, [plant], PERIOD)
    edge = 10.0 ** (one.gain_margin_db / 20.0)
    for share, sign in ((0.99, -1.0), (1.01, 1.0)):
        factor = share * edge
        pushed = replace(cascade, kp_nm_s_rad=factor * cascade.kp_nm_s_rad, ki_nm_rad=factor * cascade.ki_nm_rad)
        out = run(plant, pushed, 4000, plant.dead_time_s, velocity_loop=True)
        assert sign * growth_per_second(out, 1.0) > 0.0


@pytest.mark.parametrize(("plant", "cascade"), CASES, ids=IDS)
def test_position_gain_margin_is_the_factor_that_brings_the_cascade_to_the_edge(plant: DesignPlant, cascade: Cascade) -> None:
    (one,) = margins(cascade, [plant], PERIOD)
    edge = 10.0 ** (one.position_gain_margin_db / 20.0)
    assert one.stable
    for share, sign in ((0.99, -1.0), (1.01, 1.0)):
        pushed = replace(cascade, kpp_1_s=share * edge * cascade.kpp_1_s)
        assert sign * growth_per_second(run(plant, pushed, 2000, plant.dead_time_s), 1.0) > 0.0
        assert margins(pushed, [plant], PERIOD)[0].stable is (sign < 0.0)


def test_poles_grow_as_the_simulation_does() -> None:
    """An unstable loop: the largest pole is the rate of growth of the simulated angle."""
    unstable = replace(LOOP_A, kpp_1_s=60.0)
    poles = closed_loop_poles(G_A, unstable, PERIOD)
    rate = math.log(np.max(np.abs(poles))) / PERIOD
    out = run(G_A, unstable, 4000, G_A.dead_time_s)
    # Maxima of an oscillation over windows that hold no whole number of periods scatter by some percent.
    assert rate > 1.0
    assert growth_per_second(out, 1.0) == pytest.approx(rate, rel=0.05)


def test_suppression_sees_the_resonance_and_every_other_peak() -> None:
    """Without prefilter the belt's resonance is the peak: the gain there, from the independent formula on a dense grid."""
    omega = np.linspace(0.9 * G_A.resonance_rad_s, 1.1 * G_A.resonance_rad_s, 800)
    velocity, _ = independent_loops(G_A, LOOP_PLAIN, omega)
    (one,) = margins(LOOP_PLAIN, [G_A], PERIOD)
    assert one.suppression_db == pytest.approx(20.0 * math.log10(np.max(np.abs(velocity))), abs=0.01)


def test_suppression_of_a_rigid_axis_is_that_of_the_upper_half_of_what_is_sampled() -> None:
    """At the highest frequency the difference over one period and the hold leave next to nothing of any loop."""
    stiff = replace(G_A, stiffness_n_m=1e10)
    assert stiff.resonance_rad_s > math.pi / PERIOD
    one, twice = (margins(replace(LOOP_PLAIN, kp_nm_s_rad=kp, ki_nm_rad=0.0), [stiff], PERIOD)[0] for kp in (0.05, 0.1))
    velocity, _ = independent_loops(stiff, replace(LOOP_PLAIN, kp_nm_s_rad=0.05, ki_nm_rad=0.0), np.array([0.5 * math.pi / PERIOD]))
    assert one.suppression_db == pytest.approx(20.0 * math.log10(abs(velocity[0])), abs=0.3)
    assert twice.suppression_db - one.suppression_db == pytest.approx(20.0 * math.log10(2.0), abs=1e-6)


def test_no_crossover_is_an_infinite_margin_and_no_frequency() -> None:
    (one,) = margins(replace(LOOP_A, kp_nm_s_rad=1e-9, ki_nm_rad=0.0), [G_A], PERIOD)
    assert one.phase_margin_deg == math.inf
    assert math.isnan(one.crossover_rad_s)


def test_an_overdamped_plant_whose_poles_are_all_real_has_margins() -> None:
    """A first response around standstill shows friction as so much damping that nothing oscillates; one pole is negative.

    Such a pole alternates, z = -|z| = exp((ln|z| + jπ)), so its damping ratio is -ln|z|/sqrt(ln²|z| + π²); no other is below 1.
    """
    plant = DesignPlant(62.2e-6, RATIO, 10.0, 127e3, 0.0815, 0.0, 22.4, 1e-3)
    cascade = Cascade(1.573e-3, 4.4e-4, 0.0, 0.002)
    poles = closed_loop_poles(plant, cascade, PERIOD)
    assert poles.dtype == np.complex128  # whatever they are
    assert np.all(poles.imag[np.abs(poles) > 1e-4] == 0.0)  # those at 0 are multiple and split as rounding will have it
    fastest = math.log(-np.min(poles.real))
    (one,) = margins(cascade, [plant], PERIOD)
    assert one.damping == pytest.approx(-fastest / math.hypot(fastest, math.pi), rel=1e-12)
    assert one.stable
    assert one.velocity_stable
