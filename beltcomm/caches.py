"""Caches of what took long to find: JSON files that are made again where they cannot be used, and one line that says so."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from beltcomm import atomic, outside
from beltcomm.errors import BeltcommError

_said: list[str] = []
_listeners: list[Callable[[str], object]] = []


def listen(say: Callable[[str], object]) -> None:
    """From now on, and what there has been to say so far: that something was made again, or cannot be kept; each once.

    Parameters
    ----------
    say : callable
        Gets every line.
    """
    _listeners.append(say)
    for line in _said:
        say(line)


def tell(line: str) -> None:
    """Say a line to all that listen, once.

    Parameters
    ----------
    line : str
        A sentence.
    """
    if line not in _said:
        _said.append(line)
        for say in _listeners:
            say(line)


def found(path: Path, key: str) -> dict[str, Any] | None:
    """Content kept under this key; None for nothing, or another one's, or what cannot be read, which is thrown away and said.

    Parameters
    ----------
    path : Path
    key : str
        Of what was asked: another one's content is not used.

    Returns
    -------
    dict of str to Any or None
        Without more checks than that.
    """
    try:
        content: dict[str, Any] = outside.read_json(path)
        return content if content["key"] == key else None
    except FileNotFoundError:
        return None
    except OSError as error:
        tell(f"{path} cannot be read ({error.strerror or error}); what it keeps is found anew.")
    except (BeltcommError, ValueError, KeyError, TypeError):
        damaged(path)
    return None


def damaged(path: Path) -> None:
    """Throw away what is no more than a cache.

    Parameters
    ----------
    path : Path
    """
    tell(f"{path} is damaged; it is thrown away and made again.")
    with suppress(OSError):  # made again it is all the same
        path.unlink(missing_ok=True)


def keep(path: Path, key: str, content: Mapping[str, Any]) -> None:
    """Keep content under a key, where that is possible; where it is not, results are the same.

    Parameters
    ----------
    path : Path
        Of the file; its folder is made.
    key : str
        Of what was asked.
    content : mapping of str to Any
        Plain values for JSON.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write(path, json.dumps({"key": key, **content}).encode() + b"\n")
    except OSError as error:
        tell(f"{path} cannot be kept ({error.strerror or error}); the next command finds it anew.")


def keep_newest(folder: Path, pattern: str, most: int) -> None:
    """Leave so many of the files of a pattern, those written last; another process may do the same meanwhile.

    Parameters
    ----------
    folder : Path
        Not searched deeper.
    pattern : str
        Of file names, as for ``glob``.
    most : int
        That are left.
    """
    written: dict[Path, float] = {}
    for path in folder.glob(pattern):
        with suppress(OSError):
            written[path] = path.stat().st_mtime
    for path in sorted(written, key=lambda file: -written[file])[most:]:
        with suppress(OSError):
            path.unlink()


@cache
def source_hash() -> str:
    """SHA-256 of all source text of this package, its first 16 digits; a version number says less between two releases."""
    found = hashlib.sha256()
    for item in _sources(files("beltcomm")):
        found.update(item.read_bytes())
    return found.hexdigest()[:16]


def _sources(package: Traversable) -> list[Traversable]:
    found = []
    for item in sorted(package.iterdir(), key=lambda item: item.name):
        if item.is_dir():
            found += _sources(item)
        elif item.name.endswith(".py"):
            found.append(item)
    return found
