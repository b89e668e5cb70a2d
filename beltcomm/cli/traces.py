"""Traces of a command on a real drive: the bus's log, and when it ended badly a bundle for whoever helps."""

from __future__ import annotations

import contextlib
import getpass
import platform
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from beltcomm.rundata.buslog import BusLog

#: Name of the zip in the run folder.
BUNDLE = "bundle.zip"
#: User names that are words: they say nothing of anybody.
_NOBODY = frozenset({"root", "user", "admin", "test", "beltcomm"})
#: Exit codes that ask for help: a safety stop, the drive or the bus.
_BAD = (4, 5)
#: Schemes of drives without a CAN bus of their own.
_WITHOUT_BUS = ("virtual", "serial")


def private_words() -> list[str]:
    """Words that tell whose machine this is: its user and its name."""
    words = [platform.node()]
    with contextlib.suppress(OSError, KeyError, ImportError):  # a user without an entry in the password file
        words.append(getpass.getuser())
    return [word for word in words if word and word.lower() not in _NOBODY | {"localhost"}]


class Traces:
    """Of one command.

    Parameters
    ----------
    drive : str
        As given. on_hardware : it is no virtual drive.
    """

    def __init__(self, drive: str, wanted: bool) -> None:
        scheme = drive.partition(":")[0]
        self.on_hardware = scheme not in _WITHOUT_BUS
        self._channel = "".join(letter for letter in drive if letter.isalnum()) or "can"
        self._log: BusLog | None = None
        if self.on_hardware or wanted:
            from beltcomm.rundata.buslog import BusLog

            self._log = BusLog()

    def drive_options(self) -> dict[str, Any]:
        """Options of the adapter beside those that the user gave."""
        return {} if self._log is None else {"log": self._log}

    def leave(self, run: Path, verb: str, code: int) -> list[str]:
        """Write them; returns what to say about it.   Never raises: they must not hide how the command ended.

        Parameters
        ----------
        run : Path
            Folder that they go to.
        verb : str
            First part of the file's name.
        code : int
            Exit code of the command: a bad one makes a bundle, too.
        """
        if self._log is None or not len(self._log):
            return []
        said = []
        try:
            path = self._log.write(run / "bus", verb, self._channel)
            if code in _BAD:
                said.append(f"the last frames on the bus are in {path}")
            if code in _BAD and self.on_hardware:
                from beltcomm.jobs.bundle import write_bundle

                write_bundle(run, run / BUNDLE, private=private_words())
                said.append(f"all that somebody who helps needs is in {run / BUNDLE}, without paths and user names")
        except Exception as error:  # a full disk, mostly
            said.append(f"the bus's log could not be kept in {run}: {error}")
        return said
