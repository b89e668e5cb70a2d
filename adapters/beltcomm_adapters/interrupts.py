"""Ctrl-C while an axis is being stopped: heard, but answered after the axis stands."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


@contextlib.contextmanager
def deferred_interrupt() -> Iterator[None]:
    """Hold back SIGINT inside the block and raise after it what its handler would have raised at once: KeyboardInterrupt.

    The handler is asked when the signal comes, because it may matter when that was; of several, the last one is raised.
    Outside the main thread nothing changes: Python delivers signals to the main thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: KeyboardInterrupt | None = None
    before = signal.getsignal(signal.SIGINT)

    def remember(number: int, frame: FrameType | None) -> None:
        nonlocal came
        try:
            if callable(before):
                before(number, frame)
        except KeyboardInterrupt as interrupt:
            came = interrupt

    signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came is not None:
        raise came.with_traceback(None)
