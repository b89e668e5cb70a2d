"""``beltcomm rollback``: the gains from before the run back into the drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api


@click.command("rollback")
@shared.writing_options
@click.pass_obj
def command(frame: Frame, /, drive: str, run: Path, save: bool, **given: Any) -> int:
    """Write back the parameters that the drive had when the run began; nothing moves."""
    frame.run = run
    options = frame.options(apply="save" if save else "keep", **given)
    return frame.show(api().rollback(drive, run, options=options, talk=frame.talk()))
