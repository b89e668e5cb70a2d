"""A file of encoder edge times, as logic analysers and timer captures write them: a row for each edge.

Its columns are known by their values: time stamps that do not fall, and beside them nothing (one direction throughout), a direction, a
count, or the levels of the channels A and B.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array, IntArray
from beltcomm.encoder.edges import LEVEL_A, LEVEL_B, Edges, count_increments
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.files import read_table
from beltcomm.foreign.kinds import kind_of_table
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.spellings import plain_unit
from beltcomm.foreign.table import Table
from beltcomm.outside import MEASURED_BYTES, opened, read_text
from beltcomm.quantities import UNITS

#: s: times are kept in whole ticks of this.
TICK_S = 1e-9
_DIRECTIONS = {
    **dict.fromkeys(("1", "+1", "+", "up", "forward", "fwd", "cw", "vor", "auf"), 1),
    **dict.fromkeys(("-1", "-", "down", "reverse", "rev", "backward", "back", "ccw", "zurueck", "zurück", "ab"), -1),
}
_WANTED = (
    "a row for each edge: its time (t_s, t_us or t_ns), and a direction (1, -1), a count, the levels A and B (0, 1), or nothing for one "
    "direction throughout"
)


@dataclass(frozen=True, eq=False)
class EdgeTimes:
    """Edges of a file.

    edges : in ticks of :data:`TICK_S` after ``start_s``, one increment long 1.   start_s : time of the file's first row, s.
    notes : sentences on how it was read.
    """

    edges: Edges
    start_s: float
    notes: tuple[str, ...]

    def counts_at(self, t_s: Array) -> Array:
        """Position in counts from the first row on.

        At an edge it is the line that was passed, in between on a smooth curve through the edges that passes no line without one.

        Parameters
        ----------
        t_s : ndarray, (n,)
            On the clock of the edges.

        Returns
        -------
        ndarray
            (n,); nan before and after all edges.
        """
        found = count_increments(self.edges, debounce=False)
        after = np.cumsum(found.step)
        at, line = found.tick * TICK_S, np.maximum(after, after - found.step)
        since = t_s - self.start_s
        last = np.clip(np.searchsorted(at, since, side="right") - 1, 0, None)
        smooth = CubicSpline(at, line, extrapolate=False)(since)
        return np.asarray(np.clip(smooth, after[last], after[last] + 1.0))


def read_edges(path: Path) -> EdgeTimes:
    """Edges of an encoder in a file.

    Parameters
    ----------
    path : Path
        Of a table, or one column of time stamps.

    Returns
    -------
    EdgeTimes
        With what was found out, in words.

    Raises
    ------
    UsageError
        For a file that is none.
    DataError
        For columns that are no edges, fewer than three, or times that fall.
    """
    table = _one_column(path) or read_table(path)
    table = Table(table.file, _numbers(table), table.units, table.notes)
    stamps = _time(table)
    t_s = table.columns[stamps] * _seconds(table, stamps)
    others = {name: column for name, column in table.columns.items() if name != stamps}
    whole = ~np.isnan(np.column_stack([t_s, *others.values()])).any(axis=1)
    notes: list[str] = []
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows without a value left out")
        t_s, others = t_s[whole], {name: column[whole] for name, column in others.items()}
    if len(t_s) < 3:
        raise DataError(f"{path} holds {len(t_s)} edges; give {_WANTED}")
    falls = np.flatnonzero(np.diff(t_s) < 0.0)
    if len(falls):
        at = int(falls[0])
        raise DataError(
            f"{path}: the time falls from {t_s[at]:.9g} s to {t_s[at + 1]:.9g} s in row {at + 2}; a timer that starts anew must be "
            "extended, rows of several channels put in the order of time"
        )
    tick = np.round((t_s - t_s[0]) / TICK_S).astype(np.int64)
    edges, words = _edges(path, tick, others)
    invalid = count_increments(edges).invalid
    if invalid:
        notes.append(
            f"{invalid} of {len(edges.tick)} changes are such as no motion makes: edges were missed, and the position is off by them"
        )
    return EdgeTimes(edges, float(t_s[0]), (*notes, f"{len(edges.tick)} edges of {path.name}: {words}"))


def _one_column(path: Path) -> Table | None:
    """A text file with times alone, below a name or none; None for any other file."""
    if not path.is_file() or kind_of_table(path) != "text" or path.suffix == ".gz":
        return None
    with opened(path) as file:
        second = file.read(4096).splitlines()[1:2]
    if not second or not _is_number(second[0].decode("ascii", "replace")):
        return None
    lines = [line.strip() for line in read_text(path, MEASURED_BYTES).splitlines() if line.strip()]
    head = "" if lines and _is_number(lines[0]) else lines[0] if lines else ""
    body = lines[1:] if head else lines
    if not body or not all(map(_is_number, body)):
        return None
    return Table(str(path), {head or "c1": np.array(body, dtype=np.float64)})


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(table: Table) -> dict[str, Array]:
    """Columns as numbers; directions in words too."""
    found = {}
    for name, column in table.columns.items():
        if column.dtype.kind in "fiu":
            found[name] = column.astype(np.float64)
            continue
        words = [_DIRECTIONS.get(str(text).strip().lower()) for text in column]
        if all(word is not None for word in words):
            found[name] = np.array(words, dtype=np.float64)
    if not found:
        raise DataError(f"{table.file} holds no numbers; give {_WANTED}")
    return found


def _time(table: Table) -> str:
    """The column with the time stamps: called so, else the first that never falls and is not whole."""
    for name in table.columns:
        meaning = meaning_of(table, name)
        if meaning is not None and meaning.quantity == "time":
            return name
    rising = []
    for name, column in table.columns.items():
        known = column[~np.isnan(column)]
        if len(known) > 2 and np.all(np.diff(known) >= 0.0) and known[-1] > known[0]:
            rising.append((bool(np.all(known % 1.0 == 0.0)), name))
    if rising:
        return min(rising, key=lambda one: one[0])[1]
    raise DataError(f"{table.file}: no column rises as time does; give {_WANTED}")


def _seconds(table: Table, name: str) -> float:
    """s per unit of the time column."""
    meaning = meaning_of(table, name)
    unit = meaning.unit if meaning is not None and meaning.suffix == "s" else plain_unit(table.unit(name))
    if unit in UNITS["s"].others:
        return UNITS["s"].others[unit]
    values = table.columns[name]
    if np.all(values[~np.isnan(values)] % 1.0 == 0.0):
        raise UsageError(
            f"{table.file}: {name} is in whole numbers of an unknown unit; call the column t_ns, t_us or t_ms, or write seconds: ticks "
            "of a timer divided by its frequency"
        )
    return 1.0


def _edges(path: Path, tick: IntArray, others: dict[str, Array]) -> tuple[Edges, str]:
    """Edges, and what their rows say, in words."""
    levels = [name for name, column in others.items() if np.isin(column, (0.0, 1.0)).all()]
    signs = [name for name, column in others.items() if np.isin(column, (-1.0, 1.0)).all()]
    steps = {name: np.diff(column) for name, column in others.items()}
    counts = [name for name, step in steps.items() if np.isin(step, (-1.0, 1.0)).all() and not np.isin(others[name], (0.0, 1.0)).all()]
    named = [name for letter in "ab" for name in levels if _letter(name) == letter]
    if len(named) == 2 or len(levels) >= 2:
        first, second = named if len(named) == 2 else levels[:2]
        return _of_levels(tick, others[first], others[second]), f"levels of A ({first}) and B ({second})"
    if counts:
        return _of_steps(tick[1:], steps[counts[0]]), f"a count ({counts[0]}), 0 at the first row"
    if signs and (others[signs[0]] < 0.0).any():
        return _of_steps(tick, others[signs[0]]), f"a direction ({signs[0]})"
    if levels:
        return _of_steps(tick, 2.0 * others[levels[0]] - 1.0), f"a direction ({levels[0]}), 1 forward and 0 in reverse"
    if not others or signs:
        return _of_steps(tick, np.ones(len(tick))), "no direction beside the time, so one throughout"
    raise DataError(f"{path}: what {', '.join(others)} say of an edge is not understood; give {_WANTED}")


def _letter(name: str) -> str:
    """The channel that a name ends with: "Channel A", "enc_b"."""
    bare = Table.bare(name).strip().lower()
    return bare[-1:] if len(bare) == 1 or bare[-2:-1] in " _-." else ""


def _of_levels(tick: IntArray, level_a: Array, level_b: Array) -> Edges:
    """Each row the levels from its time on; rows without a change are none."""
    a, b = level_a.astype(np.int64), level_b.astype(np.int64)
    rows, channels = np.nonzero(np.column_stack([np.diff(a), np.diff(b)]))
    level = np.column_stack([a, b])[rows + 1, channels]
    return Edges(tick[rows + 1], channels.astype(np.int64), level, int(a[0]), int(b[0]), 1.0, TICK_S)


def _of_steps(tick: IntArray, step: Array) -> Edges:
    """Each row one count up or down."""
    after = np.cumsum(step.astype(np.int64))
    line = np.maximum(after, after - step.astype(np.int64))
    channel = np.where(line % 2 == 1, 0, 1)
    level = np.where(channel == 0, LEVEL_A[after % 4], LEVEL_B[after % 4])
    return Edges(tick, channel, level, int(LEVEL_A[0]), int(LEVEL_B[0]), 1.0, TICK_S)
