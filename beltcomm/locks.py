"""One command at a time changes a folder: a lock of the operating system, which takes it back from a killed process.

:func:`take` locks a file; :func:`occupied` and :func:`changes_run` a folder, for a command and all that it calls.
"""

from __future__ import annotations

import errno
import inspect
import os
import platform
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from beltcomm import atomic
from beltcomm.errors import DataError, UsageError
from beltcomm.outside import read_text
from beltcomm.talk import Silence, Talk

if TYPE_CHECKING:
    from filelock import FileLock

_P = ParamSpec("_P")
_R = TypeVar("_R")

#: File of a folder that is locked; a killed process leaves it, which does not matter.
NAME = ".lock"
#: What a file system says that knows no locks, and one on which nothing can be written.
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
UNWRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT)
#: Of a run: what is written into in place, and folders that may be links as long as nothing is written into them.
_IN_PLACE, _READ = ("journal.txt", "events.jsonl", NAME), ("recordings", "originals")
#: s between two looks at a lock that somebody else holds.
_LOOK_S = 0.2


@dataclass
class _Hold:
    """Of a folder, by a command of this thread.   depth : commands inside each other.   session : one of them moves a machine."""

    lock: FileLock | None
    depth: int = 0
    session: bool = False


_holds: dict[tuple[str, int], _Hold] = {}


def take(path: Path, refusal: Callable[[str], str], waiting: Callable[[str], object] | None = None) -> FileLock:
    """The lock of a file until its ``release()``, or the end of this process.

    Parameters
    ----------
    path : Path
    refusal : callable
        The sentence for a lock that is held, from the words for who holds it.
    waiting : callable
        Gets these words once, then its turn is waited for.

    Raises
    ------
    UsageError
        With ``refusal``.
    OSError
        Where there can be no lock.
    """
    import filelock  # it takes as long to import as all that prints help

    lock = filelock.FileLock(path, timeout=0.0, poll_interval=_LOOK_S, thread_local=False, fallback_to_soft=False)
    try:
        lock.acquire()
    except filelock.Timeout:
        holder = _holder(path)
        if waiting is None:
            raise UsageError(refusal(holder)) from None
        waiting(holder)
        lock.acquire(timeout=-1.0)
    with suppress(OSError):  # whoever waits is told less
        told = os.open(path, os.O_WRONLY | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0))
        os.write(told, f"process {os.getpid()} on {platform.node() or 'this computer'}\n".encode())
        os.close(told)
    return lock


@contextmanager
def occupied(
    folder: Path, talk: Talk, *, refusal: Callable[[str], str] | None = None, session: bool = False, unwritable: str = ""
) -> Iterator[None]:
    """Keep other commands out of a folder; a command that calls another one is in it already.

    Parameters
    ----------
    folder : Path
        Of the run.
    talk : Talk
    refusal : callable
        The sentence where somebody else is in it; None waits, which is said.
    session : bool
        Moves a machine: one at a time, whoever calls.
    unwritable : str
        What to do where nothing can be written; "" goes on, because nothing can be changed there.

    Raises
    ------
    UsageError
    """
    key = (os.path.realpath(folder), threading.get_ident())
    hold = _holds.get(key)
    if hold is None:
        _refuse_links(folder)
        hold = _holds[key] = _Hold(_folder_lock(folder, talk, refusal, unwritable))
        if hold.lock is not None:
            atomic.sweep(folder)
    elif session and hold.session:
        raise UsageError(refusal("this process") if refusal else f"{folder} is in use by this process")
    before, hold.session = hold.session, hold.session or session
    hold.depth += 1
    try:
        yield
    finally:
        hold.depth, hold.session = hold.depth - 1, before
        if not hold.depth:
            del _holds[key]
            if hold.lock is not None:
                with suppress(OSError):  # whoever waits for a file that has gone looks again
                    os.unlink(folder / NAME)
                hold.lock.release()


def is_occupied(folder: Path) -> bool:
    """True if another command is in a folder now; what a killed one left is no command.

    Parameters
    ----------
    folder : Path
        Of a run.
    """
    import filelock

    path = folder / NAME
    if path.is_symlink() or not path.is_file():
        return False
    lock = filelock.FileLock(path, timeout=0.0, thread_local=False, fallback_to_soft=False)
    try:
        lock.acquire()
    except filelock.Timeout:
        return True
    except OSError:
        return False
    lock.release()
    return False


def changes_run(*, waits: bool = True) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Of a command whose argument ``run`` is a folder that it changes: others are kept out of it meanwhile.

    Parameters
    ----------
    waits : bool
        Its turn, where another one is at work; else it is refused, as what moves a machine.
    """

    def alone(command: Callable[_P, _R]) -> Callable[_P, _R]:
        signature = inspect.signature(command)

        @wraps(command)
        def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            given = signature.bind(*args, **kwargs).arguments
            run, talk = given.get("run"), given.get("talk")
            if not isinstance(run, (str, os.PathLike)) or not os.path.isdir(run):
                return command(*args, **kwargs)  # which says what is wrong, or makes it
            folder = Path(run)
            with occupied(folder, talk or Silence(), refusal=None if waits else lambda holder: at_work(folder, holder)):
                return command(*args, **kwargs)

        return call

    return alone


def at_work(folder: Path, holder: str) -> str:
    """The sentence for a run in which another session is.

    Parameters
    ----------
    folder : Path
        Of the run.
    holder : str
        In words.
    """
    return f"another session is at work in {folder} ({holder}); wait for its end, or choose another folder"


def _refuse_links(folder: Path) -> None:
    """Raise UsageError where a command would write through a link out of a folder, or into a pipe or folder instead of a file."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink() and (entry.name in _IN_PLACE or (entry.is_dir() and entry.name not in _READ)):
                raise link_refused(Path(entry.path))
            if entry.name in _IN_PLACE and not entry.is_file():
                raise UsageError(f"{entry.path} is a folder, a pipe or a device, no file; delete it, it is made anew")


def link_refused(path: Path) -> UsageError:
    """Error for a link inside a folder that is to be written into.

    Parameters
    ----------
    path : Path
        The link.
    """
    return UsageError(
        f"{path} is a link to {os.path.realpath(path)}; nothing is written through links inside a run. Put what it points to in its place"
    )


def _folder_lock(folder: Path, talk: Talk, refusal: Callable[[str], str] | None, unwritable: str) -> FileLock | None:
    path = folder / NAME

    def waiting(holder: str) -> None:
        talk.say(f"{folder} is in use by {holder}; waiting for its end (Ctrl-C leaves)")

    try:
        return take(path, refusal or str, None if refusal else waiting)
    except OSError as error:
        if error.errno in NO_LOCKS:
            talk.say(f"{folder} knows no locks ({error.strerror or error}): let no other command change it meanwhile")
        elif unwritable or error.errno not in UNWRITABLE:
            remedy = unwritable or "choose another folder"
            raise UsageError(f"{path} cannot be written: {error.strerror or error}; {remedy}") from error
        return None


def _holder(path: Path) -> str:
    """In words, as the holder has written them."""
    try:
        return read_text(path, failure=DataError).strip()[:100] or "another process"
    except (OSError, DataError):
        return "another process"
