"""1010h and 1011h, power cycles and resets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from virtual.host import Abort, Host

MakeHost = Callable[..., Host]
SAVE, LOAD = 0x65766173, 0x64616F6C


def reset(one: Host) -> None:
    one.send(0x000, b"\x81\x01")
    one.run(0.1)


def test_what_is_saved_survives_a_power_cycle_and_the_rest_does_not(host: MakeHost) -> None:
    stored: dict[Any, Any] = {}
    one = host(nonvolatile=stored)
    assert one.read(0x1010, 1) == 1
    one.write(0x2100, 1, 0.5, "f")
    one.write(0x6071, 0, 5, "h")
    one.write(0x1800, 1, 0x80000199, "I")
    one.write(0x1010, 1, SAVE, "I")
    one.write(0x2100, 3, 9.0, "f")  # after saving
    again = host(nonvolatile=stored)
    assert again.read(0x2100, 1, "f") == 0.5
    assert again.read(0x2100, 3, "f") == 1.0
    assert again.read(0x6071) == 0  # a setpoint is no parameter
    assert again.read(0x1800, 1) == 0x80000199


def test_saved_gains_are_in_force_after_a_reset(host: MakeHost) -> None:
    one = host()
    one.gains(kp=0.1, ki=0.0, kpp=0.0, forward=0.0)
    one.write(0x1010, 1, SAVE, "I")
    reset(one)
    one.enable(9)
    one.write(0x60FF, 0, 10430, "i")  # 1 rad/s
    one.run(0.001)
    assert one.read(0x6074, code="h") == 70  # 0.1 N m


def test_restore_takes_effect_with_the_next_reset(host: MakeHost) -> None:
    one = host()
    one.write(0x2100, 1, 0.5, "f")
    one.write(0x1010, 1, SAVE, "I")
    one.write(0x1011, 1, LOAD, "I")
    assert one.read(0x2100, 1, "f") == 0.5
    reset(one)
    assert one.read(0x2100, 1, "f") == pytest.approx(0.002)


def test_save_needs_the_stage_off(host: MakeHost) -> None:
    one = host()
    one.enable(10)
    with pytest.raises(Abort, match=str(0x08000022)):
        one.write(0x1010, 1, SAVE, "I")


def test_factory_values_of_the_reference_page(host: MakeHost) -> None:
    one = host()
    expected = (0.002, 0.02, 1.0, 0.002, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    read = [one.read(0x2100, sub, "B" if sub in (5, 8) else "f") for sub in range(1, 16)]
    assert read == pytest.approx(expected)
    assert one.read(0x2101, 1) == 1000
    assert one.read(0x2101, 2) == 1
    assert one.read(0x6076) == 1430
    assert one.read(0x6075) == 2200
    assert [one.read(0x1018, sub) for sub in (1, 2)] == [0, 1]
    assert [one.read(index, sub) for index in (0x608F, 0x6091, 0x6092) for sub in (1, 2)] == [65536, 1, 1, 1, 65536, 1]
