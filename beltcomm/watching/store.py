"""Trace of a watch in the run folder: ``RUN/watch/moves.jsonl``, a line for each move, which a trend reads by days."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.atomic import append_line
from beltcomm.errors import UsageError
from beltcomm.locks import link_refused
from beltcomm.outside import opened
from beltcomm.watching.drift import BASE
from beltcomm.watching.estimates import ERROR, MoveEstimate, Standing, pooled
from beltcomm.watching.judge import JudgedMove

FOLDER, FILE = "watch", "moves.jsonl"
DAY_S = 86400.0
#: s from 1970 within which a move can have been, and sizes that a value and its interval can have, SI.
_FARTHEST_S, _SIZES = 1e11, (1e-30, 1e30)
#: Letters of a line, at most.
_LONGEST = 1 << 16


def append(run: Path, entry: Mapping[str, Any]) -> None:
    """Keep one more move of a watch.

    Parameters
    ----------
    run : Path
    entry : mapping of str to Any
        Plain values for JSON.

    Raises
    ------
    UsageError
        Where the folder cannot be written, or is a link.
    """
    folder = run / FOLDER
    if folder.is_symlink():
        raise link_refused(folder)
    try:
        folder.mkdir(exist_ok=True)
        append_line(folder / FILE, json.dumps(entry, allow_nan=False))
    except OSError as error:
        raise UsageError(f"{folder / FILE} cannot be written: {error.strerror or error}; make room, or choose another run") from error


#: Key of a line that says: what comes next is the base.
ANEW = "anew"


def entries(run: Path, *, marks: bool = False) -> Iterable[Mapping[str, Any]]:
    """All moves that were watched; lines that are torn are left out.

    Parameters
    ----------
    run : Path
    marks : bool
        Lines with ``ANEW``, too.
    """
    path = run / FOLDER / FILE
    if not path.is_file() or path.is_symlink():
        return
    with opened(path) as file:
        for line in iter(lambda: file.readline(_LONGEST), b""):
            try:
                found = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if not isinstance(found, dict):
                continue
            if marks and found.get(ANEW) is True:
                yield {ANEW: True}
            date_s = _within(found.get("date_s"), -_FARTHEST_S, _FARTHEST_S)
            if date_s is not None and isinstance(found.get("quantities"), dict):
                yield {**found, "date_s": date_s, "error_over_noise": _within(found.get("error_over_noise"), *_SIZES)}


def told_by(entry: Mapping[str, Any]) -> dict[str, MoveEstimate]:
    """Value and interval of every quantity that a move told, the error over the noise among them.

    Parameters
    ----------
    entry : mapping of str to Any
        As it was kept.

    Returns
    -------
    dict of str to MoveEstimate
        By key; in SI.
    """
    error = {"value": entry.get("error_over_noise"), "interval": entry.get("error_interval")}
    found = {}
    for key, one in {**entry["quantities"], ERROR: error}.items():
        value, interval = (one.get("value"), one.get("interval")) if isinstance(one, dict) else (None, None)
        value, interval = _within(value, *_SIZES), _within(interval, *_SIZES)
        if value is not None and interval is not None:
            found[str(key)] = MoveEstimate(value, interval)
    return found


def places_told(entry: Mapping[str, Any]) -> dict[int, MoveEstimate]:
    """Friction beside the model's by the number of its place, as a move told it.

    Parameters
    ----------
    entry : mapping of str to Any
        As it was kept.

    Returns
    -------
    dict of int to MoveEstimate
        N m at the motor shaft.
    """
    found = {}
    kept = entry.get("places")
    for number, one in kept.items() if isinstance(kept, dict) else ():
        pair = one if isinstance(one, list) and len(one) == 2 else (None, None)
        value, interval = _within(pair[0], -_SIZES[1], _SIZES[1]), _within(pair[1], *_SIZES)
        if re.fullmatch(r"-?\d{1,6}", number) and value is not None and interval is not None:
            found[int(number)] = MoveEstimate(value, interval)
    return found


def _within(value: Any, low: float, high: float) -> float | None:
    """A number of a file, where it is one and can be what it stands for."""
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high else None


def by_day(run: Path) -> list[tuple[float, dict[str, tuple[float, float]]]]:
    """Each day that was watched: its middle, s since 1970, and every quantity over its moves, as a share of the base, with its interval.

    The base are the first moves, anew after each maintenance that was told.

    Parameters
    ----------
    run : Path
    """
    told: dict[int, dict[str, list[MoveEstimate]]] = {}
    dates: dict[int, list[float]] = {}
    for part in _parts(run):
        bases = _bases([told_by(entry) for entry in part])
        for entry in part:
            day = int(entry["date_s"] // DAY_S)
            dates.setdefault(day, []).append(float(entry["date_s"]))
            for key, one in told_by(entry).items():
                told.setdefault(day, {}).setdefault(key, []).append(MoveEstimate(one.value / bases[key], one.interval / bases[key]))
    return [(float(np.mean(dates[day])), {key: pooled(key, pairs) for key, pairs in found.items()}) for day, found in sorted(told.items())]


def _parts(run: Path) -> list[list[Mapping[str, Any]]]:
    """Moves between two maintenances."""
    parts: list[list[Mapping[str, Any]]] = [[]]
    for entry in entries(run, marks=True):
        if ANEW in entry:
            parts.append([])
        else:
            parts[-1].append(entry)
    return [part for part in parts if part]


def _bases(told: list[dict[str, MoveEstimate]]) -> dict[str, float]:
    """Every quantity over the first moves that told it."""
    keys = dict.fromkeys(key for one in told for key in one)
    return {key: abs(pooled(key, [one[key] for one in told if key in one][:BASE])[0]) for key in keys}


def entry_of(
    number: int, date_s: float, judged: JudgedMove, standings: Sequence[Standing], events: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """A move for programs, and for the trend.

    Parameters
    ----------
    number : int
        Of the move, from 1.
    date_s : float, s
        Since 1970, UTC.
    judged : JudgedMove
        By the model.
    standings : sequence of Standing
        Of the quantities over the last moves.
    events : sequence of tuple of str
        Kind and sentence.
    """
    return {
        "move": number,
        "date": f"{np.datetime64(round(date_s), 's')}+00:00",
        "date_s": round(date_s, 3),
        "travel_m": judged.travel_m,
        "duration_s": judged.duration_s,
        "following_m": judged.following_m,
        "error_over_noise": judged.ratio,
        "error_interval": judged.ratio_interval,
        "quantities": {key: {"value": one.value, "interval": one.interval} for key, one in judged.quantities.items()},
        "places": {str(number): [float(f"{one.value:.4g}"), float(f"{one.interval:.4g}")] for number, one in judged.places.items()},
        "over_the_last_moves": {
            one.key: {
                "value": finite(one.value),
                "interval": finite(one.interval),
                "change": finite(one.change),
                "low": one.low,
                "high": one.high,
                "state": one.state,
                **({} if one.place_m is None else {"place_m": one.place_m}),
            }
            for one in standings
        },
        "events": [{"kind": kind, "text": text} for kind, text in events],
    }


def finite(value: float) -> float | None:
    """The value, None for what JSON has no number for.

    Parameters
    ----------
    value : float
        Of any unit.
    """
    return value if math.isfinite(value) else None
