"""``beltcomm fit``: the model from the recordings."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of, today


@click.command("fit")
@shared.run_argument
@click.option(
    "--solver",
    type=shared.WordChoice(["lm", "trf", "nelder-mead"]),
    help="Of the log-magnitude fit: Levenberg-Marquardt, trust region, Nelder-Mead.",
)
@click.option(
    "--model",
    type=shared.WordChoice(["two-mass", "three-mass"]),
    default="two-mass",
    help="three-mass: the end pulley too; a revision of the model, or refused where the records do not hold it.",
)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, solver: str | None, model: str) -> int:
    """Fit the model of the run folder RUN from its recordings; no machine is needed.

    Example: beltcomm fit runs/axis-1
    """
    frame.run = run
    return frame.show(
        api("beltcomm.jobs.fit").fit(
            run, solver=solver, model=model, command=frame.line(), when=today(), options=options_of(), talk=frame.talk()
        )
    )
