"""The largest kernels compiled on another processor while this one does what comes before it; the first time only.

A diagnosis needs the masked load and the belt with what may stand beside it, half of all that it compiles, when its base fit stands.  A
process of its own compiles them from the beginning on and leaves them in the cache, where they are found; where that process fails, they
are compiled here as any other.  It begins before numba is loaded here: this module imports nothing that takes time.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import subprocess
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import ParamSpec, TypeVar

from beltcomm import isolation
from beltcomm.simulate.kernels import cached

_P = ParamSpec("_P")
_R = TypeVar("_R")

_beside: list[subprocess.Popen[bytes]] = []
_meanwhile: list[Callable[[], object]] = []


def begin(meanwhile: Iterable[Callable[[], object]] = ()) -> None:
    """Compile the masked load beside this process, unless that was done before, no cache can be written or there is one processor.

    Parameters
    ----------
    meanwhile : iterable of callable
        Calls that compile what is needed later, made here while :func:`wait` has nothing else to do.
    """
    _meanwhile[:] = reversed(tuple(meanwhile))
    note = note_file()
    if note is not None and not note.exists() and len(os.sched_getaffinity(0)) > 1:
        start(isolation.python("beltcomm.simulate.kernels.compile_largest"))


def start(command: Sequence[str]) -> None:
    """Run a command beside this process, which ends it with itself; :func:`wait` waits for it."""
    if _beside:
        return
    try:
        child = isolation.start(command)
    except OSError:
        return
    _beside.append(child)
    atexit.register(_end, child)


def wait() -> None:
    """Until what was begun is done; told as any other compilation."""
    if not _beside:
        return
    from beltcomm.compiled import told_as_compiling

    with told_as_compiling():
        for child in tuple(_beside):  # another thread may wait for the same one
            while _meanwhile and child.poll() is None:
                _meanwhile.pop()()
            child.wait()
    _beside.clear()


def after_waiting(kernel: Callable[_P, _R]) -> Callable[_P, _R]:
    """The kernel, which looks for its machine code when what was begun is done."""

    @wraps(kernel)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        wait()
        return kernel(*args, **kwargs)

    return call


def _end(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    child.wait()


def note_file() -> Path | None:
    """Says that what stands in these files was compiled here by this numba; whether its machine code still fits, numba alone decides.

    None where it cannot be written.
    """
    kernels, package = cached.folder(), cached.package()
    numba = find_spec("numba")
    sources = [
        path
        for part in ("compiled.py", "control/*.py", "effects/*.py", "model/*.py", "simulate/*.py", "simulate/kernels/*.py")
        for path in sorted(package.glob(part))
    ]
    try:
        kernels.mkdir(parents=True, exist_ok=True)
        stamps = [(path, path.stat().st_size, path.stat().st_mtime_ns) for path in (*sources, Path(str(numba and numba.origin)))]
    except OSError:
        return None
    key = hashlib.sha256(repr((os.environ.get("NUMBA_CACHE_DIR"), stamps)).encode()).hexdigest()[:20]
    return kernels / f"ahead_{key}" if os.access(kernels, os.W_OK) else None
