"""Frames as they come from a bus, as rows: what the SDO answers and the process data say together."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import Heard
from beltcomm.errors import DataError
from beltcomm.foreign.busrecords import records_of
from beltcomm.foreign.convert import Reading, convert
from beltcomm.foreign.framelines import LONGEST
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.guess import completed
from beltcomm.foreign.signals import by_hand, table_of_signals
from beltcomm.watching.moves import LEAD_S, StreamPart

#: Frames of SDO transfers that stay: the first ones, for a set-up has some hundreds and a master that polls would push it out, and the
#: last ones; and all others at most, minutes at 1 kHz.
SETUP_FIRST, SETUP_LAST, OTHERS_KEPT = 3000, 3000, 400_000
_KEPT_S = 2.0 * LEAD_S


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
        """Drop the process data before this time: those moves are taken."""
        while self._others and self._others[0][1][0] < until_s - _KEPT_S:
            self._others.popleft()
