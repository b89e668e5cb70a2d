"""``--hold-to-run``: the axis moves only while the space bar is held, or while a script goes on writing to a file descriptor."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable

import click

from beltcomm.errors import UsageError
from beltcomm.posix import keys_one_by_one

#: s: without a sign of the key for so long it counts as released.
RELEASED_S = 0.5
#: Signs in a row, none later than that after the one before, from which on it counts as held: a key that repeats, not one that was hit.
REPEATS = 3
KEY = b" "


class HeldKey:
    """A key that repeats while it is held, or any byte from a script.

    Parameters
    ----------
    fd : int
        Where its signs come from.
    key : bytes or None
        The byte that counts, None for any.
    clock : callable
        Time, s.
    say : callable
        Tells the person what to do.
    """

    def __init__(self, fd: int, key: bytes | None, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._fd, self._key, self._say, self._clock = fd, key, say, clock
        self._last_s = -1.0
        self._give_back: Callable[[], None] | None = None
        self._told = False

    def begin(self) -> bool:
        """Begin to look for the key, as :class:`beltcomm.talk.Hold` asks; what was typed before does not count."""
        self._without_lines()
        if not self._told:
            self._say(
                "Hold the space bar as long as the axis may move; letting go stops it." if self._key else "Waiting for signs of life."
            )
            self._told = True
        signs, last = 0, self._clock()
        while signs < REPEATS:
            ready = self._look(RELEASED_S)
            if ready is None:
                self.end()
                return False
            now = self._clock()
            in_time = now - last <= RELEASED_S
            if ready:
                signs, last = signs + 1 if in_time else 1, now
            elif not in_time:
                signs = 0
        self._last_s = last
        return True

    def pressed(self) -> bool:
        """True as long as the key is held (:class:`beltcomm.talk.Hold`)."""
        now = self._clock()
        if self._look(0.0):
            self._last_s = now
        return now - self._last_s <= RELEASED_S

    def end(self) -> None:
        """Give the terminal its lines back; what was typed meanwhile answers no question."""
        if self._give_back is not None:
            self._give_back()
            self._give_back = None

    def _without_lines(self) -> None:
        """Keys one by one and unseen; Ctrl-C stays what it is."""
        if self._key is None or not os.isatty(self._fd) or self._give_back is not None:
            return
        self._give_back = keys_one_by_one(self._fd)
        if self._give_back is None:
            raise UsageError("this system's terminal gives no key while it is held; hold to run by a script: --hold-to-run=FD")

    def _look(self, wait_s: float) -> bool | None:
        """True if the key gave a sign within this time; None when nothing will ever come."""
        if not select.select([self._fd], [], [], wait_s)[0]:
            return False
        found = os.read(self._fd, 4096)
        if not found:
            return None
        return self._key is None or self._key in found


def option(_ctx: click.Context, _param: click.Parameter, value: str | None) -> HeldKey | None:
    """The key behind ``--hold-to-run``: the terminal's, or a file descriptor.

    Parameters
    ----------
    _ctx, _param : Context
    value : str or None
        "key", or the number of a file descriptor; None without the option.

    Raises
    ------
    UsageError
        Where there is neither.
    """
    if value is None:
        return None

    def say(text: str) -> None:
        click.echo(text, err=True)

    if value == "key":
        if sys.stdin is None or not sys.stdin.isatty():
            raise UsageError("--hold-to-run needs a terminal whose space bar is held; a script writes to a pipe: --hold-to-run=FD")
        return HeldKey(sys.stdin.fileno(), KEY, say)
    try:
        fd = int(value)
        os.fstat(fd)
    except (ValueError, OSError):
        raise UsageError(f"--hold-to-run={value}: that is no open file descriptor; give its number, or nothing for the space bar") from None
    return HeldKey(fd, None, say)
