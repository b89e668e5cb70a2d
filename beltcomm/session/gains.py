"""Parameters into a drive without moving it: differences first, then a question, then write with read-back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from beltcomm.drive import Drive
from beltcomm.errors import DataError, Refused
from beltcomm.parameters import PREFILTER_KINDS
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk


@dataclass(frozen=True)
class Written:
    """changes : name -> (before, wanted).   left_out : wanted but not in this drive.   stored : what was read back, empty when nothing
    was written."""

    changes: Mapping[str, tuple[float, float]]
    left_out: tuple[str, ...]
    stored: Mapping[str, float]

    def table(self) -> list[str]:
        """The differences as plain text."""
        lines = [f"  {n:24} {_shown(n, old):>12} -> {_shown(n, new)}" for n, (old, new) in self.changes.items()] or ["  nothing differs"]
        return lines + ([f"  the drive has no {', '.join(self.left_out)}"] if self.left_out else [])


def _shown(name: str, value: float) -> str:
    """A value in words where its number is a code."""
    return PREFILTER_KINDS[int(value)] if name == "prefilter_kind" and value in range(len(PREFILTER_KINDS)) else f"{value:.6g}"


def differences(drive: Drive, wanted: Mapping[str, float]) -> Written:
    """What would change."""
    present = drive.backup()
    changes = {
        n: (present[n], v) for n, v in wanted.items() if n in present and not math.isclose(present[n], v, rel_tol=1e-6, abs_tol=1e-12)
    }
    return Written(changes, tuple(n for n in wanted if n not in present and wanted[n]), {})


def write(drive: Drive, folder: RunFolder, wanted: Mapping[str, float], talk: Talk, *, yes: bool, save: bool, verb: str) -> Written:
    """Show, ask, back up, write, read back, and save when asked.   Raises Refused for a no, ObjectRefused, DriveError."""
    plan = differences(drive, wanted)
    talk.say("\n".join(["Parameters of the drive, now -> then:", *plan.table()]))
    if plan.changes and not yes and not talk.confirm("Write these to the drive? Nothing moves."):
        raise Refused("nothing was written, as you said")
    present = drive.backup()
    if folder.load_result("backup") is None:
        folder.save_result("backup", {"drive": dict(drive.capabilities.identity), "parameters": present})
    folder.journal(f"{verb}: writing {len(plan.changes)} parameters")  # a folder that cannot be written stops it here, before the drive
    stored = drive.write({n: v for n, v in wanted.items() if n in present})
    if save:
        drive.save()
    folder.journal(f"{verb}: " + ", ".join(f"{n}={v:.6g}" for n, v in stored.items()))
    return Written(plan.changes, plan.left_out, stored)


def backed_up(folder: RunFolder) -> Mapping[str, float]:
    """The parameters that were in the drive before the run touched it.  Raises Refused when there is no backup."""
    saved = folder.load_result("backup")
    if saved is None:
        raise Refused(f"{folder.path} holds no backup of a drive; nothing to roll back to")
    try:
        return {name: float(value) for name, value in saved["parameters"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{folder.path / 'results' / 'backup.yaml'} is damaged ({error}); set the drive with its maker's tool") from error
