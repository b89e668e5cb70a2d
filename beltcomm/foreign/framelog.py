"""Logs of CAN frames as arrays, whatever wrote them: lines of text, tables, and by python-can's readers ``.blf`` and PEAK ``.trc``."""

from __future__ import annotations

import base64
import binascii
import json
import sqlite3
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray, Column, IntArray
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.apart import Kind, read_apart
from beltcomm.foreign.framelines import (
    LONGEST,
    LoggedFrame,
    Others,
    asc_frames,
    candump_frames,
    csv_columns,
    kind_of_log,
    lines_of,
    opened_text,
)
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import opened

#: Read apart: on damaged bytes these readers turn in circles and take all memory.
_READ_APART: Final = ("blf", "trc", "sqlite")

#: Spans after which counters of loggers begin anew, ns: 16 and 32 bits of ns to ms, a day of the time of day.
_TURNS_NS = tuple(sorted({(1 << bits) * unit for bits in (16, 31, 32) for unit in (1, 100, 1000, 10_000, 1_000_000)} | {86_400 * 10**9}))
_SHORTEST_TURN_NS = 1_000_000_000

#: ns within which both sides of a turn lie to it.
_AT_TURN_NS = 1_000_000_000

#: Correlation of a clock's stamps with the count of the frames; that of the times between frames is near 0.
_OF_A_CLOCK = 0.7

#: Damaged stamps end here, that differences of two fit; and what stands for none.
_LAST_NS = 1 << 61
_NO_STAMP = -(1 << 62)

#: Identifiers between which those of nodes are: emergency, PDOs, SDO, heartbeat.
_FIRST_OWN, _END_OWN = 0x80, 0x780

#: Identifiers of a summary.
_MOST_LISTED = 12
#: Interfaces that are told apart.
_MOST_CHANNELS = 1000
#: Of them are looked into for a drive.
_MOST_TRIED = 8
_TRUE = {"1", "true", "yes", "x"}


@dataclass(frozen=True, eq=False)
class FrameLog:
    """file : where it came from.   t_s : ndarray (n,).   identifier : ndarray (n,), bit 31 marks an extended one.   remote : (n,).
    length : ndarray (n,), bytes.   data : ndarray (n, 8), uint8, zero behind the length.   notes : sentences on what was left out.
    in_file : frames that the file holds, those that were not read too; 0 when not counted.
    """

    file: str
    t_s: Array
    identifier: IntArray
    remote: BoolArray
    length: IntArray
    data: NDArray[np.uint8]
    notes: tuple[str, ...] = ()
    in_file: int = 0

    def doubled(self) -> int:
        """Frames that stand there twice: the same identifier and content at the same time, as two sockets on one bus write them."""
        if not len(self.t_s):
            return 0
        order = np.lexsort((*self.data.T, self.length, self.identifier, self.t_s))
        same = np.ones(len(order) - 1, dtype=bool)
        for column in (self.t_s, self.identifier, self.length, self.remote, *self.data.T):
            same &= column[order[1:]] == column[order[:-1]]
        return int(same.sum())

    def of_node(self, node: int) -> int:
        """Number of frames with one of the node's own identifiers (CiA 301, predefined connection set).

        Parameters
        ----------
        node : int, 1 to 127
        """
        return int(np.sum((self.identifier > _FIRST_OWN) & (self.identifier < _END_OWN) & (self.identifier % 0x80 == node)))

    def summary(self) -> str:
        """Traffic on the bus: identifier, frames, bytes and rate of the most frequent ones, in words."""
        found, counts = np.unique(self.identifier, return_counts=True)
        lasts = float(self.t_s[-1] - self.t_s[0]) if len(self.t_s) > 1 else 0.0
        order = np.argsort(-counts, kind="stable")[:_MOST_LISTED]
        lines = []
        for place in order:
            length = int(np.max(self.length[self.identifier == found[place]]))
            rate = f", {counts[place] / lasts:.3g} Hz" if lasts > 0.0 else ""
            lines.append(f"{int(found[place]) & 0x7FFFFFFF:X}h ({counts[place]} frames of {length} bytes{rate})")
        return ", ".join(lines)


