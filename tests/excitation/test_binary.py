"""The sequence is checked against the algebra of maximal-length sequences, the drift against a free inertia."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation import MAXIMAL_TAPS, choose_prbs, prbs, prbs_bits

T_S = 1e-3


@pytest.mark.parametrize("order", range(3, 17))
def test_bits_are_a_maximal_length_sequence(order: int) -> None:
    bits = prbs_bits(order)
    length = 2**order - 1
    assert len(bits) == length
    # Every non-zero word of `order` bits appears exactly once in a period: the definition of maximal length.
    wrapped = np.concatenate((bits, bits[: order - 1]))
    words = sum(wrapped[i : i + length].astype(int) << i for i in range(order))
    assert np.array_equal(np.sort(words), np.arange(1, length + 1))
    # So it is two-valued under cyclic correlation: M at zero shift, -1 elsewhere (as a ±1 sequence).
    signs = 2.0 * bits - 1.0
    correlation = np.fft.irfft(np.abs(np.fft.rfft(signs)) ** 2, n=length)
    assert correlation[0] == pytest.approx(length)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-6)


def test_orders_are_those_of_the_table() -> None:
    assert sorted(MAXIMAL_TAPS) == list(range(3, 17))
    with pytest.raises(UsageError, match="order 17"):
        prbs_bits(17)


def test_amplitude_is_peak_to_peak_and_mean_is_taken_away() -> None:
    excitation = prbs(9, 2, 0.3, T_S, repeats=3)
    period = excitation.torque[excitation.first_sample : excitation.first_sample + excitation.period_samples]
    assert excitation.period_samples == 2 * 511
    assert np.ptp(period) == pytest.approx(0.3)
    assert period.sum() == pytest.approx(0.0, abs=1e-12)
    # The zeros, one fewer than the ones, carry A/2 + A/(2M) after the compensation: closed form of (3.4).
    assert excitation.amplitude_nm == pytest.approx(0.15 * (1 + 1 / 511))
    # Each value is held for the clock.
    changes = np.flatnonzero(np.diff(np.concatenate((period, period[:1]))))
    assert np.all(np.diff(changes) % 2 == 0)


def test_record_is_rest_run_in_periods_rest() -> None:
    excitation = prbs(7, 2, 0.3, T_S, repeats=4)
    n, first = excitation.period_samples, excitation.first_sample
    assert first == 250 + 1 + n
    assert len(excitation.torque) == first + 4 * n + 1 + 450
    assert excitation.duration_s == pytest.approx(len(excitation.torque) * T_S)
    assert not excitation.torque[:250].any()
    assert not excitation.torque[-450:].any()
    for k in range(-1, 4):
        np.testing.assert_array_equal(excitation.torque[first + k * n : first + (k + 1) * n], excitation.torque[first : first + n])
    assert excitation.band_hz == pytest.approx((1 / (127 * 2e-3), 500.0))
    with pytest.raises(ValueError, match="read-only"):
        excitation.torque[0] = 1.0


@pytest.mark.parametrize("step", [0.0, 1.43e-3])
@pytest.mark.parametrize(("order", "clock"), [(7, 1), (9, 2), (10, 2), (11, 3)])
def test_a_free_inertia_comes_back_to_where_it_was(order: int, clock: int, step: float) -> None:
    excitation = prbs(order, clock, 0.3, T_S, repeats=5, torque_step_nm=step)
    inertia = 0.002145  # kg m2, G_A
    speed = np.concatenate(([0.0], np.cumsum(excitation.torque))) * T_S / inertia
    angle = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2))) * T_S  # exact for a held torque
    assert speed[-1] == pytest.approx(0.0, abs=1e-12)
    # What erratum 10 warns of, for comparison: mean A/(2M) uncompensated moves it by u t^2/(2 J).
    uncompensated = 0.3 / (2 * (2**order - 1)) * excitation.duration_s**2 / (2 * inertia)
    if step == 0:
        assert abs(angle[-1]) < 1e-9
        at_periods = angle[excitation.first_sample :: excitation.period_samples][: excitation.repeats + 1]
        np.testing.assert_allclose(at_periods, at_periods[0], atol=1e-9)
    else:  # rounding of the momentum leaves a mean of at most half a step for one sample
        assert abs(angle[-1]) <= 0.5 * step * T_S / inertia * excitation.duration_s
    assert abs(angle[-1]) < 0.01 * uncompensated


def test_torque_is_a_whole_number_of_steps() -> None:
    step = 1.43e-3
    plain, stepped = prbs(9, 2, 0.3, T_S, 3), prbs(9, 2, 0.3, T_S, 3, torque_step_nm=step)
    counts = stepped.torque / step
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    assert np.max(np.abs(np.cumsum(stepped.torque - plain.torque))) <= 0.5 * step + 1e-12
    assert np.max(np.abs(stepped.torque - plain.torque)) <= step + 1e-12
    period = stepped.torque[stepped.first_sample : stepped.first_sample + stepped.period_samples]
    assert period.sum() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "arguments", [(9, 0, 0.3, T_S, 3), (9, 2, 0.3, T_S, 0), (9, 2, 0.0, T_S, 3), (9, 2, 0.3, 0.0, 3), (2, 2, 0.3, T_S, 3)]
)
def test_impossible_values_are_refused(arguments: tuple[int, int, float, float, int]) -> None:
    with pytest.raises(UsageError):
        prbs(*arguments)


def test_amplitude_below_a_step_is_refused() -> None:
    with pytest.raises(UsageError, match=r"at least 0\.004"):
        prbs(9, 2, 0.003, T_S, 3, torque_step_nm=0.002)


@pytest.mark.parametrize(("lowest", "highest"), [(19.59, 107.11), (76.51, 134.0), (22.5, 133.78), (71.17, 149.85)])
def test_at_one_kilohertz_the_choice_is_clock_2_and_order_9_to_11(lowest: float, highest: float) -> None:
    """thesis.md, erratum 9; frequencies of its section 3."""
    choice = choose_prbs(T_S, lowest, highest, duration_s=10.0)
    assert choice.clock == 2
    assert 9 <= choice.order <= 11
    excitation = prbs(choice.order, choice.clock, 0.3, T_S, choice.repeats)
    assert excitation.duration_s <= 10.0
    assert excitation.duration_s + excitation.period_samples * T_S > 10.0
    assert f"order {choice.order}, clock 2" in choice.reason


def test_a_clock_whose_period_is_too_long_gives_way_to_a_smaller_one() -> None:
    """A geared rig, 19.6 and 43.9 Hz: clock 7 with order 8 takes 1.79 s a period, too long for three of them in 7 s."""
    long, short = (choose_prbs(T_S, 19.6, 43.9, duration_s=seconds) for seconds in (8.0, 7.0))
    assert (long.clock, long.order) == (7, 8)
    assert short.clock < 7
    assert short.repeats >= 3
    assert 1.0 / ((2**short.order - 1) * short.clock * T_S) <= 1.0
    assert prbs(short.order, short.clock, 0.3, T_S, short.repeats).duration_s <= 7.0


def test_at_the_thesis_sampling_the_clock_grows() -> None:
    choice = choose_prbs(62.5e-6, 19.59, 107.11, duration_s=10.0)
    half_power_hz = 0.443 / (choice.clock * 62.5e-6)
    assert half_power_hz >= 2**0.5 * 107.11
    assert 0.443 / ((choice.clock + 1) * 62.5e-6) < 2**0.5 * 107.11
    assert 1.0 / ((2**choice.order - 1) * choice.clock * 62.5e-6) <= 1.0


def test_resonance_beyond_the_sampling_is_refused_with_numbers() -> None:
    with pytest.raises(Refused, match=r"600 Hz .* ends at 500 Hz .* every 0\.758 ms"):
        choose_prbs(T_S, 71.17, 600.0, 10.0)


def test_too_little_time_is_refused_with_the_time_that_would_do() -> None:
    with pytest.raises(Refused, match=r"allow (\S+) s") as refused:
        choose_prbs(T_S, 19.59, 107.11, 3.0)
    needed = 0.25 + 0.45 + 2e-3 + 4 * 1.022
    assert f"allow {needed:.3g} s" in str(refused.value)
    assert choose_prbs(T_S, 19.59, 107.11, needed).repeats == 3


def test_lines_closer_than_the_longest_sequence_are_refused() -> None:
    with pytest.raises(Refused, match="beyond order 16"):
        choose_prbs(T_S, 0.05, 107.11, 1000.0)
    with pytest.raises(UsageError):
        choose_prbs(T_S, 100.0, 50.0, 10.0)
