"""The additional low-pass of 4.2.1: in loops, poles, bounds, parameters and drive; and that the design takes it when it pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.control import Cascade, CascadeStructure, Prefilter, pi_response, prefilter_response, velocity_filter_response
from beltcomm.design.cascade import candidate_prefilters, design_cascade, meets
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import closed_loop_poles
from beltcomm.design.margins import margins
from beltcomm.design.prefilters import continuous_prefilter
from beltcomm.design.specification import Specification
from beltcomm.drive import open_drive
from beltcomm.drive.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.model import load_plant
from beltcomm.rundata.analyse import design_plants
from beltcomm.thesis.discretisation import _prefilter_bound
from design.closed_loop import PERIOD, growth_per_second, run

WITH = CascadeStructure("reference", PERIOD, ("none", "notch", "butterworth"), True, True, True, roll_off=True)
WITHOUT = replace(WITH, roll_off=False)
ASKED = Specification(phase_margin_deg=45.0, position_phase_margin_deg=70.0)
RATIO = 0.01242
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 33.17 * RATIO**2, 226.42, 20.0, 1e-3, "G_A")
ROLLED_OFF = Prefilter("notch", 673.0, 4.6, 900.0)


@pytest.fixture(scope="module")
def two_resonances() -> list[DesignPlant]:
    """Rig G_B with 0.4 kg of payload on a stiff spring: resonances at 127 and 426 Hz, both ends of the travel."""
    model = load_plant("g_b").model.with_effect("payload_mode", {"stiffness": 2e6, "damping": 5.0}).with_values({"payload.mass": 0.4})
    plants = design_plants(model, [0.0, 0.57], [model["cart.mass"]], 1e-3, 0.01)
    free = np.sort(plants[0].modes_rad_s / (2.0 * np.pi))
    assert free[1] == pytest.approx(126.8, abs=0.1)
    assert free[-1] == pytest.approx(425.8, abs=0.1)
    return plants


def test_the_second_resonance_costs_less_with_the_low_pass_behind_the_notch(two_resonances: list[DesignPlant]) -> None:
    """Notch alone: the gain above its centre is bounded by the second resonance; the low-pass takes that bound away."""
    asked = replace(ASKED, prefilters=("notch",))
    alone, helped = (design_cascade(two_resonances, structure, asked) for structure in (WITHOUT, WITH))
    assert alone.cascade.prefilter.roll_off_rad_s == 0.0
    assert helped.cascade.prefilter.roll_off_rad_s > 0.0
    assert helped.stiffness > 1.3 * alone.stiffness
    assert meets(margins(helped.cascade, two_resonances, PERIOD), asked)
    # The same gains without the low-pass do not hold what was asked.
    bare = replace(helped.cascade, prefilter=replace(helped.cascade.prefilter, roll_off_rad_s=0.0))
    assert max(one.suppression_db for one in margins(bare, two_resonances, PERIOD)) > -8.0


def test_among_all_prefilters_it_is_taken_where_it_brings_the_largest_stiffness(two_resonances: list[DesignPlant]) -> None:
    best, without = (design_cascade(two_resonances, structure, ASKED) for structure in (WITH, WITHOUT))
    assert best.cascade.prefilter.roll_off_rad_s > 0.0
    assert best.stiffness > without.stiffness


def test_two_masses_and_drives_without_it_are_designed_as_before(two_resonances: list[DesignPlant]) -> None:
    assert candidate_prefilters([G_A], WITH, ASKED) == candidate_prefilters([G_A], WITHOUT, ASKED)
    assert all(prefilter.roll_off_rad_s == 0.0 for prefilter in candidate_prefilters(two_resonances, WITHOUT, ASKED))
    assert all(
        prefilter.roll_off_rad_s == 0.0 for prefilter in candidate_prefilters(two_resonances, replace(WITH, prefilters=("none",)), ASKED)
    )


@pytest.mark.parametrize("prefilter", [ROLLED_OFF, Prefilter(roll_off_rad_s=400.0)], ids=["notch", "alone"])
def test_poles_of_the_closed_loop_are_roots_of_the_loop(prefilter: Prefilter) -> None:
    """1 + L(z) = 0 at every pole z of the velocity loop, L from the frequency responses continued to complex ω = ln z/(jT)."""
    cascade = Cascade(0.08, 1.2, 0.0, 0.002, prefilter)
    poles = closed_loop_poles(G_A, cascade, PERIOD)
    # Plant 4, torque under way 2, last angle and velocity 2, prefilter 2, integrator 1, low-pass 2.
    assert len(poles) == 13
    # Poles near 0 stand for delays, the one at 1 for the free angle of the velocity loop.
    inner = poles[(np.abs(poles) > 0.05) & (np.abs(poles - 1.0) > 1e-9)]
    # Three of the plant, velocity filter, integrator, two of the low-pass, two of a notch; torque under way may add one.
    assert len(inner) - (9 if prefilter.kind == "notch" else 7) in (0, 1)
    omega = np.log(inner.astype(complex)) / (1j * PERIOD)
    loop = (
        pi_response(omega, 0.08, 1.2, PERIOD)
        * prefilter_response(omega, prefilter, PERIOD)
        * G_A.sampled_response(omega, PERIOD)
        * velocity_filter_response(omega, 0.002, PERIOD)
    )
    np.testing.assert_allclose(loop, -1.0, atol=1e-5)


def test_stability_with_the_low_pass_is_what_a_simulation_shows() -> None:
    """The compiled cascade on an independent plant, just inside and just outside of the gain at which the poles leave the circle."""
    cascade = Cascade(0.08, 1.2, 8.0, 0.002, ROLLED_OFF)
    low, high = 1.0, 40.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        scaled = replace(cascade, kp_nm_s_rad=middle * 0.08, ki_nm_rad=middle * 1.2)
        if np.max(np.abs(closed_loop_poles(G_A, scaled, PERIOD))) < 1.0:
            low = middle
        else:
            high = middle
    for factor, grows in ((0.9, False), (1.1, True)):
        scaled = replace(cascade, kp_nm_s_rad=factor * low * 0.08, ki_nm_rad=factor * low * 1.2)
        assert (growth_per_second(run(G_A, scaled, 1200, G_A.dead_time_s), 1.0) > 0.0) == grows


def test_bound_and_continuous_form_know_the_low_pass() -> None:
    omega = np.geomspace(1.0, 3000.0, 500)
    continuous = continuous_prefilter(omega, ROLLED_OFF)
    s = 1j * omega
    expected = continuous_prefilter(omega, Prefilter("notch", 673.0, 4.6)) / ((s / 900.0) ** 2 + np.sqrt(2.0) * s / 900.0 + 1.0)
    np.testing.assert_allclose(continuous, expected, rtol=1e-12)
    error = np.abs(prefilter_response(omega, ROLLED_OFF, PERIOD) / continuous - 1.0)
    assert np.all(error <= _prefilter_bound(omega, ROLLED_OFF, PERIOD) + 1e-9)


def test_parameters_carry_the_low_pass_and_old_ones_have_none() -> None:
    cascade = Cascade(0.08, 1.2, 8.0, 0.002, ROLLED_OFF)
    parameters = cascade_to_parameters(cascade)
    assert parameters["prefilter_roll_off_rad_s"] == 900.0
    assert parameters_to_cascade(parameters) == replace(cascade, feedforward=cascade.feedforward)
    del parameters["prefilter_roll_off_rad_s"]
    assert parameters_to_cascade(parameters).prefilter == Prefilter("notch", 673.0, 4.6)


def test_the_drive_takes_the_low_pass_and_gives_it_back() -> None:
    cascade = Cascade(0.08, 1.2, 8.0, 0.002, ROLLED_OFF)
    with open_drive("virtual:g_b", {}) as drive:
        assert drive.capabilities.structure.roll_off
        drive.write(cascade_to_parameters(cascade))
        back = parameters_to_cascade(drive.backup()).prefilter
    # The drive keeps single precision.
    assert (back.omega_rad_s, back.d_n, back.roll_off_rad_s) == pytest.approx((673.0, 4.6, 900.0), rel=1e-7)
