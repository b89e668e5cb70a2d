"""The compiled cascade against its closed-form frequency responses, the thesis's equations and hand-computed values."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from beltcomm.control import (
    Cascade,
    Feedforward,
    Prefilter,
    cascade_step,
    discrete_coefficients,
    new_state,
    pi_response,
    prefilter_response,
    reset_state,
    velocity_filter_response,
    velocity_step,
)
from beltcomm.errors import UsageError

PERIOD = 1e-3
NO_LIMIT = 1e12
NOTCH = Prefilter("notch", 673.0, 4.6)
BUTTERWORTH = Prefilter("butterworth", 123.27)
#: A notch with the additional low-pass of 4.2.1, and that low-pass alone.
ROLLED_OFF, LOW_PASS = Prefilter("notch", 673.0, 4.6, 900.0), Prefilter(roll_off_rad_s=300.0)
ALL = (Prefilter(), NOTCH, BUTTERWORTH, ROLLED_OFF, LOW_PASS)
OMEGA = np.array([3.0, 20.0, 123.27, 400.0, 673.0, 1500.0, 3000.0])


def response_to_position_sine(cascade: Cascade, samples: int = 4000, cycles: int = 37) -> tuple[float, complex]:
    """Torque per motor angle of the compiled velocity loop: a sine of whole cycles, second half of a long run.

    Periods of the transient (poles below 0.9) die out in the first half; the projection on exp(-jωt) over whole cycles
    is exact for the rest.
    """
    coefficients, state = discrete_coefficients(cascade, PERIOD, NO_LIMIT), new_state()
    phase = 2.0 * np.pi * cycles * np.arange(2 * samples) / samples
    position = np.cos(phase)
    torque = np.array([velocity_step(coefficients, state, 0.0, 0.0, x, 0.0) for x in position])
    h = 2.0 / samples * np.sum(torque[samples:] * np.exp(-1j * phase[samples:]))
    return 2.0 * np.pi * cycles / (samples * PERIOD), complex(h)


@pytest.mark.parametrize("prefilter", ALL, ids=lambda p: f"{p.kind}-{p.roll_off_rad_s:g}")
@pytest.mark.parametrize("cycles", [37, 401, 1511])
def test_compiled_step_has_the_stated_frequency_response(prefilter: Prefilter, cycles: int) -> None:
    cascade = Cascade(0.1, 0.0, 8.0, 0.002, prefilter)
    omega, measured = response_to_position_sine(cascade, cycles=cycles)
    point = np.array([omega])
    stated = -0.1 * velocity_filter_response(point, 0.002, PERIOD) * prefilter_response(point, prefilter, PERIOD)
    assert measured == pytest.approx(complex(stated[0]), rel=1e-9)


@pytest.mark.parametrize("prefilter", ALL, ids=lambda p: f"{p.kind}-{p.roll_off_rad_s:g}")
def test_compiled_pi_and_prefilter_impulse_response_transforms_to_the_stated_response(prefilter: Prefilter) -> None:
    """The impulse of the reference velocity sees prefilter and PI only; x_I ends in a constant, summed in closed form."""
    kp, ki = 0.1, 1.7
    cascade = Cascade(kp, ki, 0.0, 0.002, prefilter, filter_reference=False)
    coefficients, state = discrete_coefficients(cascade, PERIOD, NO_LIMIT), new_state()
    reference = np.zeros(1500)
    reference[0] = 1.0
    torque = np.array([velocity_step(coefficients, state, x, 0.0, 0.0, 0.0) for x in reference])
    z = np.exp(1j * OMEGA * PERIOD)
    powers = z[:, None] ** -np.arange(len(torque))
    tail = torque[-1] * z ** -float(len(torque)) / (1.0 - 1.0 / z)
    stated = prefilter_response(OMEGA, prefilter, PERIOD) * pi_response(OMEGA, kp, ki, PERIOD)
    np.testing.assert_allclose(powers @ torque + tail, stated, rtol=1e-9)


def test_reference_passes_the_same_filter_and_the_mean_of_its_last_interval() -> None:
    """Impulse of the reference velocity through K_P alone: K_P (1 − p)/2 (1, 1 + p, p + p², ...), p = T_R/(T_R + T)."""
    coefficients, state = discrete_coefficients(Cascade(2.0, 0.0, 0.0, 0.002), PERIOD, NO_LIMIT), new_state()
    torque = [velocity_step(coefficients, state, x, 0.0, 0.0, 0.0) for x in (1.0, 0.0, 0.0)]
    p = 2.0 / 3.0
    assert torque == pytest.approx([(1 - p) * 1.0, (1 - p) * (1 + p), (1 - p) * (p + p * p)], rel=1e-12)


@pytest.mark.parametrize("lag", [0.0, 0.002, 0.01])
def test_on_a_constant_acceleration_measured_velocity_lags_by_tr_plus_half_a_period(lag: float) -> None:
    """Thesis sheet, section 3; and a filtered reference lags by the same, so the velocity error vanishes."""
    acceleration = 40.0
    t = PERIOD * np.arange(600)
    position, velocity = 0.5 * acceleration * t**2, acceleration * t
    for filtered, expected in ((False, acceleration * (lag + 0.5 * PERIOD)), (True, 0.0)):
        cascade = Cascade(1.0, 0.0, 0.0, lag, filter_reference=filtered)
        coefficients, state = discrete_coefficients(cascade, PERIOD, NO_LIMIT), new_state()
        error = [velocity_step(coefficients, state, v, 0.0, x, 0.0) for x, v in zip(position, velocity, strict=True)]
        assert error[-1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("kind", ["notch", "butterworth"])
def test_prefilter_is_scipys_bilinear_transform_with_prewarping(kind: str) -> None:
    omega_0, d_n = 500.0, 3.0
    if kind == "notch":
        analog = ([1.0, 2.0 / d_n * omega_0, omega_0**2], [1.0, 2.0 * d_n * omega_0, omega_0**2])
        prefilter = Prefilter("notch", omega_0, d_n)
    else:
        analog = ([1.0], [1.0 / omega_0**2, np.sqrt(2.0) / omega_0, 1.0])
        prefilter = Prefilter("butterworth", omega_0)
    # scipy warps at fs: s = 2 fs (z − 1)/(z + 1), so prewarping at ω0 is the choice 2 fs = ω0/tan(ω0 T/2).
    b, a = signal.bilinear(*analog, fs=0.5 * omega_0 / np.tan(0.5 * omega_0 * PERIOD))
    _, expected = signal.freqz(b, a, worN=OMEGA * PERIOD)
    np.testing.assert_allclose(prefilter_response(OMEGA, prefilter, PERIOD), expected, rtol=1e-9)


def test_the_additional_low_pass_is_scipys_and_in_series() -> None:
    """Second-order Butterworth of scipy, which prewarps its cutoff, times the notch."""
    b, a = signal.butter(2, 900.0, fs=2.0 * np.pi / PERIOD)
    _, low_pass = signal.freqz(b, a, worN=OMEGA * PERIOD)
    np.testing.assert_allclose(
        prefilter_response(OMEGA, ROLLED_OFF, PERIOD), prefilter_response(OMEGA, NOTCH, PERIOD) * low_pass, rtol=1e-9
    )


def test_prefilters_are_exact_at_their_own_frequency() -> None:
    """(4.1) gives 1/d_n² at its centre, (4.3) gives −j/√2 at its cutoff."""
    notch = prefilter_response(np.array([673.0]), NOTCH, PERIOD)[0]
    butterworth = prefilter_response(np.array([123.27]), BUTTERWORTH, PERIOD)[0]
    assert notch == pytest.approx(1.0 / 4.6**2, rel=1e-9)
    assert butterworth == pytest.approx(-1j / np.sqrt(2.0), rel=1e-9)


def test_feedforward_is_4_16_on_the_unfiltered_reference() -> None:
    forward = Feedforward(2e-3, 0.04, 0.125, 0.05, velocity=0.0)
    coefficients = discrete_coefficients(Cascade(0.1, 1.0, 5.0, 0.002, NOTCH, forward), PERIOD, NO_LIMIT)
    for speed, sign in ((30.0, 1.0), (-30.0, -1.0), (0.0, 0.0)):
        torque = cascade_step(coefficients, new_state(), 0.0, speed, 100.0, 0.0, 0.01)
        assert torque == pytest.approx(0.2 + 0.04 * speed + 0.125 * sign + 0.05 + 0.01, rel=1e-12)


def test_kv_scales_the_reference_velocity_of_the_cascade_only() -> None:
    cascade = Cascade(2.0, 0.0, 5.0, 0.0, feedforward=Feedforward(velocity=0.25), filter_reference=False)
    coefficients = discrete_coefficients(cascade, PERIOD, NO_LIMIT)
    assert cascade_step(coefficients, new_state(), 0.1, 4.0, 0.0, 0.0, 0.0) == pytest.approx(2.0 * (0.5 + 1.0))
    assert velocity_step(coefficients, new_state(), 4.0, 0.0, 0.0, 0.0) == pytest.approx(2.0 * 4.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_conditional_integration_meets_the_limit_exactly_6_26(sign: float) -> None:
    """K_P e = 0.6 and feedforward 0.1 leave 0.3 of the limit 1.0 to the integrator: x_I = 0.3/K_I from then on."""
    kp, ki, error = 0.3, 50.0, 2.0
    cascade = Cascade(kp, ki, 0.0, 0.0, feedforward=Feedforward(offset_nm=0.1 * sign), filter_reference=False)
    coefficients, state = discrete_coefficients(cascade, PERIOD, 1.0), new_state()
    torque = [velocity_step(coefficients, state, sign * error, 0.0, 0.0, 0.0) for _ in range(6)]
    # x_I grows by T e = 2 mrad a step (0.1 N m) and stops at 0.3/50 = 6 mrad.
    assert sign * np.array(torque) == pytest.approx([0.7, 0.8, 0.9, 1.0, 1.0, 1.0], rel=1e-12)
    # The error turns round: the torque leaves the limit in the same step, by the whole proportional part.
    assert sign * velocity_step(coefficients, state, -sign * 0.1, 0.0, 0.0, 0.0) == pytest.approx(0.3 - 0.03 + 0.1)


def test_a_feedforward_step_into_the_limit_never_winds_the_integrator_up() -> None:
    coefficients, state = discrete_coefficients(Cascade(0.3, 50.0, 0.0, 0.0), PERIOD, 1.0), new_state()
    velocity_step(coefficients, state, 0.01, 0.0, 0.0, 0.0)
    before = state.copy()
    assert velocity_step(coefficients, state, 0.01, 0.0, 0.0, 5.0) == 1.0
    assert state[6] < before[6]


def test_reset_forgets_everything_but_the_position() -> None:
    coefficients, state = discrete_coefficients(Cascade(0.1, 1.7, 8.0, 0.002, NOTCH), PERIOD, 1.0), new_state()
    for k in range(20):
        cascade_step(coefficients, state, 1.0, 3.0, 0.0, 0.01 * k, 0.2)
    reset_state(state, 123.0)
    assert cascade_step(coefficients, state, 123.0, 0.0, 0.0, 123.0, 0.0) == 0.0


@pytest.mark.parametrize(
    ("cascade", "period", "limit", "words"),
    [
        (Cascade(0.1, 1.0, 5.0, 0.002, Prefilter("notch", 3200.0, 4.0)), PERIOD, 1.0, "3200 rad/s .* below 3141.59"),
        (Cascade(0.1, 1.0, 5.0, 0.002, Prefilter("butterworth", 0.0)), PERIOD, 1.0, "above 0"),
        (Cascade(0.1, 1.0, 5.0, 0.002, Prefilter("notch", 100.0, 0.0)), PERIOD, 1.0, "d_n is 0"),
        (Cascade(0.1, 1.0, 5.0, 0.002, Prefilter("notch", 100.0, 2.0, 3200.0)), PERIOD, 1.0, "low-pass at 3200 rad/s .* below 3141.59"),
        (Cascade(0.1, 1.0, 5.0, 0.002, Prefilter(roll_off_rad_s=-1.0)), PERIOD, 1.0, "low-pass at -1 rad/s .* above 0"),
        (Cascade(-0.1, 1.0, 5.0, 0.002), PERIOD, 1.0, "K_P is -0.1"),
        (Cascade(0.1, float("nan"), 5.0, 0.002), PERIOD, 1.0, "K_I is nan"),
        (Cascade(0.1, 1.0, 5.0, 0.002), 0.0, 1.0, "loop period is 0"),
        (Cascade(0.1, 1.0, 5.0, 0.002), PERIOD, 0.0, "torque limit .* 0"),
    ],
)
def test_impossible_numbers_are_refused_with_the_limit(cascade: Cascade, period: float, limit: float, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        discrete_coefficients(cascade, period, limit)


def test_the_value_objects_load_without_numba() -> None:
    """``beltcomm --help`` must stay below 0.3 s; numba alone takes longer."""
    code = "import sys, beltcomm.control; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_feedforward_advance_gives_the_torque_of_the_reference_a_delay_later() -> None:
    """Along constant jerk the extrapolation is exact: torque at t is that of the reference at t + advance."""
    period, advance, jerk = 1e-3, 1.5e-3, 3000.0
    feedforward = Feedforward(inertia_kg_m2=2e-3, viscous_nm_s_rad=3e-3, coulomb_nm=0.1, advance_s=advance)
    coefficients = discrete_coefficients(Cascade(0.0, 0.0, 0.0, 2e-3, feedforward=feedforward), period, 100.0)
    state = new_state()
    velocity = 0.5 * jerk * (period * np.arange(1, 60)) ** 2
    quotient = np.diff(velocity, prepend=0.0) / period
    torque = [cascade_step(coefficients, state, 0.0, v, a, 0.0, 0.0) for v, a in zip(velocity, quotient, strict=True)]
    t = period * np.arange(1, 60) + advance
    expected = 2e-3 * jerk * t + 3e-3 * 0.5 * jerk * t**2 + 0.1
    np.testing.assert_allclose(torque[2:], expected[2:], rtol=1e-12)
