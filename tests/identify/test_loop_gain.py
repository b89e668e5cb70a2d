"""The law of a controller from its answers: exact laws written down here give records, with noise, counts and a moving axis."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.identify.loop_gain import Gain, Steps, VelocityLaw, position_gain, velocity_law

PERIOD_S, PULSE = 1e-3, 16
ONE = np.repeat([1.0, 0.0, -1.0, 0.0], PULSE)


def answered(
    kp: float, tn_s: float, late: int, noise_nm: float, seed: int, kpp: float | None = None, inertia: float = math.inf, repeats: int = 16
) -> Steps:
    """A drive's loop sample by sample: forward-Euler PI on a setpoint ``late`` samples old; its torque moves an inertia (inf: held)."""
    asked = (0.1 if kpp else 20.0) * np.tile(ONE, repeats)
    rng, n = np.random.default_rng(seed), len(asked)
    torque, speed, angle = np.zeros(n), np.zeros(n), np.zeros(n)
    integral = 0.0
    for k in range(1, n):
        speed[k] = speed[k - 1] + PERIOD_S * torque[k - 1] / inertia
        angle[k] = angle[k - 1] + PERIOD_S * speed[k - 1]
        due = asked[k - late] if k >= late else 0.0
        error = (due if kpp is None else kpp * (due - angle[k - 1])) - speed[k - 1]
        torque[k] = kp * error + kp / tn_s * integral
        integral += PERIOD_S * error
    seen = torque + rng.normal(0.0, noise_nm, n)
    return Steps(PERIOD_S, asked, angle, speed, np.round(seen / 1.43e-3) * 1.43e-3, 4 * PULSE, noise_nm)


@pytest.mark.parametrize("inertia", [math.inf, 2e-3])
@pytest.mark.parametrize("late", [0, 1, 4])
def test_the_velocity_law_is_found_held_or_moving(inertia: float, late: int) -> None:
    found = velocity_law(answered(4.7e-3, 0.032, late, 6e-3, 1, inertia=inertia))
    assert abs(found.gain.value - 4.7e-3) < found.gain.interval < 0.06 * 4.7e-3
    assert abs(found.integral_time_s.value - 0.032) < 1.5 * found.integral_time_s.interval < 0.012


def test_the_intervals_hold_what_they_promise() -> None:
    """95 % intervals over 30 noises: binomial, fewer than 25 of 30 would happen once in 300 times by chance."""
    laws = [velocity_law(answered(4.7e-3, 0.048, 1, 6e-3, seed)) for seed in range(30)]
    assert sum(abs(one.gain.value - 4.7e-3) < one.gain.interval for one in laws) >= 25
    assert sum(abs(one.integral_time_s.value - 0.048) < one.integral_time_s.interval for one in laws) >= 25


@pytest.mark.parametrize("inertia", [math.inf, 2e-3])
def test_the_position_gain_is_found_above_it(inertia: float) -> None:
    law = VelocityLaw(Gain(0.02, 2e-4), Gain(0.032, 0.0))
    found = position_gain(answered(0.02, 0.032, 1, 6e-3, 2, kpp=25.0, inertia=inertia), law)
    assert abs(found.value - 25.0) < found.interval < 0.06 * 25.0


def test_what_cannot_be_told_is_said() -> None:
    with pytest.raises(DataError, match="cannot be told"):
        velocity_law(answered(4e-5, 0.032, 1, 6e-3, 1))  # 0.8 mN m in 6 mN m of noise
    steps = answered(4.7e-3, 0.032, 1, 1e-3, 1)
    limited = Steps(PERIOD_S, steps.setpoint, steps.position_rad, steps.velocity_rad_s, np.clip(steps.torque_nm, -0.02, 0.02), 64, 1e-3)
    with pytest.raises(DataError, match="does not answer the velocity loop's setpoint as a PI controller"):
        velocity_law(limited)
    wrong = Steps(PERIOD_S, steps.setpoint, steps.position_rad, steps.velocity_rad_s, -steps.torque_nm, 64, 1e-3)
    with pytest.raises(DataError, match="cannot be told"):
        velocity_law(wrong)


ROW_S, LOOPS, SLOW_PULSE, TN_S = 12.8e-3, 32, 8, 0.032


