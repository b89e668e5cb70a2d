"""``beltcomm remove``: a model revision without an effect."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, today


@click.command("remove")
@click.argument("effect", shell_complete=completion.effects_to_remove)
@shared.run_argument
@shared.pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, effect: str, run: Path, pictures: bool) -> int:
    """Take EFFECT out of the model of RUN, fit everything again and show the error before and after.

    Example: beltcomm remove cogging runs/axis-1
    """
    frame.run = run
    return frame.show(
        api("beltcomm.jobs.change").remove_from_run(effect, run, pictures=pictures, command=frame.line(), when=today(), talk=frame.talk())
    )
