"""``beltcomm import``: foreign measurements into a run folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from beltcomm.borders import for_terminal
from beltcomm.cli import options as shared
from beltcomm.cli import reading
from beltcomm.cli.frame import Invocation, api, run_folder
from beltcomm.cli.help import About, option
from beltcomm.cli.init import axis_with
from beltcomm.errors import BeltcommError, Refused, UsageError
from beltcomm.given import EXCITATION_KINDS, EXPERIMENTS
from beltcomm.outside import read_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from beltcomm.foreign.guess import Guess


class Rows(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic since click 8.2
    """A part of a file by row numbers: ``FIRST:LAST``, both counted, either left out."""

    name = "rows"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int | None, int | None]:
        """First and last row.  Raises click.BadParameter."""
        if isinstance(value, tuple):
            return value
        first, colon, last = str(value).partition(":")
        if not colon or not (first + last).strip().isdigit():
            self.fail(f"{value!r} is no part of a file; write FIRST:LAST, such as 1:5000 or 5001:", param, ctx)
        return (int(first) if first.strip() else None, int(last) if last.strip() else None)


class MassOrInertia(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic since click 8.2
    """A mass, or the inertia of a load that turns: the sidecar's key and value."""

    name = "payload"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Both units."""
        return "[kg|kgm2]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> dict[str, float]:
        """Key and value.  Raises click.BadParameter."""
        if isinstance(value, dict):
            return value
        key = "payload_inertia_kg_m2" if str(value).strip().endswith(("m2", "m²")) else "payload_kg"
        return {key: shared.QuantityType(key).convert(value, param, ctx)}


@click.command("import")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path), metavar="FILE...")
@reading.MAP
@option(
    "--run",
    type=click.Path(path_type=Path),
    help="New folder, or one of an earlier import; a dated one under runs/ when left out.",
    brief="New folder, or one of an earlier import.",
)
@option(
    "--axis",
    metavar="FILE",
    help="axis.yaml, or the name of a shipped axis. Without: one rigid mass.",
    brief="axis.yaml, or a shipped axis; else one rigid mass.",
)
@option(
    "--set",
    "entries",
    multiple=True,
    metavar="KEY=VALUE",
    help="An entry of axis.yaml: name=EMPS, limits.speed_m_s=0.2.",
    brief="An entry of axis.yaml: name=EMPS.",
)
@option("--name", topic=About.RECORD, help="Of the recording; the file's name when left out.")
@reading.RATE
@reading.PERIOD
@option("--resample", topic=About.ROWS, metavar="HZ", help="Take uneven rows at so many even ones per second; no more than there are.")
@option(
    "--experiment",
    type=shared.WordChoice(EXPERIMENTS),
    default="free",
    show_default=True,
    help="What was done; a log of frames tells it.",
    brief="frf, friction_sweep, reversal, trajectory, static_map.",
)
@option("--held-out", topic=About.RECORD, is_flag=True, help="Never fit this record, only judge by it.")
@option("--closed-loop", topic=About.RECORD, is_flag=True, help="A controller was active.")
@option(
    "--start-position",
    "start_position_m",
    topic=About.RECORD,
    type=shared.QuantityType("start_position_m"),
    help="Carriage position at the first row.",
)
@option(
    "--payload",
    type=MassOrInertia(),
    help="What was mounted weighs so much: 2kg; of a load that turns its inertia: 0.02kgm2.",
    brief="What was mounted: 2kg, or 0.02kgm2 of a load that turns.",
)
@option(
    "--load",
    topic=About.RECORD,
    default="",
    metavar="NAME",
    help="What was mounted, where nobody knows its weight: records of one name have one load.",
)
@option(
    "--session-time",
    "session_time_s",
    topic=About.RECORD,
    type=shared.QuantityType("session_time_s"),
    help="Start of the record on the session's clock.",
)
@option("--excitation", topic=About.EXCITATION, type=shared.WordChoice(EXCITATION_KINDS), help="Kind of excitation of an frf record.")
@option(
    "--amplitude",
    "amplitude_nm",
    topic=About.EXCITATION,
    type=shared.QuantityType("amplitude_nm"),
    help="Its largest absolute torque (force, current).",
)
@option("--period-samples", topic=About.EXCITATION, type=click.IntRange(4), help="Rows of one period, when the excitation repeats.")
@option("--first-sample", topic=About.EXCITATION, type=click.IntRange(0), default=0, help="Row, from 0, where its first period begins.")
@option("--source", topic=About.RECORD, default="", help="Where the data came from, in words.")
@option(
    "--accept",
    "accepted",
    topic=About.RECORD,
    default="",
    metavar="REASON",
    help="Take a record that is judged wrong (sign, clipped, no relation); kept with it.",
)
@reading.TORQUE_ACTS
@reading.FLIP
@reading.UNWRAP
@option("--rows", topic=About.ROWS, type=Rows(), metavar="FIRST:LAST", help="Only these rows, counted from 1.")
@option(
    "--from",
    "from_s",
    topic=About.ROWS,
    type=shared.QuantityType("from_s"),
    help="Leave out what was recorded before this time after the first row.",
)
@option("--until", "until_s", topic=About.ROWS, type=shared.QuantityType("until_s"), help="Leave out what was recorded after this time.")
@reading.DROP
@option("--keep", topic=About.ROWS, multiple=True, metavar="NAME", help="Keep a further column under its own name; all keeps all.")
@reading.SEPARATOR
@reading.DECIMAL
@option(
    "--skip-lines", topic=About.ROWS, type=click.IntRange(0), default=0, help="Leave out so many lines at the beginning of a text file."
)
@option("--record", topic=About.BUS, type=click.IntRange(1), help="Of a log of CAN frames: only this move, from 1.")
@reading.CHANNEL
@reading.NODE
@reading.SIGNAL
@reading.DBC
@option(
    "--edges",
    topic=About.ROWS,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Encoder edge times on the same clock, a row each, with A and B, a direction, a count or nothing: the position comes from them.",
)
@click.option("--dry-run", is_flag=True, help="Show what would be read and write nothing.")
@option(
    "--check",
    "check_only",
    is_flag=True,
    help="Repeat the imports of --run from their originals and compare; no FILE.",
    brief="Repeat the imports of --run and compare; no FILE.",
)
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    files: tuple[Path, ...],
    run: Path | None,
    axis: str | None,
    entries: tuple[str, ...],
    check_only: bool,
    **given: Any,
) -> int:
    """Bring measurements from FILE into a run folder; the originals are kept.

    FILE is CSV or text (also .gz), MATLAB (.mat), MDF (.mf4), HDF5, NumPy (.npz, .npy), or a log of CAN frames (candump, Vector
    .asc and .blf, PEAK .trc), of which each move becomes a recording.

    Columns are guessed from names and units; what is not sure is asked, or written to a file of mappings to be edited.
    --map OURS=THEIRS*SCALE+OFFSET says it: torque_nm=Iq*0.65, t_s=time*ms. Names, units, meanings: docs/import.md.

    Example: beltcomm import trace.csv --axis axis.yaml
    """
    if check_only:
        if files or run is None:
            raise UsageError("--check takes --run RUN and no FILE")
        return frame.show(api("beltcomm.foreign.job").check_imports(run))
    if not files:
        raise UsageError("no file is given; beltcomm import FILE --map torque_nm=NAME --map position_rad=NAME ...")
    from beltcomm.foreign.store import recording_name

    frame.run = run_folder(run, f"imported-{recording_name(files[0])}")
    chosen = axis_with(axis, entries, frame.run) if entries else axis
    from beltcomm.foreign.guess import NeedsAnswers

    words = {"axis": chosen, "sidecar": _sidecar(given), "name": given["name"], "dry_run": given["dry_run"]}
    try:
        return frame.show(
            api("beltcomm.foreign.job").import_recordings(
                files, frame.run, reading.reading_of(given), **words, ask=_ask if _can_be_asked() else None, talk=frame.talk()
            )
        )
    except NeedsAnswers as error:
        if given["dry_run"]:
            raise Refused(f"{error}. Give --map for these, or leave --dry-run out to get a file of mappings to be edited") from error
        written = _write_template(frame.run, error.template)
        raise Refused(f"{error}. Edit {written}, which holds what was found, and import again with --map {written}") from error


def _can_be_asked() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


def _ask(guesses: Sequence[Guess]) -> list[str]:
    """Put the whole mapping to the person at the terminal, once; numbers and mappings change it until it is taken."""
    chosen = [guess.choices[0] if guess.choices else "" for guess in guesses]
    numbered: list[tuple[int, str]] = []
    click.echo("What was understood of the file:", err=True)
    for place, guess in enumerate(guesses):
        click.echo(for_terminal(f"  {chosen[place] or guess.column + ': not found':40s} {guess.confidence}; {guess.why}"), err=True)
        for other in guess.choices[1:] if guess.confidence != "sure" else ():
            numbered.append((place, other))
            click.echo(for_terminal(f"    {len(numbered)}  or {other}"), err=True)
    while True:
        answer = str(
            click.prompt("Enter takes it; a number, OURS=THEIRS*SCALE or OURS=- changes it", default="", show_default=False, err=True)
        )
        answer = answer.strip()
        if not answer:
            missing = [guess.column for guess, taken in zip(guesses, chosen, strict=True) if guess.needed and not taken]
            if not missing:
                return [mapping for mapping in chosen if mapping]
            click.echo(for_terminal(f"{missing[0]} is still missing: {missing[0]}=THEIRS*SCALE"), err=True)
        elif answer.isdigit() and 1 <= int(answer) <= len(numbered):
            place, other = numbered[int(answer) - 1]
            chosen[place] = other
            click.echo(for_terminal(f"  {chosen[place]}"), err=True)
        elif "=" in answer:
            column, _, theirs = (part.strip() for part in answer.partition("="))
            place = next((k for k, guess in enumerate(guesses) if guess.column == column), -1)
            if place < 0:
                raise UsageError(f"{answer!r}: {column} is not asked for; give it with --map")
            chosen[place] = "" if theirs == "-" else answer
        else:
            raise UsageError(
                f"{answer!r} is none of the choices; answer Enter, a number up to {len(numbered)}, or a mapping OURS=THEIRS*SCALE"
            )


def _write_template(run: Path, text: str) -> Path:
    """A file beside the run folder; one that is there already, which may have been edited, is not touched."""
    from beltcomm.configfiles import write_text

    path, number = run.with_name(f"{run.name}.map"), 2
    while os.path.lexists(path) and not _holds(path, text):
        path, number = run.with_name(f"{run.name}-{number}.map"), number + 1
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    return path


def _holds(path: Path, text: str) -> bool:
    try:
        return read_text(path) == text
    except (OSError, BeltcommError):
        return False


def _sidecar(given: dict[str, Any]) -> Any:
    from beltcomm.recording.sidecar import ExcitationNote, Sidecar

    excitation = None
    if given["excitation"] is not None:
        excitation = ExcitationNote(given["excitation"], given["amplitude_nm"], given["period_samples"], given["first_sample"])
    elif given["amplitude_nm"] is not None or given["period_samples"] is not None or given["first_sample"]:
        raise UsageError("--amplitude, --period-samples and --first-sample describe an excitation; give its kind with --excitation")
    same = ("experiment", "held_out", "closed_loop", "start_position_m", "session_time_s", "source", "accepted", "load")
    return Sidecar(**{key: given[key] for key in same}, **(given["payload"] or {}), excitation=excitation)
