"""Streams of rows for a watch: frames as they come from a bus, and a log that grows, read piece by piece.

What has been read stands in a window, a copy of the file's head and of its end, which the readers of ``import`` take like any file.  Of
frames in front of the window those of SDO transfers stay, the first and the last of them, for they say what the others carry.
"""

from __future__ import annotations

import re
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import Heard
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.busrecords import records_of
from beltcomm.foreign.convert import Reading, convert
from beltcomm.foreign.files import parts_of
from beltcomm.foreign.framelines import LONGEST, kind_of_log
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.guess import completed
from beltcomm.foreign.kinds import kind_of_table
from beltcomm.foreign.signals import by_hand, table_of_signals
from beltcomm.outside import opened, unreadable
from beltcomm.watching.moves import LEAD_S, StreamPart

#: Frames of SDO transfers that stay: the first ones, for a set-up has some hundreds and a master that polls would push it out, and the
#: last ones; and all others at most, minutes at 1 kHz.
SETUP_FIRST, SETUP_LAST, OTHERS_KEPT = 3000, 3000, 400_000
_KEPT_S_OF_BUS = 2.0 * LEAD_S


class BusStream:
    """The frames of one drive.

    Parameters
    ----------
    name : str
        Of the bus, for messages. notes : why there are no rows, "" when there are.
    """

    def __init__(self, name: str, reading: Reading, axis: Axis) -> None:
        self._name, self._reading, self._axis = name, reading, axis
        self._first: list[tuple[int, Heard]] = []
        self._setup: deque[tuple[int, Heard]] = deque(maxlen=SETUP_LAST)
        self._others: deque[tuple[int, Heard]] = deque(maxlen=OTHERS_KEPT)
        self._count = 0
        self._came = False
        self.notes: tuple[str, ...] = ()

    def take(self, frames: Iterable[Heard]) -> None:
        """Frames that have come."""
        for frame in frames:
            self._came = True
            self._count += 1
            setup = self._first if len(self._first) < SETUP_FIRST else self._setup
            (setup if 0x581 <= frame[1] <= 0x67F else self._others).append((self._count, frame))

    def poll(self) -> list[StreamPart]:
        """Rows of all frames that are kept, when some have come; [] when none have."""
        if not self._came:
            return []
        self._came = False
        frames = [frame for _, frame in sorted([*self._first, *self._setup, *self._others], key=lambda item: item[0])]
        data = np.zeros((len(frames), LONGEST), dtype=np.uint8)
        for row, frame in enumerate(frames):
            data[row, : len(frame[2])] = np.frombuffer(frame[2], dtype=np.uint8)
        log = FrameLog(
            self._name,
            np.array([frame[0] for frame in frames]),
            np.array([frame[1] for frame in frames], dtype=np.int64),
            np.array([frame[3] for frame in frames], dtype=np.bool_),
            np.array([len(frame[2]) for frame in frames], dtype=np.int64),
            data,
        )
        reading = self._reading
        try:
            if reading.signals:
                table = table_of_signals(log, [by_hand(text) for text in reading.signals])
                mapping, _ = completed(table, reading.mapping, self._axis, timed=True, ask=None)
                found = [StreamPart(convert(table, Reading(mapping=mapping, torque_acts=reading.torque_acts)).columns)]
            else:
                made = records_of(log, self._axis, reading.node, reading.torque_acts, reading.period_s)
                found = [StreamPart(record.table.columns, record.start_s) for record in made]
        except DataError as error:
            self.notes = (str(error),)
            return []
        self.notes = ()
        return found

    def rescan(self) -> None:
        """Have the kept frames looked at once more, for nothing follows them."""
        self._came = True

    def forget(self, until_s: float) -> None:
        """Drop the process data before this time on the clock of the frames: those moves are taken."""
        while self._others and self._others[0][1][0] < until_s - _KEPT_S_OF_BUS:
            self._others.popleft()


#: Bytes that are taken at once, lines of the file's head that stay, and bytes of a window at most.
PIECE, HEAD_LINES, LARGEST = 1 << 21, 8, 1 << 26
#: Frames of SDO transfers by their identifiers, in any text that holds frames.
_SDO = re.compile(rb"(?:^|\s)0?x?(?:58[1-9A-F]|5[9A-F][0-9A-F]|60[1-9A-F]|6[1-7][0-9A-F])(?:#|\s|;|,)", re.I)
#: ``candump``: a stamp in seconds since 1970.
_EPOCH = re.compile(rb"^\s*\((\d{9,11}\.\d+)\)")
#: s of rows before the next move that stay in the window.
_KEPT_S = 2.0 * LEAD_S


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """A file that was moved away, or a disk that is full, in words."""
    try:
        yield
    except OSError as error:
        raise DataError(
            f"{path} cannot be watched any longer: {error.filename or path}: {unreadable(error)}; watch the file that is written now"
        ) from error


