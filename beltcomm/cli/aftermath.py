"""What a command on a machine leaves behind when it fails: its folder, the state of the drive, and the command to type next."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from beltcomm.errors import DriveError

#: How the last word of a journal begins when somebody could not wait.
LEFT_AT_ONCE = "left at once"
#: How lines of a journal begin that say how the drive was left, and what they mean.
_STATES = {
    "all parameters restored": "stopped; everything in it is as it was found",
    "limits restored, new gains kept": "stopped; the new gains are in it until power-off",
    "restoring the drive failed": "NOT restored: `{rollback}` writes back what it had",
    LEFT_AT_ONCE: "NOT restored: `{rollback}` writes back what it had",
}


def journal_of(run: Path | None) -> list[str]:
    """Lines of a run's journal; none where there is none."""
    try:
        return (run / "journal.txt").read_text(encoding="utf-8").splitlines() if run else []
    except (OSError, ValueError):
        return []


def aftermath(words: Sequence[str], run: Path, journal: Sequence[str], drive: str, code: int, *, resumes: bool) -> dict[str, str]:
    """Three labelled sentences.   words : of the command line.   journal : lines that it wrote.   code : its exit code.

    resumes : the verb knows ``--resume``.
    """
    kept = sum(1 for _ in (run / "recordings").glob("*.csv"))
    records = f"{kept} record{'s' if kept != 1 else ''} kept" if kept else "nothing recorded yet"
    told = [state for line in journal for begin, state in _STATES.items() if line.startswith(begin)]
    rollback = f"beltcomm rollback --drive {shlex.quote(drive or 'DRIVE')} --run {shlex.quote(str(run))}"
    state = told[-1].format(rollback=rollback) if told else "nothing was written to it"
    again = again_command(words, None if resumes and not kept else run, resumes=resumes)
    following = f"{again}   (when what is said above is mended)"
    if code == DriveError.exit_code:
        following = f"beltcomm doctor --drive {shlex.quote(drive or 'DRIVE')}   (finds what is wrong), then {again}"
    return {"folder": f"{run} ({records})", "drive": state, "next": following}


def again_command(words: Sequence[str], run: Path | None, *, resumes: bool) -> str:
    """The command once more, to be pasted.   run : the folder to go on in; None begins a new one, whatever was asked for before."""
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
