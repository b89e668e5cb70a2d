"""Faults as knobs: what can be made to go wrong on the virtual drive, before or while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

#: V: below, the stage of the virtual drive cannot be switched on.
LOWEST_DC_LINK_V = 100.0


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
    dc_link_v : V, what 6079h reads; below :data:`LOWEST_DC_LINK_V` there is no power at the stage.
    sto_open, enable_input_low : the safe torque off circuit, the controller enable input; the stage stays, or goes, off.
    local_control : a panel or the maker's tool has the control: controlwords are not obeyed.
    remote_frames_blocked : remote frames do not arrive, as behind an adapter that has none.
    readings : what objects hold from power-on in place of their own value, by (index, subindex); the drive itself does not use it where
        the object is read-only.
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
    dc_link_v: float | None = None
    sto_open: bool = False
    enable_input_low: bool = False
    local_control: bool = False
    remote_frames_blocked: bool = False
    readings: Mapping[tuple[int, int], int] = field(default_factory=dict)
    guarding_ignored: bool = False
    guarding_coasts: bool = False
    torque_stop_coasts: bool = False
    gain_factor: float = 1.0

    @property
    def has_power(self) -> bool:
        """Whether the DC link could drive the motor."""
        return self.dc_link_v is None or self.dc_link_v >= LOWEST_DC_LINK_V

    @property
    def stage_blocked(self) -> bool:
        """Whether something other than a fault keeps the stage off."""
        return self.sto_open or self.enable_input_low or not self.has_power
