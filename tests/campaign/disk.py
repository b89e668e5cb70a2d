"""A run folder on a disk that fills up or becomes read-only: the file layer of this process, for one folder."""

from __future__ import annotations

import builtins
import contextlib
import errno
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any


class Disk:
    """Counts what is written below ``folder`` and refuses it from the ``fails_at``-th time on (from 1), None is never.

    full : raw writes, as they leave the buffers, fail with ENOSPC; else everything that changes the folder fails with EROFS.
    writes, changes : how many raw writes there were, and how many operations that change the folder, those among them.
    """

    def __init__(self, folder: Path, full: bool, fails_at: int | None = None) -> None:
        self.folder, self.full, self.fails_at = os.path.abspath(folder), full, fails_at
        self.writes = self.changes = 0

    def touch(self, write: bool, path: object) -> None:
        """One operation.   write : bytes leave a buffer.   Raises OSError as the kernel would."""
        self.changes += 1
        self.writes += write
        counted = (self.writes if write else 0) if self.full else self.changes
        if self.fails_at is not None and counted >= self.fails_at:
            code = errno.ENOSPC if self.full else errno.EROFS
            # a failed write knows no file name, a failed open does
            raise OSError(code, os.strerror(code)) if write else OSError(code, os.strerror(code), str(path))

    def holds(self, path: object) -> bool:
        """Whether a path lies on this disk."""
        if not isinstance(path, (str, os.PathLike)):
            return False
        whole = os.path.abspath(os.fspath(path))
        return isinstance(whole, str) and (whole + os.sep).startswith(self.folder + os.sep)

    @contextlib.contextmanager
    def mounted(self) -> Iterator[Disk]:
        """All file operations of this process go through here."""
        opened = builtins.open

        def open_(file: Any, mode: str = "r", buffering: int = -1, encoding: str | None = None, *rest: Any, **more: Any) -> Any:
            if not self.holds(file) or not set(mode) & set("wax+"):
                return opened(file, mode, buffering, encoding, *rest, **more)
            self.touch(False, file)
            raw = _Raw(self, file, mode.replace("t", "").replace("b", ""))
            buffered = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
            if "b" in mode:
                return buffered
            text = io.TextIOWrapper(buffered, encoding or "utf-8", *rest, **more)
            text.mode = mode
            return text

        def guarded(function: Callable[..., Any]) -> Callable[..., Any]:
            def call(path: Any, *rest: Any, **more: Any) -> Any:
                if self.holds(path):
                    self.touch(False, path)
                return function(path, *rest, **more)

            return call

        patched = [(builtins, "open", open_), (io, "open", open_)]
        patched += [(os, name, guarded(getattr(os, name))) for name in ("mkdir", "replace", "rename", "unlink", "remove")]
        before = [(place, name, getattr(place, name)) for place, name, _ in patched]
        for place, name, new in patched:
            setattr(place, name, new)
        try:
            yield self
        finally:
            for place, name, old in before:
                setattr(place, name, old)


class _Raw(io.FileIO):
    """The bottom of a file: the real buffers stand on it, so that an error shows where it does on a real disk."""

    def __init__(self, disk: Disk, path: Any, mode: str) -> None:
        super().__init__(path, mode)
        self._disk = disk

    def write(self, data: Any) -> int:
        self._disk.touch(True, self.name)
        return int(super().write(data) or 0)
