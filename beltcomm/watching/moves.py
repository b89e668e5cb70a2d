"""Moves in rows of a stream: from rest to rest, with a little of both, where the axis turns further than its encoder trembles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, runs_of

Columns = Mapping[str, NDArray[Any]]

#: s over which a turn is looked at, and steps of the encoder that a resting axis trembles by at most.
SPAN_S, TREMBLE = 0.02, 3.0
#: s of rest that divide two moves, that are kept on either side, and that must have passed before a move is told to be over.
REST_S, LEAD_S = 0.15, 0.1
#: s and steps of the encoder below which a motion tells nothing of an axis; s above which one without a rest is taken in pieces.
SHORTEST_S, LEAST_STEPS, LONGEST_S = 0.2, 100.0, 20.0


@dataclass(frozen=True, eq=False)
class StreamPart:
    """Rows without a pause.

    Attributes
    ----------
    columns : mapping of str to ndarray
        As a recording has them, ``t_s`` on a clock of the stretch's own.
    start_s : float
        Of that clock on the stream's.
    """

    columns: Columns
    start_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Move:
    """One move.

    Attributes
    ----------
    columns : mapping of str to ndarray
        ``t_s`` from 0.
    start_s, end_s : float, s
        On the stream's clock, the rests that are kept included.
    """

    columns: Columns
    start_s: float
    end_s: float


def moves_in(stretch: StreamPart, after_s: float, ended: bool) -> tuple[list[Move], float]:
    """The moves of a stretch that are over, and the time, s on the stream's clock, up to which it holds nothing else.

    Parameters
    ----------
    stretch : StreamPart
        Rows without a gap.
    after_s : float, s
        Rows up to here, on the stream's clock, were taken before.
    ended : bool
        Nothing follows the stretch: its last move is over, too.
    """
    name = "position_rad" if "position_rad" in stretch.columns else "position_m"
    t_s = np.asarray(stretch.columns["t_s"], dtype=np.float64) + stretch.start_s
    first = int(np.searchsorted(t_s, after_s, side="right"))
    t_s, position = t_s[first:], np.asarray(stretch.columns[name], dtype=np.float64)[first:]
    if len(t_s) < 3:
        return [], after_s
    period = float(np.median(np.diff(t_s)))
    jumps = np.abs(np.diff(position))
    step = float(np.min(jumps[jumps > 0.0], initial=np.inf))
    if not np.isfinite(step):
        return [], float(t_s[-1]) - LEAD_S
    span = max(1, round(SPAN_S / period))
    turned = np.zeros(len(position), dtype=bool)
    if len(position) > span:
        turns = np.abs(position[span:] - position[:-span]) > TREMBLE * step
        turned[span:] |= turns
        turned[:-span] |= turns
    pairs: list[list[int]] = []
    for begin, end in runs_of(turned):
        if pairs and t_s[begin] - t_s[pairs[-1][1] - 1] < REST_S:
            pairs[-1][1] = end
        else:
            pairs.append([begin, end])
    found = []
    passed = float(t_s[-1]) - LEAD_S
    for begin, end in pairs:
        for low, high in _pieces(begin, end, t_s):
            over = t_s[-1] - t_s[high - 1] > REST_S + LEAD_S or ended or high < end
            if not over:
                passed = float(t_s[low]) - LEAD_S
                break
            if t_s[high - 1] - t_s[low] < SHORTEST_S or np.ptp(position[low:high]) < LEAST_STEPS * step:
                continue
            here = slice(int(np.searchsorted(t_s, t_s[low] - LEAD_S)), int(np.searchsorted(t_s, t_s[high - 1] + LEAD_S, side="right")))
            columns = {key: np.asarray(column)[first:][here] for key, column in stretch.columns.items()}
            found.append(Move({**columns, "t_s": t_s[here] - t_s[here][0]}, float(t_s[here][0]), float(t_s[here][-1])))
    return found, passed


def _pieces(begin: int, end: int, t_s: Array) -> list[tuple[int, int]]:
    """A motion in pieces of at most ``LONGEST_S``; the last one is open, as long as the motion may go on."""
    cuts = [begin]
    while t_s[end - 1] - t_s[cuts[-1]] > LONGEST_S:
        cuts.append(int(np.searchsorted(t_s, t_s[cuts[-1]] + LONGEST_S)))
    return [(low, high) for low, high in zip(cuts, [*cuts[1:], end], strict=True) if high - low > 2]
