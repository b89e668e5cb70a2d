"""A hash of all frames of a bus, for tests of sameness."""

from __future__ import annotations

import hashlib
import struct

from beltcomm.virtual.bus import Frame


class FrameHash:
    """A frame hook that keeps only a SHA-256 of everything that went over the bus."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def __call__(self, frame: Frame) -> None:
        """Add one frame."""
        time_s, identifier, data, source = frame
        self._hash.update(struct.pack("<dHB", time_s, identifier & 0xFFFF, len(data)) + data + source.encode())

    def hexdigest(self) -> str:
        """Hash of all frames so far."""
        return self._hash.hexdigest()
