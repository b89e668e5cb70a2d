"""``beltcomm commission``: the whole job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for, run_folder


@click.command("commission")
@shared.machine_options
@shared.window_option
@shared.axis_option
@shared.new_run_option
@shared.resume_option
@shared.payload_option
@shared.prefilter_option
@shared.feedforward_option
@shared.specification_options
@shared.apply_option
@shared.target_option
@click.option("--quick", is_flag=True, help="Fewer records: one position, a shorter sweep; wider intervals.")
@click.option("--thorough", is_flag=True, help="More records, up to 180 s: all that the search for missing effects needs.")
@click.option("--visible", is_flag=True, help="Say beforehand, a line each, how weak an effect the records could name; with --quick, too.")
@click.option("--report/--no-report", default=True, help="A page on the run at the end, RUN/report.html; made when left out.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation, /, drive: str, axis: str | None, run: Path | None, resume: bool, targets: dict[str, Any], **given: Any
) -> int:
    """Identify, fit, measure friction, design and verify an axis; the machine moves.

    Says what will happen first and asks before anything moves.

    Example: beltcomm commission --drive virtual --yes
    """
    from beltcomm.axis.targets import with_targets

    known = with_targets(axis_for(axis, drive, run, resume), targets)
    frame.run = run_folder(run, known.name)
    asked = shared.specification_of(given)
    options = frame.options(resume=resume, search=True, **given)
    return frame.show(api().commission(drive, known, frame.run, specification=asked, options=options, talk=frame.talk()))
