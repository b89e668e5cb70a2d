"""The state machine that turns edges of the channels A and B into increments (6.1), as an FPGA runs it: one compiled step per edge.

Levels (A, B) in forward order: (0, 0), (1, 0), (1, 1), (0, 1), so A leads B when the position rises.  The states S1 to S4 are
these levels met going forward, S8 to S5 the same levels met going in reverse:

==========  ======  ======  ======  ======
levels      (0, 0)  (1, 0)  (1, 1)  (0, 1)
forward     S1      S2      S3      S4
reverse     S8      S7      S6      S5
==========  ======  ======  ======  ======

Forward runs S1 S2 S3 S4 S1, reverse S5 S6 S7 S8 S5 (the printed rule S_i → S_mod(i+1,4) has an S_0).  Debouncing: from S3,
entered from S2, the levels of S2 do not make an increment; only "previous" becomes S7, the same levels in reverse.  Back to S3:
nothing has happened.  On to S8: the motion has reversed, one increment in reverse.  So the count is the true one behind a play
of one increment, and from one increment to the next the axis has moved by exactly one increment, also through a reversal.

Two channels that change in one tick, and an edge to a level that the channel already has (an edge was missed), are invalid: they
are counted, nothing is added to the position, and no time or distance across them is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import IntArray
from beltcomm.encoder.edges import Edges
from beltcomm.encoder.kernel import INVALID, all_increments, new_decoder
from beltcomm.errors import DataError


@dataclass(frozen=True)
class Increments:
    """Increments that a state machine made of a record.

    Attributes
    ----------
    tick, step : IntArray
        Of each increment, (n,), step 1 or −1, count their running sum.
    invalid : int
        Edges that no motion makes, above 0 the position may be wrong by several increments.
    edges : int
        Edges taken.
    """

    tick: IntArray
    step: IntArray
    invalid: int
    edges: int

    @property
    def count(self) -> int:
        """Increments from the beginning to the end of the record."""
        return int(np.sum(self.step))


def count_increments(edges: Edges, *, debounce: bool = True) -> Increments:
    """All edges of a record through the state machine.

    Raises
    ------
    DataError
        When edges are not in order of time.
    """
    require_order(edges)
    registers = new_decoder(edges.level_a, edges.level_b, debounce=debounce)
    tick, step = all_increments(registers, edges.tick, edges.channel, edges.level)
    return Increments(tick, step, int(registers[INVALID]), len(edges.tick))


def require_order(edges: Edges) -> None:
    """Refuse increments that are not in the order of time.

    Raises
    ------
    DataError
        When edges are not in order of time.
    """
    wrong = np.flatnonzero(np.diff(edges.tick) < 0)
    if len(wrong):
        at = int(wrong[0])
        raise DataError(
            f"edge {at + 1} lies at tick {edges.tick[at + 1]}, before edge {at} at tick {edges.tick[at]}; sort the edges by time first"
        )
