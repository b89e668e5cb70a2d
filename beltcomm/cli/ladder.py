"""``beltcomm ladder``: all revisions of a run's model."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api


@click.command("ladder")
@shared.run_argument
@shared.pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, pictures: bool) -> int:
    """Show the revisions of RUN's model as a staircase down to the noise.

    Example: beltcomm ladder runs/axis-1
    """
    frame.run = run
    return frame.show(api("beltcomm.jobs.laboratory").ladder_of_run(run, pictures=pictures, command=frame.line()))