def answered_seldom(kp: float, phase: float, seed: int, kpp: float | None = None, repeats: int = 16) -> Steps:
    """A loop that runs 32 times between two rows, on an axis that friction holds; a setpoint acts ``phase`` of a period after its row."""
    asked = (0.1 if kpp else 20.0) * np.tile(np.repeat([1.0, 0.0, -1.0, 0.0], SLOW_PULSE), repeats)
    rng, n, loop_s = np.random.default_rng(seed), len(asked), ROW_S / LOOPS
    late, integral, torque = round(phase * LOOPS), 0.0, np.zeros(n * LOOPS)
    for k in range(n * LOOPS):
        due = asked[(k - late) // LOOPS] if k >= late else 0.0
        error = due if kpp is None else kpp * due
        torque[k] = kp * error + kp / TN_S * integral
        integral += loop_s * error
    seen = torque[::LOOPS] + rng.normal(0.0, 2e-3, n)
    return Steps(ROW_S, asked, np.zeros(n), np.zeros(n), np.round(seen / 1.43e-3) * 1.43e-3, 4 * SLOW_PULSE, 2e-3)


@pytest.mark.parametrize("phase", [0.1, 0.5, 0.9])
def test_rows_that_are_seldom_tell_the_gains_beside_a_time_that_is_known(phase: float) -> None:
    """The step alone says them to 40 %: it cannot tell a setpoint that acts late in its period from a smaller gain."""
    law = velocity_law(answered_seldom(2e-3, phase, 3))
    found = law.gain_at(TN_S)
    assert law.gain.share > 0.3
    assert abs(found.value - 2e-3) < found.interval < 0.03 * 2e-3
    above = position_gain(answered_seldom(0.02, phase, 4, kpp=25.0), VelocityLaw(Gain(0.02, 2e-4), Gain(TN_S, 0.0)))
    assert abs(above.value - 25.0) < above.interval < 0.05 * 25.0


def test_the_interval_of_a_gain_by_its_slope_holds_what_it_promises() -> None:
    """95 % intervals over 30 noises and phases: fewer than 25 of 30 would happen once in 300 times by chance."""
    found = [velocity_law(answered_seldom(2e-3, (seed % 10) / 10.0, seed)).gain_at(TN_S) for seed in range(30)]
    assert sum(abs(one.value - 2e-3) < one.interval for one in found) >= 25


def test_a_loop_whose_integral_part_is_slow_is_told_by_its_steps() -> None:
    """Beside 16 rows of 1 ms, an integral time of 2 s leaves a slope of 1 %, which the noise hides."""
    law = velocity_law(answered(4.7e-3, 2.0, 1, 6e-3, 1))
    assert law.gain_at(2.0) == law.gain


@pytest.mark.parametrize("inertia", [math.inf, 2e-3])
@pytest.mark.parametrize("filter_s", [0.5e-3, 2e-3, 4.6e-3])
def test_a_reading_that_is_filtered_takes_nothing_from_the_gains(filter_s: float, inertia: float) -> None:
    """A torque behind 4.6 ms told the gain as 0.76 and the integral time as 0.60 times what they were, each to 7 %."""

    def filtered(steps: Steps) -> Steps:
        pole, seen = math.exp(-PERIOD_S / filter_s), np.zeros(len(steps.torque_nm))
        for k in range(1, len(seen)):
            seen[k] = pole * seen[k - 1] + (1.0 - pole) * steps.torque_nm[k]
        return Steps(PERIOD_S, steps.setpoint, steps.position_rad, steps.velocity_rad_s, seen, steps.repeat, steps.noise_nm)

    found = velocity_law(filtered(answered(4.7e-3, 0.032, 1, 6e-3, 1, inertia=inertia)))
    assert abs(found.gain.value - 4.7e-3) < found.gain.interval < 0.06 * 4.7e-3
    assert abs(found.integral_time_s.value - 0.032) < 1.5 * found.integral_time_s.interval < 0.012
    law = VelocityLaw(Gain(0.02, 2e-4), Gain(0.032, 0.0))
    above = position_gain(filtered(answered(0.02, 0.032, 1, 6e-3, 2, kpp=25.0, inertia=inertia)), law)
    assert abs(above.value - 25.0) < above.interval < 0.06 * 25.0
