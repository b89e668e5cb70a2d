"""When a setpoint acts, when it is reported, and what a sample holds, against SYNC."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from virtual.host import SYNC, UNIT_NM, Host, prepared

MakeHost = Callable[..., Host]


def test_setpoint_received_after_sync_k_acts_from_t_k_plus_1_plus_the_delay() -> None:
    one = prepared(setpoint_delay_s=0.001)
    one.plant.steps.clear()
    reported = [one.cycle(setpoint)[1] for setpoint in (100, 200, 0, 0, 0, 0)]
    # Sent after SYNC 0, active at SYNC 1, decided at t_1, acts in [t_2, t_3): the third step.
    assert [torque for torque, _ in one.plant.steps] == pytest.approx([0, 0, 100 * UNIT_NM, 200 * UNIT_NM, 0, 0])
    assert reported == [0, 0, 0, 100, 200, 0]  # at SYNC 3 the torque of [t_2, t_3)
    one.close()


@pytest.mark.parametrize(
    ("delay_s", "steps"),
    [
        (0.0, [(0, 1), (1, 1), (0, 1), (0, 1)]),
        (0.0004, [(0, 0.4), (0, 0.6), (0, 0.4), (1, 0.6), (1, 0.4), (0, 0.6), (0, 0.4), (0, 0.6)]),
        (0.0025, [(0, 0.5), (0, 0.5)] * 3 + [(0, 0.5), (1, 0.5), (1, 0.5), (0, 0.5)]),
    ],
)
def test_any_delay_splits_the_tick_where_the_switch_falls(delay_s: float, steps: list[tuple[float, float]]) -> None:
    one = prepared(setpoint_delay_s=delay_s)
    one.plant.steps.clear()
    reported = [one.cycle(setpoint)[1] for setpoint in (500, 0, 0, 0, 0, 0, 0)]
    expected = [(500 * UNIT_NM * level, 1e-3 * part) for level, part in steps]
    assert np.array(one.plant.steps[: len(steps)]) == pytest.approx(np.array(expected), abs=1e-12)
    # The mean over ticks keeps the impulse of 1 ms.
    assert sum(reported) == 500
    one.close()


@pytest.mark.parametrize(("begin", "first"), [(0.45, 3), (0.55, 4), (-0.45, 3), (-0.55, 2)])
def test_position_is_the_encoder_at_sync_in_whole_counts(begin: float, first: int) -> None:
    one = prepared(counts_per_rev=1000, setpoint_delay_s=0.0)
    position = one.cycle(0)[0]
    one.plant.position_rad, one.plant.velocity_rad_s = 0.0, 2 * np.pi * 3.0  # 3 counts per tick
    one.plant.position_rad = 2 * np.pi / 1000 * begin
    got = [one.cycle(0)[0] for _ in range(4)]
    # Latched before the plant was moved by hand, then every millisecond: the nearest count to begin + 3 k.
    assert [position, *got] == [0, 0, first, first + 3, first + 6]
    one.close()


def test_torque_noise_has_the_stated_deviation_and_does_not_move_the_machine() -> None:
    one = prepared(torque_noise_nm=6e-3, seed=3)
    torque = np.array([one.cycle(0)[1] for _ in range(2000)]) * UNIT_NM
    # Quantisation adds unit²/12; a deviation from 2000 values is known to 1/sqrt(4000) = 1.6 %.
    assert np.std(torque) == pytest.approx(np.hypot(6e-3, UNIT_NM / np.sqrt(12)), rel=0.06)
    assert abs(np.mean(torque)) < 5 * 6e-3 / np.sqrt(2000)
    assert one.plant.position_rad == 0.0
    one.close()


def test_without_sync_the_last_setpoint_stays() -> None:
    one = prepared()
    one.cycle(50)
    one.send(SYNC)
    one.run(0.005)
    assert [torque for torque, _ in one.plant.steps[-3:]] == pytest.approx([50 * UNIT_NM] * 3)
    one.close()


def test_torque_offset_adds_up_and_the_limits_cut(host: MakeHost) -> None:
    one = host()
    one.enable(10)
    one.write(0x6071, 0, 100, "h")
    one.write(0x60B2, 0, 50, "h")
    one.run(0.005)
    assert one.plant.steps[-1][0] == pytest.approx(150 * UNIT_NM)
    assert one.status & 0x0800 == 0
    one.write(0x6072, 0, 120, "H")
    one.run(0.005)
    assert one.plant.steps[-1][0] == pytest.approx(120 * UNIT_NM)
    assert one.read(0x6074, code="h") == 120
    assert one.status & 0x0800  # internal limit
    one.write(0x6073, 0, 80, "H")
    one.run(0.005)
    assert one.plant.steps[-1][0] == pytest.approx(80 * UNIT_NM)
    for index in (0x6072, 0x6073):
        one.write(index, 0, 60000, "H")
    one.write(0x6071, 0, 32767, "h")
    one.run(0.005)
    assert one.plant.steps[-1][0] == pytest.approx(3.10)  # the motor's peak


def test_velocity_actual_value_is_the_filtered_difference(host: MakeHost) -> None:
    one = host()
    one.plant.velocity_rad_s = 100.0
    one.run(0.05)
    # At constant speed (6.1) gives the speed itself, within one count per tick.
    assert one.read(0x606C, code="i") == pytest.approx(100.0 * 65536 / (2 * np.pi), abs=1000)
    before = one.read(0x606C, code="i")
    one.plant.velocity_rad_s = 0.0
    one.run(0.001)
    # One step of the backward-difference filter with T_R = 2 ms, T = 1 ms: what is left is T_R/(T_R + T).
    assert one.read(0x606C, code="i") == pytest.approx(before * 2 / 3, abs=1000)
