"""Records in a log of CANopen frames: rows by SYNC, setpoints where they act, cut where the stage goes on and off.

A synchronous PDO that a drive sends behind SYNC k was sampled at SYNC k; one that it receives there acts from SYNC k+1 on
(CiA 301, 7.2.2).  Without SYNCs a row is a frame that carries the position.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.drive.objects import name_of
from beltcomm.errors import DataError
from beltcomm.foreign.canopen import ObjectSamples, Place, Seen, objects_seen, pdos, samples, unanswered_mappings
from beltcomm.foreign.canunits import LogUnits, Overheard, profile_of, units_of
from beltcomm.foreign.excited import excitation_of, is_sweep
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.logclock import PAUSE_PERIODS, PAUSE_S, RowTimes, begins_in_motion, holes, row_times
from beltcomm.foreign.lostsyncs import with_lost_syncs
from beltcomm.foreign.table import Table
from beltcomm.recording.sidecar import ExcitationNote

Rows = NDArray[np.intp]

_POSITION, _VELOCITY, _TORQUE, _CURRENT, _DEMAND = 0x6064, 0x606C, 0x6077, 0x6078, 0x6074
_STATUSWORD, _CONTROLWORD, _MODE = 0x6041, 0x6040, 0x6060
_TARGET_TORQUE, _TARGET_POSITION, _TARGET_VELOCITY = 0x6071, 0x607A, 0x60FF
#: Objects that may be negative.
SIGNED = frozenset(
    {0x6060, 0x6061, 0x6062, 0x6063, 0x6064, 0x606B, 0x606C, 0x6071, 0x6074, 0x6077, 0x6078, 0x607A, 0x607C}
    | {0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60F4, 0x60FA, 0x60FC, 0x60FF}
)
#: Statusword: Operation Enabled; control word: enable operation (CiA 402-2, 6.2).
_STATE_MASK, _ENABLED, _RUN = 0x6F, 0x27, 0x0F
_TORQUE_MODES, _VELOCITY_MODES, _POSITION_MODES, _HOMING = (4, 10), (3, 9), (1, 7, 8), 6
#: s; a shorter stretch is no move.
_SHORTEST_S = 0.2
_FEWEST_SYNCS = 10
#: Identifier of node 0's heartbeat; the first of a node is 0, its boot-up (CiA 301, 7.2.8.3.3).
_HEARTBEAT = 0x700
#: Share of the rows without a signal from which it is one of a slower frame, not one with frames that were lost.
_SELDOM = 0.1


@dataclass(frozen=True, eq=False)
class BusRecord:
    """One move in a log.

    Attributes
    ----------
    table : Table
        Its columns, in SI where the units are known.
    start_s : float
        s after the log's first frame.
    experiment, closed_loop, excitation
        What the setpoints show was done.
    lost : str
        What of the log may hold moves that were not read.
    """

    table: Table
    start_s: float
    experiment: str
    closed_loop: bool
    excitation: ExcitationNote | None = None
    lost: str = ""


@dataclass
class _Rows:
    """All rows of a log: places of the SYNCs (or of the frames with the position), and columns on them, NaN where nothing came."""

    frames: Rows
    stamps: Array
    lost_syncs: int = 0
    synchronous: bool = False
    clock: RowTimes = field(init=False)
    columns: dict[tuple[str, Place], Array] = field(default_factory=dict)


def records_of(
    log: FrameLog,
    axis: Axis,
    node: int | None = None,
    torque_acts: Literal["after", "before"] | None = None,
    period_s: float | None = None,
) -> list[BusRecord]:
    """The moves of one drive, in order.

    Parameters
    ----------
    log : FrameLog
    axis : Axis
    node : int or None
        None takes the one whose position is on the bus.
    torque_acts : Literal['after', 'before'] or None
        Of the reported torque, relative to its SYNC; None as the drive's profile says.
    period_s : float or None
        Between rows, instead of the stamps.

    Raises
    ------
    DataError
        When the log does not show what the frames carry, or holds no move.
    """
    seen = objects_seen(log)
    node, found, also = _node_with_position(log, seen, node)
    profile = profile_of(seen, node)
    before = torque_acts == "before" or (torque_acts is None and profile.torque_sampling == "after")
    rows = _rows(log, found)
    place = rows.columns[("sent", (_POSITION, 0))]
    rows.clock = row_times(rows.stamps, place, rows.synchronous, _cycle_s(seen), period_s)
    others = [f"node {number} sends its position, too: its moves are read with --node {number}" for number in also]
    notes = [
        *log.notes,
        *others,
        *rows.clock.notes,
        f"drive: {profile.title}, node {node}",
        _torque_words(torque_acts, before, profile),
    ]
    made = []
    homing, short = 0, 0
    for stretch in _stretches(rows, seen, node, period_s):
        begin = int(rows.frames[stretch[0]])
        units, mode = units_of(seen, node, axis, begin), _mode_at(seen, node, begin)
        homing += len(stretch) * (mode == _HOMING)
        record = _record(log, rows, stretch, units, before, mode, [*notes, *units.notes])
        made += [record] if record is not None else []
        short += len(stretch) * bool(record is None and mode != _HOMING and _moves(rows, stretch))
    early = _before_the_setup(log, seen, node)
    taken = sum(len(record.table.columns["t_s"]) for record in made)
    balance = _balance(log, node, rows, early, taken, len(made), homing, short)
    if not made:
        standing = " or give the SYNC's rate with --rate" if rows.clock.standing.any() else ""
        raise DataError(
            f"{log.file} holds no move of node {node} that lasts {_SHORTEST_S:g} s with the stage on and the axis moving ({balance}); "
            f"record while the axis moves, from before the drive is set up{standing}"
        )
    lost = [f"{early} frames with the position before the set-up"] * (early > _FEWEST_SYNCS)
    lost += ["what stands behind a clock that goes back"] * _boots_late(log, rows, node)
    lost += [f"{int(rows.clock.standing.sum())} rows with standing stamps"] * bool(rows.clock.standing.any())
    made[0] = _with_note(made[0], balance, " and ".join(lost))
    return made


def _moves(rows: _Rows, stretch: Rows) -> bool:
    """True if the position changes in a stretch, or against the rows beside it: also one row alone may be of a motion."""
    beside = rows.columns[("sent", (_POSITION, 0))][max(stretch[0] - 1, 0) : stretch[-1] + 2]
    return bool(np.ptp(beside[np.isfinite(beside)]) > 0.0)


def _cycle_s(seen: list[Seen]) -> float | None:
    """The SYNC's period by 1006h, us, where the log shows one and the same, s."""
    found = {int.from_bytes(item.value, "little") for item in seen if item.place == (0x1006, 0)} - {0}
    return 1e-6 * found.pop() if len(found) == 1 else None


