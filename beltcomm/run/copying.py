"""A run under a new name."""

from __future__ import annotations

import shutil
from pathlib import Path

from beltcomm.errors import UsageError
from beltcomm.locks import NAME, at_work, occupied
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence


def copy_run(folder: RunFolder, to: Path) -> Path:
    """Copy a run, whole or not at all.   Raises UsageError where the new folder exists or cannot be, or a session is at work in the run."""
    run = folder.path
    if to.exists() or to.is_symlink():
        raise UsageError(f"{to} exists; give another name for the copy of {run}")
    if to.resolve().is_relative_to(run.resolve()):
        raise UsageError(f"{to} is inside {run}; a run cannot hold a copy of itself, give a folder beside it")
    draft = to.with_name(f".{to.name}.part")
    with occupied(run, Silence(), refusal=lambda holder: at_work(run, holder)):
        try:
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copytree(run, draft, symlinks=True, ignore=shutil.ignore_patterns(NAME))
            draft.rename(to)
        except (OSError, shutil.Error) as error:
            shutil.rmtree(draft, ignore_errors=True)
            words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise UsageError(f"{to} cannot be written: {words}; choose another place") from error
    return to