def read_frames(path: Path, channel: str | None = None, readable: Callable[[FrameLog], int] | None = None) -> FrameLog:
    """All classic data and remote frames of one interface, in the order of the file.

    Parameters
    ----------
    path : Path
    channel : str or None
        The interface, such as can0; None takes the one with the most readable frames, else with the most frames, and says so.
    readable : callable or None
        Counts the frames of a log that are understood: the busiest interface need not be that of the drive.

    Raises
    ------
    DataError
        For a file that cannot be read or holds no frame.
    UsageError
        For an interface that is not in it.
    """
    others = Others()
    kind = kind_of_log(path)
    if kind in _READ_APART:
        frames = _Frames.of_table(read_apart(kind, path), others)
    else:
        frames = _Frames.of(path, _READERS[kind or "candump"](path, others))
    notes = others.notes
    if others.count:
        notes.append(f"{others.count} {others.what} left out{f', the first is line {others.first}' if others.first else ''}")
    in_file = len(frames) + others.count
    if not len(frames) and others.fd:
        raise DataError(
            f"{path} holds {others.fd} CAN FD frames and no classic one, and what FD frames carry is not read: log the drive's classic "
            "CANopen, or decode the log with the tool that made it and export the signals as CSV"
        )
    if not len(frames):
        raise DataError(f"{path} holds no CAN frames that can be read{'; ' + notes[0] if notes else ''}; is it cut off?")
    names = frames.channels_by_count()
    if channel is not None and channel not in names:
        raise UsageError(f"{path} has no frames of the interface {channel!r}; it has {', '.join(names)}")
    logs = [_log_of(path, frames, name, in_file) for name in ([channel] if channel else names[:_MOST_TRIED])]
    counts = [readable(log) if readable is not None and len(logs) > 1 else 0 for log in logs]
    chosen = int(np.argmax(counts))
    if len(names) > 1:
        others_there = ", ".join(name for name in names if name != (channel or names[chosen]))
        notes.append(f"only the frames of {channel or names[chosen]} are taken, not those of {others_there}: see --channel")
        also = [name for k, name in enumerate(names[: len(counts)]) if k != chosen and counts[k]]
        if also:
            notes.append(f"on {', '.join(also)} a drive sends its position, too: its moves are read with --channel")
    return replace(logs[chosen], notes=(*notes, *logs[chosen].notes))


def _log_of(path: Path, frames: _Frames, channel: str, in_file: int) -> FrameLog:
    """The frames of one interface; its notes are on their stamps."""
    taken = frames.of_channel(channel)
    notes: list[str] = []
    return FrameLog(
        str(path),
        _risen(taken["time_ns"], notes),
        taken["identifier"],
        taken["remote"].astype(np.bool_),
        taken["length"].astype(np.int64),
        taken["data"].copy(),
        tuple(notes),
        in_file,
    )


class _Frames:
    """Frames gathered in columns, 28 bytes each, for a log may hold many millions."""

    def __init__(self) -> None:
        self._channels: dict[str, int] = {}
        self._columns = {"time_ns": array("q"), "channel": array("H"), "identifier": array("q"), "remote": array("B"), "length": array("B")}
        self._data = bytearray()

    def __len__(self) -> int:
        return len(self._columns["length"])

    @classmethod
    def of(cls, path: Path, frames: Iterable[LoggedFrame]) -> _Frames:
        """Frames that a reader finds.  Raises DataError for more interfaces than any computer has."""
        made = cls()
        channels, columns, data = made._channels, made._columns, made._data
        adds = [column.append for column in columns.values()]
        for time_ns, channel, identifier, remote, content in frames:
            number = channels.setdefault(channel, len(channels))
            if number == _MOST_CHANNELS:
                raise DataError(f"{path} names more than {_MOST_CHANNELS} interfaces; is it a log of CAN frames? Export one interface")
            stamp = _NO_STAMP if time_ns is None else min(max(time_ns, -_LAST_NS), _LAST_NS)
            for add, value in zip(adds, (stamp, number, identifier, remote, len(content)), strict=True):
                add(value)
            data += content.ljust(LONGEST, b"\0")
        return made

    def table(self, path: Path, others: Others) -> Table:
        """As columns of numbers with what else is known in a note, for another process."""
        columns = self._arrays()
        seconds, ns = np.divmod(columns["time_ns"], 10**9)
        numbers = [seconds, ns, *(columns[name] for name in ("channel", "identifier", "remote", "length")), *columns["data"].T]
        about = {"count": others.count, "what": others.what, "fd": others.fd, "notes": others.notes, "channels": list(self._channels)}
        return Table(str(path), {str(k): column.astype(np.float64) for k, column in enumerate(numbers)}, notes=(json.dumps(about),))

    @classmethod
    def of_table(cls, table: Table, others: Others) -> _Frames:
        """The frames of :meth:`table`."""
        about = json.loads(table.notes[0])
        others.count, others.what, others.notes = int(about["count"]), str(about["what"]), list(map(str, about["notes"]))
        others.fd = int(about["fd"])
        made = cls()
        made._channels = {str(name): number for number, name in enumerate(about["channels"])}
        seconds, ns, *numbers = (table.columns[str(k)] for k in range(6 + LONGEST))
        columns = dict(zip(("channel", "identifier", "remote", "length"), numbers, strict=False))
        columns["time_ns"] = seconds.astype(np.int64) * 10**9 + ns.astype(np.int64)
        for name, column in made._columns.items():
            column.frombytes(columns[name].astype(column.typecode).tobytes())
        made._data = bytearray(np.column_stack(numbers[4:]).astype(np.uint8).tobytes())
        return made

    def channels_by_count(self) -> list[str]:
        """The interfaces, that with the most frames first."""
        counts = np.bincount(np.array(self._columns["channel"]), minlength=len(self._channels))
        return [name for name, number in sorted(self._channels.items(), key=lambda item: -int(counts[item[1]]))]

    def of_channel(self, channel: str) -> dict[str, Column]:
        """Columns of the frames of one interface: time_ns, identifier, remote, length (n,), data (n, 8)."""
        columns = self._arrays()
        taken = columns["channel"] == self._channels[channel]
        return {name: column[taken] for name, column in columns.items()}

    def _arrays(self) -> dict[str, Column]:
        columns = {name: np.frombuffer(column, dtype=column.typecode) for name, column in self._columns.items()}
        return {**columns, "data": np.frombuffer(self._data, dtype=np.uint8).reshape(-1, LONGEST)}


