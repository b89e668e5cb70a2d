"""``beltcomm diagnose``: which physical effect is missing."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, today
from beltcomm.simulate.kernels import ahead


@click.command("diagnose")
@shared.run_argument
@click.option("--auto", is_flag=True, help="Add what is found and confirmed, step by step, until nothing is left.")
@click.option("--next", "following", is_flag=True, help="Write the plan of the records that would tell more.")
@shared.cost_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, auto: bool, cost: bool, following: bool) -> int:
    """Say which physical effect the model of RUN lacks, with evidence; changes nothing without --auto.

    Example: beltcomm diagnose runs/axis-1 --next
    """
    frame.run = run
    ahead.begin()  # before everything else is imported
    diagnose = api("beltcomm.jobs.laboratory").diagnose_run
    return frame.show(diagnose(run, cost=cost, following=following, auto=auto, command=frame.line(), when=today(), talk=frame.talk()))
