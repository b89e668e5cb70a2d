"""Reference generators against the closed forms of uniformly accelerated motion."""

from __future__ import annotations

import math

import pytest

from beltcomm.virtual.motion import Interpolator, Ramp, ReferenceProfile, trapezoid


def run(trajectory: ReferenceProfile, ticks: int = 100000) -> list[tuple[float, float, float]]:
    samples: list[tuple[float, float, float]] = []
    while not trajectory.done and len(samples) < ticks:
        trajectory.step()
        samples.append((trajectory.position, trajectory.speed, trajectory.acceleration))
    return samples


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_trapezoid_takes_the_time_of_the_closed_form(sign: float) -> None:
    # 2 rad at 4 rad/s, 20 and 40 rad/s²: ramps of 0.2 s and 0.1 s over 0.4 and 0.2 rad, 1.4 rad in 0.35 s.
    segments = trapezoid(sign * 2.0, 0.0, 4.0, 20.0, 40.0)
    assert [s[0] for s in segments] == pytest.approx([0.2, 0.35, 0.1])
    assert [s[1] for s in segments] == [sign * 20.0, 0.0, -sign * 40.0]


def test_triangle_when_the_speed_is_not_reached() -> None:
    # v² (1/2a + 1/2d) = D.
    segments = trapezoid(0.3, 0.0, 100.0, 20.0, 40.0)
    peak = math.sqrt(0.3 / (1 / 40 + 1 / 80))
    assert [s[0] for s in segments] == pytest.approx([peak / 20.0, 0.0, peak / 40.0])


@pytest.mark.parametrize("distance", [2.0, -2.0, 0.05, 0.0, 0.4])
@pytest.mark.parametrize("speed", [0.0, 3.0, -3.0, 9.0])
def test_every_start_ends_at_rest_on_the_target_within_the_limits(distance: float, speed: float) -> None:
    segments = trapezoid(distance, speed, 4.0, 20.0, 40.0)
    position, v, top = 0.0, speed, abs(speed)
    for duration, acceleration in segments:
        assert duration >= 0.0
        assert abs(acceleration) in (0.0, 20.0, 40.0)
        position += v * duration + 0.5 * acceleration * duration**2
        v += acceleration * duration
        top = max(top, abs(v))
    assert position == pytest.approx(distance, abs=1e-12)
    assert v == pytest.approx(0.0, abs=1e-12)
    assert top <= max(4.0, abs(speed)) + 1e-12


def test_trajectory_is_the_segments_at_the_ticks() -> None:
    trajectory = ReferenceProfile(1.0, 0.0, 1e-3)
    trajectory.run(trapezoid(2.0, 0.0, 4.0, 20.0, 40.0), 3.0)
    samples = run(trajectory)
    assert len(samples) in (650, 651)  # 0.65 s, by rounding found at its end or one tick later
    assert samples[99] == pytest.approx((1.0 + 0.5 * 20.0 * 0.1**2, 2.0, 20.0))
    assert samples[299] == pytest.approx((1.4 + 4.0 * 0.1, 4.0, 0.0))
    assert samples[-1] == (3.0, 0.0, 0.0)


def test_ramp_rises_and_falls_with_its_own_slopes() -> None:
    ramp = Ramp(0.0, 1e-3)
    values = []
    for target in [1.0] * 30 + [-1.0] * 40:
        ramp.step(target, 62.5, 125.0)  # 1/16 and 1/8 per tick
        values.append(ramp.value)
    assert values[7] == 0.5
    assert values[15:30] == [1.0] * 15
    assert values[37] == 0.0  # eight ticks towards zero
    assert values[45] == -0.5  # eight ticks away from it
    assert values[-1] == -1.0
    assert ramp.slope == 0.0


def test_a_steep_ramp_reverses_within_one_tick() -> None:
    ramp = Ramp(0.3, 1e-3)
    ramp.step(-0.3, 1e9, 1e9)
    assert ramp.value == -0.3
    ramp.step(0.3, 500.0, 1e9)  # what the way to zero leaves of the tick is spent on the slope away from it
    assert ramp.value == 0.3
    ramp.step(-10.0, 500.0, 600.0)
    assert ramp.value == pytest.approx(-500.0 * (1e-3 - 0.3 / 600.0))


def test_interpolator_reaches_a_setpoint_after_its_period() -> None:
    interpolator = Interpolator(0.0, 0.0)
    got = []
    for tick in range(12):
        target = (4.0, 2.0) if tick < 4 else (8.0, 0.0)
        interpolator.step(*target, 4)
        got.append((interpolator.position, interpolator.speed))
    assert [p for p, _ in got] == pytest.approx([1, 2, 3, 4, 5, 6, 7, 8, 8, 8, 8, 8])
    assert [v for _, v in got] == pytest.approx([0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0, 0, 0, 0, 0])


def test_interpolator_with_one_tick_is_the_setpoint() -> None:
    interpolator = Interpolator(0.0, 0.0)
    interpolator.step(5.0, 1.0, 1)
    assert (interpolator.position, interpolator.speed) == (5.0, 1.0)
