"""The run that is meant when none is named, and the drive of a run when none is named."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from beltcomm.borders import for_terminal
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.given import REACHED_BY

if TYPE_CHECKING:
    from beltcomm.given import Reached

#: Where commands make runs, and what a folder holds that is one.
RUNS, MARKS = Path("runs"), ("run.yaml", "axis.yaml")


def runs_here(folder: Path = RUNS) -> list[Path]:
    """Run folders, the newest last: by what was last written in them.

    Parameters
    ----------
    folder : Path
        Not searched deeper.
    """
    if not folder.is_dir():
        return []
    found = [path for path in folder.iterdir() if path.is_dir() and _is_run(path)]
    return sorted(found, key=lambda path: (written(path), path.name))


def _is_run(path: Path) -> bool:
    return any((path / mark).is_file() for mark in MARKS)


def written(path: Path) -> float:
    """Time at which something was last done in a run, s since 1970.

    Parameters
    ----------
    path : Path
    """
    files = [path / name for name in ("journal.txt", *MARKS)]
    return max((file.stat().st_mtime for file in files if file.is_file()), default=0.0)


def or_newest(ctx: click.Context, _param: click.Parameter | None, value: Path | None) -> Path | None:
    """The run given, else the newest under ``runs/`` or of this folder, which is said.

    Parameters
    ----------
    ctx, _param : Context
    value : Path or None
        As given on the line.

    Raises
    ------
    UsageError
        Where there is none.
    """
    if value is not None or ctx.resilient_parsing:
        return value
    return _newest(ctx, RUNS, Path()) or _refused()


def or_begun(ctx: click.Context, _param: click.Parameter, value: Path | None) -> Path | None:
    """As :func:`or_newest`, of a folder of runs its newest; None where there is no run and somebody is there who may begin one.

    Parameters
    ----------
    ctx, _param : Context
    value : Path or None
        As given on the line.
    """
    if ctx.resilient_parsing or (value is not None and (_is_run(value) or not runs_here(value))):
        return value
    newest = _newest(ctx, value) if value is not None else _newest(ctx, RUNS, Path())
    return newest if newest is not None or (ctx.obj.talk().attended() and not ctx.obj.json) else _refused()


def _newest(ctx: click.Context, *folders: Path) -> Path | None:
    found = next((runs for folder in folders if (runs := runs_here(folder))), None)
    if found is not None and not ctx.obj.json:
        click.echo(f"Run: {found[-1]} (the newest of {len(found)}; name another to use that)", err=True)
    return found[-1] if found else None


def _refused() -> Path:
    raise UsageError(
        "no run is named, and there is none under runs/; name one (RUN or --run), or make one with `beltcomm commission --drive virtual`"
    )


def of_newest_axis() -> list[Path]:
    """Runs of the axis of the newest one.   Raises UsageError where there is none."""
    from beltcomm.runfolder import RunFolder

    named: dict[str, list[Path]] = {}
    last = ""
    for path in runs_here(RUNS):
        try:
            opened = RunFolder.open(path)
            last = opened.axis.name if opened.has_axis else ""
        except BeltcommError:  # told where it is named
            continue
        named.setdefault(last, []).append(path)
    if not named:
        _refused()
    return named[last]


def _drive_of(run: Path | None) -> Reached | None:
    """The drive that a run was made on, as it was called then; None where it does not tell."""
    from beltcomm.rundata import headline
    from beltcomm.runfolder import RunFolder

    if run is None or not run.is_dir():
        return None
    try:
        return headline.drive_called(RunFolder.open(run))
    except BeltcommError:
        return None


def told_drive(ctx: click.Context, run: Path | None) -> tuple[str | None, dict[str, Any]]:
    """The drive of a run, which is said, with the values of the options that it was reached by; None where it does not tell.

    A run may be a stranger's: one that would give other options than those, or a profile in a file, is none to go by.

    Parameters
    ----------
    ctx : Context
    run : Path or None
        Of the run folder; None for none.
    """
    found = _drive_of(run)
    if found is None:
        return None, {}
    by = _reached_by(ctx, found.options)
    said = for_terminal(" ".join(filter(None, (found, found.options))))
    if not ctx.obj.json:
        asked = f"Of this run the drive is not taken over; give --drive and its options: it was reached by {said}"
        click.echo(asked if by is None else f"Drive: {said} (that of the run)", err=True)
    return (None, {}) if by is None else (str(found), by)


def _reached_by(ctx: click.Context, text: str) -> dict[str, Any] | None:
    """Values of the options that a drive is reached by, by parameter of the command; None for any others."""
    from beltcomm.configfiles import named_file

    params = {name: param for param in ctx.command.params for name in param.opts}
    try:
        words = shlex.split(text)
        given = dict(zip(words[::2], words[1::2], strict=True))
        if not set(given) <= {f"--{name}" for name in REACHED_BY} or named_file(given.get("--profile", "")):
            return None
        return {str(params[name].name): params[name].type_cast_value(ctx, value) for name, value in given.items() if name in params}
    except (ValueError, click.BadParameter):
        return None
