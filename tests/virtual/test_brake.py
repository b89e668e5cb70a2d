"""The holding brake of the virtual drive: when it opens and closes, on a hanging mass that nothing else holds."""

from __future__ import annotations

import pytest

from beltcomm.errors import UsageError
from beltcomm.virtual.cia402 import DriveState
from virtual.host import INERTIA, UNIT_NM, Host, RigidPlant

#: N m that pull; s that the brake takes.
WEIGHT_NM, BRAKE_S = 0.143, 0.02


class Hanging(RigidPlant):
    """A mass that falls with 71.5 rad/s² unless the brake is closed, which stops it at once."""

    closed = False

    def brake(self, torque_nm: float) -> None:
        self.closed = torque_nm > WEIGHT_NM

    def step(self, torque_nm: float, duration_s: float) -> None:
        if self.closed:
            self.velocity_rad_s = 0.0
            return
        super().step(torque_nm - WEIGHT_NM, duration_s)


def held(one: Host) -> None:
    """Enabled in torque mode with the torque that holds the mass, the brake open."""
    one.write(0x6071, 0, round(WEIGHT_NM / UNIT_NM), "h")
    one.enable(10)
    one.run(BRAKE_S + 0.01)


def test_the_brake_opens_after_its_time_and_the_setpoint_holds() -> None:
    one = Host(Hanging(), brake=(2.0, BRAKE_S))
    one.run(0.5)
    assert one.plant.position_rad == 0.0
    held(one)
    assert not one.plant.closed
    assert abs(one.plant.position_rad) < 1e-9  # the setpoint acts long before the brake is open
    one.write(0x6071, 0, 0, "h")
    one.run(0.1)
    assert one.plant.velocity_rad_s < -5.0


def test_a_stage_that_is_cut_off_leaves_the_axis_free_until_the_brake_has_closed() -> None:
    one = Host(Hanging(), brake=(2.0, BRAKE_S))
    held(one)
    one.write(0x6040, 0, 0x0000, "H")
    one.run(0.5)
    # half a t²: the brake's time and up to a tick of it
    fall = 0.5 * WEIGHT_NM / INERTIA * BRAKE_S**2
    assert fall * 0.99 < -one.plant.position_rad < 0.5 * WEIGHT_NM / INERTIA * (BRAKE_S + 2e-3) ** 2
    assert one.plant.velocity_rad_s == 0.0


def test_a_quick_stop_keeps_its_torque_until_the_brake_has_closed() -> None:
    one = Host(Hanging(), brake=(2.0, BRAKE_S))
    one.write(0x2100, 12, WEIGHT_NM, "f")  # the offset of the drive's own loops
    held(one)
    one.write(0x6040, 0, 0x0002, "H")
    one.run(0.5)
    assert one.state() == DriveState.SWITCH_ON_DISABLED
    assert abs(one.plant.position_rad) < 1e-4  # without the offset it falls by radians: K_P is 0.002


def test_a_machine_without_a_brake_cannot_have_one_closed() -> None:
    with pytest.raises(UsageError, match="no brake that the drive could close"):
        Host(RigidPlant(), brake=(2.0, BRAKE_S))
