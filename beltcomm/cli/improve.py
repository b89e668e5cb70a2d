"""``beltcomm improve``: from a model that misses something to gains that know it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, today


@click.command("improve")
@shared.run_argument
@partial(shared.machine_options, needed=False, of_run=False)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, drive: str | None, **given: Any) -> int:
    """Name what the model of RUN lacks, add it, design again; with --drive drive the verification move too.

    Says what it brings: the following error before and after, as measured with --drive, else as predicted.

    Example: beltcomm improve --drive virtual
    """
    frame.run = run
    options = frame.options(**given)
    return frame.show(api("beltcomm.improve").improve(run, drive, options=options, command=frame.line(), when=today(), talk=frame.talk()))
