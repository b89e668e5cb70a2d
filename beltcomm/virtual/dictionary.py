"""The object dictionary: rows (what an object is) and entries (its value in this drive).

A row is data; which rows a drive has is told by :mod:`beltcomm.virtual.objects` and :mod:`beltcomm.virtual.profiles`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, MutableMapping
from dataclasses import dataclass, replace
from typing import Any, Literal

Value = int | float | str
NonVolatile = MutableMapping[tuple[int, int], Value]
"""What survives a power cycle: (index, subindex) -> value.  Kept outside the drive."""

_CODES = {"u8": "<B", "i8": "<b", "u16": "<H", "i16": "<h", "u32": "<I", "i32": "<i", "f32": "<f"}
_LENGTHS = {kind: struct.calcsize(code) for kind, code in _CODES.items()}


class SdoAbort(Exception):
    """A transfer is refused with this abort code (CiA 301, table 22)."""

    TOGGLE = 0x05030000
    UNKNOWN_COMMAND = 0x05040001
    BAD_BLOCK_SIZE = 0x05040002
    BAD_SEQUENCE = 0x05040003
    BAD_CRC = 0x05040004
    UNSUPPORTED_ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_TOO_LONG = 0x06040042
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    BAD_VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    NOT_STORED = 0x08000020
    WRONG_STATE = 0x08000022

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}h")
        self.code = code


@dataclass(frozen=True)
class ObjectRow:
    """One object.

    Attributes
    ----------
    kind : Literal
        Data type.
    access : Literal['const', 'ro', 'wo', 'rw', 'none']
        As in CiA 301; "none": a quantity inside the drive that no master sees.
    default : Value
        Value after 1011h.
    low, high : float or None
        Range; None is the type's own.
    pdo : Literal['', 'r', 't', 'rt']
        "r" mappable into receive PDOs, "t" into transmit PDOs.
    when : Literal['any', 'still', 'off']
        Writable "any" time, with the axis at "still" (stage off or standstill), or only with the stage "off".
    stored : bool
        Saved by 1010h.
    unit : Literal['', 'position', 'velocity', 'acceleration']
        The factor group scales it.
    """

    index: int
    subindex: int
    kind: Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32", "str"]
    access: Literal["const", "ro", "wo", "rw", "none"]
    default: Value
    meaning: str
    low: float | None = None
    high: float | None = None
    pdo: Literal["", "r", "t", "rt"] = ""
    when: Literal["any", "still", "off"] = "any"
    stored: bool = False
    unit: Literal["", "position", "velocity", "acceleration"] = ""

    @property
    def length(self) -> int:
        """Bytes; 0 for a string."""
        return _LENGTHS.get(self.kind, 0)

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest value of an integer type."""
        bits = 8 * self.length
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.kind[0] == "i" else (0, (1 << bits) - 1)

    @property
    def code(self) -> str:
        """``struct`` code of one value, little endian."""
        return _CODES[self.kind]


class ObjectEntry:
    """The value of one object, and who must know when it is written.

    Attributes
    ----------
    check
        Called before a write with the new value; returns the value to store or raises SdoAbort.
    changed
        Called after a write.
    """

    __slots__ = ("changed", "check", "row", "value")

    def __init__(self, row: ObjectRow) -> None:
        self.row = row
        self.value: Any = row.default  # int, float or str, as the row says
        self.check: Callable[[Any], Value] | None = None
        self.changed: Callable[[], None] | None = None

    @property
    def needs_check(self) -> bool:
        """True if a value of the right type can still be refused."""
        row = self.row
        return self.check is not None or row.low is not None or row.high is not None or row.when != "any"


class _Alias(ObjectEntry):
    """Another entry's value under a number of its own, to be read."""

    __slots__ = ("_other",)

    def __init__(self, index: int, subindex: int, other: ObjectEntry) -> None:
        self._other = other
        super().__init__(replace(other.row, index=index, subindex=subindex, access="ro", stored=False, pdo="t"))

    @property
    def value(self) -> Any:
        """The other's."""
        return self._other.value

    @value.setter
    def value(self, value: Any) -> None:
        """Loading defaults is the other's."""


