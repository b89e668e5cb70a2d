"""Files from outside: one door, through which every file passes that somebody else may have written.

A file is opened without following a link out of its folder, must be a regular one (no pipe, no device), and has no more bytes than its
kind ever needs; what is packed in it unpacks to no more than that either.  What is refused is refused with a sentence.
"""

from __future__ import annotations

import codecs
import gzip
import hashlib
import json
import os
import stat
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any, Final

from beltcomm.errors import BeltcommError, DataError

#: Bytes of settings, notes and models; of kept results; and of recordings and measurements, packed or not.
SETTINGS_BYTES: Final = 4 << 20
KEPT_BYTES: Final = 64 << 20
MEASURED_BYTES: Final = 4 << 30
#: Columns and values of one table; 20 h of four signals at 1 kHz, 2 GB in memory.
MOST_COLUMNS: Final = 4000
MOST_VALUES: Final = 1 << 28
#: Bytes read at a time.
_BLOCK: Final = 4 << 20


def opened(
    path: Path, most: int = MEASURED_BYTES, failure: type[BeltcommError] = DataError, *, within: Path | None = None
) -> BufferedReader:
    """A file opened for reading.

    Parameters
    ----------
    path : Path
    most : int
        Bytes.
    failure : type of BeltcommError
        Raised for what is not read.
    within : Path or None
        The folder that a link may not lead out of; None: the one in which it stands.

    Raises
    ------
    OSError
        When it is missing or must not be read, ``failure`` for what is no regular file, too large, or a link to elsewhere.
    """
    real = Path(os.path.realpath(path, strict=True))
    folder = Path(os.path.realpath(within or path.parent))
    if not real.is_relative_to(folder):
        raise failure(f"{path} is a link out of its folder, to {real}; copy that file to its place, or give {real} itself")
    # neither waits for a pipe's other end, nor becomes the terminal that a device stands for
    flags = (
        os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    )
    number = os.open(real, flags)
    try:
        about = os.fstat(number)
        if not stat.S_ISREG(about.st_mode):
            what = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe or a device"
            raise failure(f"{path} is {what}, no file; save what it holds as a file first")
        if about.st_size > most:
            raise failure(f"{path} has {in_words(about.st_size)}, at most {in_words(most)} are read; give a part of it")
        return os.fdopen(number, "rb")
    except BaseException:
        os.close(number)
        raise


def read_bytes(path: Path, most: int = SETTINGS_BYTES, failure: type[BeltcommError] = DataError) -> bytes:
    """All bytes of a file, see :func:`opened`.

    Parameters
    ----------
    path : Path
    most : int, bytes
        That are read.
    failure : type of BeltcommError
        Raised for what is not read.

    Raises
    ------
    OSError
        When it cannot be opened.
    """
    with opened(path, most, failure) as file:
        return file.read(most)


def read_text(path: Path, most: int = SETTINGS_BYTES, failure: type[BeltcommError] = DataError, *, errors: str = "strict") -> str:
    """All text of a file in UTF-8, see :func:`opened`.

    Parameters
    ----------
    path : Path
    most : int, bytes
        That are read.
    failure : type of BeltcommError
        Raised for what is not read.
    errors : str
        As of ``bytes.decode``. Raises ``failure`` for other text, too.
    """
    try:
        return read_bytes(path, most, failure).decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise failure(f"{path} is not UTF-8 text (byte {error.start}); save it as UTF-8") from error


def read_json(path: Path) -> Any:
    """Content of a JSON file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError, DataError
        As :func:`opened`.
    ValueError
        For whatever is wrong with the text.
    """
    return from_json(read_bytes(path, KEPT_BYTES))


