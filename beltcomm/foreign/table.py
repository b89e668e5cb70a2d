"""A table from a foreign file: named columns as they stand there, before anything is mapped or scaled."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from beltcomm.arrays import Column
from beltcomm.configfiles import did_you_mean
from beltcomm.errors import DataError
from beltcomm.foreign.spellings import COUNTS, PER_CENT, PER_MILLE, plain_unit
from beltcomm.quantities import UNITS

Separator = Literal["comma", "semicolon", "tab", "bar", "space"]
Decimal = Literal["point", "comma"]

#: A number behind the brackets tells apart columns of one name.
_UNIT_IN_NAME = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()]*?)\s*[\])](_\d+)?$")
#: DIN 1313 divides by the unit; what is none there is a part of the name.
_DIVIDED = re.compile(r"^([^/]*[^/\s])(\s*)/\s*([^\s/]+?(?:/[^\s/]+?)?|[mckM]?N m)(_\d+)?$")
_UNITS = {other for unit in UNITS.values() for other in unit.others}


@dataclass(frozen=True, eq=False)
class Table:
    """file : where it came from.   columns : name -> float64 (n,), NaN where a value is missing, or text (n,).

    units : name -> unit as the file writes it, where it does.     notes : sentences on how it was read and what was left out.
    clocks : name -> the column that holds its time stamps, where the file says so; columns of different clocks differ in length.
    scalars : name -> a single number that stands beside the columns.
    """

    file: str
    columns: Mapping[str, Column]
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    clocks: Mapping[str, str] = field(default_factory=dict)
    scalars: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for column in self.columns.values():
            column.setflags(write=False)  # what is taken from it needs no copy

    def find(self, name: str) -> str | None:
        """The column that a name means: itself, else the only one that differs in case or by a unit in brackets, or c1 for the first.

        Returns
        -------
        str or None
            None when there is none.
        """
        if name in self.columns:
            return name
        wanted = name.strip().lower()
        for shortened in (str.lower, lambda known: self.bare(known).lower()):
            found = [known for known in self.columns if shortened(known) == wanted]
            if len(found) == 1:
                return found[0]
        place = int(wanted[1:]) if re.fullmatch(r"c[1-9]\d{0,4}", wanted) else 0
        return list(self.columns)[place - 1] if 0 < place <= len(self.columns) else None

    def unit(self, name: str) -> str:
        """The unit that the file states for a column: below its name or in brackets behind it; "" for none."""
        if name in self.units:
            return self.units[name]
        found = _unit_in(name)
        return found[1] if found else ""

    @staticmethod
    def bare(name: str) -> str:
        """The name without a unit in brackets."""
        found = _unit_in(name)
        return found[0] + found[2] if found else name

    def no_such_column(self, name: str) -> str:
        """The sentence for a name that is no column: the nearest one, and all there are."""
        shown = [known if " " not in known else f'"{known}"' for known in self.columns]
        more = f" and {len(shown) - 30} more" if len(shown) > 30 else ""
        return f"{self.file} has no column {name!r}{did_you_mean(name, self.columns, 0.5)}; it has {', '.join(shown[:30])}{more}"


def _unit_in(name: str) -> tuple[str, str, str] | None:
    """Bare name, unit and number of a column whose name holds a unit."""
    if match := _UNIT_IN_NAME.match(name):
        return match[1], match[2], match[3] or ""
    if not (match := _DIVIDED.match(name)):
        return None
    last = re.split(r"[\s_.,-]", match[1])[-1]
    # "Speed rad/s", "kg/s": what stands before the stroke is a unit itself
    of_unit = not match[2] and (
        plain_unit(name) in _UNITS or last.isdigit() or (plain_unit(last) in _UNITS and (last != match[1] or len(last) > 1))
    )
    known = plain_unit(match[3]) in {*_UNITS, *COUNTS, *PER_CENT, *PER_MILLE}
    return (match[1], match[3], match[4] or "") if known and not of_unit else None


def words_of(error: BaseException) -> str:
    """The first line of what a library said.

    Parameters
    ----------
    error : BaseException
        Of a library.
    """
    if isinstance(error, MemoryError):
        return "a size that no memory holds"
    return (str(error).splitlines() or [type(error).__name__])[0][:100]


@contextmanager
def damage_as_data_error(path: Path, what: str) -> Iterator[None]:
    """A DataError in place of any error that a reader meets in damaged bytes.

    Parameters
    ----------
    path : Path
    what : str
        Kind of file that it should be, in words.

    Raises
    ------
    DataError
        Where the reader fails.
    """
    try:
        yield
    except (DataError, MemoryError):
        raise
    except Exception as error:
        raise DataError(f"{path} cannot be read as {what} ({words_of(error)}); is it cut off?") from error
