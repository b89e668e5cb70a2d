"""One process at a time computes into the folder of a study; the lock is the operating system's, which takes it from a killed one."""

from __future__ import annotations

import errno
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from beltcomm.errors import UsageError
from beltcomm.talk import Talk

#: File that is locked: the members' own is replaced at the end, and a lock goes with what was replaced.  It stays when nobody holds it.
LOCK = "study.lock"
#: Byte that is locked where a locked one cannot be read: far behind the words on who holds it.
FAR = 1 << 20
#: What a system call says when another process holds the lock; anything else means that this folder knows no locks.
HELD = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)


@contextmanager
def held(folder: Path, talk: Talk) -> Iterator[None]:
    """Keep other studies out of a folder.   Raises UsageError when one computes in it, and when nothing can be written there."""
    path = folder / LOCK
    try:
        file = open(path, "a+", encoding="utf-8")  # noqa: SIM115  # closed below, however this ends; never cut before it is locked
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; choose another --out") from error
    with file:
        try:
            _lock(file)
        except OSError as error:
            if error.errno in HELD:
                raise UsageError(
                    f"{folder} is being computed by {_holder(path)}; wait for its end, or end it and the same command goes on; "
                    "--limit 0 reads what is known so far"
                ) from None
            talk.say(f"{folder} knows no locks ({error.strerror or error}): let no other study compute into it meanwhile")
        file.seek(0)
        file.truncate()
        file.write(f"process {os.getpid()} on {platform.node() or 'this computer'}\n")
        file.flush()
        yield


def _holder(path: Path) -> str:
    """In words, as the holder has written them."""
    try:
        return path.read_text(encoding="utf-8").strip() or "another process"
    except (OSError, UnicodeDecodeError):
        return "another process"


def _lock(file: IO[str]) -> None:
    """Until the file is closed or its process is gone.   Raises OSError."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        file.seek(FAR)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
