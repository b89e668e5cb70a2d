"""``beltcomm friction``: the constant-speed sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api, options_of


@click.command("friction")
@shared.machine_options
@shared.existing_run_option
@shared.output_options
@click.pass_obj
def command(frame: Frame, /, drive: str, run: Path, **given: Any) -> int:
    """Drive strokes at constant speed both ways and fit Coulomb and viscous friction; the machine moves.

    The loop that drives the strokes is designed from the run's model.
    """
    frame.run = run
    return frame.show(api().friction(drive, run, options=options_of(**given), talk=frame.talk()))
