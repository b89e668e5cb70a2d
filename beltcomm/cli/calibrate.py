"""``beltcomm calibrate``: what the gains of a drive mean."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for, run_folder


@click.command("calibrate")
@shared.machine_options
@shared.axis_option
@click.option("--run", type=click.Path(path_type=Path), help="Run folder to go on with, or to make; a dated one under runs/ when left out.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, drive: str, axis: str | None, run: Path | None, **given: Any) -> int:
    """Measure by small steps what the drive's gains mean; the machine moves a few millimetres, and its gains are put back.

    Some drives do not say what a gain of 1.0 is.  Their gains are not written before this was measured; commission does it by itself.

    Example: beltcomm calibrate --drive can0 --axis axis.yaml
    """
    existing = run is not None and (run / "axis.yaml").is_file()
    of_axis = None if existing and axis is None else axis_for(axis, drive, run, False)
    frame.run = run_folder(run, of_axis.name if of_axis is not None else "axis")
    return frame.show(api().calibrate(drive, of_axis, frame.run, options=frame.options(**given), talk=frame.talk()))
