"""``beltcomm design``: gains with margins from the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api, options_of


@click.command("design")
@shared.run_argument
@shared.payload_option
@shared.prefilter_option
@shared.feedforward_option
@shared.asked_pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Frame, /, run: Path, pictures: bool, **given: Any) -> int:
    """Design the controller from the model of the run folder RUN; no machine is needed, nothing is written to a drive."""
    frame.run = run
    return frame.show(api().design(run, pictures=pictures, command=frame.line(), options=options_of(**given), talk=frame.talk()))
