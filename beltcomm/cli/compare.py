"""``beltcomm compare``: model against measurement."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api


@click.command("compare")
@shared.run_argument
@shared.pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, pictures: bool) -> int:
    """Compare the model of RUN with its recordings: error over noise, by record, and where it fails.

    Example: beltcomm compare runs/axis-1
    """
    frame.run = run
    return frame.show(api("beltcomm.jobs.laboratory").compare_run(run, pictures=pictures, command=frame.line(), talk=frame.talk()))
