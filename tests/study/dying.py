"""Work that kills its worker, or waits until that is killed."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def dying_once(mark: Path, number: int) -> int:
    """The square of a number; whoever comes first to 5 dies over it."""
    if number == 5 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def dying(number: int) -> int:
    """No result ever."""
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def waiting(given: tuple[str, int]) -> int:
    """The number; each but 0 waits for a file.   Leaves one of its own."""
    mark, number = given
    while number and not Path(mark).exists():
        time.sleep(0.02)
    Path(f"{mark}.{number}").touch()
    return number