class GrowingLog:
    """One file.

    Attributes
    ----------
    epoch_s : float or None
        Of the stream's clock, s since 1970, where the file's stamps say it.
    notes : tuple of str
        What the reader says of it, for whoever wants to know why there is no move.
    """

    def __init__(self, path: Path, reading: Reading, axis: Axis) -> None:
        self.path, self._reading, self._axis = path, reading, axis
        if not path.is_file():
            raise UsageError(f"{path} is no file; give the log that grows")
        with _told(path):
            self._folder = tempfile.TemporaryDirectory(prefix="beltcomm-watch-")
            self._kind = kind_of_log(path)
            with opened(path) as file:
                packed = file.read(2) == b"\x1f\x8b"
            text = self._kind in ("candump", "asc", "csv") or (self._kind is None and kind_of_table(path) == "text")
        self._lines = text and not packed
        self._size, self._offset, self._read = -1, 0, 0
        self._again = False
        self._head = b""
        self._window = bytearray()
        self._checkpoints: list[tuple[int, float]] = []
        self.epoch_s: float | None = None
        self.notes: tuple[str, ...] = ()

    def poll(self) -> list[StreamPart]:
        """Rows of the window, when something has come; [] when nothing has.   Raises DataError when the file can no longer be read."""
        with _told(self.path):
            return self._poll()

    def _poll(self) -> list[StreamPart]:
        if not self._lines:
            size = self.path.stat().st_size
            if size == self._size:
                return []
            self._size = size
            return self._stretches(self.path)
        with opened(self.path) as file:
            file.seek(0, 2)
            if file.tell() < self._read:
                raise DataError(f"{self.path} has become shorter while it was watched: its recorder began anew; watch the new file")
            file.seek(self._read)
            piece = file.read(PIECE)
        piece = piece[: piece.rfind(b"\n") + 1]
        if not piece and not (self._again and self._window):
            return []
        self._again = False
        if not self._head:
            self._head = b"".join(piece.splitlines(keepends=True)[:HEAD_LINES])
            if (stamp := _EPOCH.match(piece)) is not None:
                self.epoch_s = float(stamp[1])
        self._window += piece
        self._read += len(piece)
        copy = Path(self._folder.name) / f"window{self.path.suffix}"
        copy.write_bytes((self._head if self._offset else b"") + bytes(self._window))
        found = self._stretches(copy)
        if found:
            self._checkpoints.append((self._read, max(one.start_s + float(one.columns["t_s"][-1]) for one in found)))
        elif len(self._window) > LARGEST:
            raise DataError(f"{self.path}: {'; '.join(self.notes) or 'no move was found in it'}")
        return found

    @property
    def taken_bytes(self) -> int:
        """Bytes of the file that have been read."""
        return self._read if self._lines else self._size

    def rescan(self) -> None:
        """Have the window looked at once more, for nothing follows it."""
        self._again, self._size = True, -1

    def forget(self, until_s: float) -> None:
        """Leave out of the window what lies before this time on the stream's clock: those moves are taken."""
        passed = [at for at, time_s in self._checkpoints if time_s <= until_s - _KEPT_S]
        if not passed or not self._lines:
            return
        cut = passed[-1] - self._offset
        gone = bytes(self._window[:cut])
        known = self._head if not self._offset else b""
        if self._kind is not None:
            setup = [line for line in gone[len(known) :].splitlines(keepends=True) if _SDO.search(line)]
            lines = [*self._head.splitlines(keepends=True), *setup]
            self._head = b"".join([*lines[:SETUP_FIRST], *lines[SETUP_FIRST:][-SETUP_LAST:]])
        del self._window[:cut]
        self._offset = passed[-1]
        self._checkpoints = [one for one in self._checkpoints if one[0] > self._offset]

    def close(self) -> None:
        """Give the window back."""
        self._folder.cleanup()

    def _stretches(self, path: Path) -> list[StreamPart]:
        try:
            parts = parts_of(path, self._reading, self._axis)
            mapping, _ = completed(parts[0].table, self._reading.mapping, self._axis, timed=self._reading.period_s is None, ask=None)
        except DataError as error:
            self.notes = (str(error).replace(str(path), str(self.path)),)
            return []
        found = []
        for part in parts:
            reading = replace(self._reading, mapping=mapping, torque_acts=None if part.number is not None else self._reading.torque_acts)
            try:
                found.append(StreamPart(convert(part.table, reading).columns, part.start_s))
            except DataError as error:
                self.notes = (str(error).replace(str(path), str(self.path)),)
        return found
