"""The journal of a run: ``journal.txt``, one sentence a line for people, and ``events.jsonl`` beside it, by which programs decide.

Both grow line by line and together: line n of one is line n of the other.  Where a clock is known each begins with its time.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal, get_args

from beltcomm.atomic import append_line
from beltcomm.errors import DataError, UsageError
from beltcomm.outside import KEPT_BYTES, read_text

TEXT, EVENTS = "journal.txt", "events.jsonl"
#: What a line means to a program; a note is for people only.
Event = Literal["note", "phase", "connected", "rehearsed", "restored", "gains kept", "not restored", "left at once"]


def append(folder: Path, line: str, event: Event, at: str) -> None:
    """Append one line to both files.

    Parameters
    ----------
    folder : Path
        Of the run.
    line : str
        A sentence.
    event : Event
        Kind of it, for programs.
    at : str
        When, "" where nobody knows.

    Raises
    ------
    UsageError
        When they cannot be written.
    """
    text = " ".join(line.split())
    _append(folder / TEXT, f"{at}  {text}" if at else text)
    _append(folder / EVENTS, json.dumps({"at": at, "event": event}))


def lines_of(folder: Path) -> list[str]:
    """Lines of the journal; nothing where there is none.

    Parameters
    ----------
    folder : Path
        Of the run.

    Raises
    ------
    DataError
        When it cannot be read.
    """
    path = folder / TEXT
    try:
        return read_text(path, KEPT_BYTES, errors="replace").splitlines() if path.is_file() else []
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error


def events_of(folder: Path) -> list[str]:
    """Events in the lines of the journal; a line that a power cut has torn is a note.   Nothing where it cannot be read.

    Parameters
    ----------
    folder : Path
        Of the run.

    Returns
    -------
    list of str
        One for each line.
    """
    try:
        lines = read_text(folder / EVENTS, KEPT_BYTES, errors="replace").splitlines()
    except (OSError, DataError):
        return []
    return [_event_of(line) for line in lines]


def _event_of(line: str) -> str:
    try:
        found = json.loads(line)["event"]
    except (ValueError, KeyError, TypeError, RecursionError):
        found = "note"
    return found if found in get_args(Event) else "note"


def _append(path: Path, line: str) -> None:
    try:
        append_line(path, line)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; make room or choose another --run folder") from error
