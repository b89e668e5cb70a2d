"""Frames that are kept of a bus: the set-up stays, however long a master polls afterwards."""

from __future__ import annotations

from beltcomm.axis import load_axis
from beltcomm.foreign.convert import Reading
from beltcomm.watching.streams import SETUP_FIRST, SETUP_LAST, BusStream


def test_a_master_that_polls_does_not_push_the_set_up_out() -> None:
    stream = BusStream("can0", Reading(), load_axis("egc-70-600"))
    upload, answer = bytes.fromhex("40001A0100000000"), bytes.fromhex("43001A0120006460")
    stream.take([(0.0, 0x601, upload, False), (0.001, 0x581, answer, False)])
    polled = bytes.fromhex("4041600000000000")
    stream.take((0.01 * k, 0x601 - 0x80 * (k % 2), polled, False) for k in range(1, 3 * (SETUP_FIRST + SETUP_LAST)))
    kept = [frame[2] for _, frame in (*stream._first, *stream._setup)]
    assert kept[:2] == [upload, answer]
    assert len(kept) == SETUP_FIRST + SETUP_LAST
