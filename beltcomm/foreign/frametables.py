"""CAN frames in tables: CSV by SavvyCAN, python-can and others, and python-can's SQLite."""

from __future__ import annotations

import base64
import binascii
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from beltcomm.foreign.framelines import LONGEST, LoggedFrame, Others, csv_columns, lines_of
from beltcomm.foreign.table import words_of
from beltcomm.outside import opened

_TRUE = {"1", "true", "yes", "x"}


def csv_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a CSV file, whose header says what stands where."""
    places: dict[str, Any] | None = None
    for number, line in lines_of(path, others):
        if not line.strip():
            continue
        if places is None:
            places = csv_columns(line)
            if places is None:
                others.line(number)
            continue
        try:
            frame = _csv_frame([cell.strip().strip('"') for cell in line.rstrip("\r\n").split(places["mark"])], places)
        except (ValueError, IndexError, binascii.Error):
            frame = None
        if frame is not None:
            yield frame
        else:
            others.line(number)


def _csv_frame(cells: Sequence[str], places: dict[str, Any]) -> LoggedFrame | None:
    """Raises ValueError, IndexError, binascii.Error for cells that are none."""

    def has(key: str) -> bool:
        return places[key] is not None and cells[places[key]].lower() in _TRUE

    if has("error"):
        return None
    identifier = int(cells[places["id"]].lower().removesuffix("h"), 16)
    length = min(int(cells[places["length"]]), LONGEST) if places["length"] is not None and cells[places["length"]] else LONGEST
    remote = has("remote")
    if len(places["data"]) > 1:
        data = bytes(int(cells[place], 16) for place in places["data"][:length])
    elif places["names"][places["id"]] == "arbitration_id":
        data = base64.b64decode(cells[places["data"][0]], validate=True)
    else:
        data = bytes.fromhex(cells[places["data"][0]].replace("0x", ""))
    data = b"" if remote else data
    if not 0 <= identifier < 1 << 29 or len(data) > LONGEST:
        return None
    extended = has("extended") or identifier > 0x7FF
    channel = cells[places["channel"]] if places["channel"] is not None else "0"
    return LoggedFrame(_time_ns(cells[places["time"]], places), channel, identifier | (1 << 31 if extended else 0), remote, data)


def _time_ns(text: str, places: dict[str, Any]) -> int:
    """SavvyCAN counts whole microseconds; the others write seconds."""
    name = places["names"][places["time"]]
    if "." not in text and (name == "time stamp" or name.endswith(("us", "us)", "us]"))):
        return int(text) * 1000
    seconds, _, fraction = text.replace(",", ".").partition(".")
    whole = abs(int(seconds)) * 10**9 + int(fraction[:9].ljust(9, "0") or 0)
    return -whole if seconds.startswith("-") else whole


def sqlite_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a database by python-can, its table ``messages``."""
    others.what = "error, CAN FD and other entries that are no classic CAN frames"
    opened(path).close()
    try:
        with sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True) as database:
            rows = database.execute("SELECT ts, arbitration_id, extended, remote, error, dlc, data FROM messages ORDER BY rowid")
            for number, (ts, identifier, extended, remote, error, _, data) in enumerate(rows, start=1):
                content = bytes(data or b"")
                if error or len(content) > LONGEST or not 0 <= int(identifier) < 1 << 29:
                    others.fd += len(content) > LONGEST
                    others.line(number)
                    continue
                marked = int(identifier) | (1 << 31 if extended else 0)
                yield LoggedFrame(round(float(ts) * 1e9), "0", marked, bool(remote), b"" if remote else content)
    except (sqlite3.Error, TypeError, ValueError) as error:
        others.notes.append(f"the file breaks off ({words_of(error)}): what came before is taken")
