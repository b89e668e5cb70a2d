"""``beltcomm commission``: the whole job."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for, run_folder
from beltcomm.cli.help import About, option
from beltcomm.cli.specification import specification_of, specification_options
from beltcomm.language import tr


@click.command("commission")
@shared.machine_options
@shared.window_option
@shared.axis_option
@shared.new_run_option
@shared.resume_option
@shared.payload_option
@shared.prefilter_option
@shared.feedforward_option
@specification_options
@shared.apply_option
@shared.target_option
@click.option("--quick", is_flag=True, help="Fewer records, at one position: wider intervals.")
@option(
    "--thorough",
    is_flag=True,
    help="All that the search for missing effects needs, up to 180 s.",
    brief="All that a search for effects needs, up to 180 s.",
)
@option(
    "--visible",
    topic=About.MOTION,
    is_flag=True,
    help="Say beforehand, a line each, how weak an effect the records could name; with --quick, too.",
)
@option("--report/--no-report", topic=About.OUTPUT, default=True, help="A page on the run at the end, RUN/report.html; made when left out.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation, /, drive: str, axis: str | None, run: Path | None, resume: bool, targets: dict[str, Any], **given: Any
) -> int:
    """Identify, fit, design and verify an axis; the machine moves. The plan is shown first, and asked for.

    Example: beltcomm commission --drive virtual --yes
    """
    if sys.stderr.isatty():  # on a machine with other work it would be silent for 20 s
        click.echo(tr("Planning on {drive}: speeds, forces, heat, and what records could show ...", drive=drive), err=True)
    from beltcomm.axis.targets import with_targets

    known = with_targets(axis_for(axis, drive, run, resume), targets)
    frame.run = run_folder(run, known.name)
    asked = specification_of(given)
    options = frame.options(resume=resume, search=True, **given)
    return frame.show(api().commission(drive, known, frame.run, specification=asked, options=options, talk=frame.talk()))
