"""``beltcomm bundle``: a run in one zip, for whoever helps."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.traces import BUNDLE, private_words


@click.command("bundle")
@shared.run_argument
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help=f"The zip to write; RUN/{BUNDLE} when left out.")
@click.option("--recordings", is_flag=True, help="With the rows of every record, which may be large.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, out: Path | None, recordings: bool) -> int:
    """Put a run into one zip for whoever helps: plan, journal, results, the bus's log and versions, but no paths and no user name.

    Example: beltcomm bundle runs/axis-1
    """
    frame.run = run
    return frame.show(api("beltcomm.jobs.bundle").bundle(run, out or run / BUNDLE, recordings=recordings, private=private_words()))
