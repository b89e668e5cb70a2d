"""Objects of a drive's dictionary as values: where they stand, the numbers on the wire, and what those mean in SI.

A named parameter (:mod:`beltcomm.drive.parameters`) is held by one object:  SI value = scale * raw value, or, where a drive holds an
integral time in place of K_I,  T_n = K_P / K_I = scale * raw value.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from beltcomm.errors import DataError, UsageError

#: Data type -> struct code, number in CiA 301 (table 44), word in a table.
TYPES: Final[Mapping[str, tuple[str, int]]] = {
    "int8": ("<b", 0x02),
    "int16": ("<h", 0x03),
    "int32": ("<i", 0x04),
    "uint8": ("<B", 0x05),
    "uint16": ("<H", 0x06),
    "uint32": ("<I", 0x07),
    "real32": ("<f", 0x08),
}
_KIND_OF: Final = {number: kind for kind, (_, number) in TYPES.items()}
#: Commands, not settings: what turns a stage on, chooses a mode, is a setpoint or an output, stores or loads a whole drive.  No file ever
#: writes one (CiA 301: 1010h, 1011h, 1023h, 1024h; CiA 402: the rest).
COMMANDS: Final = frozenset(
    {0x1010, 0x1011, 0x1023, 0x1024, 0x6040, 0x6042, 0x6060, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60FE, 0x60FF}
)
#: How the Metronix family takes interpolated positions: a setting beside a setpoint, of the same index.
NO_COMMAND: Final = (0x60C1, 2)
#: The mode of operation: a command, too, but one that a drive keeps, so that it is lent to a record and given back.
MODE: Final = (0x6060, 0)
#: Objects of communication, CiA 301.
COMMUNICATION: Final = range(0x1000, 0x2000)
#: The gain that an integral time rests on:  T_n = K_P / K_I.
GAIN: Final = "kp_nm_s_rad"


def name_of(index: int, subindex: int = 0) -> str:
    """An object as the standards write it: 6041h, 2100h:3, 6510h:10h.

    Parameters
    ----------
    index, subindex : int

    Returns
    -------
    str
        Without the subindex where that is 0.
    """
    return f"{index:04X}h" if subindex == 0 else f"{index:04X}h:{subindex:X}" + "h" * (subindex > 9)


def is_command(index: int, subindex: int = 0) -> bool:
    """True if an object is a command and no setting.

    Parameters
    ----------
    index, subindex : int

    Returns
    -------
    bool
        No file ever writes one for which it is True.
    """
    return index in COMMANDS and (index, subindex) != NO_COMMAND


def kind_of(data_type: int) -> str | None:
    """Data type of a number of CiA 301.

    Parameters
    ----------
    data_type : int
        As an object file writes it, table 44.

    Returns
    -------
    str or None
        One of :data:`TYPES`; None for a type that holds no single number.
    """
    return _KIND_OF.get(data_type)


def bounds_of(kind: str) -> tuple[float, float]:
    """Smallest and largest value of a type.

    Parameters
    ----------
    kind : str
        One of :data:`TYPES`.

    Returns
    -------
    tuple of float
        Raw values, both included.
    """
    if kind == "real32":
        largest: float = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
        return -largest, largest
    bits = 8 * struct.calcsize(TYPES[kind][0])
    return (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def packed(kind: str, raw: float) -> bytes:
    """The bytes of a value on the wire.

    Parameters
    ----------
    kind : str
        One of :data:`TYPES`.
    raw : float
        Cut to an integer for all but ``real32``.

    Returns
    -------
    bytes
        Little endian, as CiA 301 asks for.

    Raises
    ------
    ValueError
        When it does not fit its type.
    """
    try:
        return struct.pack(TYPES[kind][0], raw if kind == "real32" else int(raw))
    except (struct.error, OverflowError, ValueError) as error:
        raise ValueError(f"{raw:g} does not fit into {kind}") from error


@dataclass(frozen=True)
class DictionaryEntry:
    """Entry of a file on an object.

    Attributes
    ----------
    kind : str or None
        Data type, None for no single number.
    value : float or None
        That or default, None for none.
    """

    index: int
    subindex: int
    name: str
    kind: str | None
    access: str
    value: float | None = None


@dataclass(frozen=True)
class ParameterObject:
    """One parameter as an object of the drive:  SI value = scale * raw value.

    Attributes
    ----------
    type : str
        An integer type or ``real32``.
    lowest, highest : int or None
        Raw values the drive takes, None when unknown.
    law : Literal['linear', 'integral_time']
        "linear", or "integral_time": the object is T_n = K_P / K_I in units of ``scale`` seconds.
    """

    index: int
    subindex: int
    type: str
    scale: float = 1.0
    lowest: int | None = None
    highest: int | None = None
    law: Literal["linear", "integral_time"] = "linear"

    def __post_init__(self) -> None:
        """Raise ValueError for what no drive has."""
        if self.type not in (*TYPES,) or self.law not in ("linear", "integral_time"):
            raise ValueError(f"type {self.type!r} or law {self.law!r} is none")
        whole = all(isinstance(n, int) for n in (self.index, self.subindex, *(n for n in (self.lowest, self.highest) if n is not None)))
        if not whole or not (0 <= self.index <= 0xFFFF and 0 <= self.subindex <= 0xFF):
            raise ValueError(f"there is no object {self.index!r}, {self.subindex!r} with a range of {self.lowest!r} to {self.highest!r}")
        least, most = bounds_of(self.type)
        low, high = self.range
        if not (0.0 < self.scale < math.inf and least <= low <= high <= most):
            raise ValueError(f"a scale of {self.scale!r} and a range of {low} to {high} are none of {self.type}")

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest raw value of an integer object."""
        least, most = bounds_of(self.type)
        return int(least if self.lowest is None else self.lowest), int(most if self.highest is None else self.highest)

    def value(self, raw: float, gain: Callable[[], float]) -> float:
        """SI value of a raw one.

        Parameters
        ----------
        raw : float
            As the drive has it.
        gain : callable
            K_P in N m s/rad, asked where the object is an integral time.

        Returns
        -------
        float
            SI, motor shaft; inf for an integral time of 0.
        """
        if self.law == "linear":
            return raw * self.scale
        return gain() / (raw * self.scale) if raw else math.inf

    def raw(self, name: str, value: float, gain: Callable[[], float]) -> float:
        """The raw value nearest to an SI one.

        Parameters
        ----------
        name : str
            For the message.
        value : float, SI, motor shaft
        gain : callable
            As in :meth:`value`.

        Returns
        -------
        float
            Whole, unless the object is a real32.

        Raises
        ------
        UsageError
            When it is out of range.
        """
        if not math.isfinite(value):
            raise UsageError(f"{name} must be a number, not {value}")
        if self.type == "real32":
            if abs(value) > bounds_of(self.type)[1]:
                raise UsageError(f"{name} = {value:g} is beyond the real numbers that this drive takes; design with its limits")
            single: float = struct.unpack("<f", struct.pack("<f", value))[0]
            return single
        exact = math.inf  # the integral time of an integral part that is off
        if self.law == "linear":
            exact = value / self.scale
        elif value > 0:
            exact = gain() / (value * self.scale)
        least, most = self.range
        if not least - 0.5 <= exact <= most + 0.5:
            ends = sorted(self.value(end, gain) for end in (max(least, 1) if self.law != "linear" else least, most))
            raise UsageError(f"{name} = {value:g} is outside what this drive takes, {ends[0]:.4g} to {ends[1]:.4g}; design with its limits")
        return round(exact)


