"""The first use after an installation compiles: that is said where it happens, and nowhere else."""

from __future__ import annotations

import gc
from itertools import count

import numba

from beltcomm.cli.kernels import EVERY_S, Told
from beltcomm.compiled import when_compiling


def test_only_what_is_really_compiled_is_heard_and_once_for_all_that_it_needs() -> None:
    heard: list[str] = []
    when_compiling(lambda: heard.append("begun"), lambda: heard.append("ended"))
    inner = numba.njit(lambda x: x + 1)
    outer = numba.njit(lambda x: inner(x) + 1)
    assert heard == []
    assert outer(1) == 3
    assert heard == ["begun", "ended"]
    assert outer(2) == 4
    assert heard == ["begun", "ended"]


def test_nothing_is_collected_while_something_is_compiled() -> None:
    collects: list[bool] = []
    when_compiling(lambda: collects.append(gc.isenabled()), lambda: None)
    assert numba.njit(lambda x: x + 1)(1) == 2
    assert collects == [False]
    assert gc.isenabled()


def test_one_line_first_and_then_one_for_every_ten_seconds_of_it() -> None:
    lines: list[str] = []
    ticks = count(0.0, 0.6 * EVERY_S)
    told = Told(lines.append, lambda: next(ticks))
    for _ in range(4):
        told.begun()
        told.ended()
    assert lines[0].startswith("Preparing numerical kernels, once after an installation")
    assert lines[1:] == [
        "      2 kernels are ready after 12 s of compiling",
        "      4 kernels are ready after 24 s of compiling",
    ]
