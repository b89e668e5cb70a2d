"""Direction in which the encoder counts, before a loop is closed on it: with the wrong sign each loop runs away, the quick stop's too."""

from __future__ import annotations

import math
from collections.abc import Collection

from beltcomm.axis import Axis
from beltcomm.experiments.phases import SIGN_REACH_M, SIGN_TRAVEL_M, envelope_around, feel_units, room_to_creep
from beltcomm.language import tr
from beltcomm.machine import host_loss
from beltcomm.machine.creep import RAMP_S, creep
from beltcomm.machine.machine import Machine

#: s of machine time, and what the plan says of it.
_SECONDS = RAMP_S + 0.5
_WORDS = f"creep some {1e3 * SIGN_TRAVEL_M:.0f} mm without a loop to check which way its encoder counts, then "


def _is_crept(axis: Axis, kinds: Collection[str]) -> bool:
    """True if :func:`check_sign` moves this axis with a drive that runs motions of these kinds.

    Without torque setpoints it cannot.  A tilted axis: its torque is felt for when it is identified, and a creep from zero torque would
    let it fall.
    """
    return "torque" in kinds and not axis.mounting.tilted


def sign_words(axis: Axis, kinds: Collection[str] = ("torque",)) -> str:
    """Words of a plan for what :func:`check_sign` does, before what the carriage does then.

    Parameters
    ----------
    axis : Axis
    kinds : collection of str
        Of setpoint that the drive takes.

    Returns
    -------
    str
        "" where nothing is crept.
    """
    return tr(_WORDS) if _is_crept(axis, kinds) else ""


def sign_seconds(axis: Axis, kinds: Collection[str] = ("torque",)) -> float:
    """Machine time of :func:`check_sign`, s.

    Parameters
    ----------
    axis : Axis
        With its tilt.
    kinds : collection of str
        Of setpoint that the drive takes.
    """
    return _SECONDS if _is_crept(axis, kinds) else 0.0


def check_sign(machine: Machine) -> None:
    """Let the carriage creep a little towards the middle of its travel under slowly rising torque.

    Nothing moves where :func:`_is_crept` says so.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    DriveError
        When it moves against the torque.
    UsageError
        Too near to an end, and as :func:`creep`.
    """
    if not _is_crept(machine.axis, machine.drive.capabilities.kinds):
        return
    at = room_to_creep(machine)
    low, high = machine.envelope().window_m
    way, left = (SIGN_TRAVEL_M, high - at) if at < 0.5 * (low + high) else (-SIGN_TRAVEL_M, at - low)
    host_loss.prove(machine)
    begun = machine.drive.clock.now()
    limits = machine.drive_limits(envelope_around(machine, at, SIGN_REACH_M))
    feel_units(machine, limits, math.copysign(1.0, way), min(SIGN_REACH_M, left))
    crept = creep(machine.drive, machine.axis, limits, way, min(SIGN_REACH_M, left), left_m=left)
    machine.machine_seconds += machine.drive.clock.now() - begun
    machine.folder.journal(f"sign checked: {1e3 * crept.moved_m:+.1f} mm under {crept.onset_nm:.3f} N m")
