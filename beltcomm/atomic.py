"""One way to write a file: it appears whole or not at all, whatever happens meanwhile, and a link in its place is not followed."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from beltcomm.posix import is_alive

#: A file on its way, and the process that writes it.
_DRAFT = re.compile(r"\.beltcomm-(\d+)-[0-9a-f]{8}\.tmp")


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write into, which becomes ``path`` when the block has ended and its bytes are on the disk.

    What a killed process left beside it of a file on its way is taken away.  What is no file, as a pipe or a terminal, is written into
    directly; a pipe that nobody reads is none.

    Parameters
    ----------
    path : Path

    Yields
    ------
    BinaryIO
        Open for bytes.

    Raises
    ------
    OSError
        When it cannot be written; what stood there stays.
    """
    if path.exists() and not path.is_file():
        with os.fdopen(_unwaited(path, os.O_WRONLY), "wb") as stream:
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
    _take_away_drafts(path.parent)
    sync(path.parent)


def appending(path: Path) -> int:
    """Number of a file opened to be grown line by line, made where it is not there.

    Parameters
    ----------
    path : Path

    Returns
    -------
    int
        File descriptor, for the caller to close.

    Raises
    ------
    OSError
        Also for a link, a pipe or a device.
    """
    number = _unwaited(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0))
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, "it is no file", str(path))
    return number


def append_line(path: Path, text: str) -> None:
    """A line behind the last one of a file, which ends where a power cut has torn it.

    Parameters
    ----------
    path : Path
    text : str
        Without its end of line.

    Raises
    ------
    OSError
        As :func:`appending`.
    """
    with os.fdopen(appending(path), "a+b") as file:
        if file.seek(0, os.SEEK_END):
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(text.encode(errors="backslashreplace") + b"\n")


def _unwaited(path: Path, flags: int) -> int:
    """Opened without waiting for the other end of a pipe."""
    number = os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0), 0o666)
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(number, True)
    return number


def write(path: Path, data: bytes) -> None:
    """Write a file: whole or not at all.

    Parameters
    ----------
    path : Path
    data : bytes
        All of its content.

    Raises
    ------
    OSError
        When it cannot be written; what stood there stays.
    """
    with replacing(path) as file:
        file.write(data)


def sync(folder: Path) -> None:
    """Have what was renamed in a folder outlive a power cut, where the system can do that.

    Parameters
    ----------
    folder : Path
        In which a file was renamed.
    """
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def is_draft(name: str) -> bool:
    """True if this is the name of a file on its way.

    Parameters
    ----------
    name : str
        Of a file, without its folder.

    Returns
    -------
    bool
        By its form alone.
    """
    return _DRAFT.fullmatch(name) is not None


def sweep(folder: Path) -> None:
    """Take away what killed processes have left of files on their way, in a folder and the ones inside it.

    Parameters
    ----------
    folder : Path
        With all folders inside it.
    """
    for place in (folder, *_folders(folder)):
        _take_away_drafts(place)


def _take_away_drafts(place: Path) -> None:
    for name in _names(place):
        if (found := _DRAFT.fullmatch(name)) and not is_alive(int(found[1])):
            with contextlib.suppress(OSError):
                (place / name).unlink()


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _folders(folder: Path) -> list[Path]:
    return [path for name in _names(folder) if (path := folder / name).is_dir() and not path.is_symlink()]
