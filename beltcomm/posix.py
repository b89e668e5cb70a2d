"""Parts of Linux and macOS that Windows lacks: terminals by hand, bounds of a process.  Only here are ``termios`` and ``resource`` known.

Each function says by ``None`` or ``False`` that the system has no such thing; nothing of this package fails to import for that.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import subprocess


@dataclass(frozen=True)
class TerminalPair:
    """A pseudo-terminal.

    Attributes
    ----------
    here, there : int
        File descriptors of both ends.
    path : str
        What another program opens.
    forget : callable
        Drops what was sent and not read yet.
    bitrate : callable
        That the other program has set, 0 for one that is none.
    """

    here: int
    there: int
    path: str
    forget: Callable[[], None]
    bitrate: Callable[[], int]


def terminal_pair() -> TerminalPair | None:
    """A pseudo-terminal that passes every byte as it is; None where the system has none.   Both ends stay open until they are closed."""
    try:
        import termios
        import tty

        here, there = os.openpty()
    except (ImportError, OSError, AttributeError):
        return None
    tty.setraw(there)
    rates = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
    return TerminalPair(
        here,
        there,
        os.ttyname(there),
        lambda: termios.tcflush(there, termios.TCIFLUSH),
        lambda: rates.get(termios.tcgetattr(there)[5], 0),
    )


def keys_one_by_one(fd: int) -> Callable[[], None] | None:
    """A terminal gives its keys one by one and unseen from now on; what is given back ends that.   None where the system cannot.

    Ctrl-C stays what it is; what was typed meanwhile answers no question.

    Parameters
    ----------
    fd : int
        Of the terminal.
    """
    try:
        import termios
    except ImportError:
        return None
    before, changed = termios.tcgetattr(fd), termios.tcgetattr(fd)
    changed[3] &= ~(termios.ICANON | termios.ECHO)
    termios.tcsetattr(fd, termios.TCSAFLUSH, changed)
    return lambda: termios.tcsetattr(fd, termios.TCSAFLUSH, before)


def bound_this_process(bounds: Mapping[str, int]) -> None:
    """Bounds by name (``RLIMIT_AS``, ...) for this process, as far as the system knows them.

    Parameters
    ----------
    bounds : mapping of str to int
        In the units of ``resource.setrlimit``.
    """
    try:
        import resource
    except ImportError:
        return
    for name, bound in bounds.items():
        number = getattr(resource, name, None)
        if number is not None:
            _, hard = resource.getrlimit(number)
            most = bound if hard == resource.RLIM_INFINITY else min(bound, hard)
            with contextlib.suppress(*((ValueError, OSError) if sys.platform == "darwin" else ())):  # which refuses some of them
                resource.setrlimit(number, (most, hard))


def interrupt(process: subprocess.Popen[bytes]) -> None:
    """End a process as Ctrl-C would; at once where the system has no such thing for one process.

    Parameters
    ----------
    process : Popen of bytes
        Started by this one.
    """
    with contextlib.suppress(OSError):  # it has ended meanwhile
        if os.name == "nt":
            process.terminate()
        else:
            process.send_signal(signal.SIGINT)


def is_alive(process: int) -> bool:
    """True if a process is there, by its number; True where that cannot be asked without hurting it.

    Parameters
    ----------
    process : int
        Number (pid).
    """
    if os.name == "nt":  # a signal of number 0 is Ctrl-C there
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
