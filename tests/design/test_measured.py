"""Margins from measured responses: against the exact loop, against coverage of their own bounds, and against what the machine does."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from beltcomm.control import Cascade, Prefilter, cascade_step, discrete_coefficients, new_state, reset_state
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.margins import margins
from beltcomm.design.measured import LINE_LEVEL, measured_margins
from beltcomm.errors import DataError
from beltcomm.excitation import prbs
from beltcomm.response import FrequencyResponse, estimate_response
from beltcomm.response.distortion import line_scatter
from design.closed_loop import PERIOD, growth_per_second, run
from truth.rigs import RIGS

RATIO = 0.01242
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 2.53e-3, 0.0, 20.0, 1e-3, "G_A")
G_B = DesignPlant(71.73e-6, RATIO, 0.96, 222.39e3, 2.23e-3, 0.0, 20.0, 1.4e-3, "G_B")
LOOP_A = Cascade(0.085, 0.44, 14.2, 0.004, Prefilter("butterworth", 123.27))
LOOP_B = Cascade(0.0219, 0.18, 42.6, 0.004, Prefilter("notch", 842.0, 1.61))
CASES = [(G_A, LOOP_A), (G_B, LOOP_B)]
#: Lines half a Hz apart from half a Hz on, as a record of two seconds a period has them.
FREQ_HZ = 0.5 * np.arange(1, 980)


@lru_cache
def exact_response(plant: DesignPlant, period_s: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    freq = FREQ_HZ[0.49 / period_s > FREQ_HZ]
    return freq, plant.sampled_response(2.0 * np.pi * freq, period_s)


def response(plant: DesignPlant, noise: float = 0.0, periods: int = 4, seed: int = 0, period_s: float = PERIOD) -> FrequencyResponse:
    """What a perfect experiment measures, with noise of that share of h on the mean of the periods, as its scatter shows it."""
    freq, h = exact_response(plant, period_s)
    random = np.random.default_rng(seed)
    drawn = random.standard_normal((2, periods, len(freq))) * math.sqrt(periods / 2.0) * noise * np.abs(h)
    single = h + drawn[0] + 1j * drawn[1]
    mean = single.mean(axis=0)
    scatter = np.sqrt(np.sum(np.abs(single - mean) ** 2, axis=0) / (periods - 1) / periods)
    return FrequencyResponse(freq, mean, scatter, np.ones(len(freq)), periods, period_s)


@pytest.mark.parametrize(("plant", "cascade"), CASES)
def test_without_noise_they_are_those_of_the_exact_loop(plant: DesignPlant, cascade: Cascade) -> None:
    """Lines half a Hz apart against a grid fifteen times finer at the crossover: log L straight in log ω misses 0.2 degrees and 0.1 dB."""
    (exact,) = margins(cascade, [plant], PERIOD)
    found = measured_margins(response(plant), cascade, PERIOD)
    assert (found.stable, found.velocity_stable) == (True, True)
    assert found.velocity.phase_margin_deg == pytest.approx(exact.phase_margin_deg, abs=0.2)
    assert 2.0 * math.pi * found.velocity.crossover_hz == pytest.approx(exact.crossover_rad_s, rel=0.005)
    assert found.position.phase_margin_deg == pytest.approx(exact.position_phase_margin_deg, abs=0.2)
    assert found.velocity.gain_margin_db == pytest.approx(exact.gain_margin_db, abs=0.1)
    assert found.position.gain_margin_db == pytest.approx(exact.position_gain_margin_db, abs=0.1)
    assert found.velocity.sensitivity_db == pytest.approx(exact.sensitivity_db, abs=0.1)
    assert found.position.sensitivity_db == pytest.approx(exact.position_sensitivity_db, abs=0.1)
    # Without noise the tube is the curve.
    assert found.velocity.least_phase_margin_deg == pytest.approx(found.velocity.phase_margin_deg, abs=1e-6)
    assert found.velocity.most_sensitivity_db == pytest.approx(found.velocity.sensitivity_db, abs=1e-9)


def test_the_bounds_hold_as_often_as_they_say() -> None:
    """120 experiments with 3 % of noise: each bound holds in 95 % of them at least, and is no empty one."""
    below = exact_response(G_A, PERIOD)[0] < 100.0
    noiseless = measured_margins(response(G_A).lines(below), LOOP_A, PERIOD)
    held = np.zeros(4)
    bounds = []
    for seed in range(120):
        found = measured_margins(response(G_A, 0.03, seed=seed).lines(below), LOOP_A, PERIOD)
        held += [
            found.velocity.least_phase_margin_deg <= noiseless.velocity.phase_margin_deg,
            found.position.least_phase_margin_deg <= noiseless.position.phase_margin_deg,
            found.velocity.most_sensitivity_db >= noiseless.velocity.sensitivity_db,
            found.position.least_gain_margin_db <= noiseless.position.gain_margin_db,
        ]
        bounds.append(noiseless.velocity.phase_margin_deg - found.velocity.least_phase_margin_deg)
    assert np.all(held >= binom.ppf(0.001, 120, 0.95))
    # One line's disc is 2.5 standard deviations at three degrees of freedom: 3 % are 4 degrees, and twice that is not far off.
    assert np.median(bounds) < 2.0 * math.degrees(0.03 * 2.0 * math.sqrt(-math.log(1.0 - LINE_LEVEL)))


def test_stability_is_counted_and_not_read_from_wrapped_phases() -> None:
    """Whatever factor on all gains, on whatever plant: the poles decide, the lines agree; and a phase margin alone would not."""
    fooled = 0
    for plant, cascade in CASES:
        for factor in (0.3, 1.0, 2.0, 3.0, 5.0, 8.0, 20.0, 40.0):
            louder = replace(
                cascade,
                kp_nm_s_rad=factor * cascade.kp_nm_s_rad,
                ki_nm_rad=factor * cascade.ki_nm_rad,
                kpp_1_s=factor**0.5 * cascade.kpp_1_s,
            )
            (exact,) = margins(louder, [plant], PERIOD)
            found = measured_margins(response(plant), louder, PERIOD)
            assert (found.stable, found.velocity_stable) == (exact.stable, exact.velocity_stable), (plant.name, factor)
            fooled += not exact.stable and found.velocity.phase_margin_deg > 20.0
    assert fooled > 0  # distances to ±180 degrees of loops that have long turned beyond


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_the_position_gain_of_the_edge_is_that_of_the_simulation(share: float) -> None:
    """A little inside and beyond the gain margin that the lines show, the simulated cascade decays and grows."""
    edge = 10.0 ** (measured_margins(response(G_B), LOOP_B, PERIOD).position.gain_margin_db / 20.0)
    pushed = replace(LOOP_B, kpp_1_s=share * edge * LOOP_B.kpp_1_s)
    assert measured_margins(response(G_B), pushed, PERIOD).stable is (share < 1.0)
    out = run(G_B, pushed, 2000, G_B.dead_time_s)
    assert (growth_per_second(out, 1.0) < 0.0) is (share < 1.0)


def measured_on_truth(rig: str) -> FrequencyResponse:
    """A PRBS on the independent simulator, friction included; the torque acts a period late, so it is the setpoint's response."""
    excitation = prbs(9, 2, 0.5, PERIOD, 4)
    plant = RIGS[rig].plant()
    setpoint = excitation.torque
    angle = np.empty(len(setpoint))
    for n, torque in enumerate(np.concatenate(([0.0], setpoint[:-1]))):
        angle[n] = plant.position_rad
        plant.step(float(torque), PERIOD)
    return estimate_response(setpoint, angle, PERIOD, excitation.period_samples, excitation.first_sample)