def _before_the_setup(log: FrameLog, seen: list[Seen], node: int) -> int:
    """Frames that would carry the position had the log shown so by then."""
    carriers = [change for change in pdos(seen, node) if change.direction == "sent" and any(e[0] == _POSITION for e in change.entries)]
    first = min((change.frame for change in carriers), default=0)
    known = [change.cob_id for change in carriers if change.frame == first]
    return int(np.isin(log.identifier[:first], known).sum())


def _boots_late(log: FrameLog, rows: _Rows, node: int) -> bool:
    """True if the drive boots behind a clock that goes back and not before: what stands there may have come first, in another file."""
    breaks = np.flatnonzero(rows.clock.broken)
    if not len(breaks):
        return False
    boots = np.flatnonzero((log.identifier == _HEARTBEAT + node) & (log.length == 1) & (log.data[:, 0] == 0) & ~log.remote)
    return bool(len(boots)) and bool(boots[0] >= rows.frames[breaks[0] - 1])


def _balance(log: FrameLog, node: int, rows: _Rows, early: int, taken: int, moves: int, homing: int, short: int) -> str:
    """Account of all frames and rows of a log, in words."""
    size = len(log.t_s)
    read = f"all {size}" if log.in_file == size else f"{size} of {log.in_file}" if log.in_file else f"{size}"
    standing = int(rows.clock.standing.sum())
    there = int(np.isfinite(rows.columns[("sent", (_POSITION, 0))]).sum())
    words = [f"{read} frames of the file were read, {log.of_node(node)} of node {node}"]
    twice = log.doubled()
    words += [f"{twice} stand there twice at the same time"] * (twice > 0)
    doubted = [name_of(*place) for place in unanswered_mappings(log, node)]
    words += [
        f"{len(doubted)} requests to the mapping of PDOs have no answer in the log (the first to {doubted[0]}), so what frames carry "
        "behind them is in doubt: look whether moves are missing, or say what the frames carry with --signal"
        for _ in doubted[:1]
    ]
    unexplained = f"not read are {early} frames with the position before the set-up, which the log does not explain"
    words += [f"{unexplained} (where a file before it does, join the two)"] * (early > 0)
    without = len(rows.frames) - there - early
    words += [f"{without} of {len(rows.frames)} SYNCs came without a position"] * (without > _FEWEST_SYNCS)
    if rows.lost_syncs:
        words.append(f"{rows.lost_syncs} SYNCs are not in the log, but PDOs that came behind them: each has a row at the time of these")
    words += [f"{standing} rows have standing stamps and no known period, and were left out"] * (standing > 0)
    if begins_in_motion(rows.columns[("sent", (_POSITION, 0))]):
        words.append("the first rows are in motion already, so the beginning of that move is not in the log")
    gone = holes(rows.clock, rows.columns[("sent", (_POSITION, 0))])
    if gone:
        longest = max(gone, key=lambda hole: hole[1])
        words.append(
            f"in {len(gone)} places no row came while the axis moved, the longest {longest[1]:.4g} s from {longest[0]:.4g} s on: "
            "what was done there is not in the log, and a move is cut there"
        )
    where = f"{max(there - standing - taken - homing - short, 0)} with the stage off or at rest"
    where += f", {homing} in the mode of homing (6060h is 6)" if homing else ""
    where += f", {short} in stretches that are shorter than {_SHORTEST_S:g} s" if short else ""
    return "; ".join([*words, f"of {there} rows with the position {taken} are in moves ({moves}), {where}"])


