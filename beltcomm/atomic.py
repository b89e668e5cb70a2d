"""One way to write a file: it appears whole or not at all, whatever happens meanwhile, and a link in its place is not followed."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

#: A file on its way, and the process that writes it.
_DRAFT = re.compile(r"\.beltcomm-(\d+)-[0-9a-f]{8}\.tmp")


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write into, which becomes ``path`` when the block has ended and its bytes are on the disk.   Raises OSError.

    What is no file, as a pipe or a terminal, is written into directly.
    """
    if path.exists() and not path.is_file():
        with open(path, "wb") as stream:
            yield stream
        return
    draft = path.with_name(f".beltcomm-{os.getpid()}-{secrets.token_hex(4)}.tmp")
    try:
        with open(draft, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, path)
    except BaseException:
        with contextlib.suppress(OSError):  # a read-only file system refuses even to delete what is not there
            draft.unlink()
        raise
    sync(path.parent)


def write(path: Path, data: bytes) -> None:
    """Write a file.   Raises OSError."""
    with replacing(path) as file:
        file.write(data)


def sync(folder: Path) -> None:
    """Have what was renamed in a folder outlive a power cut, where the system can do that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def is_draft(name: str) -> bool:
    """True if this is the name of a file on its way."""
    return _DRAFT.fullmatch(name) is not None


def sweep(folder: Path) -> None:
    """Take away what killed processes have left of files on their way, in a folder and the ones inside it."""
    for place in (folder, *_folders(folder)):
        for name in _names(place):
            if (found := _DRAFT.fullmatch(name)) and not _alive(int(found[1])):
                with contextlib.suppress(OSError):
                    (place / name).unlink()


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _folders(folder: Path) -> list[Path]:
    return [path for name in _names(folder) if (path := folder / name).is_dir() and not path.is_symlink()]


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