def _by_python_can(path: Path, reader: str, others: Others) -> Iterator[LoggedFrame]:
    import can

    number, taken, there = 0, 0, 0
    others.what = "error, CAN FD and other entries that are no classic CAN frames"
    try:
        # opened here, for a reader that fails in its first line leaves the file open
        with opened(path) if reader == "BLFReader" else opened_text(path) as file:
            messages = getattr(can, reader)(file)
            if reader == "TRCReader":
                messages._parse_line = _patient(messages._parse_line)
            there = int(getattr(messages, "object_count", 0))
            for message in messages:
                number += 1
                if message.is_error_frame or message.is_fd or len(message.data) > LONGEST or not 0 <= message.arbitration_id < 1 << 29:
                    continue
                extended = 1 << 31 if message.is_extended_id else 0
                remote = bool(message.is_remote_frame)
                data = b"" if remote else bytes(message.data)
                taken += 1
                yield LoggedFrame(round(message.timestamp * 1e9), str(message.channel), message.arbitration_id | extended, remote, data)
    except Exception as error:  # on damaged bytes these readers raise whatever they stumble over
        others.notes.append(
            f"the file breaks off behind frame {number} ({type(error).__name__}: {words_of(error)}): what came before is taken"
        )
    if reader == "TRCReader":  # it passes over what it does not understand, remote frames too, and does not say so
        there = sum(bool(line.strip()) and not line.lstrip().startswith(";") for _, line in lines_of(path, others))
    others.count = max(there, number) - taken


