"""JSON as nested arrays: columns, a list of records, one record per line, tables as pandas and browsers' loggers write them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.arrays import numbered, table_of
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import from_json, opened

#: Records from which a list of them is a measurement, and the share of them that must have a key for it to be a column.
_FEWEST, _SHARE = 3, 0.5


def read_json(path: Path) -> Table:
    """The columns in a JSON file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a damaged one, or one without columns.
    """
    with opened(path) as file:
        text = file.read()
    try:
        try:
            found = from_json(text, members=_apart)
        except ValueError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < _FEWEST or lines[0].lstrip()[:1] not in (b"{", b"["):
                raise
            found = [from_json(line, members=_apart) for line in lines]  # one record on each line
    except ValueError as error:
        raise DataError(f"{path} cannot be read as JSON ({words_of(error)}); is it cut off?") from error
    return table_of(path, as_columns(found))


def _apart(members: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object in which members of one name are kept, as columns of one name are: JSON keeps the last of them."""
    return dict(zip(numbered([name for name, _ in members]), (value for _, value in members), strict=True))


def as_columns(found: Any) -> dict[str, Any]:
    """Content of a JSON text as nested mappings of arrays.

    Parameters
    ----------
    found : Any
        As JSON has it.
    """
    made = _turned(found)
    return made if isinstance(made, dict) else {"": made}


def _turned(value: Any) -> Any:
    if isinstance(value, Mapping):
        names, rows = value.get("columns"), value.get("data")
        if isinstance(names, list) and isinstance(rows, list) and rows and all(isinstance(row, list) for row in rows[:_FEWEST]):
            return _of_rows([str(name) for name in names], rows)
        return {str(key): _turned(item) for key, item in value.items()}
    if not isinstance(value, list):
        return value
    if value and all(isinstance(item, Mapping) and _longest(item) > len(value) for item in value):
        return [_turned(item) for item in value]  # signals, each with all of its values
    if len(value) >= _FEWEST and all(isinstance(item, Mapping) for item in value):
        return _of_records([_flat(item, "") for item in value])
    if len(value) >= _FEWEST and all(isinstance(item, list) for item in value):
        names = [str(name) for name in value[0]] if all(isinstance(name, str) for name in value[0]) else []
        rows = value[1:] if names else value
        return _of_rows(names or [f"c{k}" for k in range(1, len(rows[0]) + 1)], rows)
    return _numbers(value)


def _longest(item: Mapping[str, Any]) -> int:
    return max((len(member) for member in item.values() if isinstance(member, list)), default=0)


def _flat(record: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """A record with its inner records and short lists as members ``outer.inner``, ``list1``."""
    found: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            found |= {f"{prefix}{key}{k}": item for k, item in enumerate(value[:100], start=1) if not isinstance(item, (list, Mapping))}
        else:
            found[f"{prefix}{key}"] = value
    return found


def _of_records(records: list[dict[str, Any]]) -> dict[str, Any]:
    counts: dict[str, int] = {}
    for record in records:
        for key in record:
            counts[key] = counts.get(key, 0) + 1
    return {key: _numbers([record.get(key) for record in records]) for key, count in counts.items() if count > _SHARE * len(records)}


def _of_rows(names: list[str], rows: list[Any]) -> dict[str, Any]:
    whole = [row for row in rows if isinstance(row, list) and len(row) == len(names)]
    return {name: _numbers(list(column)) for name, column in zip(numbered(names), zip(*whole, strict=True), strict=False)}


def _numbers(values: list[Any]) -> Any:
    """An array where all are numbers or missing, else the list as it is; numbers in quotes count."""
    if not values or any(isinstance(value, (list, Mapping)) for value in values):
        return values
    try:
        return np.array([np.nan if value is None else float(value) for value in values])
    except (TypeError, ValueError):
        return values