@dataclass(frozen=True)
class ObjectValue:
    """Value that stands, or shall stand, in one object.

    Attributes
    ----------
    kind : str
        Data type.
    raw : float
        The number on the wire.
    name, value
        The parameter that it holds and its SI value, "" and None for none.
    """

    index: int
    subindex: int
    kind: str
    raw: float
    name: str = ""
    value: float | None = None

    @property
    def place(self) -> tuple[int, int]:
        """Index and subindex."""
        return self.index, self.subindex

    @property
    def title(self) -> str:
        """The object as the standards write it."""
        return name_of(self.index, self.subindex)

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        found: dict[str, Any] = {"object": self.title, "type": self.kind, "raw": self.raw}
        return found | ({"name": self.name, "value": self.value} if self.name else {})


def object_from_dict(data: Mapping[str, Any]) -> ObjectValue:
    """The inverse of :meth:`ObjectValue.to_dict`.

    Parameters
    ----------
    data : Mapping[str, Any]
        Entry of a file.

    Returns
    -------
    ObjectValue
        With the raw value that the file has.

    Raises
    ------
    DataError
        For a damaged entry.
    """
    try:
        index, _, subindex = str(data["object"]).replace("h", "").partition(":")
        kind, raw = str(data["type"]), float(data["raw"])
        packed(kind, raw)
        if not math.isfinite(raw):
            raise ValueError(f"{raw} is no number")
        value = None if data.get("value") is None else float(data["value"])
        found = ObjectValue(int(index, 16), int(subindex or "0", 16), kind, raw, str(data.get("name") or ""), value)
        if not (0 <= found.index <= 0xFFFF and 0 <= found.subindex <= 0xFF):
            raise ValueError(f"there is no object {data['object']}")
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise DataError(f"an entry of the file's objects is damaged ({error}); take another backup") from error
    return found


def object_values(parameters: Mapping[str, ParameterObject], values: Mapping[str, float]) -> list[ObjectValue]:
    """The objects that hold these SI values.

    An integral time rests on the K_P beside it, as the object will hold it.

    Parameters
    ----------
    parameters : Mapping[str, ParameterObject]
        Of the drive, by name.
    values : Mapping[str, float]
        SI at the motor shaft, by name; a name without an object is left out.

    Returns
    -------
    list of ObjectValue
        In the order of ``parameters``.

    Raises
    ------
    UsageError
        For a value out of range, or an integral time without K_P.
    """
    raws: dict[str, float] = {}

    def gain() -> float:
        if GAIN not in raws:
            raise UsageError(f"the integral time of this drive rests on {GAIN}; give it too")
        return raws[GAIN] * parameters[GAIN].scale

    for name in ordered(parameters, values):
        raws[name] = parameters[name].raw(name, values[name], gain)
    return [
        ObjectValue(p.index, p.subindex, p.type, raws[name], name, p.value(raws[name], gain))
        for name, p in parameters.items()
        if name in raws
    ]


def ordered(parameters: Mapping[str, ParameterObject], names: Iterable[str]) -> list[str]:
    """Names that have an object, what others rest on first.

    Parameters
    ----------
    parameters : Mapping[str, ParameterObject]
        Of the drive, by name.
    names : iterable of str
        Those that are wanted.

    Returns
    -------
    list of str
        An integral time behind the gain that it rests on.
    """
    wanted = set(names)
    return sorted((name for name in parameters if name in wanted), key=lambda name: parameters[name].law != "linear")
