"""Signals that end a program: like Ctrl-C, with a stopped axis and restored parameters; a second Ctrl-C at once leaves without these."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from beltcomm.errors import LeaveNow

#: s, within which a second Ctrl-C means: leave at once.
TWICE_S = 2.0


@contextmanager
def like_ctrl_c(noted: Callable[[], None]) -> Iterator[None]:
    """SIGTERM (``kill``, shutdown) and SIGHUP (closed terminal, dropped connection) raise KeyboardInterrupt in the main thread.

    Parameters
    ----------
    noted : callable
        Called first. From then on both are ignored: closing a terminal sends several, and none may disturb the restoring. A SIGHUP that
        was ignored before (``nohup``) stays so. Outside the main thread nothing changes.
    """
    names = ("SIGTERM", "SIGHUP")
    wanted = [signal.Signals[name] for name in names if name in signal.Signals.__members__]  # Windows has no SIGHUP
    if threading.current_thread() is not threading.main_thread():
        wanted = []
    before = {number: signal.getsignal(number) for number in wanted}
    mine = [number for number in wanted if before[number] is not signal.SIG_IGN]

    def end(_number: int, _frame: FrameType | None) -> None:
        for number in mine:
            signal.signal(number, signal.SIG_IGN)
        noted()
        raise KeyboardInterrupt

    for number in mine:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, before[number] or signal.SIG_DFL)


@contextmanager
def twice_leaves(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt as ever; another one within ``TWICE_S`` raises LeaveNow.

    Also where SIGINT is ignored: a script's job in the background is born deaf to it, and who ends the script must stop the axis too.
    Where it is handled by somebody else, and outside the main thread, nothing changes.

    Parameters
    ----------
    clock : callable
        Monotonic clock, s.
    """
    before = signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and before in (signal.default_int_handler, signal.SIG_IGN)
    heard: list[float] = []

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        now = clock()
        again = bool(heard) and now - heard[-1] <= TWICE_S
        heard.append(now)
        raise LeaveNow if again else KeyboardInterrupt

    if ours:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
