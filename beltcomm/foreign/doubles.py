"""Frames that stand in a log twice: two sockets on one bus, a file joined to itself, rotated files that overlap.

A frame that is there twice is a record that confirms itself, so each is taken once, and that is said.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beltcomm.arrays import BoolArray, Column
from beltcomm.foreign.framelog import FrameLog
from beltcomm.foreign.logclock import QUEUE_S

#: Share of the frames with content that stand there twice, from which the log was written twice.
_DOUBLED = 0.05
#: s: the shortest frame has 47 bits and lasts that long at 1 Mbit/s; one content of one identifier that is nearer was on the bus once.
_ONE_FRAME_S = 47e-6
#: Of a stretch that two sockets wrote half the frames are the second one's; what a full queue lost is missing.
_NEARLY_HALF = 0.4
#: Frames that a part has, so that its repetition is no chance; places and parts that are looked at.
_FEWEST_FRAMES, _MOST_PLACES, _MOST_PARTS = 20, 100, 1000


def without_doubles(log: FrameLog) -> FrameLog:
    """The log with each frame once, and a note on those that were left out.

    Parameters
    ----------
    log : FrameLog
        Frames in the order of their file.
    """
    if len(log.t_s) < 2:
        return log
    for found, words in (
        (_repeated_parts, "{} frames of {} parts that stand in the file before left out, stamps and content are the same"),
        (_at_once, "{} frames that repeat the one before at the same time left out, as two sockets on one bus write them"),
        (
            _nearer_than_a_frame,
            "{} frames that repeat another sooner than a frame lasts left out, as two sockets on one bus write them",
        ),
    ):
        again, parts = found(log)
        if again.any():
            kept = {name: getattr(log, name)[~again] for name in ("t_s", "identifier", "remote", "length", "data")}
            said = words.format(int(again.sum()), parts)
            log = replace(log, **kept, notes=(*log.notes, said), in_file=log.in_file or len(again))
    return log


def _contents(log: FrameLog) -> tuple[Column, ...]:
    return (log.identifier, log.length, log.remote, *log.data.T)


def _repeated_parts(log: FrameLog) -> tuple[BoolArray, int]:
    """Frames behind a stamp that goes back that repeat others up to where the log had come, or up to its end; number of such parts."""
    columns = (log.t_s, *_contents(log))
    size, parts = len(log.t_s), 0
    again = np.zeros(size, dtype=bool)
    for start in (np.flatnonzero(np.diff(log.t_s) < -QUEUE_S) + 1).tolist()[:_MOST_PARTS]:
        places = np.flatnonzero(np.logical_and.reduce([column[:start] == column[start] for column in columns]))
        longest = 0
        for place in places[:_MOST_PLACES].tolist():
            most = min(start - place, size - start)
            same = np.logical_and.reduce([column[place : place + most] == column[start : start + most] for column in columns])
            run = most if same.all() else int(np.argmin(same))
            if run == most:  # one that breaks off between is a clock that was set back
                longest = max(longest, run)
        if longest >= _FEWEST_FRAMES:
            again[start : start + longest] = True
            parts += 1
    return again, parts


def _at_once(log: FrameLog) -> tuple[BoolArray, int]:
    """Frames that repeat the one just before, stamp included; none where hardly any with content does, for a clock may stand."""
    columns = (log.t_s, *_contents(log))
    again = np.append(False, np.logical_and.reduce([column[1:] == column[:-1] for column in columns]))
    filled = log.length > 0
    return (again if again[filled].sum() > _DOUBLED * filled.sum() else np.zeros_like(again)), 1


def _nearer_than_a_frame(log: FrameLog) -> tuple[BoolArray, int]:
    """Frames whose content came from the same identifier less than a frame's time before, where that is half of a stretch of the log."""
    contents = _contents(log)
    order = np.lexsort((log.t_s, *contents))
    near = np.ones(len(order) - 1, dtype=bool)
    for column in contents:
        near &= column[order[1:]] == column[order[:-1]]
    steps = np.diff(log.t_s[order])
    near &= (steps > 0.0) & (steps < _ONE_FRAME_S)
    again = np.zeros(len(order), dtype=bool)
    again[order[1:][near]] = True
    places = np.flatnonzero(again)
    if not len(places):
        return again, 0
    stretch = slice(places[0], places[-1] + 1)
    enough = len(places) >= _FEWEST_FRAMES and len(places) > _NEARLY_HALF * (stretch.stop - stretch.start)
    return (again if enough else np.zeros_like(again)), 1
