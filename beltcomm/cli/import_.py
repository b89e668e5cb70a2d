"""``beltcomm import``: foreign measurements into a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api, run_folder
from beltcomm.cli.init import axis_with
from beltcomm.errors import UsageError
from beltcomm.quantities import parse_quantity

#: Values of --experiment and --excitation; those of ``beltcomm.sidecar``, which is imported when the verb runs.
_EXPERIMENTS = ("frf", "friction_sweep", "reversal", "trajectory", "static_map", "free")
_KINDS = ("multisine", "prbs", "chirp", "gprbs")


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


@click.command("import")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path), metavar="FILE...")
@click.option(
    "--map", "mapping", multiple=True, metavar="OURS=THEIRS*SCALE", help="torque_nm=Iq*0.65, t_s=time*ms, position_rad=enc*rev/65536."
)
@click.option(
    "--run",
    type=click.Path(path_type=Path),
    help="Run folder: a new one, or one made by an earlier import. Dated under runs/ when left out.",
)
@click.option("--axis", metavar="FILE", help="axis.yaml, or the name of a shipped axis. Without: one rigid mass.")
@click.option("--set", "entries", multiple=True, metavar="KEY=VALUE", help="An entry of axis.yaml: name=EMPS, limits.speed_m_s=0.2.")
@click.option("--name", help="Of the recording; the file's name when left out.")
@click.option("--rate", metavar="HZ", help="Rows per second, when there is no time column (1000Hz, 2kHz).")
@click.option("--period", metavar="S", help="The same as time between rows (1ms).")
@click.option("--experiment", type=click.Choice(_EXPERIMENTS), default="free", show_default=True, help="What was done.")
@click.option("--held-out", is_flag=True, help="Never fit this record, only judge by it.")
@click.option("--closed-loop", is_flag=True, help="A controller was active.")
@click.option("--start-position", "start_position_m", type=shared.Quantity("start_position_m"), help="Carriage position at the first row.")
@click.option("--payload", "payload_kg", type=shared.Quantity("payload_kg"), help="Mass that was mounted.")
@click.option(
    "--session-time", "session_time_s", type=shared.Quantity("session_time_s"), help="Start of the record on the session's clock."
)
@click.option("--excitation", type=click.Choice(_KINDS), help="Kind of excitation of an frf record.")
@click.option("--amplitude", "amplitude_nm", type=shared.Quantity("amplitude_nm"), help="Its largest absolute torque (force, current).")
@click.option("--period-samples", type=click.IntRange(2), help="Rows of one period, when the excitation repeats.")
@click.option("--first-sample", type=click.IntRange(0), default=0, help="Row, from 0, where its first period begins.")
@click.option("--source", default="", help="Where the data came from, in words.")
@click.option(
    "--torque-acts",
    type=click.Choice(["after", "before"]),
    default="after",
    show_default=True,
    help="After or before its row's time stamp.",
)
@click.option("--unwrap", metavar="SPAN", help="The position is a counter that starts anew after SPAN, after scaling (1rev, 200mm).")
@click.option("--rows", type=Rows(), metavar="FIRST:LAST", help="Only these rows, counted from 1.")
@click.option("--from", "from_s", type=shared.Quantity("from_s"), help="Leave out what was recorded before this time after the first row.")
@click.option("--until", "until_s", type=shared.Quantity("until_s"), help="Leave out what was recorded after this time.")
@click.option("--drop-incomplete", is_flag=True, help="Leave out rows in which a value is missing.")
@click.option("--keep", multiple=True, metavar="NAME", help="Keep a further column under its own name; all keeps all.")
@click.option("--separator", type=click.Choice(["comma", "semicolon", "tab", "space"]), help="Of a text file; recognised when left out.")
@click.option("--decimal", type=click.Choice(["point", "comma"]), help="Of a text file; recognised when left out.")
@click.option("--skip-lines", type=click.IntRange(0), default=0, help="Leave out so many lines at the beginning of a text file.")
@click.option("--dry-run", is_flag=True, help="Show what would be read and write nothing.")
@click.option("--check", "check_only", is_flag=True, help="Repeat the imports of --run from their originals and compare; no FILE.")
@shared.output_options
@click.pass_obj
def command(
    frame: Frame, /, files: tuple[Path, ...], run: Path | None, axis: str | None, entries: tuple[str, ...], check_only: bool, **given: Any
) -> int:
    """Bring measurements from FILE (CSV, text, .gz, .mat, .npz, .npy) into a run folder; the originals are kept.

    --map reads: OUR column = THEIR column times a scale, then an offset if need be: --map torque_nm=Iq*0.65
    --map position_rad=enc*9.587e-5+0.3. A unit may stand for the scale: --map t_s=time*ms. Columns that already have one of our
    names need no --map. Names of columns, units and what they mean: docs/import.md.
    """
    if check_only:
        if files or run is None:
            raise UsageError("--check takes --run RUN and no FILE")
        return frame.show(api().check_imports(run))
    if not files:
        raise UsageError("no file is given; beltcomm import FILE --map torque_nm=NAME --map position_rad=NAME ...")
    from beltcomm.foreign.store import recording_name

    frame.run = run_folder(run, f"imported-{recording_name(files[0])}")
    chosen = axis_with(axis, entries, frame.run) if entries else axis
    return frame.show(
        api().import_recordings(
            files, frame.run, _reading(given), axis=chosen, sidecar=_sidecar(given), name=given["name"], dry_run=given["dry_run"]
        )
    )


def _reading(given: dict[str, Any]) -> Any:
    from beltcomm.foreign.convert import Reading

    first, last = given["rows"] or (None, None)
    same = ("mapping", "keep", "separator", "decimal", "skip_lines", "from_s", "until_s", "torque_acts", "unwrap", "drop_incomplete")
    return Reading(**{key: given[key] for key in same}, period_s=_period_s(given["rate"], given["period"]), first_row=first, last_row=last)


def _period_s(rate: str | None, period: str | None) -> float | None:
    """The time between rows from --rate or --period.  Raises UsageError for both, or what is no positive number."""
    if rate is not None and period is not None:
        raise UsageError("--rate and --period say the same; give one of them")
    if period is not None:
        return parse_quantity(period, "period_s")
    if rate is None:
        return None
    value = parse_quantity(rate, "rate_hz")
    if value <= 0.0:
        raise UsageError(f"--rate is {value:g} Hz; it must be positive")
    return 1.0 / value


def _sidecar(given: dict[str, Any]) -> Any:
    from beltcomm.sidecar import ExcitationNote, Sidecar

    excitation = None
    if given["excitation"] is not None:
        excitation = ExcitationNote(given["excitation"], given["amplitude_nm"], given["period_samples"], given["first_sample"])
    elif given["amplitude_nm"] is not None or given["period_samples"] is not None or given["first_sample"]:
        raise UsageError("--amplitude, --period-samples and --first-sample describe an excitation; give its kind with --excitation")
    same = ("experiment", "held_out", "closed_loop", "start_position_m", "payload_kg", "session_time_s", "source")
    return Sidecar(**{key: given[key] for key in same}, excitation=excitation)
