"""The exceptions of beltcomm. Each carries the exit code that the command line returns.

::

    BeltcommError
    ├── Refused      1  the target was missed, or the person at the machine said no
    │   ├── Declined        somebody was asked, and did not say yes
    │   └── ObjectLocked    an object that is never written (index and subindex kept)
    ├── UsageError   2  wrong option, wrong axis file, impossible limits
    ├── DataError    3  a recording or run folder that the method cannot use
    │   ├── DamagedRecord   one recording spoils the rest (its name kept)
    │   └── NoMotion        the torque of a record did not move the axis (the torque kept)
    ├── SafetyStop   4  a limit was reached; the axis was stopped
    └── DriveError   5  no answer, wrong answer, drive fault
        ├── BusError        nobody answers, frames lost, adapter gone
        ├── DriveFault      the drive went into fault (EMCY code and text kept)
        └── ObjectRefused   the drive refused a read or a write (abort code kept)

A message says what, which value, which limit, and what to do next.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


class LeaveNow(KeyboardInterrupt):
    """A second Ctrl-C right after the first: the axis is still stopped, but nothing else is waited for or put back."""


class BeltcommError(Exception):
    """Base of everything this package raises on purpose; ``str(error)`` is one or two plain sentences.

    Attributes
    ----------
    run : Path or None
        Folder of the session that it ended, None outside of one.
    diagnosis : dict of str to object or None
        What the records of that session show, where they were searched; see :mod:`beltcomm.jobs.early_end`.
    """

    exit_code = 1
    run: Path | None = None
    diagnosis: Mapping[str, object] | None = None

    @property
    def fault_and_remedy(self) -> tuple[str, str]:
        """Fault and remedy that the message names; no remedy, "", where it names none."""
        what, _, remedy = str(self).partition("; ")
        return what, remedy


class Refused(BeltcommError):
    """Nothing is broken, but the result asked for is not to be had (infeasible design, user's no, missed target)."""

    exit_code = 1


class Declined(Refused):
    """Somebody was asked before anything was done, and did not say yes."""


class ObjectLocked(Refused):
    """An object of a drive that beltcomm never writes, whoever asks.  ``index``, ``subindex``: which."""

    def __init__(self, message: str, index: int = 0, subindex: int = 0) -> None:
        super().__init__(message)
        self.index = index
        self.subindex = subindex


class UsageError(BeltcommError):
    """The command, the axis file or a limit is wrong: nothing was started."""

    exit_code = 2


class DataError(BeltcommError):
    """A recording or a run folder cannot be used by the method that was asked for."""

    exit_code = 3


class MissingColumn(DataError):
    """A recording lacks a column that it must have.  ``column`` is its name."""

    def __init__(self, message: str, column: str) -> None:
        super().__init__(message)
        self.column = column


class DamagedRecord(DataError):
    """One recording holds what no axis does; without it, or made again, the job can go on.  ``record`` is its name."""

    def __init__(self, message: str, record: str) -> None:
        super().__init__(message)
        self.record = record


class NoMotion(DataError):
    """The torque of a record did not move the axis.

    Parameters
    ----------
    torque_nm : float
        The largest in it, N m at the motor.
    """

    def __init__(self, message: str, torque_nm: float) -> None:
        super().__init__(message)
        self.torque_nm = torque_nm


class SafetyStop(BeltcommError):
    """A watched limit was reached and the axis was stopped.

    ``reason`` is a word for programs: position, speed, torque, lag, belt_force, interrupted, lost_frames.
    ``answered``: the axis went the way its torque pushed it, so the drive's own loop may brake it, even if its stage was to go off.
    """

    exit_code = 4

    def __init__(self, message: str, reason: str = "limit") -> None:
        super().__init__(message)
        self.reason = reason
        self.answered = False


class DriveError(BeltcommError):
    """The drive or the bus did not do what it must."""

    exit_code = 5


class BusError(DriveError):
    """No node answers, frames are lost, or the interface is gone."""


class DriveFault(DriveError):
    """The drive reports a fault.  ``code`` is the EMCY error code (CiA 301, 7.2.7), 0 when none was sent."""

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code


class ObjectRefused(DriveError):
    """An SDO transfer was aborted.  ``abort_code`` as in CiA 301, table 22; ``index``, ``subindex`` of the object."""

    def __init__(self, message: str, abort_code: int, index: int = 0, subindex: int = 0) -> None:
        super().__init__(message)
        self.abort_code = abort_code
        self.index = index
        self.subindex = subindex