def _with_note(record: BusRecord, note: str, lost: str) -> BusRecord:
    table = record.table
    noted = Table(table.file, table.columns, table.units, (*table.notes, note), table.clocks)
    return replace(record, table=noted, lost=lost)


def _torque_words(asked: str | None, before: bool, profile: Overheard) -> str:
    why = f"as --torque-acts {asked} says" if asked else f"as the profile of the {profile.title} says"
    if not asked and not profile.known:
        why = "which is assumed, for the log does not name the drive: see --torque-acts"
    place = "of the period just ended, so it was moved to the row before" if before else "of the period that follows"
    return f"the torque reported at a SYNC is that {place}, {why}"


def readable(log: FrameLog) -> int:
    """Frames with a position that the log explains before they come, of all nodes.

    Parameters
    ----------
    log : FrameLog
    """
    seen = objects_seen(log)
    found = (samples(log, seen, number, SIGNED).get(("sent", (_POSITION, 0))) for number in {item.node for item in seen})
    return sum(len(values.raw) for values in found if values is not None)


def _node_with_position(
    log: FrameLog, seen: list[Seen], node: int | None
) -> tuple[int, dict[tuple[str, Place], ObjectSamples], tuple[int, ...]]:
    """The node that is asked for, else that with the most frames with a position; its samples, and other nodes that have some."""
    numbers = sorted({item.node for item in seen}) if node is None else [node]
    best: tuple[int, dict[tuple[str, Place], ObjectSamples]] | None = None
    sizes: dict[int, int] = {}
    for number in numbers:
        found = samples(log, seen, number, SIGNED)
        sizes[number] = len(found[("sent", (_POSITION, 0))].raw) if ("sent", (_POSITION, 0)) in found else 0
        if sizes[number] and (best is None or sizes[number] > sizes[best[0]]):
            best = number, found
    if best is None:
        shown = "the log shows no SDO access to the PDO mapping (1A00h)" if not any(pdos(seen, n) for n in numbers) else "no PDO carries it"
        raise DataError(
            f"{log.file}: which frames carry the position 6064h cannot be told, {shown}. On the bus are {log.summary()}. Record from "
            "before the drive is set up (if that is in a file before this one, join them into one), or say what the frames carry: --signal "
            "6064h=181:0:i32 (COB-ID, first byte, type), or --dbc FILE"
        )
    chosen = best[0]
    return *best, tuple(number for number, size in sizes.items() if size and number != chosen)


