"""``beltcomm add``: a model revision with one more effect."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, today


@click.command("add")
@click.argument("effect", shell_complete=completion.effects_to_add)
@shared.run_argument
@shared.pictures_option
@shared.cost_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, effect: str, run: Path, pictures: bool, cost: bool) -> int:
    """Add EFFECT to the model of RUN, fit everything again and show the error before and after."""
    frame.run = run
    return frame.show(
        api("beltcomm.jobs.laboratory").add_to_run(
            effect, run, cost=cost, pictures=pictures, command=frame.line(), when=today(), talk=frame.talk()
        )
    )
