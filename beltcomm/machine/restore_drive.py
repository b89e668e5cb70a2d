"""End of a session for its drive: stopped, and with the parameters that it is to have, whatever made it end."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from beltcomm.drive import Drive
from beltcomm.errors import BeltcommError, BusError, DriveError, LeaveNow
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: How many Ctrl-C the restoring of a drive survives.
IMPATIENCE = 5


def leave(
    drive: Drive, folder: RunFolder, talk: Talk, wanted: Mapping[str, float], keep: bool, error: BaseException | None
) -> KeyboardInterrupt | None:
    """Stop the axis and write the ``wanted`` parameters; returns the last Ctrl-C heard meanwhile.

    Parameters
    ----------
    drive : Drive
    folder : RunFolder
    talk : Talk
    wanted : mapping of str to float, SI
        By name of the parameter.
    keep : bool
        New gains stay.
    error : BaseException or None
        What ends the session. After :class:`LeaveNow` nothing is written, and the journal names the backup.
    """
    interrupted: KeyboardInterrupt | None = None
    at_once = isinstance(error, LeaveNow)
    for _ in range(IMPATIENCE):
        try:
            drive.stop()
            if at_once:
                folder.journal(
                    f"left at once, with the axis stopped: the drive's own gains are NOT restored, they are in "
                    f"{folder.file('results', 'backup')}; `beltcomm rollback` writes them again",
                    "left at once",
                )
            else:
                _restore(drive, folder, talk, wanted, keep, error)
            break
        except KeyboardInterrupt as again:  # an impatient user must not leave a half-restored drive behind
            interrupted, at_once = again, at_once or isinstance(again, LeaveNow)
    return interrupted


def _restore(drive: Drive, folder: RunFolder, talk: Talk, wanted: Mapping[str, float], keep: bool, error: BaseException | None) -> None:
    try:
        try:
            drive.write(wanted)
        except BusError:
            raise
        except DriveError:  # one refusal may be a passing state of the drive, as a transfer disturbed once is
            drive.write(wanted)
    except BeltcommError as problem:
        talk.say(f"The drive's parameters could not be restored ({problem}); `beltcomm rollback` writes the backup again.")
        with suppress(BeltcommError):  # a full disk takes nothing from what was said
            folder.journal(f"restoring the drive failed: {problem}", "not restored")
    else:
        try:
            folder.journal(*(("limits restored, new gains kept", "gains kept") if keep else ("all parameters restored", "restored")))
        except BeltcommError:
            if error is None:  # what ended the session counts more than a disk that is full now
                raise
