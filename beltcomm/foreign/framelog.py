"""Logs of CAN frames as arrays: candump (``-L`` and plain), and by python-can's readers Vector ``.asc``, ``.blf`` and PEAK ``.trc``."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.table import words_of

_READ_BY_PYTHON_CAN = {".asc": "ASCReader", ".blf": "BLFReader", ".trc": "TRCReader"}
#: ``candump -L``: (1436509052.249713) can0 181#0011223344556677
_COMPACT = re.compile(r"\((\d+\.\d+)\)\s+(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(R\d?|#?[0-9A-Fa-f.]*)(?:\s+[TR])?\s*$")
#: ``candump``:  (1436509052.249713)  can0  181   [8]  00 11 22 33 44 55 66 77; the stamp only with -t
_SPACED = re.compile(
    r"(?:\((\d+\.\d+)\)\s+)?(\S+)\s+(?:(?:RX|TX)\s+\S+\s+)?([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(\d{1,2})\]\s*"
    r"((?:[0-9A-Fa-f]{2}\s?)*|remote request)\s*(?:'.*')?$"
)
#: Lines from which a text file is recognised as a log.
_LOOKED_AT = 20
_LONGEST = 8
#: s, at which stamps of text logs begin anew while they are read.
_TURN = 1_000_000


class Frame(NamedTuple):
    """One classic frame; time_s is NaN without a stamp, identifier has bit 31 set when it is an extended one."""

    time_s: float
    channel: str
    identifier: int
    remote: bool
    data: bytes


@dataclass(frozen=True, eq=False)
class FrameLog:
    """file : where it came from.   t_s : ndarray (n,).   identifier : ndarray (n,), bit 31 marks an extended one.   remote : (n,).
    length : ndarray (n,), bytes.   data : ndarray (n, 8), uint8, zero behind the length.   notes : sentences on what was left out.
    """

    file: str
    t_s: NDArray[np.float64]
    identifier: NDArray[np.int64]
    remote: NDArray[np.bool_]
    length: NDArray[np.int64]
    data: NDArray[np.uint8]
    notes: tuple[str, ...] = ()

    def summary(self, most: int = 12) -> str:
        """What is on the bus: identifier, frames, bytes and rate of the most frequent ones, in words."""
        found, counts = np.unique(self.identifier, return_counts=True)
        lasts = float(self.t_s[-1] - self.t_s[0]) if len(self.t_s) > 1 else 0.0
        order = np.argsort(-counts, kind="stable")[:most]
        lines = []
        for place in order:
            length = int(np.max(self.length[self.identifier == found[place]]))
            rate = f", {counts[place] / lasts:.3g} Hz" if lasts > 0.0 else ""
            lines.append(f"{int(found[place]) & 0x7FFFFFFF:X}h ({counts[place]} frames of {length} bytes{rate})")
        return ", ".join(lines)


def is_frame_log(path: Path) -> bool:
    """Whether a file is a log of CAN frames: by its ending, or text whose first lines are candump's."""
    if path.suffix.lower() in _READ_BY_PYTHON_CAN:
        return True
    try:
        with _opened(path) as file:
            lines = [line.strip() for line, _ in zip(file, range(_LOOKED_AT), strict=False) if line.strip()]
    except (OSError, EOFError, ValueError):
        return False
    fitting = sum(_matched(line) is not None for line in lines)
    return fitting > 0 and fitting >= 0.7 * len(lines)


def read_frames(path: Path, channel: str | None = None) -> FrameLog:
    """All classic data and remote frames of one interface, in the order of the file.

    channel : the interface, such as can0; None takes the one with the most frames and says so.
    Raises DataError for a file that cannot be read or holds no frame, UsageError for an interface that is not in it.
    """
    reader = _READ_BY_PYTHON_CAN.get(path.suffix.lower())
    notes: list[str] = []
    frames = list(_by_python_can(path, reader, notes) if reader else _candump(path, notes))
    if not frames:
        raise DataError(f"{path} holds no CAN frames that can be read{'; ' + notes[0] if notes else ''}; is it cut off?")
    names = sorted({frame.channel for frame in frames}, key=lambda name: -sum(frame.channel == name for frame in frames))
    if channel is not None and channel not in names:
        raise UsageError(f"{path} has no frames of the interface {channel!r}; it has {', '.join(names)}")
    chosen = channel or names[0]
    if len(names) > 1:
        frames = [frame for frame in frames if frame.channel == chosen]
        notes.append(f"only the frames of {chosen} are taken, not those of {', '.join(n for n in names if n != chosen)}: see --channel")
    data = np.zeros((len(frames), _LONGEST), dtype=np.uint8)
    flat = np.frombuffer(b"".join(frame.data.ljust(_LONGEST, b"\0") for frame in frames), dtype=np.uint8)
    data[:] = flat.reshape(len(frames), _LONGEST)
    return FrameLog(
        str(path),
        _risen(np.array([frame.time_s for frame in frames]), notes),
        np.array([frame.identifier for frame in frames], dtype=np.int64),
        np.array([frame.remote for frame in frames], dtype=np.bool_),
        np.array([len(frame.data) for frame in frames], dtype=np.int64),
        data,
        tuple(notes),
    )


