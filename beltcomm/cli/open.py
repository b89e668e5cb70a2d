"""``beltcomm open``: a run on a page of this computer."""

from __future__ import annotations

import secrets
import webbrowser
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for, options_of, run_folder, today
from beltcomm.errors import Declined
from beltcomm.language import tr

OFFER = "There is no run here yet. Commission the shipped axis on a virtual drive first? It takes half a minute, and no machine moves."


def _first_run(frame: Invocation) -> Path:
    """A run on the virtual axis, after a question: a page needs one to show.   Raises Declined where it is not wanted."""
    if not frame.talk().confirm(tr(OFFER)):
        raise Declined(tr("nothing was made; measurements of your own become a run by `beltcomm import FILE --run runs/NAME`"))
    axis = axis_for(None, "virtual", None, False)
    made = run_folder(None, axis.name)
    frame.show(api().commission("virtual", axis, made, options=frame.options(yes=True), talk=frame.talk()))
    return made


@click.command("open")
@shared.run_to_open_argument
@shared.payload_option
@click.option("--move", type=click.Path(path_type=Path), help="CSV with t_s and position_m: the move whose tracking error is predicted.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page on 127.0.0.1; a free one when left out.")
@click.option("--browser/--no-browser", default=True, help="Open the page; with --no-browser its address is only printed.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path | None, move: Path | None, port: int, browser: bool, **given: Any) -> int:
    """Show a run on a page that only this computer can reach, until Ctrl-C.

    Where the model fails and which effect heals it, the design with sliders, what a session does now, runs side by side, a virtual
    session at a click. Nothing on it moves a machine or writes to a drive. Of a folder of runs the newest; where there is none yet, one on
    a virtual axis is offered.

    Example: beltcomm open runs/first
    """
    frame.run = run = run or _first_run(frame)
    opened = webbrowser.open if browser else None
    frame.talk().say(tr("Reading {run} ...", run=run))
    return frame.show(
        api().open_page(
            run,
            token=secrets.token_urlsafe(16),
            port=port,
            move=move,
            opened=opened,
            when=today,
            options=options_of(**given),
            talk=frame.talk(),
        )
    )
