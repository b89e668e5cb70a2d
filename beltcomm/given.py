"""Arguments that another program gives the public functions: paths, numbers and choices, checked before anything is opened or moved."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Final, Literal, get_args

from beltcomm.errors import Refused, UsageError
from beltcomm.talk import Talk

#: What an excitation can be.
ExcitationKind = Literal["prbs", "gprbs", "chirp", "multisine"]
EXCITATION_KINDS: Final[tuple[ExcitationKind, ...]] = get_args(ExcitationKind)
#: What a record can be; ``static_map`` has position and torque or current, and no time.
EXPERIMENTS: Final = ("frf", "friction_sweep", "reversal", "trajectory", "static_map", "free")
#: Bytes of a name in a file system.
LONGEST_PART = 255
#: A file or a folder as a program names it.
Place = str | Path | PathLike[str]


def place(value: Place, what: str = "run folder") -> Path:
    """The path that was given.

    Parameters
    ----------
    value : Place
        As it was given.
    what : str
        Is meant by it.

    Raises
    ------
    UsageError
        For what is no path.
    """
    if isinstance(value, (str, PathLike)) and str(value):
        path = Path(value)
        if "\0" in str(path):
            raise UsageError(f"the {what} is {str(path)[:LONGEST_PART]!r}, and no path holds a zero")
        if long := next((part for part in path.parts if len(os.fsencode(part)) > LONGEST_PART), ""):
            raise UsageError(
                f"the {what} is a path with a name of {len(long)} letters ({long[:20]}...); no name has more than {LONGEST_PART}"
            )
        return path
    raise UsageError(f"the {what} is {value!r}, which is no path; give its path as text or as a pathlib.Path")


def places(values: Place | Iterable[Place], what: str = "run folder") -> list[Path]:
    """Several paths; a single one counts as one and not as its letters.

    Parameters
    ----------
    values : Place or iterable of Place
        As they were given.
    what : str
        Is meant by each.

    Raises
    ------
    UsageError
    """
    if isinstance(values, (str, PathLike)):
        return [place(values, what)]
    if not isinstance(values, Iterable):
        raise UsageError(f"a list of paths is wanted, each of a {what}; given was {values!r}")
    return [place(value, what) for value in values]


def number(value: object, what: str, unit: str) -> float:
    """A finite number.

    Parameters
    ----------
    value : object
        As it was given.
    what : str
        Is meant by it.
    unit : str
        For the sentence; "" for none.

    Raises
    ------
    UsageError
        Units stand in names here, never in values.
    """
    try:
        found = math.nan if isinstance(value, bool) or not isinstance(value, Real) else float(value)
        shown = repr(value)[:LONGEST_PART]
    except (OverflowError, ValueError):  # an integer of more digits than a number has, or than are written out
        found, shown = math.inf, "too large"
    if not math.isfinite(found):
        raise UsageError(f"{what} is {shown}; give a plain number" + (f" in {unit}, without the unit" if unit else ""))
    return found


def whole(value: object, what: str) -> int:
    """A whole number.

    Parameters
    ----------
    value : object
        As it was given.
    what : str
        Is meant by it.

    Raises
    ------
    UsageError
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise UsageError(f"{what} is {value!r}; give a whole number")
    return int(value)


def word(value: object, what: str) -> str:
    """A text that is not empty.

    Parameters
    ----------
    value : object
        As it was given.
    what : str
        Is meant by it.

    Raises
    ------
    UsageError
    """
    if not isinstance(value, str) or not value:
        raise UsageError(f"the {what} is {value!r}; give its name as text")
    return value


def choice(value: object, what: str, known: Sequence[str]) -> None:
    """Refuse a value that is none of those known.

    Parameters
    ----------
    value : object
        As it was given.
    what : str
        Its name, as the sentence begins.
    known : sequence of str
        All that may be chosen.

    Raises
    ------
    UsageError
        With the nearest one and all others.
    """
    if value not in known:
        near = get_close_matches(str(value), known, n=1)
        raise UsageError(f"{what} is {value!r}{f', did you mean {near[0]!r}?' if near else ''}; choose one of {', '.join(known)}")


#: Options that a drive is reached by; a run keeps them, and no others are taken from its folder.
REACHED_BY = ("as", "profile", "node", "bitrate")


class Reached(str):
    """The name of a drive for the next command.

    Attributes
    ----------
    options
        Those that it is reached by, as the command line takes them.
    """

    options = ""


def pasted(value: object) -> str:
    """A path or a drive as a terminal takes it: in quotes where it has blanks and the like, and never like an option.

    Parameters
    ----------
    value : object
        Path, text, or an address with options.
    """
    text = str(value)
    quoted = shlex.quote(f"./{text}" if text.startswith("-") else text)
    return f"{quoted} {value.options}" if isinstance(value, Reached) and value.options else quoted


def may_write(file: Path, yes: bool, talk: Talk) -> None:
    """Ask before a file is overwritten, unless told not to.

    Parameters
    ----------
    file : Path
        To be written.
    yes : bool
        True for a consent given before.
    talk : Talk

    Raises
    ------
    UsageError
        For a folder.
    Refused
        For a no.
    """
    if file.is_dir():
        raise UsageError(f"{file} is a folder; give the name of the file to write")
    if file.exists() and not yes and not talk.confirm(f"{file} exists. Overwrite it?"):
        raise Refused(f"{file} was left as it is; give another file name, or --yes to overwrite it")
