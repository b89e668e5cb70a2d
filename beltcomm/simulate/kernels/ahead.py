"""The largest kernels compiled on another processor while this one does what comes before it; the first time only.

A diagnosis needs the masked load and the belt with what may stand beside it, half of all that it compiles, when its base fit stands.  A
process of its own compiles them from the beginning on and leaves them in the cache, where they are found; where that process fails, they
are compiled here as any other.  It begins before numba is loaded here: this module imports nothing that takes time.

The user's cache of kernels is kept free of entries of programs that are no more.

Nothing is taken away but regular files whose whole name is one that this package or numba, for it, has given; and of those, nothing that a
running program has to find again: a note or machine code that is missing is made again.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import re
import stat
import subprocess
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import ParamSpec, TypeVar

from platformdirs import user_cache_path

from beltcomm import atomic, isolation

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
    """The kernel, which looks for its machine code when what was begun is done.

    Parameters
    ----------
    kernel : callable
        Compiled.
    """

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
    kernels, home = folder(), package()
    numba = find_spec("numba")
    sources = [
        path
        for part in ("compiled.py", "control/*.py", "effects/*.py", "model/*.py", "simulate/*.py", "simulate/kernels/*.py")
        for path in sorted(home.glob(part))
    ]
    try:
        kernels.mkdir(parents=True, exist_ok=True)
        stamps = [(path, path.stat().st_size, path.stat().st_mtime_ns) for path in (*sources, Path(str(numba and numba.origin)))]
    except OSError:
        return None
    key = hashlib.sha256(repr((os.environ.get("NUMBA_CACHE_DIR"), stamps)).encode()).hexdigest()[:20]
    return kernels / f"ahead_{key}" if os.access(kernels, os.W_OK) else None


#: Changes whenever the generated source changes shape, so that an old cache is never met.
VERSION = 20
#: Notes of what was compiled ahead; drafts of kernels; machine code of kernels as numba and Python name it.  Sources are left: a process
#: of the version that wrote them may be about to read them, and they are short.
_NOTE = re.compile(r"ahead_[0-9a-f]{20}")
_DRAFT = re.compile(r"kernel_(\d+)_[0-9a-f]{20}\w+\.draft")  # as earlier versions named them
_CODE = re.compile(r"kernel_(\d+)_[0-9a-f]{20}\.(?:\w+-\d+\.py\d+\w*\.(?:nbi|[0-9a-f]+\.nbc)|[\w-]+\.pyc)")
#: Longest note, in bytes, that this package writes.
_LONGEST = 10_000


def folder() -> Path:
    """Of the kernels: their sources, notes of what was compiled ahead, and beside them in ``__pycache__`` what numba makes of them."""
    return user_cache_path("beltcomm") / "kernels"


def package() -> Path:
    """Folder of this program."""
    return Path(__file__).resolve().parents[2]


def write_note(note: Path) -> None:
    """Write down whose a note is: of which program, and for which cache of machine code.

    Parameters
    ----------
    note : Path
    """
    atomic.write(note, json.dumps(_owner()).encode() + b"\n")


def prune(note: Path) -> None:
    """Take away what earlier versions left beside ``note``, the one that holds now; what cannot be taken away stays.

    Notes of this program's earlier state, of programs that are no more, and those from before notes told whose they are; drafts and machine
    code of kernels whose number is below :data:`VERSION`.  A later program, and another one that is still installed, keep theirs.

    Parameters
    ----------
    note : Path
        Of the file that holds now.
    """
    for path in _files(note.parent):
        if _NOTE.fullmatch(path.name) and path != note:
            _remove(path, _is_superseded(path))
        elif found := _DRAFT.fullmatch(path.name):
            _remove(path, int(found[1]) < VERSION)
    for path in _files(note.parent / "__pycache__"):
        if found := _CODE.fullmatch(path.name):
            _remove(path, int(found[1]) < VERSION)


def _owner() -> dict[str, str]:
    return {"package": str(package()), "numba_cache": os.environ.get("NUMBA_CACHE_DIR", "")}


def _is_superseded(note: Path) -> bool:
    """True if nobody will look for a note any more; False for one that this package has not written."""
    try:
        if not note.stat().st_size:
            return True  # from before notes told whose they are
        if note.stat().st_size > _LONGEST:
            return False
        owner = json.loads(note.read_text(encoding="utf-8"))
        where = str(owner["package"])
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return owner == _owner() or (os.path.isabs(where) and not os.path.exists(where))


def _files(place: Path) -> list[Path]:
    """Regular files in a folder; links are somebody else's."""
    try:
        return sorted(path for path in place.iterdir() if stat.S_ISREG(path.lstat().st_mode))
    except OSError:
        return []


def _remove(path: Path, old: bool) -> None:
    if old:
        with contextlib.suppress(OSError):  # another process was first, or it is not ours
            path.unlink()