def _opened(path: Path) -> Any:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rt", encoding="utf-8", errors="replace")
    return open(path, encoding="utf-8", errors="replace")


def _matched(line: str) -> Frame | None:
    match = _COMPACT.match(line)
    if match:
        stamp, channel, identifier, payload = match.groups()
        remote = payload.startswith("R")
        text = "" if remote else payload.replace(".", "")
        if text.startswith("#") or len(text) % 2 or len(text) > 2 * _LONGEST:  # ## is CAN FD
            return None
        return Frame(_stamp(stamp), channel, _identifier(identifier), remote, bytes.fromhex(text))
    match = _SPACED.match(line)
    if match is None:
        return None
    stamp, channel, identifier, length, payload = match.groups()
    remote = payload.startswith("remote")
    data = b"" if remote else bytes.fromhex(payload)
    if not remote and (len(data) != int(length) or len(data) > _LONGEST):
        return None
    return Frame(_stamp(stamp) if stamp else np.nan, channel, _identifier(identifier), remote, data)


def _stamp(text: str) -> float:
    """Seconds below :data:`_TURN`: of those since 1970 a float holds no microseconds."""
    seconds, _, fraction = text.partition(".")
    return int(seconds) % _TURN + float(f"0.{fraction}")


def _identifier(text: str) -> int:
    return int(text, 16) | (1 << 31 if len(text) == 8 else 0)


def _candump(path: Path, notes: list[str]) -> Iterator[Frame]:
    others, first = 0, 0
    try:
        with _opened(path) as file:
            for number, line in enumerate(file, start=1):
                frame = _matched(line.strip())
                if frame is not None:
                    yield frame
                elif line.strip():
                    others, first = others + 1, first or number
    except (OSError, EOFError, ValueError) as error:
        notes.append(f"the file breaks off ({words_of(error)}): what came before is taken")
    if others:
        notes.append(f"{others} lines that are no classic CAN frames left out, the first is line {first}")


def _by_python_can(path: Path, reader: str, notes: list[str]) -> Iterator[Frame]:
    import can

    number, others = 0, 0
    try:
        # opened here, for a reader that fails in its first line leaves the file open
        with open(path, "rb") if reader == "BLFReader" else _opened(path) as file:
            for message in getattr(can, reader)(file):
                number += 1
                if message.is_error_frame or message.is_fd or len(message.data) > _LONGEST:
                    others += 1
                    continue
                extended = 1 << 31 if message.is_extended_id else 0
                remote = bool(message.is_remote_frame)
                data = b"" if remote else bytes(message.data)
                yield Frame(float(message.timestamp), str(message.channel), message.arbitration_id | extended, remote, data)
    except Exception as error:  # on damaged bytes these readers raise whatever they stumble over
        notes.append(f"the file breaks off behind frame {number} ({type(error).__name__}: {words_of(error)}): what came before is taken")
    if others:
        notes.append(f"{others} error and CAN FD frames left out")


def _risen(stamps: NDArray[np.float64], notes: list[str]) -> NDArray[np.float64]:
    """Stamps since the first; those of ``candump -t d``, each since the one before, are added up."""
    if np.all(np.isfinite(stamps)) and len(stamps) > 2:
        steps = np.diff(stamps)
        if np.mean((steps < 0.0) & (steps > -0.5 * _TURN)) > 0.1:
            notes.append("the stamps are the times between frames (candump -t d); they were added up")
            stamps = np.cumsum(stamps)
        else:
            stamps = np.unwrap(stamps, period=_TURN)
    since: NDArray[np.float64] = np.round(stamps - stamps[0], 9)
    return since
