"""Standard input, output and error as they must be before anything else is done: open, able to take any letter, named when they fail."""

from __future__ import annotations

import codecs
import io
import os
import sys
from typing import Any, TextIO

from beltcomm.borders import spelled

#: By the names in ``sys``: what they are called in a sentence.
NAMES = ("standard input", "standard output", "standard error")


class NamedStream(io.TextIOWrapper):
    """A stream whose fault tells which it is, and which fails once: what comes later goes nowhere."""

    def write(self, text: str, /) -> int:
        """As ever."""
        try:
            return super().write(text)
        except OSError as error:
            self._fail(error)
            raise

    def flush(self) -> None:
        """As ever."""
        try:
            super().flush()
        except OSError as error:
            self._fail(error)
            raise

    def _fail(self, error: OSError) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        error.filename = NAMES[self.fileno()]


def prepare() -> None:
    """For this process.  A descriptor that is closed would be given to the next file that is opened, which others then write into."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    codecs.register_error("spelled", spelled)
    sys.stdin = sys.stdin or _new(0, "r")
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")
    sys.stdout, sys.stderr = (_named(stream or _new(number, "w")) for number, stream in ((1, sys.stdout), (2, sys.stderr)))


def _new(number: int, mode: str) -> Any:
    return open(number, mode, encoding="utf-8", closefd=False)


def _named(stream: TextIO) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    lines, through = stream.line_buffering, stream.write_through
    encoding = stream.encoding
    return NamedStream(stream.detach(), encoding, "spelled", line_buffering=lines, write_through=through)
