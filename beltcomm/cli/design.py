"""``beltcomm design``: gains with margins from the model."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame, api, options_of


@click.command("design")
@shared.run_argument
@shared.payload_option
@click.option("--prefilter", type=click.Choice(["none", "notch", "butterworth"]), help="Of the velocity loop; the best one when left out.")
@shared.output_options
@click.pass_obj
def command(frame: Frame, /, run: Path, payload_kg: float | None, prefilter: str | None) -> int:
    """Design the controller from the model of the run folder RUN; no machine is needed, nothing is written to a drive."""
    frame.run = run
    options = options_of(payload_kg=payload_kg)
    return frame.show(api().design(run, prefilter=prefilter, options=options, talk=frame.talk()))
