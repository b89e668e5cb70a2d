"""Finding of an examination: one statement about a machine, a port or a drive, and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

#: ok: as it must be.   warning: works, but somebody should know.   wrong: hinders commissioning.   unknown: it cannot be told.
State = Literal["ok", "warning", "wrong", "unknown"]

#: What was read, by name with the unit as suffix.
Values = dict[str, float | int | str | bool]


@dataclass(frozen=True)
class Finding:
    """One statement.

    Attributes
    ----------
    area : str
        Where it belongs, a word or two such as ``bus``; findings of one area stand together.
    name : str
        Stable key for programs, unique within its area.
    state : State
        See :data:`State`.
    text : str
        One plain sentence with the value found, for people.
    remedy : str
        What to do next, "" when nothing is.
    values : Mapping[str, float or int or str or bool]
        What was read, by name with the unit as suffix (SI), for programs and for comparison with axis.yaml.
    unreachable : bool
        The drive or its bus cannot be reached, so that nothing further was asked.
    """

    area: str
    name: str
    state: State
    text: str
    remedy: str = ""
    values: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    unreachable: bool = False
