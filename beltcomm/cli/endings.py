"""Signals that end a program, made to end it like Ctrl-C: with a stopped axis and restored parameters."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def like_ctrl_c(noted: Callable[[], None]) -> Iterator[None]:
    """SIGTERM (``kill``, shutdown) and SIGHUP (closed terminal, dropped connection) raise KeyboardInterrupt in the main thread.

    noted : called first.   From then on both are ignored: closing a terminal sends several, and none may disturb the restoring.
    A SIGHUP that was ignored before (``nohup``) stays so.  Outside the main thread nothing changes.
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
