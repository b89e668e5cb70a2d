"""Homing methods 17, 18, 35, 37."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from beltcomm.virtual.cia402 import DriveState
from virtual.host import COUNTS, Abort, Host

MakeHost = Callable[..., Host]
PER_RAD = COUNTS / (2 * math.pi)
REACHED, ATTAINED, FAILED, REFERENCED = 0x0400, 0x1000, 0x2000, 0x8000


@pytest.mark.parametrize("method", [35, 37])
@pytest.mark.parametrize("offset", [0, 1000])
def test_present_position(host: MakeHost, method: int, offset: int) -> None:
    one = host()
    one.place(1.0)
    one.write(0x6098, 0, method, "b")
    one.write(0x607C, 0, offset, "i")
    one.enable(6)
    one.run(0.001)
    assert one.status & (ATTAINED | REFERENCED) == 0
    one.control(0x1F)
    one.run(0.002)
    assert one.status & (REACHED | ATTAINED | FAILED | REFERENCED) == REACHED | ATTAINED | REFERENCED
    assert one.read(0x6064, code="i") == -offset  # zero = home + offset
    assert one.plant.position_rad == 1.0


@pytest.mark.parametrize(("method", "edge", "side"), [(17, -2.0, -1), (18, 3.0, 1)])
def test_end_switch(host: MakeHost, method: int, edge: float, side: int) -> None:
    one = host(end_switches_rad=(-2.0, 3.0))
    one.gains()
    one.write(0x6098, 0, method, "b")
    one.write(0x6099, 1, round(10 * PER_RAD), "I")
    one.write(0x6099, 2, round(0.5 * PER_RAD), "I")
    one.enable(6)
    one.control(0x1F)
    furthest, top = 0.0, 0.0
    for _ in range(3000):
        one.run(0.001)
        furthest = max(furthest, side * one.plant.position_rad)
        top = max(top, side * one.plant.velocity_rad_s)
    assert one.state() == DriveState.OPERATION_ENABLED  # a switch that is looked for is no fault
    assert one.status & (ATTAINED | FAILED | REFERENCED) == ATTAINED | REFERENCED
    assert furthest > side * edge
    assert top == pytest.approx(10.0, rel=0.1)
    # The edge is seen at the first tick behind it: within 0.5 rad/s for 1 ms, and a little for the loop.
    zero = one.plant.position_rad - one.read(0x6064, code="i") / PER_RAD
    assert zero == pytest.approx(edge, abs=1.5e-3)


def test_starting_on_the_switch_leaves_it(host: MakeHost) -> None:
    one = host(end_switches_rad=(-2.0, 3.0))
    one.gains()
    one.place(-2.05)
    one.write(0x6098, 0, 17, "b")
    one.enable(6)
    one.control(0x1F)
    one.run(1.5)
    assert one.status & ATTAINED
    assert one.plant.position_rad > -2.0


def test_taking_bit_4_back_stops_the_search(host: MakeHost) -> None:
    one = host(end_switches_rad=(-2000.0, 3000.0))
    one.gains()
    one.write(0x6098, 0, 18, "b")
    one.enable(6)
    one.control(0x1F)
    one.run(0.3)
    assert one.plant.velocity_rad_s > 1.0
    assert one.status & REACHED == 0
    one.control(0x0F)
    one.run(0.5)
    assert abs(one.plant.velocity_rad_s) < 0.1
    assert one.status & (ATTAINED | REFERENCED) == 0


def test_without_switches_the_search_is_an_error(host: MakeHost) -> None:
    one = host()
    one.write(0x6098, 0, 17, "b")
    one.enable(6)
    one.control(0x1F)
    one.run(0.002)
    assert one.status & (ATTAINED | FAILED) == FAILED
    assert one.of(0x81)[0][:2] == bytes.fromhex("808A")
    assert one.state() == DriveState.OPERATION_ENABLED


def test_methods_not_offered(host: MakeHost) -> None:
    with pytest.raises(Abort, match=str(0x06090030)):
        host().write(0x6098, 0, 7, "b")


def test_absolute_encoder_knows_its_zero(host: MakeHost) -> None:
    one = host(referenced=True, zero_rad=-1.0)
    one.run(0.001)
    assert one.status & REFERENCED
    assert one.read(0x6064, code="i") == round(PER_RAD)


def test_moves_after_homing_are_from_the_new_zero(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.place(1.0)
    one.enable(6)
    one.control(0x1F)
    one.run(0.01)
    one.control(0x0F)
    one.write(0x6060, 0, 1, "b")
    one.write(0x607A, 0, round(0.5 * PER_RAD), "i")
    one.control(0x1F)
    one.run(1.0)
    assert one.plant.position_rad == pytest.approx(1.5, abs=2e-3)
