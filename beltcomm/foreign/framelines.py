"""Logs of CAN frames line by line: candump (``-L`` and as shown), Vector ``.asc``; and what kind of log a file is, by its content."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from beltcomm.foreign.table import words_of
from beltcomm.foreign.textformat import wide_encoding
from beltcomm.outside import MEASURED_BYTES, MOST_VALUES, in_words, opened, unpacked

LogKind = Literal["blf", "trc", "asc", "candump", "csv", "sqlite"]

#: (1436509052.249713), with -t A (2015-07-10 05:37:32.249713)
_IN_BRACKETS = r"\(((?:\d{4}-\d\d-\d\d \d\d:\d\d:\d\d|-?\d+)\.\d+)\)\s+"
#: ``candump -L``: (1436509052.249713) can0 181#0011223344556677
_COMPACT = re.compile(_IN_BRACKETS + r"(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(R\d?|#?[0-9A-Fa-f.]*)(?:\s+[TR])?\s*$")
#: ``candump``:  (1436509052.249713)  can0  181   [8]  00 11 22 33 44 55 66 77; the stamp only with -t
_SPACED = re.compile(
    rf"(?:{_IN_BRACKETS})?"
    r"(\S+)\s+(?:(?:RX|TX)\s+\S\s+\S\s+)?([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(\d{1,2})\]\s*"
    r"((?:[0-9A-Fa-f]{2}\s?)*|remote request)\s*(?:'.*')?$"
)
#: Lines from which a text file is recognised as a log.
_LOOKED_AT = 40
#: CAN FD:   (1436509052.249713) can0 181##1001122...,   can0  181  [12]  00 11 ...
_CANDUMP_FD = re.compile(rf"(?:{_IN_BRACKETS})?\S+\s+[0-9A-Fa-f]{{3,8}}(##[0-9A-Fa-f]+|\s+\[(12|16|20|24|32|48|64|\d\d)\]\s+[0-9A-Fa-f])")
_COLOURS = re.compile("\x1b\\[[0-9;]*m")
#: Letters of a line that are read at once: no frame takes more.
_LONGEST_LINE = 4096
LONGEST = 8
#: .asc:   0.001000 1  181             Rx   d 8 00 11 22 33 44 55 66 77; stamps may lie before the trigger, below zero
_ASC = re.compile(
    r"\s*(-?\d+\.\d+)\s+(\d+)\s+([0-9A-Fa-f]+)(x?)\s+(?:Rx|Tx)\s+([dr])(?:\s+([0-9A-Fa-f]+)((?:\s+[0-9A-Fa-f]+)*))?(?:\s|$)", re.I
)
_ASC_EVENT = re.compile(r"\s*(?:-?\d+\.\d+)\s+(?:CANFD\s+)?\d+\s+\S")
_ASC_STAMP = re.compile(r"\s*(-?\d+\.\d+)\s")
_ASC_BASE = re.compile(r"\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.I)


#: Lines that an .asc has beside its frames; those with a stamp and words are events.
_ASC_WORDS = re.compile(r"\s*(-?\d+\.\d+\s+[A-Za-z]|date\b|base\b|(no\s+)?internal\b|begin\b|end\b|//|previous\b|$)", re.I)


class LoggedFrame(NamedTuple):
    """One classic frame; time_ns is None without a stamp, identifier has bit 31 set when it is an extended one."""

    time_ns: int | None
    channel: str
    identifier: int
    remote: bool
    data: bytes


@dataclass
class Others:
    """Lines of a file that are no frames to be read.

    Attributes
    ----------
    count : int
        Of them.
    what : str
        Kind of these lines, in words.
    first : int
        Line, 0 when not known.
    fd : int
        Frames of CAN FD among them.
    """

    count: int = 0
    what: str = "lines that are no classic CAN frames"
    first: int = 0
    fd: int = 0
    notes: list[str] = field(default_factory=list)

    def line(self, number: int) -> None:
        """Count one of them.

        Parameters
        ----------
        number : int
            In the file, from 1.
        """
        self.count, self.first = self.count + 1, self.first or number


@contextmanager
def opened_text(path: Path) -> Iterator[io.TextIOWrapper]:
    """A text file to read from, a gzip file's unpacked, in UTF-8 or UTF-16.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError, EOFError, zlib.error, DataError
        When it cannot be read.
    """
    with unpacked(path) as source:
        encoding = wide_encoding(source.read(_LONGEST_LINE)) or "utf-8-sig"
        source.seek(0)
        with io.TextIOWrapper(source, encoding=encoding, errors="replace") as text:
            yield text


#: What stands at the beginning of files that hold frames; PEAK's and Vector's text formats have a header of their own.
_BLF, _SQLITE = b"LOGG", b"SQLite format 3\0"
_TRC_HEAD = re.compile(r";\s*\$(FILEVERSION|STARTTIME)|;.*PCAN-(View|Explorer|Trace|Net)", re.I)
_ASC_HEAD = re.compile(r"\s*base\s+(hex|dec)\b|\s*Begin Trigger\s?block|//\s*version\s+\d", re.I)
#: Headers of frames in CSV: python-can's, SavvyCAN's, and others with a time, an identifier and data.
_CSV_TIME = re.compile(r"time ?stamps?( ?\(?u?s\)?)?|time( ?\[?\(?u?s\]?\)?)?|zeit", re.I)
_CSV_ID = re.compile(r"arbitration_id|(can[ _-]?)?id(entifier)?( ?\(?hex\)?)?", re.I)
_CSV_DATA = re.compile(r"data( ?bytes)?( ?\(?hex\)?)?|payload|(d|b|data|byte)[ _]?[0-8]", re.I)


def kind_of_log(path: Path) -> LogKind | None:
    """Kind of log of frames that a file is, by its first bytes and lines; by its ending alone where those say nothing; None for no log.

    Raises OSError.

    Parameters
    ----------
    path : Path
        Of the file, packed or not.
    """
    with opened(path) as file:
        begin = file.read(16)
    ending = path.suffix.lower()
    if begin.startswith(_BLF):
        return "blf"
    if begin.startswith(_SQLITE):
        return "sqlite" if _holds_messages(path) else None
    try:
        lines = _first_lines(path)
    except (OSError, EOFError, ValueError, zlib.error):
        lines = []
    kind = _kind_of_lines(lines)
    if (
        kind is None
        and ending in {".blf", ".trc", ".asc"}
        and not (ending != ".blf" and (b"\0" in begin or b"#9" in begin or _is_a_table(lines)))
    ):
        return {".blf": "blf", ".trc": "trc", ".asc": "asc"}[ending]  # type: ignore[return-value]
    return kind


def _first_lines(path: Path) -> list[str]:
    """The first lines with content of a text file.   Raises OSError, EOFError, ValueError, zlib.error."""
    with opened_text(path) as file:
        lines = (
            _plain_line(line).strip() for _, line in zip(range(_LOOKED_AT), iter(lambda: file.readline(_LONGEST_LINE), ""), strict=False)
        )
        return [line for line in lines if line]


def _kind_of_lines(lines: Sequence[str]) -> LogKind | None:
    if any(_TRC_HEAD.match(line) for line in lines):
        return "trc"
    if any(_ASC_HEAD.match(line) for line in lines) or sum(_ASC.match(line) is not None for line in lines) > 0.7 * len(lines) > 0:
        return "asc"
    fitting = sum(_matched(line) is not None or _CANDUMP_FD.match(line) is not None for line in lines)
    if fitting > 0 and fitting >= 0.7 * len(lines):
        return "candump"
    return "csv" if lines and csv_columns(lines[0]) is not None else None


def _is_a_table(lines: Sequence[str]) -> bool:
    """True if most lines are nothing but numbers: a table that bears the ending of a log."""
    rows = [re.split(r"[\s;,]+", line.strip("\0")) for line in lines]
    numbers = [len(row) > 1 and all(re.fullmatch(r"[-+.\deE]+", cell) for cell in row if cell) for row in rows]
    return sum(numbers) > 0.5 * len(lines)


def csv_columns(header: str) -> dict[str, Any] | None:
    """Places of time, identifier, data and the rest in a header line of frames; None for any other header.

    Parameters
    ----------
    header : str
        Line of names.
    """
    mark = ";" if header.count(";") > header.count(",") else ","
    names = [cell.strip().strip('"').lower() for cell in header.split(mark)]
    found: dict[str, Any] = {"mark": mark, "names": names}
    for key, pattern in (("time", _CSV_TIME), ("id", _CSV_ID)):
        found[key] = next((k for k, name in enumerate(names) if pattern.fullmatch(name)), None)
    found["data"] = [k for k, name in enumerate(names) if _CSV_DATA.fullmatch(name)]
    for key, words in (("extended", {"extended", "ext", "ide"}), ("remote", {"remote", "rtr"}), ("error", {"error"}),
                       ("length", {"len", "dlc", "length"}), ("channel", {"bus", "channel", "interface"})):  # fmt: skip
        found[key] = next((k for k, name in enumerate(names) if name in words), None)
    whole = found["time"] is not None and found["id"] is not None and found["data"]
    return found if whole and (found["length"] is not None or len(found["data"]) in (1, 8)) else None


def _holds_messages(path: Path) -> bool:
    """True if a database has python-can's table of messages: its definition stands as text in the first page."""
    with opened(path) as file:
        begin = file.read(1 << 16)
    return b"arbitration_id" in begin and b"dlc" in begin


