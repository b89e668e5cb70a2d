"""Objects that records borrow from a drive beside its parameters: read before the first one, so that a killed session's can go back."""

from __future__ import annotations

from typing import Final

#: Mode of operation; 0, "no mode", is where a drive starts and cannot be gone back to.
MODE: Final = (0x6060, 0, "int8")
#: Method of homing, borrowed where a profile states one.
HOMING: Final = (0x6098, 0, "int8")
#: Borrowed by a record, a stroke or their guarding: index, subindex, type, in the order in which they go back.
LENT_TO_RECORDS: Final = (
    MODE,
    (0x605A, 0, "int16"),
    (0x6081, 0, "uint32"),
    (0x6083, 0, "uint32"),
    (0x6084, 0, "uint32"),
    (0x6085, 0, "uint32"),
    (0x6086, 0, "int16"),
    (0x6087, 0, "uint32"),
    (0x6065, 0, "uint32"),
    (0x6066, 0, "uint16"),
    (0x607D, 1, "int32"),
    (0x607D, 2, "int32"),
    (0x60C0, 0, "int16"),
    (0x60C1, 2, "uint8"),
    (0x60C2, 2, "int8"),
    (0x60C2, 1, "uint8"),
    (0x6007, 0, "int16"),
    (0x1029, 1, "uint8"),
    (0x1016, 1, "uint32"),
    (0x100D, 0, "uint8"),
    (0x100C, 0, "uint16"),
    (0x1017, 0, "uint16"),
)
