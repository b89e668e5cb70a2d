"""Result of a command, kept in ``RUN/kept`` for as long as nothing that it rests on has changed: the same question costs no search."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from typing import Any

from beltcomm import caches
from beltcomm.caches import source_hash
from beltcomm.errors import BeltcommError
from beltcomm.journal import EVENTS, TEXT
from beltcomm.outside import sha256_of
from beltcomm.result import Line, Result, Row, plain
from beltcomm.runfolder import RunFolder

#: Parts of a run folder that no result rests on, beside hidden files: foreign files before they became records, what is kept, drawn, told
#: or written down.
BESIDE = ("originals", "kept", "pictures", "report.html", "report.json", TEXT, EVENTS, "verdict.txt")


def kept_or_new(folder: RunFolder, name: str, question: Sequence[object], make: Callable[[], Result], drawn: bool = False) -> Result:
    """The answer of before where the same programs would give it again from the same files, else a new one, kept.

    Parameters
    ----------
    name : str
        Of the answer, and of its own file among the results.
    question : sequence of object
        Everything else that the answer depends on.
    drawn : bool
        Pictures belong to it, and must be there.
    """
    path, key = folder.path / "kept" / f"{name}.json", _key(folder, name, question)
    found = caches.found(path, key) if key else None
    try:
        pictures = found["data"]["pictures"] if found and drawn else []
        if found and bool(pictures) is drawn and all((folder.path / picture).is_file() for picture in pictures):
            shown = [_line(kept) for kept in found["text"]]
            return Result(found["data"], shown, int(found["exit_code"]), details=[_line(kept) for kept in found["details"]])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        caches.damaged(path)
    made = make()
    result = Result(plain(made.data), made.text, made.exit_code, details=made.details)
    if not key:
        return result
    caches.keep(
        path,
        key,
        {"data": result.data, "text": [*map(_kept, result.text)], "details": [*map(_kept, result.details)], "exit_code": result.exit_code},
    )
    return result


def _key(folder: RunFolder, name: str, question: Sequence[object]) -> str:
    """Changes with everything that the answer rests on; empty where a file cannot be read: then nothing is kept."""
    own = folder.path / "results" / f"{name}.yaml"
    there = (
        path
        for path in sorted(folder.path.rglob("*"))
        if path.is_file() and path != own and path.relative_to(folder.path).parts[0] not in BESIDE and path.name[0] != "."
    )
    try:
        found = [(str(p.relative_to(folder.path)), sha256_of(p)) for p in there]
    except (OSError, BeltcommError):
        return ""
    text = json.dumps([found, source_hash(), str(folder.path), *question])
    return hashlib.sha256(text.encode()).hexdigest()


def _kept(line: str) -> str | list[object]:
    if isinstance(line, Line):
        return [list(part) for part in line.parts]
    return [str(line), line.cells, line.right, line.head] if isinstance(line, Row) else line


def _line(kept: str | list[Any]) -> str:
    if isinstance(kept, str):
        return kept
    return Line(*((str(text), str(style)) for text, style in kept)) if isinstance(kept[0], list) else Row(*kept)
