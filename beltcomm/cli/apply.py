"""``beltcomm apply``: the designed gains into the drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import About, option


@click.command("apply")
@shared.writing_options
@shared.force_option
@option(
    "--verify",
    "shown",
    is_flag=True,
    help="Show by a small move that they do what was predicted, before --save; else put back.",
    brief="A small move proves them before --save.",
)
@option(
    "--position",
    "position_m",
    topic=About.MOTION,
    type=shared.QuantityType("position_m"),
    help="With --verify: where the carriage is, when the drive has no zero.",
)
@click.option("--dcf", type=click.Path(path_type=Path), metavar="FILE", help="The values of a DCF in place of the run's design.")
@click.pass_obj
def command(frame: Invocation, /, drive: str, run: Path, save: bool, shown: bool, dcf: Path | None, **given: Any) -> int:
    """Write the gains of the run's design to the drive and read them back; nothing moves, unless --verify asks for a small move.

    What stood there before is kept in the run; `beltcomm rollback` writes it again.

    Example: beltcomm apply --drive can0 --run runs/axis-1 --save
    """
    frame.run = run
    options = frame.options(apply="save" if save else "keep", **given)
    return frame.show(api().apply(drive, run, dcf=dcf, shown=shown, options=options, talk=frame.talk()))
