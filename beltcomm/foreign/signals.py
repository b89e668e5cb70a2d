"""Signals out of CAN frames by hand (``6064h=181:0:i32``) or by a DBC file (read by cantools), each message with stamps of its own."""

from __future__ import annotations

import importlib.util
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.apart import read_apart
from beltcomm.foreign.canopen import bits_of
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import read_bytes

_TYPES = {f"{sign}{bits}": (bits, sign) for sign in "iu" for bits in (8, 16, 24, 32, 64)} | {"f32": (32, "f"), "f64": (64, "f")}
#: Bytes of a DBC file, at most; those of whole vehicles have ten millions.
_DBC_BYTES: Final = 64 << 20
_BY_HAND = re.compile(r"(?P<name>[^=]+)=(?P<id>[0-9A-Fa-f]{1,8})h?:(?P<byte>[0-7]):(?P<type>[iuf]\d+)(?P<big>be)?")


@dataclass(frozen=True)
class Signal:
    """One number inside a frame:  value = scale * raw + offset.

    Attributes
    ----------
    first, bits : int
        First bit from the frame's first byte on (big endian: counted from its highest bit), and how many.
    kind : str
        "i", "u" or "f".
    big : bool
        Big endian.
    """

    name: str
    identifier: int
    first: int
    bits: int
    kind: str
    big: bool = False
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    message: str = ""

    def of(self, words: NDArray[np.uint8]) -> Array:
        """Values in frames.

        Parameters
        ----------
        words : ndarray (n, 8)

        Returns
        -------
        ndarray
            (n,), in the unit of the signal.
        """
        if self.big:
            whole = np.ascontiguousarray(words).view(">u8").ravel().astype(np.uint64)
            top = whole << np.uint64(self.first)
            raw = top.view(np.int64) >> np.int64(64 - self.bits) if self.kind == "i" else (top >> np.uint64(64 - self.bits)).view(np.int64)
        else:
            raw = bits_of(words, self.first, self.bits, self.kind == "i")
        if self.kind == "f":
            number = raw.astype(np.uint32).view(np.float32) if self.bits == 32 else raw.view(np.float64)
            raw = np.where(np.isfinite(number), number, np.nan)
        unsigned = raw.view(np.uint64) if self.kind == "u" and self.bits == 64 else raw
        return np.asarray(unsigned, dtype=np.float64) * self.scale + self.offset


def by_hand(text: str) -> Signal:
    """``NAME=COB-ID:BYTE:TYPE``: identifier in hexadecimal; first byte, from 0; i8 to i64, u8 to u64, f32 or f64, "be": big endian.

    Parameters
    ----------
    text : str
        Of ``--signal``.

    Returns
    -------
    Signal
        The identifier is an extended one with more than three digits.

    Raises
    ------
    UsageError
        For another form, and for bytes beyond a frame of 8.
    """
    match = _BY_HAND.fullmatch(text.strip())
    if match is None or match["type"] not in _TYPES:
        raise UsageError(
            f"--signal {text} is none; write NAME=COB-ID:BYTE:TYPE, such as 6064h=181:0:i32 ({', '.join(_TYPES)}; be behind it: big endian)"
        )
    bits, kind = _TYPES[match["type"]]
    if 8 * int(match["byte"]) + bits > 64:
        raise UsageError(f"--signal {text}: {bits // 8} bytes from byte {match['byte']} on do not fit into a frame of 8")
    identifier = int(match["id"], 16) | (1 << 31 if len(match["id"]) > 3 else 0)
    return Signal(match["name"].strip(), identifier, 8 * int(match["byte"]), bits, kind, bool(match["big"]))


def of_dbc(path: Path) -> list[Signal]:
    """All signals of a DBC file that are in every frame of their message (multiplexed ones are left out).

    Parameters
    ----------
    path : Path

    Raises
    ------
    UsageError
        When the file is not there or cantools is not installed.
    DataError
        When it cannot be read.
    """
    if not path.is_file():
        raise UsageError(f"{path} does not exist; give the DBC file of the bus")
    if importlib.util.find_spec("cantools") is None:
        raise UsageError("a DBC file needs a further package: pip install 'beltcomm[dbc]', or use --signal")
    (about,) = read_apart("dbc", path, _DBC_BYTES).notes
    return [Signal(**signal) for signal in json.loads(about)]


def dbc_apart(path: Path) -> Table:
    """The signals of :func:`of_dbc` as a note: on damaged text cantools reads for hours, so it does so in a process of its own.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        When it cannot be read.
    """
    import cantools

    try:
        # as Vector's tools write it; other bytes there are in names of units at most
        text = read_bytes(path, _DBC_BYTES).decode("cp1252", "replace")
        database: Any = cantools.database.load_string(text, database_format="dbc", strict=False)
        found: list[dict[str, Any]] = []
        for message in database.messages:
            identifier = message.frame_id | (1 << 31 if message.is_extended_frame else 0)
            for signal in message.signals:
                big = signal.byte_order == "big_endian"
                first = 8 * (signal.start // 8) + 7 - signal.start % 8 if big else signal.start
                bits, scale, offset = int(signal.length), float(signal.scale), float(signal.offset)
                fits = first >= 0 and bits > 0 and first + bits <= 64 and (not signal.is_float or bits in (32, 64))
                if signal.multiplexer_ids or not fits or not math.isfinite(scale) or not math.isfinite(offset):
                    continue
                kind = "f" if signal.is_float else "i" if signal.is_signed else "u"
                names = {"name": str(signal.name), "unit": str(signal.unit or ""), "message": str(message.name)}
                found.append({**names, "identifier": identifier, "first": first, "bits": bits, "kind": kind, "big": big})
                found[-1] |= {"scale": scale, "offset": offset}
    except (DataError, MemoryError):
        raise
    except Exception as error:  # on damaged text this reader raises whatever it stumbles over
        raise DataError(f"{path} cannot be read as a DBC file ({words_of(error)})") from error
    return Table(str(path), {}, notes=(json.dumps(found),))


def table_of_signals(log: FrameLog, signals: Sequence[Signal]) -> Table:
    """The signals that are in a log of frames, as columns with clocks of their own.

    Parameters
    ----------
    log : FrameLog
    signals : sequence of Signal
        Place in a frame, type and unit of each.

    Returns
    -------
    Table
        Those in fewer than two frames are left out.

    Raises
    ------
    DataError
        When none of them is in it.
    """
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    names = [signal.name for signal in signals]
    for signal in signals:
        size = (signal.first + signal.bits + 7) // 8
        frames = np.flatnonzero((log.identifier == signal.identifier) & ~log.remote & (log.length >= size))
        if len(frames) < 2:
            continue
        clock = f"time of {signal.message or f'{signal.identifier & 0x7FFFFFFF:X}h'}"
        stamps = log.t_s[frames]
        if clock in columns and len(columns[clock]) != len(frames):
            clock = f"time of {signal.name}"
        columns[clock], units[clock] = stamps, "s"
        name = signal.name if names.count(signal.name) == 1 else f"{signal.message or signal.identifier}.{signal.name}"
        columns[name], clocks[name] = signal.of(log.data[frames]), clock
        if signal.unit:
            units[name] = signal.unit
    if not clocks:
        raise DataError(f"{log.file} has no frames of these signals; on the bus are {log.summary()}")
    if not np.isfinite(log.t_s).all():
        columns = {name: column for name, column in columns.items() if name in clocks}
        clocks = {}
    return Table(log.file, columns, units, log.notes, clocks)