def speed_when_closed(rig: str, cascade: Cascade, seconds: float) -> NDArray[np.float64]:
    """Motor speed on the same machine under the compiled cascade, after a push of a millimetre on its reference; 3 N m at most."""
    plant, state = RIGS[rig].plant(), new_state()
    coefficients = discrete_coefficients(cascade, PERIOD, 3.0)
    reset_state(state, 0.0)
    late, speed = 0.0, []
    for _ in range(round(seconds / PERIOD)):
        torque = cascade_step(coefficients, state, 0.08, 0.0, 0.0, plant.position_rad, 0.0)
        plant.step(late, PERIOD)
        late = torque
        speed.append(plant.speeds[0])
    return np.array(speed)


@pytest.mark.parametrize(("rig", "cascade", "factor"), [("g_a", LOOP_A, 25.0), ("g_b", LOOP_B, 20.0)])
def test_what_a_measured_response_calls_unstable_is_unstable_on_the_machine(rig: str, cascade: Cascade, factor: float) -> None:
    """Measured around standstill, friction and all; then closed on the independent simulator: one rests, the other swings without end."""
    measured = measured_on_truth(rig)
    far = replace(cascade, kp_nm_s_rad=factor * cascade.kp_nm_s_rad, ki_nm_rad=factor * cascade.ki_nm_rad)
    for loop, stable in ((cascade, True), (far, False)):
        assert measured_margins(measured, loop, PERIOD).stable is stable
        speed = speed_when_closed(rig, loop, 1.5)
        assert bool(np.max(np.abs(speed[-300:])) < 0.1) is stable  # rad/s; the limit cycle of the unstable one is faster by far
    assert np.max(np.abs(speed[-300:])) > 5.0


