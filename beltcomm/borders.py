"""Text that a file brought along, made harmless where it leaves this program: one function for each border.

Inside, names and sentences are what they are; nobody cleans them twice.
"""

from __future__ import annotations

import json
import re
import unicodedata
from typing import Any
from urllib.parse import quote

#: What a reader does not see and a terminal or a browser obeys: control characters but the tab and the end of a line, marks that turn
#: the direction of writing or join and hide, separators of lines that only some know, halves of characters.
_OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\U000e0000-\U000e007f]"
)
#: The same and what no name of a file in a zip may hold.
_NOT_PACKED = re.compile(rf"{_OBEYED.pattern}|[\t\n\\]")
#: What opens and closes comments of C and of structured text.
_MARKS = ("/*", "*/", "(*", "*)")
_SPELLED = (
    *(("²", "2"), ("³", "3"), ("µ", "u"), ("μ", "u"), ("°", " deg"), ("−", "-"), ("·", "*"), ("±", "+-"), ("→", "->"), ("–", "-")),
    *(("…", "..."), ("×", "x"), ("≤", "<="), ("≥", ">="), ("≈", "~"), ("√", "sqrt "), ("─", "-"), ("━", "-"), ("│", "|")),
)


def for_terminal(text: str) -> str:
    """Text in which what a terminal would obey is shown: ``\\x1b`` in place of an escape.

    Parameters
    ----------
    text : str
        Of any origin.
    """
    return _OBEYED.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode(), text)


def for_html(text: str) -> str:
    """A whole page or a part of it, whose markup stands already: what is obeyed is shown as a box with a question mark.

    Parameters
    ----------
    text : str
        Markup, its values escaped already.
    """
    return _OBEYED.sub("\N{REPLACEMENT CHARACTER}", text)


def for_json(data: Any) -> str:
    """One line of JSON that any program reads and any terminal shows.

    Parameters
    ----------
    data : Any
        Plain values.

    Raises
    ------
    ValueError
        For nan and infinity.
    """
    text = json.dumps(data, ensure_ascii=False, allow_nan=False)
    return _OBEYED.sub(lambda found: json.dumps(found[0])[1:-1], text)


def for_comment(text: str) -> str:
    """Text that can stand in a comment of C and of structured text: ASCII, one line, neither kind's delimiters.

    Parameters
    ----------
    text : str
        Of any origin.
    """
    for special, plain in _SPELLED:
        text = text.replace(special, plain)
    text = " ".join(for_terminal(" ".join(text.split())).encode("ascii", "backslashreplace").decode().split())
    for mark in _MARKS:
        text = text.replace(mark, f"{mark[0]} {mark[1]}")
    return text


def spelled(error: UnicodeError) -> tuple[str, int]:
    """For ``codecs.register_error``: what a character set has no letter for, in letters that every one has; JSON stays JSON.

    Parameters
    ----------
    error : UnicodeError
        Of a text that is being encoded.

    Returns
    -------
    tuple of str and int
        The letters in its place, and where encoding goes on.

    Raises
    ------
    UnicodeError
        The error itself, when it is not one of encoding.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    plain = dict(_SPELLED)
    return "".join(plain.get(letter) or json.dumps(letter)[1:-1] for letter in error.object[error.start : error.end]), error.end


def for_archive(name: str) -> str:
    """The name of a file inside a zip, without what is obeyed, bytes that are no text, and what another system takes for a folder.

    Parameters
    ----------
    name : str
        Of the file, with folders.
    """
    return _NOT_PACKED.sub(lambda found: quote(found[0], errors="surrogatepass"), name)


def for_file_name(text: str, otherwise: str, gap: str = "-") -> str:
    """A part of a file name on any system: letters, digits, '_', '-' and '.', a letter or digit at both ends.

    Parameters
    ----------
    text : str
        Of any origin.
    otherwise : str
        Where nothing is left.
    gap : str
        Stands for everything else.
    """
    ascii_only = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_.-]+", gap, ascii_only)[:60].strip("_.-") or otherwise