def _matched(line: str) -> LoggedFrame | None:
    match = _COMPACT.match(line)
    if match:
        stamp, channel, identifier, payload = match.groups()
        remote = payload.startswith("R")
        text = "" if remote else payload.replace(".", "")
        if text.startswith("#") or len(text) % 2 or len(text) > 2 * LONGEST:  # ## is CAN FD
            return None
        return LoggedFrame(_stamp(stamp), channel, _identifier(identifier), remote, bytes.fromhex(text))
    match = _SPACED.match(line)
    if match is None:
        return None
    stamp, channel, identifier, length, payload = match.groups()
    remote = payload.startswith("remote")
    data = b"" if remote else bytes.fromhex(payload)
    if not remote and (len(data) != int(length) or len(data) > LONGEST):
        return None
    return LoggedFrame(_stamp(stamp) if stamp else None, channel, _identifier(identifier), remote, data)


def _stamp(text: str) -> int:
    """Nanoseconds: of the seconds since 1970 a float holds no microseconds."""
    seconds, _, fraction = text.lstrip("-").partition(".")
    if "-" in seconds:
        seconds = str(_since_1970(seconds))
    whole = int(seconds) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))
    return -whole if text.startswith("-") else whole


@lru_cache(maxsize=8)
def _since_1970(stamp: str) -> int:
    return int(np.datetime64(stamp.replace(" ", "T"), "s").astype(np.int64))


