"""``beltcomm compare``: model against measurement."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame


@click.command("compare")
@shared.run_argument
@shared.output_options
@click.pass_obj
def command(frame: Frame, /, run: Path) -> int:
    """Compare the model of RUN with its recordings: error over noise, by record, and where it fails."""
    from beltcomm.session.laboratory import compare_run

    frame.run = run
    return frame.show(compare_run(run, talk=frame.talk()))