def _rows(log: FrameLog, found: Mapping[tuple[str, Place], ObjectSamples]) -> _Rows:
    position = found[("sent", (_POSITION, 0))]
    syncs = np.flatnonzero((log.identifier == 0x80) & ~log.remote)
    synchronous = bool(position.synchronous.mean() > 0.5) and len(syncs) >= _FEWEST_SYNCS
    if synchronous:
        syncs = _answered(syncs, position.frames)
        sent = [values.frames[values.synchronous] for (direction, _), values in found.items() if direction == "sent"]
        rows = _Rows(*with_lost_syncs(log, syncs, sent), synchronous=True)
    else:
        alone = np.unique(position.frames)
        rows = _Rows(alone, log.t_s[alone], synchronous=False)
    size = len(rows.frames)
    for (direction, place), values in found.items():
        column = np.full(size, np.nan)
        at = np.searchsorted(rows.frames, values.frames, side="right") - 1
        if direction == "received":
            at = np.where(values.synchronous & synchronous, at + 1, at)
        kept = (at >= 0) & (at < size)
        column[at[kept]] = values.raw[kept]
        rows.columns[(direction, place)] = _held(column) if direction == "received" or place[0] == _STATUSWORD else column
    if synchronous:
        return rows
    for place in ((_TORQUE, 0), (_VELOCITY, 0), (_CURRENT, 0), (_DEMAND, 0)):  # from other frames: the last value that came
        if ("sent", place) in rows.columns:
            rows.columns[("sent", place)] = _held(rows.columns[("sent", place)])
    return rows


def _answered(syncs: Rows, frames: Rows) -> Rows:
    """The SYNCs behind which the position comes: all but for lost ones, or every n-th (transmission type n, CiA 301, 7.5.2.37)."""
    count = np.bincount(np.searchsorted(syncs, frames, side="right"), minlength=len(syncs) + 1)[1:]
    known = np.flatnonzero(count)
    every = int(np.median(np.diff(known))) if len(known) > 1 else 1
    return syncs[known] if every > 1 and float(np.mean(np.diff(known) == every)) > 1.0 - _SELDOM else syncs


def _held(column: Array) -> Array:
    """Each missing value as the last one before it."""
    known = np.where(np.isfinite(column), np.arange(len(column)), 0)
    return np.asarray(column[np.maximum.accumulate(known)])


def _stretches(rows: _Rows, seen: list[Seen], node: int, period_s: float | None) -> list[Rows]:
    """Rows of each move: complete, stage on, control word running, one mode, without a pause; with a rate alone no row may be lost."""
    position = rows.columns[("sent", (_POSITION, 0))]
    kept = np.isfinite(position) & ~rows.clock.standing
    status = rows.columns.get(("sent", (_STATUSWORD, 0)))
    if status is not None and np.isfinite(status).any():
        kept &= (np.nan_to_num(status).astype(np.int64) & _STATE_MASK) == _ENABLED
    control = rows.columns.get(("received", (_CONTROLWORD, 0)))
    if control is not None and np.isfinite(control).any():
        kept &= (np.nan_to_num(control).astype(np.int64) & _RUN) == _RUN
    chosen = np.flatnonzero(kept)
    if not len(chosen):
        return []
    modes = np.array([item.frame for item in seen if item.node == node and item.place[0] in (_MODE, 0x6040) and item.written])
    epochs = np.array([change.frame for change in pdos(seen, node)])
    steps = np.diff(rows.clock.t_s[chosen])
    usual = float(np.median(steps)) if len(steps) else 0.0
    breaks = (steps > max(PAUSE_PERIODS * usual, PAUSE_S)) | (np.diff(np.cumsum(rows.clock.broken)[chosen]) > 0)
    if period_s is not None:
        breaks |= np.diff(chosen) > 1
    for changes in (modes, epochs):
        if len(changes):
            breaks |= np.diff(np.searchsorted(changes, rows.frames[chosen])) > 0
    # rows between that were left out because the stage was off part two records as well
    between = np.add.reduceat(~kept & np.isfinite(position), chosen)[:-1] if len(chosen) > 1 else np.zeros(0)
    breaks |= between > 0
    return list(np.split(chosen, np.flatnonzero(breaks) + 1))


def _mode_at(seen: list[Seen], node: int, frame: int) -> int | None:
    """The mode of operation that was written, or read from 6061h, last before a frame."""
    mode = None
    for item in seen:
        if item.frame > frame:
            break
        if item.node == node and item.place in ((_MODE, 0), (0x6061, 0)):
            mode = int.from_bytes(item.value, "little", signed=True)
    return mode


