"""The estimate is compared with scipy's exact zero-order-hold response of (2.38), its noise level with repetition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from beltcomm.errors import DataError
from beltcomm.response import FrequencyResponse, estimate_response, log_spaced_lines

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
T_S = 1e-3
N = 1022
FIRST = 300 + N


def plant() -> tuple[Array, Array, Array, Array]:
    """G_A (table A.4) as (2.38) with d = 0, sampled at 1 kHz with a held torque."""
    inertia, mass, stiffness, d_m, d_c, ratio = 71.73e-6, 13.44, 203.74e3, 33.17, 226.42, 0.01242
    a = np.array(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-stiffness * ratio**2 / inertia, stiffness * ratio / inertia, -d_m * ratio**2 / inertia, 0],
            [stiffness * ratio / mass, -stiffness / mass, 0, -d_c / mass],
        ]
    )
    b = np.array([[0], [0], [1 / inertia], [0]])
    sampled = signal.cont2discrete((a, b, np.array([[1.0, 0, 0, 0]]), np.zeros((1, 1))), T_S, method="zoh")
    return sampled[0], sampled[1], sampled[2], sampled[3]


def exact_response(freq_hz: Array) -> ComplexArray:
    a, b, c, _ = plant()
    z = np.exp(2j * np.pi * freq_hz * T_S)
    return np.array([(c @ np.linalg.solve(zi * np.eye(4) - a, b))[0, 0] for zi in z])


def excite(n_periods: int, seed: int = 1, bit_samples: int = 2) -> Array:
    bits = np.random.default_rng(seed).integers(0, 2, N // bit_samples)
    period = 0.3 * (np.repeat(bits, bit_samples) - 0.5)
    period -= period.mean()
    return np.concatenate((np.zeros(300), np.tile(period, n_periods + 1), np.zeros(50)))


def move(torque: Array) -> Array:
    return np.asarray(signal.dlsim((*plant(), T_S), torque)[1])[:, 0]


def test_without_noise_it_is_the_exact_sampled_response() -> None:
    torque = excite(4)
    # Start angle and constant speed do not matter: that is what Clary's method II is for.
    position = move(torque) + 100.0 + 0.5 * T_S * np.arange(len(torque))
    response = estimate_response(torque, position, T_S, N, FIRST)
    # The slowest time constant of the axis, 0.054 s, passes nearly 20 times in the run-in of 1.0 s.
    np.testing.assert_allclose(response.h, exact_response(response.freq_hz), rtol=1e-6)
    assert response.n_periods == 4
    assert np.all(response.coherence > 1 - 1e-9)
    # Clock 2 has its spectrum zero at 500 Hz: |sinc(f / 500)| < 0.05 above 476 Hz.
    assert response.freq_hz[0] == pytest.approx(1 / (N * T_S))
    assert 450 < response.freq_hz[-1] < 490
    assert any("does not excite" in remark for remark in response.remarks)


def test_phase_convention_is_that_of_a_lag() -> None:
    """One sample of delay turns h by exp(-Iω T_s)."""
    torque = excite(3)
    position = move(torque)
    now = estimate_response(torque, position, T_S, N, FIRST)
    late = estimate_response(torque, np.concatenate(([0.0], position[:-1])), T_S, N, FIRST)
    np.testing.assert_allclose(late.h / now.h, np.exp(-2j * np.pi * now.freq_hz * T_S), rtol=1e-6)


def test_noise_level_and_band_agree_with_repetition() -> None:
    """40 records of 5 periods with torque noise of 6 mN m (run-folder.md, plants) and 0.1 mrad on the angle."""
    rng = np.random.default_rng(3)
    torque = excite(5)
    position = move(torque)
    responses = []
    for _ in range(40):
        noisy_torque = torque + rng.normal(0, 6e-3, len(torque))
        responses.append(estimate_response(noisy_torque, position + rng.normal(0, 1e-4, len(torque)), T_S, N, FIRST))
    # Lines that every record has.  Below the tenth, white angle noise counts only at the ends of a period, and one period's
    # end is the next one's start: their mean is better than the scatter says.
    common = [f for f in responses[0].freq_hz[10:] if all(np.isclose(r.freq_hz, f).any() for r in responses)]
    same = [r.lines(np.isin(np.round(r.freq_hz, 6), np.round(common, 6))) for r in responses]
    assert len(common) > 350
    error = np.array([r.h for r in same]) - exact_response(same[0].freq_hz)
    noise = np.array([r.noise for r in same])
    assert np.mean(np.mean(np.abs(error) ** 2, axis=0) / np.mean(noise**2, axis=0)) == pytest.approx(1.0, abs=0.05)
    inside = np.abs(error) <= np.array([r.error_radius() for r in same])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_averaging_lowers_the_noise_by_the_root_of_the_periods() -> None:
    """Thesis 3.4: √n_m.  16 and 64 periods, so that the scatter itself is known well."""
    rng = np.random.default_rng(4)
    noise = []
    for n in (16, 64):
        torque = excite(n)
        response = estimate_response(torque, move(torque) + rng.normal(0, 1e-4, len(torque)), T_S, N, FIRST)
        noise.append(response.noise)
    assert np.sqrt(np.mean((noise[0] / noise[1]) ** 2)) == pytest.approx(2.0, rel=0.03)


def test_error_radius_is_the_quantile_of_the_f_distribution() -> None:
    """F_0.95(2, 6) = 5.143, F_0.95(2, 20) = 3.493: standard tables."""
    for n_periods, quantile in ((4, 5.143), (11, 3.493)):
        response = FrequencyResponse(np.ones(1), np.ones(1, complex), np.ones(1), np.ones(1), n_periods, T_S)
        assert response.error_radius()[0] == pytest.approx(np.sqrt(quantile), abs=2e-4)


def test_coherence_is_the_part_of_the_motion_that_the_torque_explains() -> None:
    """γ² = |w|² / (|w|² + σ_w²) with σ_w² = σ² (N |1 - 1/z|² + 2), white angle noise after V_2."""
    n, sigma = 40, 1e-3
    torque = excite(n)
    rng = np.random.default_rng(5)
    response = estimate_response(torque, move(torque) + rng.normal(0, sigma, len(torque)), T_S, N, FIRST)
    v_2 = 1 - np.exp(-2j * np.pi * response.freq_hz * T_S)
    lines = np.rint(response.freq_hz * N * T_S).astype(int)
    u = np.fft.rfft(torque[FIRST : FIRST + N])[lines]
    power = np.abs(exact_response(response.freq_hz) * v_2 * u) ** 2
    expected = power / (power + sigma**2 * (N * np.abs(v_2) ** 2 + 2))
    assert expected.min() < 0.1 < 0.99 < expected.max()
    # The estimate from n periods is too high by up to 1/n where nothing is explained.
    assert 0.0 < np.mean(response.coherence - expected) < 1 / n
    assert np.std(response.coherence - expected) < 0.1


@pytest.mark.parametrize("how", ["gap in t_s", "not a number"])
def test_a_period_with_a_lost_sample_is_left_out(how: str) -> None:
    torque = excite(4)
    position = move(torque)
    t_s: Array = T_S * (1 + 20e-6) * np.arange(len(torque), dtype=np.float64)
    t_s += np.random.default_rng(6).uniform(-2e-4, 2e-4, len(torque))
    lost = FIRST + N + 400
    if how == "gap in t_s":
        keep = np.delete(np.arange(len(torque)), [40, lost])  # one in the run-in too: it must not shift the periods
        response = estimate_response(torque[keep], position[keep], T_S, N, FIRST, t_s=t_s[keep])
    else:
        position[lost] = np.nan
        response = estimate_response(torque, position, T_S, N, FIRST, t_s=t_s)
    assert response.n_periods == 3
    assert "1 of 4 periods left out" in response.remarks[0]
    np.testing.assert_allclose(response.h, exact_response(response.freq_hz), rtol=1e-6)


def test_unusable_records_are_refused_in_words() -> None:
    torque = excite(4)
    position = move(torque)
    with pytest.raises(DataError, match="1 whole period"):
        estimate_response(torque[: FIRST + N + 5], position[: FIRST + N + 5], T_S, N, FIRST)
    with pytest.raises(DataError, match="equal length"):
        estimate_response(torque, position[:-1], T_S, N, FIRST)
    with pytest.raises(DataError, match="no frequency is excited"):
        estimate_response(np.zeros(len(torque)), position, T_S, N, FIRST)
    t_s: Array = np.arange(len(torque), dtype=np.float64) * T_S
    t_s[8] = t_s[7]
    with pytest.raises(DataError, match="row 8"):
        estimate_response(torque, position, T_S, N, FIRST, t_s=t_s)


def test_saved_and_loaded_is_the_same(tmp_path: Path) -> None:
    torque = excite(3)
    response = estimate_response(torque, move(torque), T_S, N, FIRST)
    path = tmp_path / "frf.npz"
    response.save(path)
    again = FrequencyResponse.load(path)
    for name in ("freq_hz", "h", "noise", "coherence"):
        np.testing.assert_array_equal(getattr(again, name), getattr(response, name))
    assert (again.n_periods, again.sample_period_s, again.remarks) == (3, T_S, response.remarks)
    with pytest.raises(ValueError, match="read-only"):
        again.h[0] = 0


def test_files_that_are_no_response_are_refused(tmp_path: Path) -> None:
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK\x03\x04 half a file")
    other = tmp_path / "other.npz"
    np.savez(other, freq_hz=np.ones(3))
    for path in (tmp_path / "missing.npz", broken, other):
        with pytest.raises(DataError, match="estimate it anew"):
            FrequencyResponse.load(path)
    with pytest.raises(DataError, match="rise"):
        FrequencyResponse(np.array([2.0, 1.0]), np.ones(2, complex), np.ones(2), np.ones(2), 3, T_S)


def test_log_spaced_subset_is_nearly_logarithmic() -> None:
    """Figure 3.9: 30 of the linearly spaced lines."""
    freq: Array = np.arange(1, 501, dtype=np.float64)
    index = log_spaced_lines(freq, 30, 1.0, 500.0)
    chosen = freq[index]
    assert len(chosen) == 30
    assert (chosen[0], chosen[-1]) == (1.0, 500.0)
    assert np.all(np.diff(index) >= 1)
    # Where the lines are dense enough the ratio is even within the rounding to a line, half a line of 1 Hz each side.
    high = chosen[chosen > 30]
    steps = np.log(high[1:] / high[:-1])
    np.testing.assert_allclose(steps, steps.mean(), atol=1.5 / high[:-1].min())
    assert list(log_spaced_lines(freq, 30, 3.0, 7.0)) == [2, 3, 4, 5, 6]
    with pytest.raises(DataError, match="501 and 600"):
        log_spaced_lines(freq, 30, 501.0, 600.0)
