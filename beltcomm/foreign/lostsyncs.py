"""SYNCs that a log of CAN frames lost, shown by what the drive sent behind them; frames that changed places within a queue."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.logclock import QUEUE_S

Frames = NDArray[np.intp]

SYNC = 0x80
#: Share of a period by which frames of one SYNC lie nearer to each other than to those of the next.
_HALF = 0.5
#: Share of the SYNCs from which PDOs that come twice are not lost SYNCs, but a drive that sends more often.
_SELDOM = 0.05
_FEWEST_SYNCS = 10
#: An identifier comes once with each SYNC when its frames are as many as the SYNCs, but for this share.
_AS_MANY = 0.2


def with_lost_syncs(log: FrameLog, syncs: Frames, sent: Iterable[Frames]) -> tuple[Frames, Array, int]:
    """Frames at which rows begin, their stamps, and how many of them stand for a SYNC that is not in the log.

    Where a PDO comes twice behind one SYNC, a period apart, the second was sampled at a SYNC that was lost: without a row of its own it
    would overwrite the first, and the row would have the position of another time.

    Parameters
    ----------
    log : FrameLog
    syncs : ndarray (n,)
        Places of the SYNCs, rising.
    sent : iterable of ndarray
        Places of the frames of each PDO that a drive sends at the SYNC.

    Returns
    -------
    frames : ndarray (m,)
        Rising; of a lost SYNC that of the first frame behind it.
    t_s : ndarray (m,)
        Of a lost SYNC as long before that frame as others are.
    lost : int
    """
    stamps: Array = log.t_s[syncs]
    steps = np.diff(stamps)
    rising = steps[steps > 0.0]
    if len(syncs) < _FEWEST_SYNCS or 2 * len(rising) < len(steps):
        return syncs, stamps, 0
    period = float(np.median(rising))
    begins = np.array(syncs)
    places, times = [], []
    for frames in sent:
        at = np.searchsorted(syncs, frames, side="right") - 1
        lag = float(np.median((log.t_s[frames] - stamps[np.maximum(at, 0)])[at >= 0])) if (at >= 0).any() else 0.0
        for k in (np.flatnonzero((np.diff(at) == 0) & (at[1:] >= 0) & (np.diff(log.t_s[frames]) > _HALF * period)) + 1).tolist():
            following, when = int(at[k]) + 1, float(log.t_s[frames[k]]) - lag
            if following < len(syncs) and stamps[following] - when < _HALF * period:  # the SYNC stands behind what it caused
                begins[following] = min(begins[following], frames[k])
            else:
                places.append(int(frames[k]))
                times.append(when)
    found: list[int] = []
    for k in np.argsort(places, kind="stable").tolist():
        if not found or times[k] - times[found[-1]] > _HALF * period:
            found.append(k)
    if len(found) > _SELDOM * len(syncs):
        return syncs, stamps, 0
    rows = np.concatenate([begins, np.array([places[k] for k in found], dtype=np.intp)])
    order = np.argsort(rows, kind="stable")
    return rows[order], np.concatenate([stamps, [times[k] for k in found]])[order], len(found)


def in_stamped_order(log: FrameLog) -> FrameLog:
    """The log with frames of one instant in the order of their stamps, where more SYNCs then have their PDOs behind them, and a note.

    A logger with several queues writes frames in another order than it stamped them; that of the stamps need not be the better one,
    for they may be set when a frame is taken out.

    Parameters
    ----------
    log : FrameLog
    """
    steps = np.diff(log.t_s)
    if not np.isfinite(steps).all() or not ((steps < 0.0) & (steps >= -QUEUE_S)).any():
        return log
    order = np.arange(len(log.t_s))
    for part in np.split(order, np.flatnonzero(steps < -QUEUE_S) + 1):
        stamps = log.t_s[part]
        if float(np.max(np.maximum.accumulate(stamps) - stamps)) <= QUEUE_S:  # else a clock that ran backwards
            order[part[0] : part[-1] + 1] = part[np.argsort(stamps, kind="stable")]
    columns = {name: getattr(log, name)[order] for name in ("identifier", "remote", "length", "data", "t_s")}
    ordered = replace(log, **columns)
    if _uneven_syncs(ordered) >= _uneven_syncs(log):
        return log
    moved = int(np.sum(order != np.arange(len(order))))
    note = f"{moved} frames stand in another order than their stamps; by the stamps more SYNCs have their PDOs behind them, so these hold"
    return replace(ordered, notes=(*log.notes, note))


def _uneven_syncs(log: FrameLog) -> int:
    """Number of SYNCs behind which a frame that comes with each of them is missing or comes twice, over all such frames."""
    syncs = np.flatnonzero((log.identifier == SYNC) & ~log.remote)
    if len(syncs) < _FEWEST_SYNCS:
        return 0
    names, counts = np.unique(log.identifier, return_counts=True)
    uneven = 0
    for name in names[np.abs(counts - len(syncs)) < _AS_MANY * len(syncs)]:
        if name != SYNC:
            at = np.searchsorted(syncs, np.flatnonzero(log.identifier == name), side="right")
            uneven += int(np.sum(np.bincount(at, minlength=len(syncs) + 1)[1:] != 1))
    return uneven
