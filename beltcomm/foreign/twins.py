"""Columns of a file beside one that has a name of ours, and that could be meant as well."""

from __future__ import annotations

import re
from collections.abc import Mapping

from beltcomm.foreign.mapping import Source
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.table import Table
from beltcomm.recording.columns import CHANNELS, KNOWN_COLUMNS

#: What tells columns of one name apart: an index behind it.
_INDEX = re.compile(r"[_ ]?\d+$")
#: Columns of ours without which there is no recording: an error in them is one of the whole model.
_NEEDED = frozenset(channels[signal] for channels in CHANNELS.values() for signal in ("torque", "position"))


def twins_of_ours(table: Table, sources: Mapping[str, Source]) -> list[tuple[str, ...]]:
    """Columns that have a name of ours, each with the others that could be meant by it.

    Parameters
    ----------
    table : Table
        Columns as they were read.
    sources : mapping of str to Source
        Where each column of ours comes from; what the user mapped has no twins, for it is the user's word.

    Returns
    -------
    list of tuple of str
        Names of columns of the file, the one with our name first; without those that have no twin.
    """
    found = []
    for column, source in sources.items():
        if source.theirs != column or source.written != column:
            continue
        twins = [name for name in table.columns if name != column and _could_be_meant(table, column, name)]
        if twins:
            found.append((column, *twins))
    return found


def _could_be_meant(table: Table, column: str, name: str) -> bool:
    """By its name but for case and index; torque and position also by what stands around the name, or by the same quantity and unit."""
    if _INDEX.sub("", Table.bare(name)).lower() == column:
        return True
    if column not in _NEEDED or name in KNOWN_COLUMNS or table.columns[name].dtype.kind not in "fiu":
        return False
    ours, theirs = meaning_of(table, column), meaning_of(table, name)
    if ours is None or theirs is None or not theirs.by_name or theirs.quantity != ours.quantity or theirs.role == "setpoint" or theirs.load:
        return False
    around = re.search(rf"(?<![a-z]){re.escape(column)}(?![a-z])", name.lower()) is not None
    return around or (theirs.suffix == ours.suffix != "")


def with_place(table: Table, name: str) -> str:
    """A column as a question names it: of two with one name the place tells which is which.

    Parameters
    ----------
    table : Table
    name : str
        Of one of its columns.
    """
    return f"{name!r} (c{list(table.columns).index(name) + 1})"
