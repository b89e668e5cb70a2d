"""``beltcomm open``: a run on a page of this computer."""

from __future__ import annotations

import secrets
import webbrowser
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of, today
from beltcomm.language import tr


@click.command("open")
@shared.run_argument
@shared.payload_option
@click.option("--move", type=click.Path(path_type=Path), help="CSV with t_s and position_m: the move whose tracking error is predicted.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page on 127.0.0.1; a free one when left out.")
@click.option("--browser/--no-browser", default=True, help="Open the page; with --no-browser its address is only printed.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, move: Path | None, port: int, browser: bool, **given: Any) -> int:
    """A run on a page that only this computer can reach, until Ctrl-C: where the model fails and which effect heals it, the design with
    sliders, what a session does now, runs side by side, a virtual session at a click. Nothing on it moves a machine or writes to a drive.

    Example: beltcomm open runs/first
    """
    frame.run = run
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
