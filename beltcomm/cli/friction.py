"""``beltcomm friction``: constant-speed sweeps, and what those of several runs say of the load."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import option
from beltcomm.cli.newest import or_newest, told_drive


@click.command("friction")
@shared.several_runs_argument
@option(
    "--compare",
    is_flag=True,
    help="No machine: the sweeps of RUN once more; of several runs, friction against their load.",
    brief="No machine: sweeps of RUNS side by side.",
)
@partial(shared.machine_options, needed=False)
@click.option("--run", type=click.Path(path_type=Path), help="Run folder to go on with; the newest when left out.")
@option(
    "--order",
    type=shared.WordChoice(["I", "II", "III", "IV", "V", "VI", "all"], case_sensitive=False),
    help="Of the speeds of table A.1: I slowest first, II fastest first, III shuffled, IV as I with each speed ten times, V as I after "
    "long use, VI as I with a payload; all: I to IV. Without it seven speeds.",
    brief="Of the speeds: I to VI, or all; seven speeds without.",
)
@option(
    "--repeat",
    type=int,
    help="So many sweeps, to see drift and scatter; in order IV so often each speed.",
    brief="So many sweeps, to see drift and scatter.",
)
@option(
    "--payload-mounted",
    "mounted_kg",
    type=shared.QuantityType("payload_kg"),
    help="What is mounted now; noted beside every sweep, to compare.",
    brief="What is mounted now; noted beside every sweep.",
)
@shared.pictures_option
@shared.output_options
@click.pass_context
def command(
    ctx: click.Context, /, runs: tuple[Path, ...], compare: bool, drive: str | None, run: Path | None, pictures: bool, **given: Any
) -> int:
    """Drive strokes at constant speed both ways and fit Coulomb and viscous friction; the machine moves.

    The first sweep of a run is fitted; further ones are held out and judge its model.  The loop is designed from that
    model.  With --compare nothing moves: RUNS are set side by side.

    Example: beltcomm friction --drive can0 --run runs/axis-1
    """
    frame: Invocation = ctx.obj
    if compare:
        folders = (*runs, *((run,) if run is not None else ()))
        if drive is not None:
            raise click.UsageError("--compare needs no machine; leave --drive out", ctx)
        frame.run = folders[0] if folders else None
        return frame.show(
            api("beltcomm.jobs.friction_compare").friction_compare(folders, pictures=pictures, command=frame.line(), talk=frame.talk())
        )
    if runs:
        raise click.UsageError(
            f"what shall be done with {runs[0]}? --run RUN sweeps there, --compare RUN RUN sets sweeps side by side", ctx
        )
    run = or_newest(ctx, None, run)
    if drive is None:
        drive, by = told_drive(ctx, run)
        given |= {name: value for name, value in by.items() if given.get(name) is None}
    if drive is None:
        raise click.UsageError("Missing option '--drive' (with --compare RUN RUN no machine is needed)", ctx)
    frame.run, frame.drive = run, drive
    return frame.show(
        api().friction(drive, run, options=frame.options(**given), pictures=pictures, command=frame.line(), talk=frame.talk())
    )
