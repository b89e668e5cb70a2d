"""Setpoints on the wire: which objects carry them in which mode of operation, and a motion in the drive's units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltcomm.drive import Motion, MotionKind
from beltcomm_adapters.cia402 import ENABLE_INTERPOLATION, ENABLE_OPERATION
from beltcomm_adapters.exchange import MappedObject
from beltcomm_adapters.scaling import Scaling

_CONTROLWORD: Final[MappedObject] = (0x6040, 0, 16)
_WORD, _TORQUE, _WORD_TORQUE, _WORD_LONG, _LONG_TORQUE = (Struct(code).pack for code in ("<H", "<h", "<Hh", "<Hi", "<ih"))
#: Modes in which a torque is commanded: profile and cyclic synchronous torque.
TORQUE_MODES: Final = (4, 10)
#: Modes in which a position controller runs.
POSITION_MODES: Final = (7, 8)
#: Modes in which the drive goes from one setpoint to the next on a straight line.
INTERPOLATED_MODES: Final = (7, 8, 9)
#: Modes in which 60B2h is added to the controller's torque.
OFFSET_MODES: Final = (8, 9)


@dataclass(frozen=True)
class Layout:
    """Way of the setpoints of one mode of operation to the drive.

    Attributes
    ----------
    received : tuple[tuple[MappedObject, ...], ...]
        Objects of each receive PDO; the first begins with 6040h.
    follows : bool
        Statusword bit 12 must be set.
    running : int
        Control word while moving.
    """

    mode: int
    received: tuple[tuple[MappedObject, ...], ...]
    follows: bool
    running: int = ENABLE_OPERATION


def layout_of(mode: int, offsets: bool) -> Layout:
    """The layout of the setpoints in a mode of operation.

    Parameters
    ----------
    mode : int
        3, 4, 6, 7, 8, 9 or 10.
    offsets : bool
        True if mode 8 carries 60B1h and 60B2h as well, mode 9 60B2h.
    """
    torque, velocity = ((_CONTROLWORD, (0x6071, 0, 16)),), ((_CONTROLWORD, (0x60FF, 0, 32)),)
    added: tuple[tuple[MappedObject, ...], ...] = (((0x60B2, 0, 16),),) if offsets else ()
    position: tuple[tuple[MappedObject, ...], ...] = ((_CONTROLWORD, (0x607A, 0, 32)),)
    if offsets:
        position += (((0x60B1, 0, 32), (0x60B2, 0, 16)),)
    return {
        3: Layout(3, velocity, False),
        4: Layout(4, torque, False),
        6: Layout(6, ((_CONTROLWORD,),), False),
        7: Layout(7, ((_CONTROLWORD, (0x60C1, 1, 32)),), True, ENABLE_INTERPOLATION),
        8: Layout(8, position, True),
        9: Layout(9, velocity + added, True),
        10: Layout(10, torque, True),
    }[mode]


@dataclass(frozen=True)
class Setpoints:
    """A motion in the drive's units, one entry per period; ``kind`` as in :class:`beltcomm.drive.Motion`.

    Attributes
    ----------
    axis : tuple of int
        Where the axis is to be, where that is not the position sent.
    """

    kind: MotionKind
    position: tuple[int, ...]
    velocity: tuple[int, ...]
    torque: tuple[int, ...]
    axis: tuple[int, ...] = ()

    @property
    def path(self) -> tuple[int, ...]:
        """Positions that the axis is to follow."""
        return self.axis or self.position

    @classmethod
    def of(cls, motion: Motion, scaling: Scaling) -> Setpoints:
        """Quantise a motion.

        Parameters
        ----------
        motion : Motion, motor shaft
        scaling : Scaling
        """

        def raw(values: NDArray[np.float64], unit: float) -> tuple[int, ...]:
            return tuple(np.rint(values / unit).astype(np.int64).tolist())

        return cls(
            motion.kind,
            raw(motion.position_rad + (0.0 if motion.lead_rad is None else motion.lead_rad), scaling.position_rad),
            raw(motion.velocity_rad_s, scaling.speed_rad_s),
            raw(motion.torque_nm, scaling.torque_nm),
            () if motion.lead_rad is None else raw(motion.position_rad, scaling.position_rad),
        )


def as_interpolated(values: Sequence[int], loop_share: float) -> list[float]:
    """Setpoints as the drive's loop has them at the SYNC that makes each of them active: on its way from the one before.

    Parameters
    ----------
    values : sequence of int
        Raw, one for each SYNC.
    loop_share : float
        The loop's period over that of the setpoints; each is reached in the last loop before the next one (60C2h).
    """
    if loop_share >= 1.0:
        return list(values)
    return [before + loop_share * (now - before) for before, now in zip((values[0], *values[:-1]), values, strict=True)]


class Frames:
    """Payloads of a layout's receive PDOs.

    Parameters
    ----------
    rest : int
        Torque that holds the axis where torque is commanded.
    """

    def __init__(self, layout: Layout, kind: str, rest: int = 0) -> None:
        self._layout = layout
        self._kind = kind
        self._rest = rest
        self._offsets = len(layout.received) > 1

    def of(self, controlword: int, position: int, velocity: int, torque: int) -> tuple[bytes, ...]:
        """One payload per receive PDO.

        Parameters
        ----------
        controlword : int
        position : int, raw
        velocity : int, raw
        torque : int, raw
        """
        if self._layout.mode == 6:
            return (_WORD(controlword),)
        if self._kind == "torque":
            return (_WORD_TORQUE(controlword, torque),)
        if self._kind == "velocity":
            asked = _WORD_LONG(controlword, velocity)
            return (asked, _TORQUE(torque)) if self._offsets else (asked,)
        head = _WORD_LONG(controlword, position)
        return (head, _LONG_TORQUE(velocity, torque)) if self._offsets else (head,)

    def at_rest(self, controlword: int, position: int) -> tuple[bytes, ...]:
        """The torque that holds the axis where torque is commanded, no speed, and the position.

        Parameters
        ----------
        controlword : int
        position : int, raw
            Where positions are commanded.
        """
        return self.of(controlword, position, 0, self._rest if self._kind == "torque" else 0)
