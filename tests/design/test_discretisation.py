"""Bounds of the discrete parts against the parts themselves, over all frequencies up to π/T; and how sharp they are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.control import Prefilter, pi_response, prefilter_response, velocity_filter_response
from beltcomm.design.prefilters import continuous_prefilter
from beltcomm.errors import UsageError
from beltcomm.thesis.discretisation import _pi_bound, _prefilter_bound, _steepest, _velocity_filter_bound, _warped_frequency

PERIODS = (0.4e-3, 1e-3, 6.4e-3)
NOTCH, BUTTERWORTH = Prefilter("notch", 673.279, 4.584), Prefilter("butterworth", 123.27)
#: What rounding adds to a difference of two numbers near 1.
ROUNDING = 1e-12


def frequencies(period_s: float) -> np.ndarray:
    return np.geomspace(1e-3, 0.9999, 4000) * math.pi / period_s


@pytest.mark.parametrize("period_s", PERIODS)
@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.032])
def test_the_velocity_filter_stays_within_half_an_angle(period_s: float, lag_s: float) -> None:
    omega = frequencies(period_s)
    s = 1j * omega
    error = np.abs(velocity_filter_response(omega, lag_s, period_s) * (1.0 + s * lag_s) / s - 1.0)
    bound = _velocity_filter_bound(omega, period_s)
    assert np.all(error <= bound + ROUNDING)
    # Without T_R the bound is what is there at low frequencies: a lag of T/2.
    if lag_s == 0.0:
        assert error[0] == pytest.approx(bound[0], rel=1e-5)


@pytest.mark.parametrize("period_s", PERIODS)
@pytest.mark.parametrize("tn_s", [0.005, 0.06, 2.0])
def test_the_pi_stays_within_its_bound_and_differs_by_the_closed_form(period_s: float, tn_s: float) -> None:
    omega = frequencies(period_s)
    kp, ki = 0.1, 0.1 / tn_s
    theta = omega * period_s
    continuous = kp + ki / (1j * omega)
    difference = pi_response(omega, kp, ki, period_s) - continuous
    closed = ki * period_s * (-0.5 + 1j * (1.0 / theta - 0.5 / np.tan(0.5 * theta)))
    np.testing.assert_allclose(difference, closed, rtol=1e-6)
    bound = _pi_bound(omega, kp, ki, period_s)
    assert np.all(np.abs(difference / continuous) <= bound + ROUNDING)
    # At π/T the second term is θ/π² itself, so the bound is met there.
    assert abs(difference[-1] / continuous[-1]) == pytest.approx(bound[-1], rel=1e-3)


@pytest.mark.parametrize("period_s", PERIODS)
@pytest.mark.parametrize("prefilter", [NOTCH, Prefilter("notch", 300.0, 1.3), BUTTERWORTH], ids=["notch", "narrow", "butterworth"])
def test_prefilters_are_the_continuous_ones_elsewhere_and_stay_within_their_bound(prefilter: Prefilter, period_s: float) -> None:
    omega = frequencies(period_s)
    if prefilter.omega_rad_s >= math.pi / period_s:
        with pytest.raises(UsageError, match=r"below 490\.874 rad/s"):
            _prefilter_bound(omega, prefilter, period_s)
        return
    discrete = prefilter_response(omega, prefilter, period_s)
    np.testing.assert_allclose(
        discrete, continuous_prefilter(_warped_frequency(omega, prefilter, period_s), prefilter), rtol=1e-7, atol=1e-12
    )
    error = np.abs(discrete / continuous_prefilter(omega, prefilter) - 1.0)
    bound = _prefilter_bound(omega, prefilter, period_s)
    assert np.all(error <= bound + 1e-9)
    # Far below ω_0 the slopes of numerator and denominator, 2x/d_n and 2x d_n, are added where they subtract; the rest is that the
    # bound takes the slope at the upper end of ω .. ω'.
    d = prefilter.d_n**2
    assert bound[0] < 1.5 * ((d + 1.0) / (d - 1.0) if d else 1.0) * error[0]
    own = np.array([prefilter.omega_rad_s])
    assert _prefilter_bound(own, prefilter, period_s)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("prefilter", [NOTCH, Prefilter("notch", 100.0, 1.1), BUTTERWORTH])
def test_the_slope_bound_is_above_every_slope_between_two_frequencies(prefilter: Prefilter) -> None:
    """Slopes by differences of the logarithm on a fine grid."""
    omega = prefilter.omega_rad_s * np.geomspace(0.01, 100.0, 200_001)
    response = continuous_prefilter(omega, prefilter)
    slope = np.abs(np.log(response[1:] / response[:-1])) / np.diff(np.log(omega))
    for low, high in ((0, 100_000), (95_000, 105_000), (100_000, 200_000), (0, 200_000), (120_000, 120_100)):
        bound = _steepest(prefilter, omega[[low]], omega[[high]])[0]
        assert slope[low:high].max() <= bound * (1.0 + 1e-6)
        if prefilter.kind == "butterworth":
            assert slope[low:high].max() == pytest.approx(bound, rel=1e-3)


def test_no_prefilter_has_no_error() -> None:
    assert np.all(_prefilter_bound(frequencies(1e-3), Prefilter(), 1e-3) == 0.0)


@pytest.mark.parametrize("omega", [0.0, -1.0, math.pi / 1e-3, 1e5])
def test_frequencies_that_a_loop_does_not_have_are_refused(omega: float) -> None:
    for bound in (lambda w: _velocity_filter_bound(w, 1e-3), lambda w: _pi_bound(w, 0.1, 1.0, 1e-3)):
        with pytest.raises(UsageError, match=r"below 3141\.59 rad/s"):
            bound(np.array([omega]))
