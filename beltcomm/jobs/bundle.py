"""One zip with all that somebody who helps needs to know of a run, and nothing of whose machine it was made on."""

from __future__ import annotations

import platform
import re
import shutil
import zipfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from beltcomm import atomic
from beltcomm.borders import for_archive
from beltcomm.errors import UsageError
from beltcomm.given import Place, place
from beltcomm.outside import MEASURED_BYTES, opened, read_text
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder

#: What is in the zip beside the run folder's own files.
VERSIONS = "versions.txt"
PACKAGES = ("beltcomm", "numpy", "scipy", "numba", "python-can", "canopen", "pyserial", "PyYAML", "click", "ruckig")
#: Files that a bundle has: text, which is scrubbed, and logs of the bus, which hold frames only.
TEXTS = (".yaml", ".txt", ".log", ".csv", ".part", ".json")
LOGS = (".gz",)
#: Folders that are bulky: left out unless they are asked for.
BULKY = ("recordings", "originals", "pictures")
#: A path with at least two folders, but for devices, which say how the drive is connected.
_PATH = re.compile(r"(?<![\w.:/])(?:/(?!dev/)[\w.+~-]+){2,}|\b[A-Za-z]:\\[^\s\"']+")

_SEPARATOR = re.compile(r"[/\\]")


def _scrubbed(text: str, private: Sequence[str]) -> str:
    """A text without the places of a machine: of each path only its last part stays, and no ``private`` word."""
    text = _PATH.sub(lambda found: ".../" + _SEPARATOR.split(found[0].rstrip("/"))[-1], text)
    for word in sorted(private, key=len, reverse=True):  # a user's name may be part of the machine's
        if len(word) > 2:
            text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", "...", text)
    return text


def _versions() -> str:
    """Python, the kind of system, and the packages that matter, one per line."""
    lines = [f"python {platform.python_version()}", f"system {platform.system()} {platform.release()} {platform.machine()}"]
    for name in PACKAGES:
        try:
            lines.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            lines.append(f"{name} is not installed")
    return "\n".join(lines) + "\n"


def write_bundle(run: Path, path: Path, *, recordings: bool = False, private: Sequence[str] = ()) -> list[str]:
    """Write the zip and return the names in it; links are left out.

    Parameters
    ----------
    run : Path
    path : Path
        Of the file.
    recordings : bool
        With the rows of every record and foreign originals too; else their sidecars only.
    private : sequence of str
        Words that are taken out.

    Raises
    ------
    DataError
        When there is no such folder.
    UsageError
        When the zip cannot be written.
    """
    if not run.is_dir():
        RunFolder.open(run)
    chosen = [file for file in sorted(run.rglob("*")) if _stands_in(file, run) and _belongs(file.relative_to(run), recordings)]
    try:
        with atomic.replacing(path) as whole, zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(VERSIONS, _versions())
            for file in chosen:
                inside = for_archive(file.relative_to(run).as_posix())
                if file.suffix in LOGS:
                    with opened(file) as log, archive.open(inside, "w") as packed:
                        shutil.copyfileobj(log, packed)
                else:
                    archive.writestr(inside, _scrubbed(read_text(file, MEASURED_BYTES, errors="replace"), private))
            return archive.namelist()
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; make room or choose another place with --out") from error


def bundle(run: Place, out: Place, *, recordings: bool = False, private: Sequence[str] = ()) -> Result:
    """Pack a run into one zip without paths and names; see :func:`write_bundle`.

    Parameters
    ----------
    run : Place
        Run folder.
    out : Place
        Of the zip.
    recordings : bool
        Pack the recordings too.
    private : sequence of str
        Words to be taken out.

    Returns
    -------
    Result
        What was packed.

    Raises
    ------
    DataError
        There is no such run.
    UsageError
        The zip cannot be written, or a file of another kind stands there.
    """
    run, out = place(run), place(out, "zip")
    if out.exists() and not _is_bundle(out):
        raise UsageError(f"{out} exists and is no bundle; give another name for the zip, or delete that file first")
    names = write_bundle(run, out, recordings=recordings, private=private)
    return Result({"bundle": str(out), "files": names}, [f"{len(names)} files of {run} are in {out}, without paths and user names."])


def _is_bundle(file: Path) -> bool:
    try:
        with zipfile.ZipFile(file) as archive:
            return VERSIONS in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _stands_in(file: Path, run: Path) -> bool:
    """True if a file is one of the run's own: a link may point to anything that this user can read."""
    inside = file.relative_to(run)
    return file.is_file() and not any((run / part).is_symlink() for part in (inside, *inside.parents[:-1]))


def _belongs(inside: Path, recordings: bool) -> bool:
    if inside.suffix not in (*TEXTS, *LOGS) or inside.name.startswith("."):
        return False
    return recordings or inside.parts[0] not in BULKY or inside.suffix == ".yaml"