def test_friction_s_wrong_lines_repeat() -> None:
    """No noise at all on the simulator, yet neighbouring lines differ by a tenth and more: scatter between periods does not see it."""
    measured = measured_on_truth("g_a")
    clear = measured.freq_hz < 150.0
    assert np.median(measured.noise[clear] / np.abs(measured.h[clear])) < 0.01
    assert np.median(line_scatter(measured)[clear] / np.abs(measured.h[clear])) > 0.1
    # Of pure noise it is the noise: 4 degrees of freedom per window, 137 independent windows.
    noisy = response(G_A, 0.05, seed=3)
    high = noisy.freq_hz > 200.0
    assert np.sqrt(np.mean(line_scatter(noisy)[high] ** 2 / np.abs(noisy.h[high]) ** 2)) == pytest.approx(0.05, rel=0.1)


def test_lines_hidden_by_noise_are_named_and_never_trusted() -> None:
    clean = response(G_A)
    noise = np.where((clean.freq_hz > 90.0) & (clean.freq_hz < 120.0), 0.5 * np.abs(clean.h), 1e-6 * np.abs(clean.h))
    found = measured_margins(replace(clean, noise=noise), LOOP_A, PERIOD)
    assert found.hidden_hz == ((90.5, 119.5),)
    assert found.hidden_lines == 59
    assert found.stable is True  # the loop is far below 1 there, noise included
    assert found.hidden_gain_db < 0.0
    # With gains that noise may lift to 1, nobody can tell.
    loud = replace(LOOP_A, kp_nm_s_rad=3.0 * LOOP_A.kp_nm_s_rad, prefilter=Prefilter())
    assert measured_margins(replace(clean, noise=noise), loud, PERIOD).stable is None
    everywhere = replace(clean, noise=10.0 * np.abs(clean.h))
    with pytest.raises(DataError, match="noise hides all but 0 of 979 lines; raise the amplitude"):
        measured_margins(everywhere, LOOP_A, PERIOD)


def test_a_gap_in_the_lines_is_named() -> None:
    clean = response(G_A)
    kept = clean.lines((clean.freq_hz < 60.0) | (clean.freq_hz > 80.0))
    assert measured_margins(kept, LOOP_A, PERIOD).gaps_hz == ((59.5, 80.5),)


def test_a_record_with_another_period_is_held_like_the_loop() -> None:
    """Sampled four times faster: its torque is held for a quarter of the time, which is half a degree per Hz of crossover less lag."""
    (exact,) = margins(LOOP_A, [G_A], PERIOD)
    fast = measured_margins(response(G_A, period_s=0.25e-3), LOOP_A, PERIOD)
    assert fast.velocity.phase_margin_deg == pytest.approx(exact.phase_margin_deg, abs=0.3)
    assert fast.position.gain_margin_db == pytest.approx(exact.position_gain_margin_db, abs=0.2)


def test_a_delay_that_the_response_does_not_hold_is_added() -> None:
    without = response(replace(G_A, dead_time_s=0.0))
    (exact,) = margins(LOOP_A, [G_A], PERIOD)
    assert measured_margins(without, LOOP_A, PERIOD, G_A.dead_time_s).velocity.phase_margin_deg == pytest.approx(
        exact.phase_margin_deg, abs=0.2
    )
    with pytest.raises(DataError, match="no line of the response lies below half"):
        measured_margins(without.lines(without.freq_hz > 200.0), LOOP_A, 4e-3)
