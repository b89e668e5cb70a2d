"""Says that numerical kernels are compiled, where that happens: the first use after an installation is silent for so long otherwise."""

from __future__ import annotations

import time
from collections.abc import Callable

import click

#: s: between two lines on how far it is.
EVERY_S = 10.0
FIRST = (
    "Preparing numerical kernels, once after an installation: about {usual} of computing before and between what follows; "
    "they are kept for every later command"
)
#: 13 to 20 s were measured for each of `commission`, `compare` and `diagnose` with nothing cached, on a machine with other work.
USUAL = "15 seconds"


class Told:
    """Lines while kernels are compiled.

    Parameters
    ----------
    say : callable
        Where they go.
    clock : callable
        Time, s.
    """

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._say, self._clock = say, clock
        self._count, self._spent_s, self._told_s, self._began_s = 0, 0.0, 0.0, 0.0

    def begun(self) -> None:
        """A kernel is compiled now."""
        if not self._count:
            self._say(FIRST.format(usual=USUAL))
        self._count += 1
        self._began_s = self._clock()

    def ended(self) -> None:
        """It is ready."""
        self._spent_s += self._clock() - self._began_s
        if self._spent_s >= self._told_s + EVERY_S:
            self._told_s = self._spent_s
            self._say(f"      {self._count} kernels are ready after {self._spent_s:.0f} s of compiling")


_told: list[Told] = []


def listen() -> None:
    """From now on what is compiled is told on stderr, once however often this is called."""
    if _told:
        return
    from beltcomm import caches
    from beltcomm.compiled import when_compiling

    told = Told(_say)
    _told.append(told)
    when_compiling(told.begun, told.ended)
    caches.listen(_say)


def _say(line: str) -> None:
    """To the talk of the running command, which may have a live display there."""
    context = click.get_current_context(silent=True)
    if context is not None and hasattr(context.obj, "talk"):
        context.obj.talk().say(line)
