"""Faults as knobs: what can be made to go wrong on the virtual drive, before or while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Faults:
    """What is wrong with this drive; times are virtual time in s, None is never.

    drop_tpdo : numbers (from 1) of the transmit PDOs, counted over all four, that get lost on the bus.
    ignore_sync, late_sync : numbers (from 1) of the SYNCs that are not seen, or acted upon one tick later.
    emergency_at_s, emergency_code : the drive goes into fault by itself, stage off, with this EMCY error code.
    rated_torque_nm : 6076h reads this value; the currents stay those of the real motor.
    stuck_from_s : the axis is blocked from then on, whatever the torque.
    encoder_sign : -1 counts the wrong way round.
    encoder_step_at_s, encoder_step_counts : the encoder jumps once.
    silent_from_s : cable pulled: nothing is received or sent; the drive itself runs on.
    refused_modes : modes of operation that 6060h takes but 6061h never shows.
    guarding_ignored, guarding_coasts : a host that falls silent is not noticed, or its loss cuts the stage off instead of braking.
    torque_stop_coasts : a quick stop out of torque mode only takes the torque away, no loop brakes.
    gain_factor : the velocity gain is this many times what its object says, read anew with every write of a gain.
    """

    drop_tpdo: frozenset[int] = frozenset()
    ignore_sync: frozenset[int] = frozenset()
    late_sync: frozenset[int] = frozenset()
    emergency_at_s: float | None = None
    emergency_code: int = 0x3220
    rated_torque_nm: float | None = None
    stuck_from_s: float | None = None
    encoder_sign: int = 1
    encoder_step_at_s: float | None = None
    encoder_step_counts: int = 0
    silent_from_s: float | None = None
    refused_modes: frozenset[int] = frozenset()
    guarding_ignored: bool = False
    guarding_coasts: bool = False
    torque_stop_coasts: bool = False
    gain_factor: float = 1.0
