"""Faults as knobs: what can be made to go wrong on the virtual drive and on its bus, before or while they run.

The drive's own faults (:class:`Faults`) and those of the wire and of the host at its end (:class:`BusFaults`) know nothing of each other.
Times are virtual time in s; None is never.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

#: V: below, the stage of the virtual drive cannot be switched on.
LOWEST_DC_LINK_V = 100.0

FrameKind = Literal["nmt", "sync", "emcy", "tpdo", "rpdo", "sdo answer", "sdo request", "life", "other"]
#: Function code (identifier >> 7) of the predefined connection set, CiA 301, table 38.
_KINDS: tuple[FrameKind, ...] = (
    *("nmt", "emcy", "other", "tpdo", "rpdo", "tpdo", "rpdo", "tpdo", "rpdo", "tpdo", "rpdo"),
    *("sdo answer", "sdo request", "other", "life", "other"),
)


def kind_of(identifier: int) -> FrameKind:
    """Purpose of a frame, by its identifier; ``life`` is boot-up, heartbeat and node guarding.

    Parameters
    ----------
    identifier : int
        COB-ID of 11 bits.
    """
    return "sync" if identifier == 0x80 else _KINDS[identifier >> 7 & 0xF]


@dataclass
class Faults:
    """Faults of this drive.

    Attributes
    ----------
    drop_tpdo : frozenset[int]
        Numbers (from 1) of the transmit PDOs, counted over all four, that get lost on the bus.
    ignore_sync, late_sync : frozenset[int]
        Numbers (from 1) of the SYNCs that are not seen, or acted upon one tick later.
    emergency_at_s, emergency_code
        The drive raises this EMCY error code by itself.
    emergency_effect : Literal['off', 'brake', 'report']
        "off" takes the stage off at once, "brake" brakes first, "report" goes on as if nothing had been.
    rated_torque_nm : float or None
        6076h reads this value; the currents stay those of the real motor.
    misread : Mapping[tuple[int, int], int]
        (index, subindex) -> whole number that a read by SDO gives in place of the truth; the drive goes on with the truth.
    stuck_from_s : float or None
        The axis is blocked from then on, whatever the torque.
    weak_from_s, weak_share
        From then on only this share of the torque acts, while 6077h reports all of it.
    encoder_sign : int
        -1 counts the wrong way round.
    encoder_step_at_s, encoder_step_counts
        The encoder jumps once.
    end_switch_from_s, end_switch
        The lower (0) or upper (1) end switch reads as pressed.
    warm_from_s, warm_for_s
        over-temperature: the warning bit, and so long after it fault 4310h.
    reset_at_s : float or None
        The node restarts by itself: boot-up message, stage off, what was not saved is gone.
    silent_from_s : float or None
        Cable pulled: nothing is received or sent; the drive itself runs on.
    refused_modes : frozenset[int]
        Modes of operation that 6060h takes but 6061h never shows.
    sdo_abort : Mapping[int, int]
        Number (from 1) of an SDO transfer -> abort code it is answered with; nothing is read or written.
    sdo_silent : frozenset[int]
        Numbers of the SDO transfers that are neither carried out nor answered.
    dc_link_v : float or None, V
        What 6079h reads; below :data:`LOWEST_DC_LINK_V` there is no power at the stage.
    sto_open, enable_input_low : bool
        The safe torque off circuit, the controller enable input; the stage stays, or goes, off.
    local_control : bool
        A panel or the maker's tool has the control: controlwords are not obeyed.
    remote_frames_blocked : bool
        Remote frames do not arrive, as behind an adapter that has none.
    readings : Mapping[tuple[int, int], int]
        What objects hold from power-on in place of their own value, by (index, subindex); the drive itself does not use it where the
        object is read-only.
    guarding_ignored, guarding_coasts : bool
        A host that falls silent is not noticed, or its loss cuts the stage off instead of braking.
    torque_stop_coasts : bool
        A quick stop out of torque mode only takes the torque away, no loop brakes.
    rewritten_at_s, rewritten
        Somebody at a panel or the maker's tool writes these objects then: (index, subindex) -> factor and summand of what stands there.
    gain_factor : float
        The velocity gain is this many times what its object says, read anew with every write of a gain.
    """

    drop_tpdo: frozenset[int] = frozenset()
    ignore_sync: frozenset[int] = frozenset()
    late_sync: frozenset[int] = frozenset()
    emergency_at_s: float | None = None
    emergency_code: int = 0x3220
    emergency_effect: Literal["off", "brake", "report"] = "off"
    rated_torque_nm: float | None = None
    misread: Mapping[tuple[int, int], int] = field(default_factory=dict)
    stuck_from_s: float | None = None
    weak_from_s: float | None = None
    weak_share: float = 0.1
    encoder_sign: int = 1
    encoder_step_at_s: float | None = None
    encoder_step_counts: int = 0
    end_switch_from_s: float | None = None
    end_switch: Literal[0, 1] = 0
    warm_from_s: float | None = None
    warm_for_s: float = 0.5
    reset_at_s: float | None = None
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
    rewritten_at_s: float | None = None
    rewritten: Mapping[tuple[int, int], tuple[float, float]] = field(default_factory=dict)
    gain_factor: float = 1.0
    sdo_abort: Mapping[int, int] = field(default_factory=dict)
    sdo_silent: frozenset[int] = frozenset()

    @property
    def has_power(self) -> bool:
        """True if the DC link could drive the motor."""
        return self.dc_link_v is None or self.dc_link_v >= LOWEST_DC_LINK_V

    @property
    def stage_blocked(self) -> bool:
        """True if something other than a fault keeps the stage off."""
        return self.sto_open or self.enable_input_low or (self.dc_link_v is not None and not self.has_power)


@dataclass(frozen=True)
class FrameFault:
    """Fault of some frames on their way.

    Attributes
    ----------
    what : Literal['lost', 'late', 'doubled', 'swapped']
        Lost, late by ``delay_s``, doubled, or swapped with the next frame of its direction.
    direction, kinds
        The frames it looks at. Of them it takes those with ``numbers`` (from 1), and of the rest a share ``rate``, drawn from the seed
        of :class:`BusFaults`.
    from_s, until_s : float
        When.
    """

    what: Literal["lost", "late", "doubled", "swapped"]
    direction: Literal["both", "to node", "to host"] = "both"
    kinds: frozenset[FrameKind] = frozenset(_KINDS) | {"sync"}
    rate: float = 0.0
    numbers: frozenset[int] = frozenset()
    from_s: float = 0.0
    until_s: float = math.inf
    delay_s: float = 0.003


@dataclass
class BusFaults:
    """Faults between the host and the nodes.

    Attributes
    ----------
    frames, seed
        Faults of single frames; the first that takes a frame has it.
    off_from_s, off_until_s
        bus-off: the interface raises python-can's errors, for good or for a time, and carries nothing.
    silent_from_s, silent_until_s
        Cable pulled at the host: nothing arrives anywhere, the interface notices nothing.
    clock_jump_at_s, clock_jump_s
        The host's clock jumps; ``stamps_only``: only the one that stamps received frames.
    host_dies_at_s : float or None
        The host is killed: from then on each of its calls raises :class:`HostDied` and does nothing.
    """

    frames: tuple[FrameFault, ...] = ()
    seed: int = 0
    off_from_s: float | None = None
    off_until_s: float = math.inf
    silent_from_s: float | None = None
    silent_until_s: float = math.inf
    clock_jump_at_s: float | None = None
    clock_jump_s: float = 0.0
    stamps_only: bool = False
    host_dies_at_s: float | None = None


class HostDied(BaseException):
    """The host was killed.  Nothing may catch it, as nothing catches a SIGKILL; who does gets it again with the next call."""
