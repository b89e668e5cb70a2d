"""Which way the encoder counts, before a loop is closed on it: with the wrong sign each loop runs away, the quick stop's too."""

from __future__ import annotations

from beltcomm.session.creep import RAMP_S, creep
from beltcomm.session.machine import Machine
from beltcomm.session.phases import SIGN_REACH_M, SIGN_TRAVEL_M, room_around, room_to_creep

#: s of machine time, and what the plan says of it.
SIGN_SECONDS = RAMP_S + 0.5
SIGN_WORDS = f"creep some {1e3 * SIGN_TRAVEL_M:.0f} mm without a loop to check which way its encoder counts, then "


def check_sign(machine: Machine) -> None:
    """Let the carriage creep a little towards the middle of its travel under slowly rising torque.

    A tilted axis is not crept: its torque is felt for when it is identified, and a creep from zero torque would let it fall.
    Raises DriveError when it moves against the torque, UsageError too near to an end, and as :func:`creep`.
    """
    if machine.axis.mounting.tilted:
        return
    at = room_to_creep(machine)
    low, high = machine.full_room().window_m
    way = SIGN_TRAVEL_M if at < 0.5 * (low + high) else -SIGN_TRAVEL_M
    begun = machine.drive.clock.now()
    crept = creep(machine.drive, machine.axis, machine.drive_limits(room_around(machine, at, SIGN_REACH_M)), way, SIGN_REACH_M)
    machine.machine_seconds += machine.drive.clock.now() - begun
    machine.folder.journal(f"sign checked: {1e3 * crept.moved_m:+.1f} mm under {crept.onset_nm:.3f} N m")
