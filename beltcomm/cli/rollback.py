"""``beltcomm rollback``: the gains from before the run back into the drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api, options_of


@click.command("rollback")
@shared.drive_options
@shared.existing_run_option
@click.option("--save", is_flag=True, help="Make them permanent in the drive; else they hold until power-off.")
@click.option("--yes", is_flag=True, help="Answer every question with yes.")
@click.option("--dry-run", is_flag=True, help="Show what would be written and write nothing.")
@shared.output_options
@click.pass_obj
def command(frame: Frame, /, drive: str, run: Path, save: bool, **given: Any) -> int:
    """Write back the parameters that the drive had when the run began; nothing moves."""
    frame.run = run
    options = options_of(apply="save" if save else "keep", **given)
    return frame.show(api().rollback(drive, run, options=options, talk=frame.talk()))
