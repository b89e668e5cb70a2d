"""The clock of a logger: parts of a log that were joined in the wrong order, a clock that is set, turns over or stands still.

A log's frames stand in the order in which they came, so it is the stamps that are mended, never the frames; only whole parts change
their places.  What a SYNC's period does not tell is not made up: such rows are counted and left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray, runs_of
from beltcomm.foreign.framelog import FrameLog

#: s, by which stamps of frames in the right order may go back: queues of a controller, not another file.
QUEUE_S = 5e-3
#: s between two files of one logger that follow each other.
_SEAM_S = 1.0
_MOST_PARTS = 1000
#: Rows on one stamp that are a clock that stands, not a coarse one.
_STANDING = 20
#: Share of a period, and of it for each row, by which a clock that came back may differ from what it would have shown.
_HALF, _DRIFT = 0.5, 0.0005
#: Clean steps from which a period is known.
_FEWEST_STEPS = 50
#: Rows on either side by which motion is seen to go on.
_BESIDE = 10
#: Counts between which a position changes at rest.
_AT_REST = 4.0
#: A pause longer than this many periods, and than this time, parts two moves.
PAUSE_PERIODS, PAUSE_S = 20.0, 0.05


def in_order(log: FrameLog, readable: Callable[[FrameLog], int]) -> FrameLog:
    """The log with its parts in the order of their stamps, where they were joined in another one, and a note on it.

    Parameters
    ----------
    log : FrameLog
    readable : callable
        Counts the frames of a log that are understood in their order: the set-up must come before what it explains. It decides between
        a clock that was set back, whose frames stand in the right order, and files joined in the wrong one.
    """
    if not np.isfinite(log.t_s).all():
        return log
    starts = [0, *(np.flatnonzero(np.diff(log.t_s) < -QUEUE_S) + 1).tolist()]
    if not 1 < len(starts) <= _MOST_PARTS:
        return log
    steps = np.diff(log.t_s)
    # of three files the third may stand behind the first
    finer = [0, *(np.flatnonzero((steps < -QUEUE_S) | (steps > PAUSE_S)) + 1).tolist()]
    starts_of_parts = finer if len(finer) <= _MOST_PARTS else starts
    parts = [np.arange(a, b) for a, b in zip(starts_of_parts, [*starts_of_parts[1:], len(log.t_s)], strict=True)]
    by_stamp = sorted(parts, key=lambda part: float(log.t_s[part[0]]))
    gaps = [float(log.t_s[b[0]] - log.t_s[a[-1]]) for a, b in pairwise(by_stamp) if b[0] != a[-1] + 1]
    if not gaps or min(gaps) < -QUEUE_S:  # the parts overlap: a clock that was set, or begins at zero again
        return log
    sorted_log = _picked(log, np.concatenate(by_stamp))
    gain = readable(sorted_log) - readable(log)
    if gain < 0 or (gain == 0 and max(gaps) > _SEAM_S):
        return log
    first = log.t_s[starts[1] - 1] - log.t_s[starts[1]]
    note = (
        f"the file's stamps go back by {first:.6g} s at frame {starts[1] + 1}: it is {len(gaps) + 1} parts joined in another order than "
        "they were logged; they were put in the order of their stamps"
    )
    return replace(sorted_log, notes=(*log.notes, note))


def _picked(log: FrameLog, frames: NDArray[np.intp]) -> FrameLog:
    t_s = log.t_s[frames]
    columns = {name: getattr(log, name)[frames] for name in ("identifier", "remote", "length", "data")}
    return replace(log, t_s=np.round(t_s - t_s[0], 9), **columns)


@dataclass(frozen=True, eq=False)
class RowTimes:
    """t_s : ndarray (n,), s, never falling but where it is not known.   broken : (n,), whether time before a row is not known.

    standing : (n,), rows whose time cannot be told.   notes : a sentence on each thing that was mended.
    """

    t_s: Array
    broken: BoolArray
    standing: BoolArray
    notes: tuple[str, ...] = ()


def row_times(t_s: Array, position: Array, synchronous: bool, cycle_s: float | None, period_s: float | None) -> RowTimes:
    """Times of rows whose stamps may stand still or jump.

    Parameters
    ----------
    t_s : ndarray (n,)
        Stamps of the rows, s.
    position : ndarray (n,)
        In any unit, NaN where none came: motion that goes on over a jump of the stamps shows that it was the clock.
    synchronous : bool
        The rows are SYNCs.
    cycle_s : float or None
        The SYNC's period, s, when the log shows it (1006h).
    period_s : float or None
        The time between rows that the user gave instead of stamps.
    """
    size = len(t_s)
    broken, standing = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
    if period_s is not None:
        counted: Array = np.arange(size, dtype=np.float64)
        counted *= period_s
        return RowTimes(counted, broken, standing, (f"the stamps are not used: rows are {period_s:.6g} s apart as given",))
    if size < 3:
        return RowTimes(t_s, broken, standing)
    steps = np.diff(t_s)
    zeros = steps == 0.0
    runs = runs_of(zeros)
    clean = ~zeros & (steps > 0.0)
    clean[[b for _, b in runs if b < size - 1]] = False  # a step behind a stand holds what was missed
    period = _period(steps[clean], synchronous, cycle_s)
    notes: list[str] = []
    mended = np.array(steps)
    if period is not None:
        away = _returns(mended, t_s, period, notes)
        runs = [(a, b) for a, b in runs if not away[a:b].all()]
        _stands_filled(mended, runs, position, period, notes)
        _jumps_bridged(mended, steps, position, period, broken, notes)
    else:
        for a, b in runs:
            standing[a : b + 1] |= b - a >= _STANDING
        broken[1:] |= steps < 0.0
    if not notes and not broken.any():
        return RowTimes(t_s, broken, standing)
    mended[broken[1:]] = period or 0.0
    return RowTimes(np.round(t_s[0] + np.concatenate(([0.0], np.cumsum(mended))), 9), broken, standing, tuple(notes))


def holes(clock: RowTimes, position: Array) -> list[tuple[float, float]]:
    """Where no row came while the axis moved: just before, just after, or from one place to another; begin and length of each, s.

    Parameters
    ----------
    clock : RowTimes
    position : ndarray (n,)
        In counts, NaN where none came.
    """
    steps = np.diff(clock.t_s)
    rising = steps[steps > 0.0]
    if len(rising) < _FEWEST_STEPS:
        return []
    long = np.flatnonzero((steps > max(PAUSE_PERIODS * float(np.median(rising)), PAUSE_S)) & ~clock.broken[1:])
    found = []
    for k in long.tolist():
        beside = position[max(0, k - _BESIDE) : k + 1], position[k + 1 : k + 2 + _BESIDE]
        whole = [part[np.isfinite(part)] for part in beside]
        # elsewhere than before: a whole move is missing, its rests too
        elsewhere = bool(len(whole[0]) and len(whole[1])) and abs(float(whole[1][0] - whole[0][-1])) > _AT_REST
        if elsewhere or _moves(position[: k + 1], -1) or _moves(position[k + 1 :], 1):
            found.append((float(clock.t_s[k]), float(steps[k])))
    return found


def begins_in_motion(position: Array) -> bool:
    """True if the axis moves in the first rows, so that the beginning of that move is not there.

    Parameters
    ----------
    position : ndarray (n,)
        In counts, NaN where none came.
    """
    return _moves(position, 1)


def _moves(position: Array, side: int) -> bool:
    """True if the first rows (side 1), or the last (-1), lie apart by more than counts that come and go at rest."""
    beside = position[:_BESIDE] if side > 0 else position[-_BESIDE:]
    known = beside[np.isfinite(beside)]
    return len(known) > 1 and abs(float(known[-1] - known[0])) > _AT_REST


def _period(clean: Array, synchronous: bool, cycle_s: float | None) -> float | None:
    """The time between rows, s; None when the log does not show it."""
    if len(clean) < _FEWEST_STEPS:
        return cycle_s if synchronous else None
    usual = float(np.median(clean))
    even = synchronous or float(np.mean(np.abs(clean / usual - 1.0) < 0.2)) > 0.9
    return usual if even else None


def _returns(mended: Array, t_s: Array, period: float, notes: list[str]) -> BoolArray:
    """Even steps while the clock was elsewhere, where it came back to what it would have shown; which steps these are.

    As many periods as rows lie between a stamp before the clock went back, or before it came back, and one behind: nothing is missing,
    whatever stands between, a zero, stamps that fall, or another time of day.
    """
    steps, size = np.diff(t_s), len(t_s)
    away = np.zeros(len(steps), dtype=bool)
    astray = (steps < 0.0) | (steps > max(PAUSE_PERIODS * period, PAUSE_S))
    late = t_s - period * np.arange(size)  # constant while the clock is right
    found = []
    begins = np.flatnonzero(astray & ~np.append(False, astray[:-1]))
    behind = np.flatnonzero(np.abs(steps / period - 1.0) > _HALF) + 1  # first rows behind a step that is none
    for k in begins[:_MOST_PARTS].tolist():
        if away[k]:
            continue
        ends = behind[np.searchsorted(behind, k + 2) :]
        room = period * (_HALF + _DRIFT * (ends - k))
        back = ends[(np.abs(late[ends] - late[k]) < room) & (t_s[ends] > t_s[k])]
        if len(back) and (steps[k : back[0]] < 0.0).any():
            b = int(back[0])
            away[k:b] = True
            shown = np.abs(steps[k:b])  # a clock that runs backwards shows the time between rows, too
            shown = np.where((shown > _HALF * period) & (shown < PAUSE_PERIODS * period), shown, period)
            mended[k:b] = shown + (t_s[b] - t_s[k] - shown.sum()) / (b - k)
            found.append(b - k)
    if found:
        notes.append(
            f"the clock was elsewhere {len(found)} times, for {sum(found)} rows in all, and came back to what it would have shown: "
            "these rows lie evenly between those beside them"
        )
    return away


def _stands_filled(mended: Array, runs: list[tuple[int, int]], position: Array, period: float, notes: list[str]) -> None:
    """Even steps where the clock stood; a step behind it that is too long for them is a pause, but in even motion or at the beginning."""
    rows, lost, taken = 0, 0.0, -1
    for a, b in runs:
        rows += b - a
        # the clock may have stopped in the middle of the step before
        first = a - 1 if a - 1 > taken and 0.0 < mended[a - 1] < (1.0 + _HALF) * period else a
        taken = b
        shown = float(mended[first : b + 1].sum())
        missing = (b - first + 1) * period - shown
        behind = float(mended[b]) if b < len(mended) else 0.0
        if b < len(mended) and abs(missing) < period * (_HALF + _DRIFT * (b - a)):
            mended[first : b + 1] = shown / (b - first + 1)
            continue
        mended[first:b] = period
        if missing < 0.0 and b < len(
            mended
        ):  # the clock caught up, and more: a pause, but in motion or where it stood from the first row on
            mended[b] = period if a == 0 or _goes_on(position, b) else period - missing
        elif behind > PAUSE_PERIODS * period:  # the clock went on where it stood, behind a pause
            lost += missing - period + behind
        elif b < len(mended):
            mended[b] = max(1.0, round(behind / period)) * period
            lost += missing
    if rows:
        words = f"{rows} rows have standing stamps: they were set {period:.6g} s apart, as the others are; lost ones cannot be seen"
        notes.append(words + (f". The clock stood for {lost:.6g} s, by which all that follows is later than its stamps" if lost else ""))


def _jumps_bridged(mended: Array, steps: Array, position: Array, period: float, broken: BoolArray, notes: list[str]) -> None:
    """Steps of the clock over which motion goes on become one period; where time goes back and it does not, time is not known."""
    back, ahead = 0, 0
    for k in np.flatnonzero((steps < 0.0) | (steps > max(PAUSE_PERIODS * period, PAUSE_S))).tolist():
        if mended[k] != steps[k]:  # filled already
            continue
        if _goes_on(position, k):
            mended[k] = period
            back, ahead = back + (steps[k] < 0.0), ahead + (steps[k] > 0.0)
        elif steps[k] < 0.0:
            broken[k + 1] = True
    if back or ahead:
        notes.append(f"the clock was set {back + ahead} times ({back} back) while the motion went on evenly: {period:.6g} s were put there")
    if broken.any():
        notes.append(f"the clock goes back {int(broken.sum())} times: how much time passed there is not known, a move is cut there")


def _goes_on(position: Array, k: int) -> bool:
    """True if the axis moves on from row k to k+1 as it does beside them."""
    part = position[max(0, k - _BESIDE) : k + 2 + _BESIDE]
    if len(part) < 2 * _BESIDE + 2 or not np.isfinite(part).all():
        return False
    moves = np.diff(part)
    at = k - max(0, k - _BESIDE)
    beside = np.delete(moves, at)
    room = 0.25 * float(np.ptp(beside)) + 1.0
    usual = float(np.median(np.abs(beside)))
    return usual >= 3.0 and room < 2.0 * usual and bool(beside.min() - room <= moves[at] <= beside.max() + room)