class ObjectDictionary:
    """All objects of one drive.

    Attributes
    ----------
    stage_on, moving
        Kept up to date by the servo; they decide on writes that need the axis still or the stage off.
    """

    def __init__(self, rows: Iterable[ObjectRow]) -> None:
        self.stage_on = False
        self.moving = False
        self._entries = {(row.index, row.subindex): ObjectEntry(row) for row in _with_counts(list(rows))}
        self._indices = {index for (index, _), entry in self._entries.items() if entry.row.access != "none"}

    def entry(self, index: int, subindex: int = 0) -> ObjectEntry:
        """One entry, seen or not, for the drive itself."""
        return self._entries[index, subindex]

    def has(self, index: int, subindex: int = 0) -> bool:
        """True if the drive has this object, or the quantity without one."""
        return (index, subindex) in self._entries

    def seen(self, index: int, subindex: int = 0) -> ObjectEntry:
        """One entry as a master sees it; raises SdoAbort when there is none."""
        found = self._entries.get((index, subindex))
        if found is None or found.row.access == "none":
            raise SdoAbort(SdoAbort.NO_SUBINDEX if index in self._indices else SdoAbort.NO_OBJECT)
        return found

    def alias(self, index: int, subindex: int, other: ObjectEntry) -> None:
        """Give a quantity a second number, so that both lead to the entry ``other``."""
        self._entries[index, subindex] = _Alias(index, subindex, other)
        self._indices.add(index)

    def read(self, index: int, subindex: int) -> bytes:
        """Value as the bytes of an upload; raises SdoAbort when there is none, or none to read."""
        entry = self.seen(index, subindex)
        row = entry.row
        if row.access == "wo":
            raise SdoAbort(SdoAbort.WRITE_ONLY)
        if row.kind == "str":
            return str(entry.value).encode("ascii")
        return struct.pack(row.code, entry.value)

    def write(self, index: int, subindex: int, data: bytes, sized: bool = True) -> None:
        """Store the bytes of a download, whose length the client has told where it is ``sized``.

        Raises SdoAbort when there is no such object, none to write, or another length.
        """
        entry = self.seen(index, subindex)
        row = entry.row
        if row.access in ("ro", "const"):
            raise SdoAbort(SdoAbort.READ_ONLY)
        if not sized:
            data = data[: row.length]
        if len(data) != row.length:
            raise SdoAbort(SdoAbort.TOO_LONG if len(data) > row.length else SdoAbort.TOO_SHORT)
        self.store(entry, struct.unpack(row.code, data)[0])
        if entry.changed is not None:
            entry.changed()

    def store(self, entry: ObjectEntry, value: Any) -> None:
        """Check a written value against range and drive state and keep it, or raise SdoAbort; ``changed`` is not called."""
        row = entry.row
        if row.when != "any" and self.stage_on and (row.when == "off" or self.moving):
            raise SdoAbort(SdoAbort.WRONG_STATE)
        if isinstance(value, float) and not math.isfinite(value):
            raise SdoAbort(SdoAbort.BAD_VALUE)
        if row.high is not None and value > row.high:
            raise SdoAbort(SdoAbort.TOO_HIGH)
        if row.low is not None and value < row.low:
            raise SdoAbort(SdoAbort.TOO_LOW)
        entry.value = value if entry.check is None else entry.check(value)

    def rescale(self, unit: str, factor: float) -> None:
        """The factor group has changed: written values keep their physical meaning, since the drive stores internal units.

        Parameters
        ----------
        unit : str
            As the rows of the dictionary name it.
        factor : float
            New user units per old one. An end of the type's range is "off" and stays.
        """
        for entry in self._entries.values():
            row = entry.row
            if row.unit == unit and row.access == "rw":
                bottom, top = row.range
                if bottom < entry.value < top or entry.value == 0:
                    low = bottom if row.low is None else row.low
                    entry.value = int(min(max(round(entry.value * factor), low), top))

    def load(self, stored: NonVolatile, communication_only: bool = False) -> None:
        """Values after power-on or reset: what was saved, defaults for the rest.  No ``changed`` is called.

        With ``communication_only`` those of CiA 301 alone, as after a reset of the communication.
        """
        for key, entry in self._entries.items():
            if not communication_only or (key[0] < 0x2000 and entry.row.stored):
                entry.value = stored.get(key, entry.row.default)

    def save(self, stored: NonVolatile) -> None:
        """Keep every stored object's value, and nothing from before."""
        stored.clear()
        stored.update({key: entry.value for key, entry in self._entries.items() if entry.row.stored})


def _with_counts(rows: list[ObjectRow]) -> list[ObjectRow]:
    """The rows, and for each record without a row for subindex 0 the constant highest subindex."""
    highest: dict[int, int] = {}
    for row in rows:
        if row.access != "none":
            highest[row.index] = max(row.subindex, highest.get(row.index, 0))
    given = {row.index for row in rows if row.subindex == 0}
    counts = [ObjectRow(i, 0, "u8", "const", top, "highest subindex") for i, top in highest.items() if i not in given]
    return rows + counts
