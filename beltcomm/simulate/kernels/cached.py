"""The user's cache of kernels, and its entries of programs that are no more.

Nothing is taken away but regular files whose whole name is one that this package or numba, for it, has given; and of those, nothing that a
running program has to find again: a note or machine code that is missing is made again.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import stat
from pathlib import Path

from platformdirs import user_cache_path

from beltcomm import atomic

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
    """Whose note it is: of which program, and for which cache of machine code."""
    atomic.write(note, json.dumps(_owner()).encode() + b"\n")


def prune(note: Path) -> None:
    """Take away what earlier versions left beside ``note``, the one that holds now; what cannot be taken away stays.

    Notes of this program's earlier state, of programs that are no more, and those from before notes told whose they are; drafts and machine
    code of kernels whose number is below :data:`VERSION`.  A later program, and another one that is still installed, keep theirs.
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