def _record(
    log: FrameLog, rows: _Rows, stretch: Rows, units: LogUnits, before: bool, mode: int | None, notes: Sequence[str]
) -> BusRecord | None:
    t_s = rows.clock.t_s[stretch]
    position = rows.columns[("sent", (_POSITION, 0))][stretch]
    if mode == _HOMING or len(stretch) < 3 or np.ptp(position) == 0.0 or t_s[-1] - t_s[0] < _SHORTEST_S:
        return None
    raw = {key: column[stretch] for key, column in rows.columns.items()}
    if before:  # the value of the next row of the bus, not of the next row that is left
        following = np.minimum(stretch + 1, len(rows.frames) - 1)
        for place in ((_TORQUE, 0), (_CURRENT, 0), (_DEMAND, 0)):
            if ("sent", place) in raw:
                raw[("sent", place)] = rows.columns[("sent", place)][following]
    columns = {"t_s": t_s - t_s[0], **_columns(raw, units, mode)}
    words = list(notes)
    columns = _whole_rows(columns, words)
    if len(columns["t_s"]) < 3:
        return None
    units_beside = {"6077h": "per mille of rated torque", "6078h": "per mille of rated current"}
    table = Table(log.file, columns, {name: unit for name, unit in units_beside.items() if name in columns}, tuple(words))
    return BusRecord(table, float(t_s[0]), *_what_was_done(columns, mode))


def _whole_rows(columns: dict[str, Array], words: list[str]) -> dict[str, Array]:
    """Rows in which nothing is missing, for a frame that a damaged line held must not cost the move; signals that seldom came are left."""
    torque = next((name for name in ("torque_nm", "current_a", "6077h", "6078h") if name in columns), "")
    missing = {name: ~np.isfinite(column) for name, column in columns.items()}
    for name in [name for name, mask in missing.items() if mask.mean() > _SELDOM and name not in ("position_rad", torque)]:
        words.append(f"{name} came in {int((~missing.pop(name)).sum())} of {len(columns['t_s'])} rows and is left out")
        columns = {other: column for other, column in columns.items() if other != name}
    lost = np.zeros(len(columns["t_s"]), dtype=bool)
    for name, mask in missing.items():
        if (mask & ~lost)[:-1].any():
            words.append(f"{int((mask & ~lost)[:-1].sum())} rows without {'a torque' if name == torque else name} left out")
        lost |= mask
    return {name: column[~lost] for name, column in columns.items()}


def _columns(raw: Mapping[tuple[str, Place], Array], units: LogUnits, mode: int | None) -> dict[str, Array]:
    """Raw columns in SI under our names; under the object's number where its unit is not known."""
    found: dict[str, Array] = {}

    def take(direction: str, index: int, name: str, unit: float | None, subindex: int = 0) -> None:
        column = raw.get((direction, (index, subindex)))
        if column is None or name in found or not np.isfinite(column).any():
            return
        if unit is None:
            found[f"{index:04X}h"] = column
        elif direction == "sent" or np.isfinite(column).all():
            found[name] = column * unit

    take("sent", _TORQUE, "torque_nm", units.torque_nm)
    if "torque_nm" not in found and "6077h" not in found:
        take("sent", _CURRENT, "current_a", units.current_a)
    torque_mode = mode in _TORQUE_MODES or (mode is None and ("received", (_TARGET_TORQUE, 0)) in raw)
    if torque_mode:
        take("received", _TARGET_TORQUE, "torque_setpoint_nm", units.torque_nm)
    take("sent", _DEMAND, "torque_setpoint_nm", units.torque_nm)
    take("sent", _POSITION, "position_rad", units.position_rad)
    take("sent", _VELOCITY, "velocity_rad_s", units.speed_rad_s)
    if mode in _POSITION_MODES:
        take("received", _TARGET_POSITION, "reference_position_rad", units.position_rad)
        take("received", 0x60C1, "reference_position_rad", units.position_rad, 1)
        take("received", 0x60B1, "reference_velocity_rad_s", units.speed_rad_s)
    if mode in _VELOCITY_MODES:
        take("received", _TARGET_VELOCITY, "reference_velocity_rad_s", units.speed_rad_s)
    if not torque_mode:
        take("received", 0x60B2, "torque_offset_nm", units.torque_nm)
        if "torque_offset_nm" in found and not found["torque_offset_nm"].any():
            del found["torque_offset_nm"]
    return found


def _what_was_done(columns: Mapping[str, Any], mode: int | None) -> tuple[str, bool, ExcitationNote | None]:
    if mode in _VELOCITY_MODES or mode in _POSITION_MODES:
        sweep = is_sweep(columns.get("reference_velocity_rad_s"))
        return ("friction_sweep" if sweep else "trajectory" if mode in _POSITION_MODES else "free"), True, None
    setpoint = columns.get("torque_setpoint_nm")
    note = excitation_of(setpoint) if setpoint is not None and mode in _TORQUE_MODES else None
    return ("frf" if note is not None else "free"), False, note
