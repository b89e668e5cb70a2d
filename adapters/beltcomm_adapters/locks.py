"""Objects that are never written, whoever asks: a wrong value there damages the drive, or makes the axis run away."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from beltcomm.drive.objects import name_of
from beltcomm.errors import ObjectLocked


@dataclass(frozen=True)
class Lock:
    """Objects ``first`` to ``last``, all their subindices or one.

    Attributes
    ----------
    what : str
        They hold, in words.
    """

    first: int
    last: int
    what: str
    subindex: int | None = None

    def holds(self, index: int, subindex: int) -> bool:
        """True if an object is among them."""
        return self.first <= index <= self.last and self.subindex in (None, subindex)


#: Locked on every drive: what CiA 402 defines, and what the family of the CMMP-AS has, which a wrong profile must not open.
ALWAYS: Final = (
    Lock(0x60F6, 0x60F6, "gains of the current controller"),
    Lock(0x6402, 0x6410, "the motor's data"),
    Lock(0x604D, 0x604D, "the motor's pole number"),
    Lock(0x6075, 0x6075, "the motor's rated current"),
    Lock(0x6076, 0x6076, "the motor's rated torque"),
    Lock(0x608F, 0x608F, "the encoder's resolution"),
    Lock(0x2021, 0x2026, "encoder selection and data of the CMMP-AS family"),
)
#: Receive PDO mappings: an object mapped there is written with every frame.
_RECEIVE_MAPS: Final = range(0x1600, 0x1800)


class Locks:
    """Locked objects of one drive; more can be added, nothing taken away."""

    def __init__(self) -> None:
        self._locks = list(ALWAYS)

    def add(self, locks: Iterable[Lock]) -> None:
        """Lock more objects: a profile's."""
        self._locks += locks

    def _lock_of(self, index: int, subindex: int) -> Lock | None:
        """Lock of an object; None for one that may be written."""
        return next((lock for lock in self._locks if lock.holds(index, subindex)), None)

    def check(self, index: int, subindex: int, data: bytes = b"") -> None:
        """Check that an object may be written.

        Parameters
        ----------
        index : int
        subindex : int
        data : bytes
            What is to be written: a mapping may lead to another object.

        Raises
        ------
        ObjectLocked
            For one that is never written, also by way of a receive PDO.
        """
        if index in _RECEIVE_MAPS and subindex and len(data) == 4:
            mapped = int.from_bytes(data, "little")
            index, subindex = mapped >> 16, mapped >> 8 & 0xFF
        lock = self._lock_of(index, subindex)
        if lock is not None:
            raise ObjectLocked(
                f"object {name_of(index, subindex)} is never written by beltcomm: it holds {lock.what}, and a wrong value damages the "
                "drive or makes the axis run away; the maker's own tool sets it",
                index,
                subindex,
            )