def from_json(text: str | bytes, members: Callable[[list[tuple[str, Any]]], Any] | None = None) -> Any:
    """Content of a JSON text.

    Parameters
    ----------
    text : str or bytes
        UTF-8 where it is bytes.
    members : callable or None
        Makes an object of its names and values, where the last of two with one name shall not be the only one.

    Raises
    ------
    ValueError
        Also for one that is nested deeper than this program can follow.
    """
    try:
        return json.loads(text, object_pairs_hook=members)
    except RecursionError as error:
        raise ValueError("its values nest too deeply") from error


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes in hexadecimal digits, however large it is.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError, DataError
        As :func:`opened`.
    """
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def unpacked(path: Path, most: int = MEASURED_BYTES) -> Iterator[Any]:
    """A file to read bytes from, a gzip file's unpacked.

    Parameters
    ----------
    path : Path
        Of the file, packed or not.
    most : int, bytes
        Of the file as it is.

    Raises
    ------
    OSError, DataError
        As :func:`opened`.
    """
    with opened(path, most) as file:
        packed = file.read(2) == b"\x1f\x8b"
        file.seek(0)
        yield gzip.GzipFile(fileobj=file) if packed else file


def blocks(path: Path, most: int = MEASURED_BYTES) -> Iterator[bytes]:
    """The bytes of a file piece by piece, a gzip file's unpacked.

    Parameters
    ----------
    path : Path
        Of the file, packed or not.
    most : int, bytes
        Of what it unpacks to.

    Yields
    ------
    bytes
        Pieces in their order.

    Raises
    ------
    OSError, EOFError, zlib.error
        For what cannot be read.
    DataError
        When there are more than ``most``, see :func:`opened`.
    """
    with unpacked(path, most) as source:
        total = 0
        while block := source.read(_BLOCK):
            total += len(block)
            if total > most:
                raise DataError(f"{path} unpacks to more than {in_words(most)}, which is not read; unpack it and give a part of it")
            yield block


def text_blocks(path: Path, encoding: str, errors: str = "strict") -> Iterator[str]:
    """Text of a file in blocks that end at the ends of lines.

    Parameters
    ----------
    path : Path
        Of the file, packed or not.
    encoding, errors : str
        As for ``bytes.decode``.

    Raises
    ------
    UnicodeDecodeError
        For bytes that are no text.
    DataError
        For a line beyond any.
    """
    decoder = codecs.getincrementaldecoder(encoding)(errors)
    rest = ""
    for block in blocks(path):
        text = rest + decoder.decode(block)
        # a line may end in \r\n, and the \n be in the next piece
        end = text.rfind("\n") + 1 or text.rfind("\r", 0, -1) + 1
        if not end and len(text) > 2 * _BLOCK:
            raise DataError(f"{path} has a line of more than {in_words(_BLOCK)}; it is no table of numbers, or its lines have no ends")
        rest = text[end:]
        if end:
            yield text[:end]
    rest += decoder.decode(b"", final=True)
    if rest:
        yield rest


def check_columns(file: str, count: int) -> None:
    """Refuse more columns than any measurement has.

    Parameters
    ----------
    file : str
        Name, for the sentence.
    count : int
        Of its columns.

    Raises
    ------
    DataError
        For more than ``MOST_COLUMNS``.
    """
    if count > MOST_COLUMNS:
        raise DataError(
            f"{file} has {count} columns, at most {MOST_COLUMNS} are read; export the signals that are needed: time, torque, position"
        )


def check_count(file: str, rows: int, columns: int) -> None:
    """Refuse more values than are taken into memory.

    Parameters
    ----------
    file : str
        Name, for the sentence.
    rows, columns : int
        Of its table.

    Raises
    ------
    DataError
        For more than ``MOST_VALUES``.
    """
    if rows * columns > MOST_VALUES:
        raise DataError(
            f"{file} has more than {MOST_VALUES // columns} rows of {columns} columns, at most {MOST_VALUES} values are read; "
            "export a part of the time, or fewer signals"
        )


def unreadable(error: BaseException) -> str:
    """Reason why a file cannot be read, in a few words.

    Parameters
    ----------
    error : BaseException
        That opening or unpacking raised.
    """
    if isinstance(error, EOFError | zlib.error):
        return "its packed content is damaged or cut off"
    return str(getattr(error, "strerror", None) or error)


def in_words(size: int) -> str:
    """A number of bytes for a sentence.

    Parameters
    ----------
    size : int, bytes
        Of a file.
    """
    for unit, name in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size} bytes"
