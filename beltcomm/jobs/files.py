"""Files that a command writes where the user says."""

from __future__ import annotations

from pathlib import Path

from beltcomm.errors import Refused, UsageError
from beltcomm.talk import Talk


def may_write(file: Path, yes: bool, talk: Talk) -> None:
    """Ask before a file is overwritten, unless told not to.   Raises UsageError for a folder, Refused for a no."""
    if file.is_dir():
        raise UsageError(f"{file} is a folder; give the name of the file to write")
    if file.exists() and not yes and not talk.confirm(f"{file} exists. Overwrite it?"):
        raise Refused(f"{file} was left as it is; give another file name, or --yes to overwrite it")
