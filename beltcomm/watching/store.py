"""What a watch leaves in the run folder: ``RUN/watch/moves.jsonl``, a line for each move, which a trend reads by days."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.atomic import appending
from beltcomm.errors import UsageError
from beltcomm.identify.course import NORMAL
from beltcomm.locks import link_refused
from beltcomm.outside import opened

FOLDER, FILE = "watch", "moves.jsonl"
DAY_S = 86400.0
#: Letters of a line, at most.
_LONGEST = 1 << 16


def append(run: Path, entry: Mapping[str, Any]) -> None:
    """One more move.   Raises UsageError where the folder cannot be written."""
    folder = run / FOLDER
    if folder.is_symlink():
        raise link_refused(folder)
    try:
        folder.mkdir(exist_ok=True)
        number = appending(folder / FILE)
        with os.fdopen(number, "ab") as file:
            file.write((json.dumps(entry, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise UsageError(f"{folder / FILE} cannot be written: {error.strerror or error}; make room, or choose another run") from error


def entries(run: Path) -> Iterable[Mapping[str, Any]]:
    """All moves that were watched; lines that are torn are left out."""
    path = run / FOLDER / FILE
    if not path.is_file() or path.is_symlink():
        return
    with opened(path) as file:
        for line in iter(lambda: file.readline(_LONGEST), b""):
            try:
                found = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if isinstance(found, dict) and isinstance(found.get("date_s"), (int, float)) and isinstance(found.get("quantities"), dict):
                yield found


def by_day(run: Path) -> list[tuple[float, dict[str, tuple[float, float]]]]:
    """Each day that was watched: its middle, s since 1970, and value and interval of every quantity over its moves."""
    days: dict[int, list[Mapping[str, Any]]] = {}
    for entry in entries(run):
        days.setdefault(int(entry["date_s"] // DAY_S), []).append(entry)
    return [(float(np.mean([e["date_s"] for e in some])), _pooled(some)) for _, some in sorted(days.items())]


def _pooled(moves: list[Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    told: dict[str, list[tuple[float, float]]] = {}
    for move in moves:
        for key, one in move["quantities"].items():
            value, interval = (one.get("value"), one.get("interval")) if isinstance(one, dict) else (None, None)
            if isinstance(value, (int, float)) and isinstance(interval, (int, float)) and math.isfinite(value) and interval > 0.0:
                told.setdefault(str(key), []).append((float(value), float(interval)))
    found = {}
    for key, pairs in told.items():
        values, halves = np.array(pairs).T
        weights = (NORMAL / halves) ** 2
        mean = float(np.sum(weights * values) / np.sum(weights))
        square = float(np.sum(weights * (values - mean) ** 2)) / max(len(values) - 1, 1)
        found[key] = mean, NORMAL * math.sqrt(max(1.0, square) / float(np.sum(weights)))
    return found
