"""State left by a command on a machine that failed: its folder, the drive's parameters, and the command to type next."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from beltcomm.errors import BeltcommError, Declined, DriveError
from beltcomm.given import pasted

#: What an error names that doubts what is known of the axis beforehand.
AXIS_FILE = "axis.yaml"
#: What Python says of a value that is of another kind than the one that was written.
OF_VALUES = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, StopIteration)
#: What events of a journal say of how the drive was left.
_STATES = {
    "restored": "stopped; everything in it is as it was found",
    "gains kept": "stopped; the new gains are in it until power-off",
    "not restored": "NOT restored: `{rollback}` writes back what it had",
    "left at once": "NOT restored: `{rollback}` writes back what it had",
}


def aftermath(
    words: Sequence[str],
    run: Path,
    events: Sequence[str],
    drive: str,
    error: BeltcommError,
    *,
    resumes: bool,
) -> dict[str, str]:
    """Labelled sentences.

    Parameters
    ----------
    words : sequence of str
        Of the command line.
    run : Path
    events : sequence of str
        That it noted.
    drive : str
        As for ``--drive``.
    error : BeltcommError
        That ended the command.
    resumes : bool
        The verb knows ``--resume``.
    """
    sentence, declined = str(error), isinstance(error, Declined)  # somebody said no, so nothing is to be mended
    kept = sum(1 for _ in (run / "recordings").glob("*.csv"))
    records = f"{kept} record{'s' if kept != 1 else ''} kept" if kept else "nothing recorded yet"
    if not kept and declined:
        records += "; --run takes it again, or delete it"
    states = [_STATES[event] for event in events if event in _STATES]
    rollback = f"beltcomm rollback --drive {pasted(drive or 'DRIVE')} --run {pasted(run)}"
    state = states[-1].format(rollback=rollback) if states else "nothing was written to it"
    again = again_command(words, None if resumes and not kept else run, resumes=resumes)
    following = f"{again}   ({'asks again' if declined else 'when what is said above is mended'})"
    if resumes and kept and AXIS_FILE in sentence:  # a run goes on with the axis that it was begun with, and no other
        anew = again_command(_with_axis(words, run), None, resumes=True)
        following = f"{anew}   (a new run, when {AXIS_FILE} is mended); when it is right and the machine is mended: {again}"
    if sentence.startswith("the move is refused") and (slowed := _slowed(words)):
        following = f"{again_command(slowed, run, resumes=resumes)}   (slowed down until every limit is kept)"
    told = error.diagnosis
    if told is not None:
        if told["named"] or told["repeated"]:  # records of a machine before and after it was mended are of two machines
            mended = _with_axis(words, run) if resumes and AXIS_FILE in sentence else words
            following = f"{again_command(mended, None, resumes=resumes)}   (a new run, when the machine is mended)"
            if told["repeated"]:
                following += "; --resume was tried: it ended with the same records as before and will again"
        following = f"{told['command']}   (shows all of it); then {following}"
    elif kept and "`beltcomm diagnose" in sentence:
        following = f"beltcomm diagnose {pasted(run)}   (says what these records show); then {following}"
    if isinstance(error, DriveError):
        following = f"beltcomm doctor --drive {pasted(drive or 'DRIVE')}   (finds what is wrong), then {again}"
    shown = {} if told is None else {name: str(told[name]) for name in ("found", "check") if told[name]}
    return {**shown, "folder": f"{run} ({records})", "drive": state, "next": following}


def _slowed(words: Sequence[str]) -> list[str]:
    """The command with the limits that were asked for by name as those of the target, whose move is slowed; [] where none were."""
    parted = [part for word in words for part in (word.split("=", 1) if word.startswith("--trajectory=") else [word])]
    if "--trajectory" not in parted[:-1] or any(word.startswith("--feedforward") for word in words):  # which is driven as it is
        return []
    at = parted.index("--trajectory")
    return [*parted[:at], "--target", f"move={parted[at + 1]}", *parted[at + 2 :]]


def _with_axis(words: Sequence[str], run: Path) -> list[str]:
    """The command with the axis file that is to be mended: the run's own copy where none was named."""
    named = any(word == "--axis" or word.startswith("--axis=") for word in words)
    return [*words] if named else [*words, "--axis", str(run / AXIS_FILE)]


def again_command(words: Sequence[str], run: Path | None, *, resumes: bool) -> str:
    """The command once more, to be pasted.

    Parameters
    ----------
    words : sequence of str
        Of the command line.
    run : Path or None
        The folder to go on in; None begins a new one, whatever was asked for before.
    resumes : bool
        As of :func:`aftermath`.
    """
    kept: list[str] = []
    skip = False
    for word in words:
        if skip or word == "--resume" or word.startswith("--run="):
            skip = False
            continue
        if word == "--run":
            skip = True
            continue
        kept.append(word)
    into = [] if run is None else ["--run", str(run), *(["--resume"] if resumes else [])]
    return shlex.join(["beltcomm", *kept, *into])


def edited_files(named: Iterable[Path]) -> str:
    """Files of runs that somebody else than this tool has written, in words; "" for none.

    Parameters
    ----------
    named : iterable of Path
        What a command was given, runs and whatever else.
    """
    from beltcomm.runfolder import RunFolder  # only a command that failed needs it

    found: list[Path] = []
    for run in dict.fromkeys(named):
        if os.path.isfile(run / "axis.yaml"):
            with suppress(BeltcommError):
                found += RunFolder.open(run).edited_files()
    return ", ".join(map(str, found))
