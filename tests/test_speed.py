"""The benchmark's own judgement: medians and ratios in pairs, aims with what their spread leaves open, growth, the history."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks.speeds.measure import Figure, growth, keep, last, ratio, spread


def figure(value: float, **more: object) -> Figure:
    return Figure("drive", "cycles", value, "x real time", **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "met"),
    [
        (figure(30.0), None),
        (figure(30.0, aim=25.0), True),
        (figure(20.0, aim=25.0), False),
        (figure(1.1, aim=1.2, least=False), True),
        (figure(1.3, aim=1.2, least=False), False),
        (figure(26.0, aim=25.0, low=24.0, high=28.0), None),
        (figure(26.0, aim=25.0, low=25.5, high=28.0), True),
        (figure(math.nan, aim=25.0), False),
    ],
)
def test_an_aim_is_met_missed_or_left_open_by_the_spread(found, met):
    assert found.met is met
    word = {True: "met", False: "MISSED", None: "cannot tell" if found.aim is not None else ""}[met]
    assert found.line().endswith(word)


def test_ratios_are_taken_pair_by_pair_so_that_a_drift_of_the_machine_cancels():
    drift = np.array([1.0, 2.0, 4.0, 8.0])
    found = ratio(list(3.0 * drift), list(drift))
    assert (found.low, found.median, found.high) == (3.0, 3.0, 3.0)
    with pytest.raises(ValueError, match="no values"):
        spread([])
    assert spread([1.0, 2.0, 3.0, 4.0, 100.0]).median == 3.0


def test_growth_is_the_exponent_of_a_power():
    assert growth((1, 2, 4, 8), (3.0, 6.0, 12.0, 24.0)) == pytest.approx(1.0)
    assert growth((1, 2, 4), (2.0, 8.0, 32.0)) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="two sizes"):
        growth((2, 2), (1.0, 1.0))


def test_the_history_grows_and_finds_the_latest_value(tmp_path):
    path = tmp_path / "kept" / "history.json"
    assert keep(path, "monday", "2 cores", [figure(20.0)]) == []
    before = keep(path, "tuesday", "2 cores", [figure(25.0)])
    assert last(before, figure(0.0)) == 20.0
    assert last(keep(path, "wednesday", "2 cores", []), figure(0.0)) == 25.0
    assert last(before, Figure("drive", "another", 1.0, "s")) is None
    assert [run["when"] for run in json.loads(path.read_text())] == ["monday", "tuesday", "wednesday"]
    path.write_text("{}")
    with pytest.raises(ValueError, match="no history of benchmarks"):
        keep(path, "thursday", "2 cores", [])


def test_the_bound_is_that_of_the_dense_covariance():
    """An axis whose matrices change from sample to sample, and forget everything at one of them as a stuck motor does."""
    from benchmarks.rounding import deviations, everywhere, repeats, responses
    from benchmarks.speeds.bound import gains, innovations
    from benchmarks.speeds.estimation import open_factor

    rng, n, step, noise_nm = np.random.default_rng(1), 30, 2e-3, 0.5
    Phi = 0.9 * np.linalg.qr(rng.normal(size=(n, 2, 2)))[0]
    Phi[12] = np.diag([1.0, 0.0])
    Gamma, g = rng.normal(scale=5e-3, size=(n, 2)), rng.normal(size=(n, 2, 3))
    white = innovations(Phi, Gamma, g, noise_nm, step)

    columns, paths, x, w = np.zeros((n, 3)), np.zeros((n, n)), np.zeros((2, 3)), np.zeros((2, n))
    for k in range(n):
        columns[k], paths[k] = x[0], w[0]
        x, w = Phi[k] @ x + g[k], Phi[k] @ w + np.outer(Gamma[k], np.eye(n)[k])
    dense = noise_nm**2 * paths @ paths.T + step**2 / 12.0 * np.eye(n)
    np.testing.assert_allclose(white.T @ white, columns.T @ np.linalg.solve(dense, columns), rtol=1e-9)
    K, S = gains(Phi, Gamma, noise_nm, step)
    angle = rng.integers(0, 3000, n) / 1000  # rounding that is not white
    usual, best = deviations(white, responses(Phi, K, S), step**2 * everywhere(angle))
    A = np.linalg.solve(white.T @ white, columns.T @ np.linalg.inv(dense))
    begins = (np.arange(1000) + 0.5)[:, None] / 1000
    rounded = step * (np.round(angle + begins) - angle - begins)
    true = noise_nm**2 * paths @ paths.T + rounded.T @ rounded / 1000
    np.testing.assert_allclose(usual, np.sqrt(np.diag(A @ true @ A.T)), rtol=1e-5)
    np.testing.assert_allclose(best, np.sqrt(np.diag(np.linalg.inv(columns.T @ np.linalg.solve(true, columns)))), rtol=1e-5)
    np.testing.assert_allclose(repeats(angle, 7).toarray(), everywhere(angle) * (np.subtract.outer(range(n), range(n)) % 7 == 0))
    low, high = open_factor(8)
    assert low < 1.0 < high