def _identifier(text: str) -> int:
    return int(text, 16) | (1 << 31 if len(text) == 8 else 0)


def _plain_line(line: str) -> str:
    """A line without the colours that a terminal was to show it in."""
    return _COLOURS.sub("", line) if "\x1b" in line else line


def lines_of(path: Path, others: Others) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, as long as they can be read and are no more than a log has.

    Parameters
    ----------
    path : Path
    others : Others
        Counts lines that hold no frame.
    """
    try:
        with opened_text(path) as file:
            total = 0
            for number, line in enumerate(iter(lambda: file.readline(_LONGEST_LINE), ""), start=1):
                total += len(line)
                if total > MEASURED_BYTES or number > MOST_VALUES:
                    raise ValueError(f"more than {in_words(MEASURED_BYTES)} of text, or {MOST_VALUES} lines")
                yield number, _plain_line(line)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        others.notes.append(f"the file breaks off ({words_of(error)}): what came before is taken")


def candump_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a log by candump.

    Parameters
    ----------
    path : Path
    others : Others
        Counts lines that hold no frame.
    """
    for number, line in lines_of(path, others):
        frame = _matched(line.strip())
        if frame is not None:
            yield frame
        elif line.strip():
            others.fd += _CANDUMP_FD.match(line.strip()) is not None
            others.line(number)


def asc_frames(path: Path, others: Others) -> Iterator[LoggedFrame]:
    """Frames of a log by Vector's tools.   Stamps may be the times since the event before ("timestamps relative").

    Parameters
    ----------
    path : Path
    others : Others
        Counts lines that hold no frame.
    """
    base, relative, now = 16, False, 0
    for number, line in lines_of(path, others):
        head = _ASC_BASE.match(line)
        if head:
            base, relative = (16 if head[1].lower() == "hex" else 10), (head[2] or "").lower() == "relative"
            continue
        stamp = _ASC_STAMP.match(line)
        now = _stamp(stamp[1]) + now * relative if stamp else now
        if not _ASC_EVENT.match(line):
            if not _ASC_WORDS.match(line):
                others.line(number)
            continue
        try:
            frame = _asc_frame(line, base, now)
        except ValueError:  # hexadecimal digits under "base dec", a byte above 255
            frame = None
        if frame is not None:
            yield frame
        else:
            others.fd += "CANFD" in line
            others.line(number)


def _asc_frame(line: str, base: int, now: int) -> LoggedFrame | None:
    match = _ASC.match(line)
    if match is None:
        return None
    _, channel, identifier, extended, kind, length, rest = match.groups()
    remote = kind.lower() == "r"
    size = 0 if remote else min(int(length or "0", base), LONGEST)
    words = (rest or "").split()[:size]
    if len(words) < size or (not remote and length is None):
        return None
    if int(identifier, base) >= 1 << 29:
        return None
    return LoggedFrame(now, channel, int(identifier, base) | (1 << 31 if extended else 0), remote, bytes(int(word, base) for word in words))
