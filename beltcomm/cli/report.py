"""``beltcomm report``: everything known of a run, as one page."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import kernels
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation


@click.command("report")
@shared.run_argument
@click.option("--against", type=click.Path(path_type=Path, file_okay=False), help="An earlier run of the same axis: what changed since.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Where the page goes (RUN/report.html).")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, against: Path | None, out: Path | None) -> int:
    """Write a page on RUN that explains itself: one file of HTML, made for screen and paper, and its numbers beside it.

    Example: beltcomm report runs/axis-1
    """
    frame.run = run
    from beltcomm.pages import report as page  # alone: what moves a machine takes long to import

    kernels.listen()

    return frame.show(page(run, against=against, out=out, talk=frame.talk()))