def _patient(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """A reader of one line for which a damaged one is none: python-can's ends there, and all that follows would be lost."""

    def parsed(line: str) -> Any:
        try:
            return parse(line)
        except ValueError:
            return None

    return parsed


def frames_apart(kind: Kind, path: Path) -> Table:
    """All frames of a file that python-can reads, in the process for such readers; :func:`read_frames` makes frames of them again.

    Parameters
    ----------
    kind : Kind
        Of the log.
    path : Path
    """
    others = Others()
    readers = {"blf": "BLFReader", "trc": "TRCReader"}
    frames = _Frames.of(path, _by_python_can(path, readers[kind], others) if kind in readers else _sqlite_frames(path, others))
    return frames.table(path, others)


def _risen(stamps: IntArray, notes: list[str]) -> Array:
    """Stamps since the first; those of ``candump -t d``, each since the one before, are added up; a counter's turns are taken out."""
    without = stamps == _NO_STAMP
    if without.any():
        return np.where(without, np.nan, stamps * 1e-9)
    exact = stamps
    if len(exact) > 2 and ((np.mean(np.diff(exact) < 0) > 0.1 and not _rises(exact)) or _are_steps(exact)):
        notes.append("the stamps are the times between frames (candump -t d); they were added up")
        exact = np.cumsum(exact)
    exact, turned = _without_turns(exact)
    notes += [turned] * bool(turned)
    since: Array = np.round((exact - exact[0]) * 1e-9, 9)
    return since


def _rises(stamps_ns: IntArray) -> bool:
    """True if the stamps rise with the frames on the whole: a clock, though neighbours changed places."""
    if not np.ptp(stamps_ns):
        return False
    return float(np.corrcoef(np.arange(len(stamps_ns)), stamps_ns - stamps_ns[0])[0, 1]) > _OF_A_CLOCK


def _are_steps(stamps_ns: IntArray) -> bool:
    """True if even times between frames follow a first stamp of 0: a clock would have come to them step by step."""
    usual = float(np.median(stamps_ns[1:]))
    return bool(stamps_ns[0] == 0 and np.mean(np.diff(stamps_ns[1:]) <= 0) > 0.5 and usual / 3.0 < stamps_ns[1] < 3.0 * usual)


def _without_turns(stamps_ns: IntArray) -> tuple[IntArray, str]:
    """Stamps of a counter that begins anew, as if it did not, and a sentence; "" when none does.   stamps_ns : ndarray (n,)."""
    steps = np.diff(stamps_ns)
    added = np.zeros(len(stamps_ns), dtype=np.int64)
    spans = []
    for k in np.flatnonzero(steps < -_SHORTEST_TURN_NS // 2).tolist():
        span = next((s for s in _TURNS_NS if s >= _SHORTEST_TURN_NS and _turns(int(stamps_ns[k]), int(stamps_ns[k + 1]), s)), 0)
        if span:
            added[k + 1 :] += span
            spans.append(span)
    if not spans:
        return stamps_ns, ""
    return stamps_ns + added, f"the logger's counter begins anew {len(spans)} times, after {spans[0] * 1e-9:.9g} s: its stamps were joined"


def _turns(before: int, after: int, span: int) -> bool:
    near = min(_AT_TURN_NS, span // 10)
    return span - near <= before < span and 0 <= after < near


def _csv_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a CSV file, whose header says what stands where."""
    places: dict[str, Any] | None = None
    for number, line in lines_of(path, others):
        if not line.strip():
            continue
        if places is None:
            places = csv_columns(line)
            if places is None:
                others.line(number)
            continue
        try:
            frame = _csv_frame([cell.strip().strip('"') for cell in line.rstrip("\r\n").split(places["mark"])], places)
        except (ValueError, IndexError, binascii.Error):
            frame = None
        if frame is not None:
            yield frame
        else:
            others.line(number)


def _csv_frame(cells: Sequence[str], places: dict[str, Any]) -> LoggedFrame | None:
    """Raises ValueError, IndexError, binascii.Error for cells that are none."""

    def has(key: str) -> bool:
        return places[key] is not None and cells[places[key]].lower() in _TRUE

    if has("error"):
        return None
    identifier = int(cells[places["id"]].lower().removesuffix("h"), 16)
    length = min(int(cells[places["length"]]), LONGEST) if places["length"] is not None and cells[places["length"]] else LONGEST
    remote = has("remote")
    if len(places["data"]) > 1:
        data = bytes(int(cells[place], 16) for place in places["data"][:length])
    elif places["names"][places["id"]] == "arbitration_id":
        data = base64.b64decode(cells[places["data"][0]], validate=True)
    else:
        data = bytes.fromhex(cells[places["data"][0]].replace("0x", ""))
    data = b"" if remote else data
    if not 0 <= identifier < 1 << 29 or len(data) > LONGEST:
        return None
    extended = has("extended") or identifier > 0x7FF
    channel = cells[places["channel"]] if places["channel"] is not None else "0"
    return LoggedFrame(_time_ns(cells[places["time"]], places), channel, identifier | (1 << 31 if extended else 0), remote, data)


def _time_ns(text: str, places: dict[str, Any]) -> int:
    """SavvyCAN counts whole microseconds; the others write seconds."""
    name = places["names"][places["time"]]
    if "." not in text and (name == "time stamp" or name.endswith(("us", "us)", "us]"))):
        return int(text) * 1000
    seconds, _, fraction = text.replace(",", ".").partition(".")
    whole = abs(int(seconds)) * 10**9 + int(fraction[:9].ljust(9, "0") or 0)
    return -whole if seconds.startswith("-") else whole


def _sqlite_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a database by python-can, its table ``messages``."""
    others.what = "error, CAN FD and other entries that are no classic CAN frames"
    opened(path).close()
    try:
        with sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True) as database:
            rows = database.execute("SELECT ts, arbitration_id, extended, remote, error, dlc, data FROM messages ORDER BY rowid")
            for number, (ts, identifier, extended, remote, error, _, data) in enumerate(rows, start=1):
                content = bytes(data or b"")
                if error or len(content) > LONGEST or not 0 <= int(identifier) < 1 << 29:
                    others.fd += len(content) > LONGEST
                    others.line(number)
                    continue
                marked = int(identifier) | (1 << 31 if extended else 0)
                yield LoggedFrame(round(float(ts) * 1e9), "0", marked, bool(remote), b"" if remote else content)
    except (sqlite3.Error, TypeError, ValueError) as error:
        others.notes.append(f"the file breaks off ({words_of(error)}): what came before is taken")


_READERS: Final[dict[str, Callable[[Path, Others], Iterator[LoggedFrame]]]] = {
    "candump": candump_frames,
    "asc": asc_frames,
    "csv": _csv_frames,
}
