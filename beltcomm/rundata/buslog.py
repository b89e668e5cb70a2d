"""Log of a CAN bus, kept in memory while a command runs and written at its end in the format of ``candump -L``."""

from __future__ import annotations

import gzip
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from beltcomm import atomic
from beltcomm.locks import link_refused

#: Frames of the cyclic exchange (SYNC, PDO, signs of life) that are kept: the last 20 s at 1 kHz with five frames each.
CYCLIC_KEPT = 100_000
#: All other frames (NMT, EMCY, SDO): an ordinary command has some thousands.
OTHERS_KEPT = 200_000

Frame = tuple[float, int, bytes, str]
"""Time in s, identifier, data, and who sent it: "host", "node", "host rtr"."""


def _is_cyclic(identifier: int) -> bool:
    """SYNC, process data, heartbeat and guarding: what comes by itself, many times a second (CiA 301, table 38)."""
    return identifier == 0x80 or 0x180 <= identifier < 0x580 or identifier >= 0x700


class BusLog:
    """Call it with every frame.

    Parameters
    ----------
    dropped
        Cyclic frames that were too many to keep.
    """

    def __init__(self) -> None:
        self._cyclic: deque[tuple[int, Frame]] = deque(maxlen=CYCLIC_KEPT)
        self._others: deque[tuple[int, Frame]] = deque(maxlen=OTHERS_KEPT)
        self._count = 0
        self.dropped = 0

    def __call__(self, frame: Frame) -> None:
        """One more frame."""
        kept = self._cyclic if _is_cyclic(frame[1]) else self._others
        self.dropped += len(kept) == kept.maxlen
        kept.append((self._count, frame))
        self._count += 1

    def __len__(self) -> int:
        return len(self._cyclic) + len(self._others)

    def lines(self, channel: str) -> Iterator[str]:
        """The frames in their order: ``(12.345678) can0 181#0011AA``, a remote frame ``(12.345678) can0 701#R``."""
        for _, (time_s, identifier, data, source) in sorted([*self._cyclic, *self._others], key=lambda item: item[0]):
            content = "R" if source.endswith("rtr") else data.hex().upper()
            yield f"({time_s:017.6f}) {channel} {identifier:03X}#{content}"

    def write(self, folder: Path, name: str, channel: str) -> Path:
        """All of it into ``NAME.log.gz``, or NAME-2 and so on when there is one already; returns the file, or raises OSError."""
        if folder.is_symlink():
            raise link_refused(folder)
        folder.mkdir(parents=True, exist_ok=True)
        number = 1
        while (path := folder / f"{name}{f'-{number}' if number > 1 else ''}.log.gz").exists():
            number += 1
        with atomic.replacing(path) as raw, gzip.open(raw, "wt", encoding="ascii", newline="\n") as file:
            file.writelines(f"{line}\n" for line in self.lines(channel))
        return path
