"""Backups of a drive: what stood in it before something was written, as raw values of its objects and as named parameters.

``results/backup.yaml`` is from before the run; ``results/backup_N.yaml`` from before each later writing.  The raw values are what goes
back: they mean the same whatever is known of the gains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.configfiles import did_you_mean, read_yaml, unsealed
from beltcomm.contents import check_content
from beltcomm.drive import Drive
from beltcomm.drive.objects import MODE, ObjectValue, object_from_dict, object_values
from beltcomm.drive.parameters import GAIN_NAMES, cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import BeltcommError, DataError, Refused, UsageError
from beltcomm.result import table
from beltcomm.runfolder import RunFolder, next_free

#: The backup from before the run.
FIRST = "backup"


@dataclass(frozen=True)
class Backup:
    """One backup.

    Attributes
    ----------
    name : str
        Of its file.
    when : str
        Date and time of the file, UTC.
    before : str
        What was to be written, in words.
    drive : dict of str to str
        Identity of the drive.
    parameters : dict of str to float
        Name -> SI value.
    objects : tuple of ObjectValue
        Raw values; empty in backups of old runs.
    edited : bool
        It is another one than beltcomm wrote.
    """

    name: str
    path: Path
    when: str
    before: str
    drive: Mapping[str, str]
    parameters: Mapping[str, float]
    objects: tuple[ObjectValue, ...]
    edited: bool = False


def _backup_of(drive: Drive, before: str) -> dict[str, Any]:
    """Contents of a backup."""
    return {
        "drive": dict(drive.capabilities.identity),
        "before": before,
        "parameters": drive.backup(),
        "objects": [item.to_dict() for item in drive.objects() if item.place != MODE],
    }


def keep_first(folder: RunFolder, drive: Drive) -> None:
    """Keep the backup from before the run, unless there is one: a resumed run keeps what was there before the first session.

    Parameters
    ----------
    folder : RunFolder
    drive : Drive
    """
    if folder.load_result(FIRST) is None:
        folder.save("results", FIRST, _backup_of(drive, "the run"))


def take(folder: RunFolder, drive: Drive, before: str) -> Path:
    """One more backup, or the first; returns its path.

    Parameters
    ----------
    folder : RunFolder
    drive : Drive
    before : str
        Command that it is taken for.

    Raises
    ------
    UsageError
        When it cannot be written.
    """
    taken = set(folder.names("results"))
    name = FIRST if FIRST not in taken else next_free(f"{FIRST}_", taken)
    return folder.save("results", name, _backup_of(drive, before))


def renew(folder: RunFolder, drive: Drive) -> None:
    """Renew the SI values of the first backup, now that the meaning of raw ones is known; for a drive in which the same raw values stand.

    Parameters
    ----------
    folder : RunFolder
    drive : Drive
    """
    saved = folder.load_result(FIRST)
    if saved is not None and saved.get("objects") == [item.to_dict() | _si(saved, item) for item in drive.objects() if item.place != MODE]:
        folder.save("results", FIRST, _backup_of(drive, str(saved.get("before") or "the run")))


def _si(saved: Mapping[str, Any], item: ObjectValue) -> dict[str, Any]:
    """The SI value that a backup has for an object, so that only raw values are compared."""
    entry = next((one for one in saved["objects"] if isinstance(one, Mapping) and one.get("object") == item.title), {})
    return {"value": entry["value"]} if "value" in entry else {}


def list_backups(folder: RunFolder) -> list[Backup]:
    """Every backup of a run, the oldest first.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For an unreadable one.
    """
    names = [name for name in folder.names("results") if name == FIRST or name.removeprefix(f"{FIRST}_").isdigit()]
    return [read(folder.file("results", name)) for name in names]


def choose_backup(folder: RunFolder, which: str | None) -> Backup:
    """A backup by name or path; None is the one from before the run.

    Parameters
    ----------
    folder : RunFolder
    which : str or None
        Name or path.

    Raises
    ------
    Refused
        When there is none.
    UsageError
    DataError
    """
    names = [one.name for one in list_backups(folder)] if which is not None else []
    if which is None or which in names:
        if folder.load_result(which or FIRST) is None:
            raise Refused(f"{folder.path} holds no backup of a drive; nothing to roll back to")
        return read(folder.file("results", which or FIRST))
    path = Path(which)
    if not path.is_file():
        raise UsageError(
            f"there is no backup {which}{did_you_mean(which, names)}; this run has {', '.join(names) or 'none'}, or give the path of a file"
        )
    return read(path)


def read(path: Path) -> Backup:
    """A backup from its file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        When it is damaged.
    """
    data, whole = unsealed(read_yaml(path, DataError))
    check_content(FIRST, data, path)
    try:
        objects = tuple(object_from_dict(entry) for entry in data.get("objects") or ())
    except BeltcommError as error:
        raise DataError(f"{path} is damaged ({error}); set the drive with its maker's tool") from error
    when = str(np.datetime64(int(path.stat().st_mtime), "s")).replace("T", " ")
    before, drive = data.get("before") or "the run", data.get("drive") or {}
    return Backup(path.stem, path, when, before, drive, data["parameters"], objects, not whole)


def same_drive(backup: Backup, drive: Drive) -> None:
    """Refuse the backup of another drive.

    Parameters
    ----------
    backup : Backup
        Of any run.
    drive : Drive
        Connected; what either of the two does not tell is not compared.

    Raises
    ------
    UsageError
        With what differs.
    """
    here = drive.capabilities.identity
    apart = [
        f"{key} {backup.drive.get(key)} -> {here.get(key)}"
        for key in sorted({*backup.drive, *here})
        if backup.drive.get(key) and here.get(key) and backup.drive[key] != here[key]  # one of the two ports may not tell
    ]
    if backup.drive and apart:
        raise UsageError(f"{backup.path} is the backup of another drive ({'; '.join(apart)}); nothing is written")


def values_to_restore(backup: Backup, drive: Drive) -> list[ObjectValue]:
    """Values that are to stand in the drive again.

    The mode of operation, which older backups hold, does not go back: whoever uses the drive next chooses it.
    An old run's backup has no raw values, and none of the parameters that are younger than it: these are as a plain cascade has them.

    Parameters
    ----------
    backup : Backup
        Of this drive.
    drive : Drive

    Raises
    ------
    UsageError
        For a value that the drive cannot take.
    """
    if backup.objects:
        return [item for item in backup.objects if item.place != MODE]
    offered = drive.capabilities.parameters
    known = dict(backup.parameters)
    if set(GAIN_NAMES[:4]) <= set(known):
        plain = cascade_to_parameters(parameters_to_cascade(known))
        known = {name: known.get(name, plain.get(name, 0.0)) for name in offered if name in known or name in plain}
    return object_values(offered, {name: value for name, value in known.items() if name in offered})


def list_lines(backups: Sequence[Backup]) -> list[str]:
    """All backups of a run as a table.

    Parameters
    ----------
    backups : sequence of Backup
        Of the run.
    """
    rows = [[one.name, one.when, one.before, f"{len(one.objects) or len(one.parameters)}"] for one in backups]
    return [*table(["name", "date (UTC)", "taken before", ">objects"], rows, "  ")] if backups else ["  none"]
