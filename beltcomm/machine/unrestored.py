"""A drive that a session has changed and not set back, because its process was killed or the cable was cut: noted and found again.

Before the first setting is written a note is put into the user's state folder: which run, what stood in the drive.  It goes away when
the drive is as it should be.  Beside the note a lock is held as long as its session lives; the system gives it back whatever ends the
process.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltcomm import atomic
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.drive import Drive
from beltcomm.drive.objects import ObjectValue, object_from_dict
from beltcomm.errors import BeltcommError, DataError, UsageError
from beltcomm.given import pasted
from beltcomm.locks import take
from beltcomm.machine import gains
from beltcomm.machine.hardware import Hardware, state_folder
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

if TYPE_CHECKING:
    from filelock import FileLock

#: What is in no backup: it is volatile in every drive.
MAPPING = "which objects its PDOs carry comes back when the drive is switched off and on"


class Note:
    """The note of one drive.

    Attributes
    ----------
    path
        Its file, whether it is there or not.
    """

    def __init__(self, hardware: Hardware) -> None:
        self.hardware = hardware
        self.path = state_folder() / "unrestored" / f"{hardware.key}.yaml"
        self._held: FileLock | None = None

    def found(self) -> dict[str, Any] | None:
        """Note that an earlier session left; None when every session has ended well.

        Raises UsageError when that session is still at work on this drive, or the note was damaged since.
        """
        if not self.path.is_file():
            return None
        try:
            self._take().release()
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            return read_yaml(self.path)
        except UsageError as error:
            raise UsageError(
                f"a session on {self.hardware.words} ended without restoring it, and its note is damaged ({error}); roll its run back "
                f"(`beltcomm rollback --drive {pasted(self.hardware.name)} --run RUN`), then delete the note"
            ) from error

    def write_locked(self, run: Path | None, objects: Sequence[ObjectValue]) -> None:
        """Write the note and keep it locked.

        Parameters
        ----------
        run : Path or None
            Folder that the backup is in, None for none.
        objects : sequence of ObjectValue
            As they were before the session.

        Raises
        ------
        UsageError
            When it cannot be kept: then nothing may be changed.
        """
        told = {
            "drive": self.hardware.name,
            "words": self.hardware.words,
            "run": str(run.resolve()) if run is not None else "",
            "process": os.getpid(),
            "objects": [item.to_dict() for item in objects],
        }
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._held = self._take()
            atomic.write(self.path, to_yaml(told).encode())
        except OSError as error:
            self.release()
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> UsageError:
        return UsageError(
            f"{self.path} cannot be written: {error.strerror or error}; a session that is killed could not be found again. Make room, "
            "or set XDG_STATE_HOME to a folder that can be written"
        )

    def remove(self) -> None:
        """The drive is as it should be."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """The session ends; the note stays."""
        if self._held is not None:
            self._held.release()
            self._held = None

    def _take(self) -> FileLock:
        """The drive's lock.   Raises UsageError when another session has it."""
        drive = self.hardware
        return take(
            self.path.with_suffix(".lock"),
            lambda holder: f"another session is at work on {drive.words} ({drive.name}, {holder}); wait for its end",
        )


def settle(drive: Drive, note: Note, talk: Talk, *, yes: bool, dry_run: bool) -> None:
    """Offer the rollback that an earlier session owes this drive; with ``yes`` it is done at once, and said.   Nothing moves.

    A no keeps what is in the drive from now on.   Raises UsageError when that session still lives, and what writing raises.

    Parameters
    ----------
    drive : Drive
    note : Note
        Of what that session changed.
    talk : Talk
    yes : bool
        True for a consent given before.
    dry_run : bool
        True if it is only said.

    Raises
    ------
    DataError
        For a damaged note.
    UsageError
        When that session still lives.
    DriveError
        When the drive does not take a value.
    """
    left = note.found()
    if left is None:
        return
    run = str(left.get("run") or "")
    which = f"the run {run}" if run else "an earlier command"
    try:
        noted = [object_from_dict(entry) for entry in left.get("objects") or ()]
    except (DataError, TypeError) as error:
        raise DataError(f"{note.path} is damaged ({error}); set the drive back with `beltcomm rollback`, then delete that file") from error
    owed = gains.differences(drive, None, noted)  # raw values: what they mean may not be known, what stood there is
    if not owed.changes:
        talk.say(f"{which[0].upper()}{which[1:]} ended without restoring this drive; its settings are those from before all the same.")
        if not dry_run:
            note.remove()
        return
    talk.say(
        "\n".join([f"{which[0].upper()}{which[1:]} ended without restoring this drive. Settings, now -> before that run:", *owed.table()])
    )
    if dry_run:
        talk.say("They stay as they are (--dry-run).")
        return
    if not yes and not talk.confirm("Roll them back now? Nothing moves."):
        back = f"; `beltcomm rollback --drive {pasted(note.hardware.name)} --run {pasted(run)}` writes them back later" if run else ""
        talk.say(f"They stay as they are, and count as this drive's own from now on{back}.")
        _journal(run, "not rolled back after the session was cut off: the user keeps what is in the drive")
        note.remove()
        return
    drive.write_objects([one.wanted for one in owed.changes])
    talk.say(f"{len(owed.changes)} settings were rolled back and read back{' (--yes)' if yes else ''}; {MAPPING}.")
    _journal(run, f"rolled back at a later connect: {len(owed.changes)} settings, left by a session that was cut off")
    note.remove()


def _journal(run: str, line: str) -> None:
    """Into the journal of the run that was cut off, where there still is one."""
    if run and Path(run).is_dir():
        with contextlib.suppress(BeltcommError):
            RunFolder(Path(run), None).journal(line)
