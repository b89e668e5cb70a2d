"""The four estimators on edges of known motions: unbiased, still at rest, right sign, and the same in a loop as over a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.encoder.edges import Edges, Flaws, edges_of
from beltcomm.encoder.estimators import EstimatorSettings, Velocities, coefficients, velocities
from beltcomm.encoder.kernel import (
    _switching_weight,
    close_period,
    combined_step,
    event_counter_step,
    gate_step,
    high_pass_step,
    new_decoder,
    new_estimator,
    take_edge,
)
from beltcomm.errors import DataError, UsageError

METHODS = ("high_pass", "event_counter", "gate", "combined")
GAP = 2.5e-6


def steady(speed: float, duration: float = 0.3, settings: EstimatorSettings | None = None) -> Velocities:
    edges = edges_of(lambda t: 1.1e-6 + speed * t, duration)
    return velocities(edges, settings or EstimatorSettings(), duration, start_velocity_m_s=speed)


SPEEDS = (7.3e-4, 4.1e-3, 0.0561, 1.07)
#: Below 2 Δξ/T_s = 5 mm/s the event counter has no value in every period (6.5).
MEASURABLE = [(method, speed) for method in METHODS for speed in SPEEDS if method != "event_counter" or speed > 5e-3]


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("method", "speed"), MEASURABLE)
def test_constant_speed_is_unbiased(method: str, speed: float, sense: float) -> None:
    found = steady(sense * speed)
    values = getattr(found, method)[found.t_s > 3.0 * GAP / speed + 0.002]
    # Each method's own random error: a tick in the time it measures, or an increment spread over the record.
    bound = {
        "high_pass": GAP / (found.t_s[-1] - 0.01),
        "event_counter": speed * 1e-8 / 1e-3,
        "gate": speed * 1e-8 * speed / GAP,
        "combined": max(speed * 1e-8 / 1e-3, 1e-8 * speed**2 / GAP if speed < 0.0075 else 0.0),
    }[method]
    assert abs(np.mean(values) - sense * speed) <= bound
    assert np.all(np.sign(values[found.increments[-len(values) :] > 0]) == sense)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed", [1e-3, 0.3])
def test_standstill_goes_to_zero(method: str, speed: float) -> None:
    edges = edges_of(lambda t: speed * np.minimum(t, 0.1), 0.2)
    settings = EstimatorSettings(timeout_s=0.03)
    found = velocities(edges, settings, 0.2)
    values = getattr(found, method)
    assert abs(values[95]) > 0.0 or method == "event_counter"
    assert values[-1] == pytest.approx(0.0, abs=speed * np.exp(-0.09 / 0.003) + 1e-18)
    if method != "high_pass":
        assert np.all(values[found.t_s > 0.1 + 0.03] == 0.0)


def test_without_time_out_the_gate_freezes() -> None:
    edges = edges_of(lambda t: 1e-3 * np.minimum(t, 0.1), 0.2)
    frozen = velocities(edges, EstimatorSettings(timeout_s=np.inf, extension="none"), 0.2)
    assert frozen.gate[-1] == pytest.approx(1e-3, rel=1e-5)
    cut = velocities(edges, EstimatorSettings(timeout_s=0.03, extension="none"), 0.2)
    # Constant, then 0 from T_out after the last increment (at 0.1 s or one increment's 2.5 ms before) on.
    assert set(np.round(cut.gate[60:], 8)) == {0.0, 1e-3}
    assert 0.127 <= cut.t_s[np.flatnonzero(cut.gate)[-1]] <= 0.1305


def test_the_first_increment_after_a_standstill_measures_the_standstill_and_not_the_velocity() -> None:
    # Moves at 4 mm/s until 20 ms, rests 60 ms, goes on: an increment per 0.625 ms, T_out 30 ms.
    edges = edges_of(lambda t: 4e-3 * (np.minimum(t, 0.02) + np.maximum(t - 0.08, 0.0)) + 1e-6, 0.1)
    first, second = edges.tick[edges.tick * 1e-8 > 0.08][:2] * 1e-8
    settings = EstimatorSettings(period_s=1e-4, timeout_s=0.03)
    found = velocities(edges, settings, 0.1)
    assert np.all(found.gate[(found.t_s > first) & (found.t_s < second)] == 0.0)
    assert np.sum((found.t_s > first) & (found.t_s < second)) >= 5
    np.testing.assert_allclose(found.gate[found.t_s > second], 4e-3, rtol=1e-4)


def test_the_extension_is_the_bound_that_no_increment_leaves() -> None:
    # (6.17): no increment for τ means slower than Δξ/τ; it takes over once τ exceeds the last gap, here 2.5 ms.
    edges = edges_of(lambda t: 1e-3 * np.minimum(t, 0.1), 0.2)
    found = velocities(edges, EstimatorSettings(timeout_s=0.03), 0.2)
    last = edges.tick[-1] * 1e-8
    for k in np.flatnonzero((found.t_s > last) & (found.t_s < last + 0.03 - 1e-9)):
        assert found.gate[k] == pytest.approx(min(1e-3, GAP / (found.t_s[k] - last)), rel=1e-5)


def test_the_printed_extension_reads_too_fast_between_two_increments() -> None:
    # Half a millimetre per second is an increment per 5 ms: as printed, Δξ/τ begins at τ just above T_s, up to five times too fast.
    values = {e: steady(5e-4, settings=EstimatorSettings(extension=e)).gate[15:] for e in ("printed", "bounded")}  # type: ignore[arg-type]
    assert np.max(values["printed"]) > 2.0 * 5e-4
    np.testing.assert_allclose(values["bounded"], 5e-4, rtol=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_the_sign_is_right_after_a_reversal(method: str) -> None:
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 1e-3 * np.sin(2.0 * np.pi * 5.0 * t)

    duration = 0.4
    found = velocities(edges_of(motion, duration), EstimatorSettings(), duration, start_velocity_m_s=1e-3 * 2.0 * np.pi * 5.0)
    true = 1e-3 * 2.0 * np.pi * 5.0 * np.cos(2.0 * np.pi * 5.0 * found.t_s)
    # The latest methods lag 2.5 ms, in which this motion changes by 2.5 mm/s; near the turn one increment more is needed.
    clear = np.abs(true) > 6e-3
    values = getattr(found, method)
    assert np.all(np.sign(values[clear]) == np.sign(true[clear]))
    assert np.max(np.abs(values - true)) < 6e-3


@pytest.mark.parametrize("method", METHODS)
def test_bounces_change_no_estimate(method: str) -> None:
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 0.4e-6 + 2e-4 * np.sin(2.0 * np.pi * 8.0 * t)

    clean = velocities(edges_of(motion, 0.2), EstimatorSettings(), 0.2)
    flawed = edges_of(motion, 0.2, flaws=Flaws(bounces=3, bounce_s=5e-5, seed=11))
    np.testing.assert_array_equal(getattr(velocities(flawed, EstimatorSettings(), 0.2), method), getattr(clean, method))
    plain = getattr(velocities(flawed, EstimatorSettings(), 0.2, debounce=False), method)
    if method != "high_pass":  # its count is right again after each bounce; the others are off by a tenth of the top speed and more
        assert np.max(np.abs(plain - getattr(clean, method))) > 0.1 * 2e-4 * 2.0 * np.pi * 8.0


def test_the_same_seed_gives_the_same_estimates() -> None:
    def made(seed: int) -> Velocities:
        flaws = Flaws(line_rms=0.05, bounces=2, bounce_s=1e-5, seed=seed)
        return velocities(edges_of(lambda t: 0.05 * t, 0.1, flaws=flaws), EstimatorSettings(), 0.1)

    for method in METHODS:
        np.testing.assert_array_equal(getattr(made(7), method), getattr(made(7), method))
    assert not np.array_equal(made(7).gate, made(8).gate)


def test_a_loop_that_steps_gets_what_the_record_gets() -> None:
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 3e-5 * np.sin(2.0 * np.pi * 40.0 * t) + 1e-3 * t

    settings = EstimatorSettings(period_s=2.5e-4, low_pass_s=1e-3)
    edges = edges_of(motion, 0.05)
    expected = velocities(edges, settings, 0.05)
    c, state, registers = coefficients(settings), new_estimator(), new_decoder(edges.level_a, edges.level_b)
    waiting = list(zip(edges.tick, edges.channel, edges.level, strict=True))
    for k in range(len(expected.t_s)):
        now = (k + 1) * settings.period_ticks
        while waiting and waiting[0][0] <= now:
            take_edge(registers, *waiting.pop(0))
        got = [high_pass_step(c, state, registers), event_counter_step(c, registers), gate_step(c, registers, now)]
        got.append(combined_step(c, state, registers, now))
        close_period(registers)
        assert got == [getattr(expected, method)[k] for method in METHODS]


def test_the_combination_takes_one_method_below_and_the_other_above() -> None:
    crossing = 2.0 * GAP / (1e-3 - 1e-8)
    for speed, method in ((0.45 * crossing, "gate"), (1.55 * crossing, "event_counter")):
        found = steady(-speed)
        np.testing.assert_array_equal(found.combined[10:], getattr(found, method)[10:])
    # (6.20) at its three printed points, and odd about the middle.
    assert [_switching_weight(f * crossing, crossing) for f in (0.5, 1.0, 1.5)] == pytest.approx([0.0, 0.5, 1.0])
    assert _switching_weight(0.8 * crossing, crossing) + _switching_weight(1.2 * crossing, crossing) == pytest.approx(1.0)


def test_the_printed_combination_misses_what_the_event_counter_has_not() -> None:
    # At 1.5 increments per period half of the periods hold one increment only: ξ_h has no value, and (6.20) gives it a weight of
    # (1 − sin 0.75π)/2 = 0.146.
    speed = 1.5 * GAP / 1e-3
    printed, guarded = (steady(speed, settings=EstimatorSettings(switching=s)) for s in ("printed", "guarded"))  # type: ignore[arg-type]
    assert np.min(printed.combined[10:]) / speed == pytest.approx(1.0 - 0.5 * (1.0 - np.sin(0.75 * np.pi)), abs=1e-3)
    np.testing.assert_allclose(guarded.combined[10:], speed, rtol=1e-4)


def test_the_low_pass_of_the_combination_is_first_order() -> None:
    # A step of the velocity from 0.1 to 0.2 m/s goes through 1 − (T/(T + T_s))^k.
    edges = edges_of(lambda t: 0.1 * t + 0.1 * np.maximum(t - 0.1, 0.0), 0.2)
    found = velocities(edges, EstimatorSettings(low_pass_s=4e-3), 0.2, start_velocity_m_s=0.1)
    k = np.arange(1, 20)
    np.testing.assert_allclose(found.combined[99 + k], 0.2 - 0.1 * 0.8**k, rtol=2e-3)


def test_an_invalid_edge_is_told_and_nothing_is_measured_across_it() -> None:
    edges = edges_of(lambda t: 0.1 * t, 0.05)
    kept = np.arange(len(edges.tick)) != 1000
    cut = Edges(edges.tick[kept], edges.channel[kept], edges.level[kept], edges.level_a, edges.level_b)
    found = velocities(cut, EstimatorSettings(), 0.05)
    assert found.invalid >= 1
    # Levels recover after one turn of four edges; from then on gate and events are right again, the position stays wrong.
    np.testing.assert_allclose(found.gate[30:], 0.1, rtol=5e-4)
    np.testing.assert_allclose(found.event_counter[30:], 0.1, rtol=5e-4)
    assert found.position_m[-1] == pytest.approx(0.1 * 0.05 - 4 * GAP, abs=1.01 * GAP)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"increment_m": -1.0}, "the increment is -1"),
        ({"period_s": 1.0000004e-3}, "not a whole number of ticks"),
        ({"lag_s": -1e-3}, "T_R is -0.001 s"),
        ({"low_pass_s": float("nan")}, "low-pass time constant is nan"),
        ({"timeout_s": 1e-3}, "not above the sampling period"),
        ({"extension": "linear"}, "no extension 'linear'"),
        ({"switching": "hard"}, "no switching 'hard'"),
    ],
)
def test_settings_out_of_range_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        coefficients(replace(EstimatorSettings(), **change))  # type: ignore[arg-type]


def test_edges_of_another_encoder_or_out_of_order_are_refused() -> None:
    with pytest.raises(UsageError, match="make them equal"):
        velocities(edges_of(lambda t: 0.1 * t, 0.01, increment_m=1e-6), EstimatorSettings(), 0.01)
    with pytest.raises(DataError, match="sort the edges"):
        velocities(Edges(np.array([5, 3]), np.array([0, 1]), np.array([1, 1]), 0, 0), EstimatorSettings(), 0.01)
