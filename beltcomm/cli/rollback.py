"""``beltcomm rollback``: the gains from before the run back into the drive."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import option


@click.command("rollback")
@partial(shared.writing_options, needed=False)
@option(
    "--backup",
    metavar="FILE|list",
    help="Another backup of the run, by name or path; list shows them all. The first when left out.",
    brief="Another backup of the run; list shows them all.",
)
@shared.force_option
@click.pass_context
def command(ctx: click.Context, /, drive: str | None, run: Path, save: bool, backup: str | None, **given: Any) -> int:
    """Write back what the drive had when the run began, or what any other backup holds; nothing moves.

    Example: beltcomm rollback --drive can0 --run runs/axis-1
    """
    frame: Invocation = ctx.obj
    frame.run = run
    if backup == "list":
        return frame.show(api().backups(run))
    if drive is None:
        raise click.UsageError("Missing option '--drive' (with --backup list no drive is needed)", ctx)
    options = frame.options(apply="save" if save else "keep", **given)
    return frame.show(api().rollback(drive, run, backup=backup, options=options, talk=frame.talk()))
