"""``beltcomm design``: gains with margins from the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of
from beltcomm.cli.specification import specification_of, specification_options


@click.command("design")
@shared.run_argument
@shared.payload_option
@shared.prefilter_option
@shared.feedforward_option
@specification_options
@shared.asked_pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, pictures: bool, **given: Any) -> int:
    """Design the controller from the model of the run folder RUN; no machine is needed, nothing is written to a drive.

    Example: beltcomm design runs/axis-1 --payload 20
    """
    frame.run = run
    asked = specification_of(given)
    options = options_of(**given)
    return frame.show(api().design(run, specification=asked, pictures=pictures, command=frame.line(), options=options, talk=frame.talk()))
