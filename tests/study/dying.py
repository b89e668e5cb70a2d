"""Work that kills its worker."""

from __future__ import annotations

import os
import signal
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
