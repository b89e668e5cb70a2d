"""Error formulas of 6.1 and appendix C: the printed numbers, their derivation, and simulation with the estimators on generated edges."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from beltcomm.encoder import formulas as f
from beltcomm.encoder.edges import edges_of
from beltcomm.encoder.estimators import EstimatorSettings, velocities
from beltcomm.errors import UsageError

STEP, TICK, PERIOD, LAG = 2.5e-6, 1e-8, 1e-3, 2e-3
#: In units of Δξ/T_s: neither they nor the ticks of their gaps, 10⁵ over them, lie near a whole number, so both roundings occur.
RATIOS = (2.3, 3.77, 12.4, 117.6, 801.1)


def measured_time_s(speed_m_s: ArrayLike) -> NDArray[np.float64]:
    """(C.4), with (6.7) and (6.8): T_n,inc = ⌊ξ T_s/Δξ_min⌋ Δξ_min/ξ, s, → T_s for high speeds (6.10)."""
    return f._intervals_printed(speed_m_s, STEP, PERIOD) * STEP / np.asarray(speed_m_s)


def event_counter_error_percent(speed_m_s: ArrayLike, sign: int) -> NDArray[np.float64]:
    """(6.11), (C.6): ∓100 ξ/(⌊ξ T_s/Δξ_min⌋ ξ_h,max), percent, for Δt_min ≪ T_s; (C.6) is printed without the 100."""
    return -sign * 100.0 * np.asarray(speed_m_s) / (f._intervals_printed(speed_m_s, STEP, PERIOD) * f.highest_speed_m_s(STEP, TICK))


def gate_rms_percent(speed_m_s: ArrayLike, increment_m: float, tick_s: float, intervals: ArrayLike = 1.0) -> NDArray[np.float64]:
    """100 Δt_min ξ/(√6 m Δξ_min), percent: rms over speeds and phases of (C.8), and of (C.5) with m intervals (not in the source).

    Two times, each rounded up to a tick: the difference of two uniform errors has the variance Δt_min²/6.   For errors ≪ 100 %.
    """
    return np.asarray(100.0 * tick_s * np.asarray(speed_m_s) / (np.sqrt(6.0) * np.asarray(intervals) * increment_m))


def high_pass_rms_percent(speed_m_s: ArrayLike, increment_m: float, period_s: float, lag_s: float) -> NDArray[np.float64]:
    """100 Δξ_min/((T_R + T_s) ξ √6) √((1 + p)⁻¹), p = T_R/(T_R + T_s), percent: rms where rounding is white (not in the source).

    Rounding has the variance Δξ_min²/12 and, from a few increments per period on, no memory; the sum of the squared weights of
    (1 − z⁻¹)/(1 − p z⁻¹) is 2/(1 + p).
    """
    pole = lag_s / (lag_s + period_s)
    return 100.0 * increment_m / ((lag_s + period_s) * np.asarray(speed_m_s)) * float(np.sqrt(1.0 / (6.0 * (1.0 + pole))))


def relative_errors(speed: float, method: str, phases: int = 12, periods: int = 40) -> np.ndarray:
    """Errors in percent at constant speed, over ``phases`` places where the axis begins."""
    duration = periods * PERIOD + 3.0 * STEP / speed
    errors = []
    for phase in range(phases):
        start = STEP * (0.05 + phase / phases)
        edges = edges_of(lambda t, start=start: start + speed * t, duration)  # type: ignore[misc]
        found = velocities(edges, EstimatorSettings(), duration, start_velocity_m_s=speed)
        assert found.invalid == 0
        errors.append(100.0 * (getattr(found, method)[found.t_s > 3.0 * STEP / speed] / speed - 1.0))
    return np.concatenate(errors)


def test_the_printed_numbers() -> None:
    assert f.highest_speed_m_s(STEP, TICK) == pytest.approx(250.0)  # (6.15)
    assert f.crossing_speed_m_s(STEP, TICK, PERIOD) == pytest.approx(2.0 * STEP / PERIOD, rel=1.1e-5)  # (6.19)
    assert f.event_counter_limit_percent(TICK, PERIOD) == pytest.approx(1e-3)  # (6.13)
    assert f.lowest_speed_m_s(STEP, 5.0 * PERIOD) == pytest.approx(0.5e-3)  # (6.18), T_out of figure 6.7


def test_appendix_c_leads_to_the_equations_of_the_chapter() -> None:
    speed = np.array([3.1e-3, 0.0213, 0.4567, 4.99])
    real, printed = f._increments_real(speed, STEP, PERIOD), f._intervals_printed(speed, STEP, PERIOD)
    np.testing.assert_allclose(real * STEP, f._travel_in_period_m(speed, PERIOD))  # (C.1), (C.2)
    assert np.all((printed <= real) & (real < printed + 1.0))  # (C.3)
    time = measured_time_s(speed)
    np.testing.assert_allclose(time * speed, printed * STEP)  # (C.4)
    for sign in (1, -1):
        # (C.5), first line: the velocity (6.4) with a time wrong by a tick.
        wrong = 100.0 * (printed * STEP / (time + sign * TICK) - speed) / speed
        np.testing.assert_allclose(f._event_counter_error_exact_percent(speed, STEP, TICK, PERIOD, sign=sign), wrong, rtol=1e-6)
        # (C.6) neglects ±Δt beside T_n, at most one part in T_n/Δt; its printed form lacks the factor 100.
        short = event_counter_error_percent(speed, sign)
        np.testing.assert_allclose(short / wrong, 1.0, atol=2.0 * TICK / time.min())
        # (C.8), first line.
        gap = f._gate_time_s(speed, STEP)
        wrong = 100.0 * (STEP / (gap + sign * TICK) - speed) / speed
        np.testing.assert_allclose(f.gate_error_percent(speed, STEP, TICK, sign=sign), wrong, rtol=1e-6)
        np.testing.assert_allclose(f._time_error_percent(gap, TICK, sign), wrong, rtol=1e-6)


def test_the_crossing_solves_6_12_equals_6_16() -> None:
    for sign in (1, -1):
        speed = f.crossing_speed_m_s(STEP, TICK, PERIOD, sign=sign)
        envelope = f.event_counter_envelope_percent(speed, STEP, TICK, PERIOD)
        assert envelope == pytest.approx(abs(float(f.gate_error_percent(speed, STEP, TICK, sign=sign))), rel=1e-9)
    apart = f.crossing_speed_m_s(STEP, TICK, PERIOD) / f.crossing_speed_m_s(STEP, TICK, PERIOD, sign=-1) - 1.0
    assert apart == pytest.approx(2.0 * TICK / PERIOD, rel=1e-3)


def test_6_13_is_a_limit() -> None:
    speeds = np.geomspace(0.01, 1e6, 50)
    envelope = f.event_counter_envelope_percent(speeds, STEP, TICK, PERIOD)
    assert np.all(np.diff(envelope) < 0.0), "falls all the way, so it has no smallest value"
    assert envelope[-1] == pytest.approx(f.event_counter_limit_percent(TICK, PERIOD), rel=1e-6)


@pytest.mark.parametrize("ratio", [0.173, *RATIOS])
def test_the_gate_is_off_by_up_to_a_tick_per_gap(ratio: float) -> None:
    speed = ratio * STEP / PERIOD
    errors = relative_errors(speed, "gate")
    assert np.max(errors) <= f.gate_error_percent(speed, STEP, TICK, sign=-1) * (1.0 + 1e-6)
    assert np.min(errors) >= f.gate_error_percent(speed, STEP, TICK) * (1.0 + 1e-6)
    # Of the two rounded gaps at a speed, the worse is off by half a tick or more.
    assert np.max(np.abs(errors)) >= 0.49 * abs(float(f.gate_error_percent(speed, STEP, TICK)))


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_period_holds_one_interval_less_than_c_3_says_at_worst(ratio: float) -> None:
    speed = ratio * STEP / PERIOD
    edges = edges_of(lambda t: 1e-7 + speed * t, 0.2)
    held = velocities(edges, EstimatorSettings(), 0.2).increments[1:] - 1
    assert held.max() == f._intervals_printed(speed, STEP, PERIOD)
    assert held.min() == f._intervals_fewest(speed, STEP, PERIOD)
    # How often the better case occurs is the broken part of ξ T_s/Δξ.
    assert np.mean(held == held.max()) == pytest.approx(ratio % 1.0, abs=0.02)


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_event_counter_keeps_its_true_worst_case(ratio: float) -> None:
    speed = ratio * STEP / PERIOD
    errors = relative_errors(speed, "event_counter")
    worst = float(f.event_counter_worst_percent(speed, STEP, TICK, PERIOD))
    assert np.max(np.abs(errors)) <= worst * (1.0 + 1e-6)
    assert np.max(np.abs(errors)) >= 0.49 * worst


def test_6_12_is_no_envelope_where_the_methods_cross() -> None:
    # From 2 to 3 increments per period a period with two increments has one gap, as the gate: (6.12) promises up to half of that.
    ratios = np.array([2.77, 2.83, 2.89, 2.97])
    beyond = []
    for ratio in ratios:
        speed = ratio * STEP / PERIOD
        errors = relative_errors(speed, "event_counter", phases=20)
        beyond.append(np.max(np.abs(errors)) / float(f.event_counter_envelope_percent(speed, STEP, TICK, PERIOD)))
        assert np.max(np.abs(errors)) == pytest.approx(np.max(np.abs(relative_errors(speed, "gate", phases=20))), rel=0.02)
    assert max(beyond) > 1.2


@pytest.mark.parametrize("lag", [0.0, LAG])
@pytest.mark.parametrize("ratio", [0.173, 3.77, 117.6])
def test_the_high_pass_keeps_its_bound(ratio: float, lag: float) -> None:
    speed, duration = ratio * STEP / PERIOD, 0.4
    errors = []
    for phase in range(6):
        edges = edges_of(lambda t, phase=phase: STEP * (0.05 + phase / 6.0) + speed * t, duration)  # type: ignore[misc]
        found = velocities(edges, EstimatorSettings(lag_s=lag), duration, start_velocity_m_s=speed)
        errors.append(100.0 * (found.high_pass / speed - 1.0))
    worst = float(f.high_pass_worst_percent(speed, STEP, PERIOD, lag))
    assert np.max(np.abs(errors)) <= worst * (1.0 + 1e-9)
    if lag == 0.0:  # counts per period are the two neighbours of the ratio
        assert np.max(np.abs(errors)) == pytest.approx(100.0 * max(ratio % 1.0, 1.0 - ratio % 1.0) / ratio, rel=1e-6)


def test_rms_over_many_speeds() -> None:
    # Speeds spread so that the broken parts of the gap in ticks and of the increments per period are uniform.
    gate, events, lagged = [], [], []
    speeds = 0.1234 * (1.0 + 0.02 * (np.arange(24) * 0.6180339887 % 1.0))
    for speed in speeds:
        gate.append(relative_errors(speed, "gate", phases=1))
        events.append(relative_errors(speed, "event_counter", phases=1))
        lagged.append(relative_errors(speed, "high_pass", phases=1)[15:])
    rms = [np.sqrt(np.mean(np.concatenate(e) ** 2)) for e in (gate, events, lagged)]
    mean = float(np.mean(speeds))
    assert rms[0] == pytest.approx(gate_rms_percent(mean, STEP, TICK), rel=0.1)
    assert rms[1] == pytest.approx(gate_rms_percent(mean, STEP, TICK, 49.0), rel=0.1)  # 49 or so intervals in a period
    assert rms[2] == pytest.approx(high_pass_rms_percent(mean, STEP, PERIOD, LAG), rel=0.15)


def test_the_gate_saturates_at_an_increment_per_tick() -> None:
    for speed in (90.0, 170.0, 249.0):
        duration = 2e-3
        found = velocities(edges_of(lambda t: speed * t, duration, scan_s=1e-5), EstimatorSettings(), duration)  # noqa: B023
        ticks = 250.0 / speed
        assert found.invalid == 0
        assert {round(250.0 / np.floor(ticks), 9), round(250.0 / np.ceil(ticks), 9)} >= {round(v, 9) for v in found.gate}
        # The event counter averages over the period and is right.
        assert found.event_counter[-1] == pytest.approx(speed, rel=1e-5 + TICK / PERIOD)
    too_fast = velocities(edges_of(lambda t: 260.0 * t, 2e-3, scan_s=1e-5), EstimatorSettings(), 2e-3)
    assert too_fast.invalid > 0, "beyond 250 m/s edges are lost, and it is told"


def test_delays_under_acceleration() -> None:
    # x = a t²/2: each estimate is the true velocity of some instant before; by how much is the delay.
    acceleration, duration = 4.0, 0.12
    edges = edges_of(lambda t: 0.5 * acceleration * t**2, duration)
    found = velocities(edges, EstimatorSettings(), duration)
    late = {m: found.t_s - getattr(found, m) / acceleration for m in ("high_pass", "event_counter", "gate")}
    settled = found.t_s > 0.03
    speed = acceleration * found.t_s[settled]
    # One tick in T_inc costs Δt ξ²/(Δξ a); half of it per edge.
    tick_cost = TICK * speed**2 / STEP / acceleration
    low, high = f.gate_delay_s(speed, STEP)
    # While speed rises, the gaps that lie behind are longer than Δξ/ξ now: by a factor 1 + 2 a gap/ξ to first order.
    longer = 1.0 + 2.0 * acceleration * STEP / speed**2
    assert np.all(late["gate"][settled] >= low - tick_cost)
    assert np.all(late["gate"][settled] <= high * longer + tick_cost)
    low, high = f.event_counter_delay_s(speed - acceleration * PERIOD, STEP, PERIOD)
    assert np.all((late["event_counter"][settled] >= low - 1e-6) & (late["event_counter"][settled] <= high + 1e-6))
    assert np.mean(late["event_counter"][settled]) == pytest.approx(0.5 * PERIOD, rel=0.02)
    assert np.mean(late["high_pass"][settled]) == pytest.approx(f.high_pass_delay_s(PERIOD, LAG), rel=0.01)


def test_the_delay_of_the_gate_fills_its_range() -> None:
    # Through 10 mm/s at 0.1 m/s², an increment per 0.25 ms, from 16 places between two lines; a tick is worth 4 us of delay here.
    shares = []
    for k in range(16):
        edges = edges_of(lambda t, k=k: STEP * (k + 0.5) / 16.0 + 0.05 * t**2, 0.105)  # type: ignore[misc]
        found = velocities(edges, EstimatorSettings(), 0.105)
        near = found.t_s > 0.095
        low, high = f.gate_delay_s(0.1 * found.t_s[near], STEP)
        shares.append((found.t_s[near] - found.gate[near] / 0.1 - low) / (high - low))
    spread = np.concatenate(shares)
    assert -0.03 <= np.min(spread) < 0.1
    assert 0.9 < np.max(spread) <= 1.03
    assert np.mean(spread) == pytest.approx(0.5, abs=0.03)


def test_where_a_formula_has_no_value() -> None:
    slow = np.array([1e-4, 2.4e-3])
    for values in (
        f.event_counter_envelope_percent(slow, STEP, TICK, PERIOD),
        f.event_counter_worst_percent(np.array([2.6e-3, 4.9e-3]), STEP, TICK, PERIOD),
    ):
        assert np.all(np.isnan(values))
    with pytest.raises(UsageError, match="not longer than the tick"):
        f.crossing_speed_m_s(STEP, TICK, TICK)
