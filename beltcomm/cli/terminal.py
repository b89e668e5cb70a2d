"""Lines and tables on a terminal, fitted to its width; everywhere else plain text.  ``NO_COLOR`` and ``TERM=dumb`` are honoured."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TextIO

import click

from beltcomm import language
from beltcomm.borders import for_terminal

if TYPE_CHECKING:
    from rich.console import Console

    from beltcomm.result import Line

#: Columns of a terminal that does not tell, and of any.
USUAL_WIDTH, WIDEST = 80, 1000
#: Between two columns of a drawn table.
GAP = 2
#: What the parts of a line look like where there are colours; bold stays without them.
STYLES = {
    "good": "bold green",
    "bad": "bold red",
    "note": "yellow",
    "title": "bold",
    "soft": "dim",
    "command": "bold cyan",
    "bar": "green",
}
#: A mark or an arrow before a sentence, which goes on below itself.
LABEL = re.compile(r"  (?:\w[\w ]{0,11}  +|  +-> )(?=\S)")
#: ``TERM`` of a terminal that only prints.
DUMB = ("dumb", "unknown")


def draws(stream: TextIO) -> bool:
    """True if control characters may be written: to a terminal that can do more than print.

    Parameters
    ----------
    stream : TextIO
        Written to.
    """
    return stream.isatty() and os.environ.get("TERM", "").lower() not in DUMB


def _width_of(stream: TextIO) -> int:
    """Columns of the terminal behind a stream; of each stream its own, for one of them may be a pipe."""
    try:
        told = int(os.environ.get("COLUMNS", "0"))
    except ValueError:
        told = 0
    try:
        width = told if told > 0 else os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        width = 0
    return min(width, WIDEST) if width > 0 else USUAL_WIDTH


def fitted(line: str, stream: TextIO) -> str:
    """A line without anything that a terminal obeys, no wider than it, broken between words and indented; into a pipe it goes whole.

    Parameters
    ----------
    line : str
        Of any origin.
    stream : TextIO
        Written to.
    """
    line = for_terminal(line)
    if not stream.isatty() or len(line) <= (width := _width_of(stream)):
        return line
    label = LABEL.match(line)
    indent = " " * (label.end() if label and 2 * label.end() <= width else len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, replace_whitespace=False)


def _plain(line: str, stream: TextIO) -> str:
    """A line for a terminal that only prints, or a pipe."""
    from beltcomm.result import Line

    if isinstance(line, Line) and stream.isatty() and len(line) > _width_of(stream) and not any(s == "command" for _, s in line.parts):
        parts = [(for_terminal(text), style) for text, style in line.parts]
        return "\n".join("".join(text for text, _ in row) for row in _narrow(parts, _width_of(stream)))
    if isinstance(line, Line) and any(style == "command" for _, style in line.parts):
        return for_terminal(line)
    return fitted(line, stream)


def console_of(stream: TextIO) -> Console:
    """Console for drawing on a terminal.

    Parameters
    ----------
    stream : TextIO
        Written to.
    """
    from rich.console import Console

    return Console(file=stream, width=_width_of(stream), highlight=False, markup=False, emoji=False)


def _in_language(line: str) -> str:
    """A line as the language of the screens has it; what is to be typed and cells of a table stay."""
    from beltcomm.result import Line, Row

    if isinstance(line, Line):
        return Line(*((text if style == "command" else language.line_told(text), style) for text, style in line.parts))
    return line if isinstance(line, Row) else "\n".join(map(language.line_told, line.split("\n")))


def echo(lines: Iterable[str], stream: TextIO) -> None:
    """Print lines; on a terminal rows of a table are drawn as one.

    Parameters
    ----------
    lines : iterable of str
        With rows of tables.
    stream : TextIO
        Written to.
    """
    if not draws(stream):
        for line in map(_in_language, lines) if language.spoken() else lines:
            click.echo(_plain(line, stream), file=stream)
        return
    draw(lines, console_of(stream), stream)


def draw(lines: Iterable[str], console: Console, stream: TextIO) -> None:
    """Draw lines on a console, which may have a live display below.

    Parameters
    ----------
    lines : iterable of str
        With rows of tables.
    console : Console
        Of the terminal.
    stream : TextIO
        Written to.
    """
    from beltcomm.result import Line

    for block in _blocks(map(_in_language, lines) if language.spoken() else lines):
        if isinstance(block, Line):
            _draw_line(block, console)
        elif isinstance(block, str):
            for line in block.split("\n"):
                console.print(fitted(line, stream), soft_wrap=True)
        else:
            _draw_table(block, console)


def _draw_line(line: Line, console: Console) -> None:
    """In its colours; its parts below each other where the terminal is too narrow, a command whole so that it can be copied."""
    from rich.text import Text

    parts = [(for_terminal(text), style) for text, style in line.parts]
    whole = sum(len(text) for text, _ in parts)
    if len("".join(text for text, _ in parts).rstrip()) > console.width and not any(style == "command" for _, style in parts):
        for row in _narrow(parts, console.width):
            console.print(Text.assemble(*((text, STYLES.get(style, "")) for text, style in row)), soft_wrap=True)
        return
    text = Text.assemble(*((text, STYLES.get(style, "")) for text, style in parts))
    if whole > console.width:
        text.rstrip()
    console.print(text, soft_wrap=True)


def _narrow(parts: Sequence[tuple[str, str]], width: int) -> Iterator[list[tuple[str, str]]]:
    """Rows of parts that fit; a long part is broken between words, bars are left out."""
    row: list[tuple[str, str]] = []
    used = 0
    for text, style in parts:
        words = " ".join(text.split())
        if not words or style == "bar":
            continue
        for number, piece in enumerate(textwrap.wrap(words, max(8, width - 4), break_on_hyphens=False)):
            if row and (number or used + 2 + len(piece) > width):
                yield row
                row, used = [], 0
            lead = "  " if row else " " if not number and not used else "   "
            row.append((lead + piece, style))
            used += len(lead) + len(piece)
    if row:
        yield row


def failure(text: str, stream: TextIO) -> None:
    """Write an error, its first word in red on a terminal that has colours.

    Parameters
    ----------
    text : str
        With its first word before a colon.
    stream : TextIO
        Written to.
    """
    first, colon, rest = fitted(text, stream).partition(":")
    coloured = draws(stream) and not os.environ.get("NO_COLOR")
    click.echo((click.style(first + colon, fg="red", bold=True) if coloured else first + colon) + rest, file=stream, color=coloured)


def _blocks(lines: Iterable[str]) -> Iterator[Any]:
    """Each line by itself, and the rows of each table together."""
    from beltcomm.result import Row

    table: list[Row] = []
    for line in lines:
        if table and (not isinstance(line, Row) or line.head):
            yield table
            table = []
        if isinstance(line, Row):
            table.append(line)
        else:
            yield line
    if table:
        yield table


def _draw_table(rows: list[Any], console: Console) -> None:
    """As a table where it fits, else each row as a paragraph, so that nothing is cut off."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from beltcomm.result import Row

    rows = [Row(row, tuple(map(for_terminal, row.cells)), row.right, row.head) for row in rows]
    head, *body = rows
    widths = _widths(rows, console.width)
    if widths:
        drawn = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
        for title, right, width in zip(head.cells, head.right, widths, strict=True):
            drawn.add_column(title, justify="right" if right else "left", width=width)
        for row in body:
            drawn.add_row(*row.cells)
        console.print(drawn)
        return
    for row in body:
        name, *cells = row.cells
        console.print(name, style="bold")
        for title, cell in zip(head.cells[1:], cells, strict=True):
            if cell:
                console.print(f"  {title + ': ' if title else ''}{cell}")


def _widths(rows: list[Any], width: int) -> list[int]:
    """Columns: numbers keep to one line, words stay whole, the first columns get what is left; none where that is too wide."""
    columns = list(zip(*(row.cells for row in rows), strict=True))
    most = [max(map(len, cells)) for cells in columns]
    least = [
        full if right else max((len(word) for cell in cells for word in cell.split()), default=0)
        for cells, full, right in zip(columns, most, rows[0].right, strict=True)
    ]
    left = width - sum(least) - GAP * (len(columns) - 1)
    if left < 0:
        return []
    widths = []
    for low, high in zip(least, most, strict=True):
        more = min(left, high - low)
        widths.append(low + more)
        left -= more
    return widths
