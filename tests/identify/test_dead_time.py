"""Closed forms: a response, and the same response behind a delay, a lag, or a hold."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.errors import DataError
from beltcomm.identify.dead_time import _dead_time_against, dead_time_between
from beltcomm.response import FrequencyResponse

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
T_S = 1e-3
FREQ: Array = np.arange(1, 480, dtype=np.float64) / 1.022
OMEGA = 2 * np.pi * FREQ


def axis_h(freq_hz: Array = FREQ) -> ComplexArray:
    """Two masses, resonance 107 Hz, antiresonance 19.6 Hz, as G_A (thesis.md, section 3)."""
    s, w_r, w_z = 2j * np.pi * freq_hz, 2 * np.pi * 107.16, 2 * np.pi * 19.60
    flexible = (s**2 / w_z**2 + 0.1 * s / w_z + 1) / (s**2 / w_r**2 + 0.1 * s / w_r + 1)
    return np.asarray(flexible / (0.002145 * s * (s + 20.0)), dtype=np.complex128)


def response(h: ComplexArray, noise: Array | None = None, freq_hz: Array = FREQ) -> FrequencyResponse:
    return FrequencyResponse(freq_hz, h, np.zeros(len(h)) if noise is None else noise, np.ones(len(h)), 8, T_S)


def noisy(h: ComplexArray, relative: float, rng: np.random.Generator) -> FrequencyResponse:
    noise = relative * np.abs(h)
    return response(h + noise * (rng.normal(size=len(h)) + 1j * rng.normal(size=len(h))) / np.sqrt(2), noise)


@pytest.mark.parametrize("delay_s", [1e-3, 0.37e-3, 4.2e-3, 12e-3])
def test_delay_is_found_exactly(delay_s: float) -> None:
    """At 12 ms the phase turns by nearly six whole turns up to 470 Hz."""
    h = axis_h()
    found = dead_time_between(response(h * np.exp(-1j * OMEGA * delay_s)), response(h))
    assert found.value_s == pytest.approx(delay_s, rel=1e-9)
    assert found.samples == pytest.approx(delay_s / T_S, rel=1e-9)
    assert found.interval_s < 1e-9
    assert found.remarks == ()


def test_interval_covers() -> None:
    """The thesis's 1 ms (3.30), 200 noisy pairs."""
    rng = np.random.default_rng(1)
    h = axis_h()
    late = h * np.exp(-1j * OMEGA * 1e-3)
    inside, values, bent = [], [], 0
    for _ in range(200):
        found = dead_time_between(noisy(late, 0.2, rng), noisy(h, 0.2, rng), highest_hz=107.0)
        inside.append(abs(found.value_s - 1e-3) <= found.interval_s)
        values.append(found.value_s)
        bent += bool(found.remarks)
    # ± 3 standard deviations of 200 decisions at 0.95.
    assert 0.90 <= np.mean(inside) <= 0.996
    assert np.mean(values) == pytest.approx(1e-3, abs=3 * np.std(values) / np.sqrt(200))
    assert bent <= 8  # 1 % by the test's level, 2 expected


def test_lines_are_matched_by_frequency_and_kept_to_the_range() -> None:
    h = axis_h()
    setpoint = response(h * np.exp(-1j * OMEGA * 1e-3))
    some = np.arange(3, 300, 2)
    found = dead_time_between(setpoint, response(h).lines(some), lowest_hz=10.0, highest_hz=107.0)
    assert found.value_s == pytest.approx(1e-3, rel=1e-9)
    assert set(found.freq_hz) <= set(FREQ[some])
    assert found.freq_hz.min() >= 10.0
    assert found.freq_hz.max() <= 107.0


def test_noisy_lines_count_less() -> None:
    """A constant phase error of 1 rad above 107 Hz, where the noise is a hundred times larger, must not matter."""
    h = axis_h()
    bad = FREQ > 107.0
    late = h * np.exp(-1j * OMEGA * 1e-3) * np.where(bad, np.exp(1j), 1.0)
    noise = np.abs(h) * np.where(bad, 1.0, 1e-3)
    found = dead_time_between(response(late, noise), response(h, 1e-3 * np.abs(h)))
    assert found.value_s == pytest.approx(1e-3, rel=0.02)


def test_against_a_continuous_model_the_hold_counts_as_half_a_sample() -> None:
    """Response of a double integrator to a held torque: T² (z + 1)/(2 (z - 1)²), phase of 1/s² minus ωT/2."""
    z = np.exp(1j * OMEGA * T_S)
    sampled = T_S**2 * (z + 1) / (2 * (z - 1) ** 2)
    continuous: ComplexArray = (-1 / OMEGA**2).astype(np.complex128)
    assert _dead_time_against(response(sampled), continuous).value_s == pytest.approx(T_S / 2, rel=1e-9)
    assert _dead_time_against(response(sampled * np.exp(-1j * OMEGA * 1e-3)), sampled).value_s == pytest.approx(1e-3, rel=1e-9)


def test_a_lag_is_told_from_a_dead_time() -> None:
    h = axis_h()
    found = dead_time_between(noisy(h / (1 + 1e-3j * OMEGA), 0.01, np.random.default_rng(2)), response(h))
    assert any("a lag or a filter" in remark for remark in found.remarks)


def test_exchanged_responses_and_no_delay_are_said() -> None:
    h = axis_h()
    late = h * np.exp(-1j * OMEGA * 1e-3)
    assert any("negative" in remark for remark in dead_time_between(response(h), response(late)).remarks)
    rng = np.random.default_rng(3)
    none = dead_time_between(noisy(h, 0.05, rng), noisy(h, 0.05, rng))
    assert any("no dead time is seen" in remark for remark in none.remarks)


def test_too_few_lines_are_refused() -> None:
    h = axis_h()
    with pytest.raises(DataError, match="no line in common"):
        dead_time_between(response(h), response(h, freq_hz=FREQ + 0.1))
    with pytest.raises(DataError, match="5 are needed"):
        dead_time_between(response(h), response(h), lowest_hz=10.0, highest_hz=12.0)
    with pytest.raises(DataError, match="evaluate it at these lines"):
        _dead_time_against(response(h), h[:-1])
