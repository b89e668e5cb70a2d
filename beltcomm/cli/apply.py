"""``beltcomm apply``: the designed gains into the drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api


@click.command("apply")
@shared.writing_options
@click.option("--force", is_flag=True, help="Also gains whose model or verification is in doubt.")
@click.pass_obj
def command(frame: Frame, /, drive: str, run: Path, save: bool, **given: Any) -> int:
    """Write the gains of the run's design to the drive and read them back; nothing moves."""
    frame.run = run
    options = frame.options(apply="save" if save else "keep", **given)
    return frame.show(api().apply(drive, run, options=options, talk=frame.talk()))
