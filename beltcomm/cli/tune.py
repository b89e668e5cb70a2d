"""``beltcomm tune``: the three knobs as sliders on a page of this computer."""

from __future__ import annotations

import secrets
import webbrowser
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of


@click.command("tune")
@shared.run_argument
@shared.payload_option
@click.option("--move", type=click.Path(path_type=Path), help="CSV with t_s and position_m: the move whose tracking error is predicted.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page on 127.0.0.1; a free one when left out.")
@click.option("--browser/--no-browser", default=True, help="Open the page; with --no-browser its address is only printed.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, move: Path | None, port: int, browser: bool, **given: Any) -> int:
    """Turn the three knobs of the run's design by sliders, on a page that only this computer can reach, until Ctrl-C.

    Open loop, step, disturbance and the predicted tracking error follow. Saving makes it the run's design; nothing is written to a drive.

    Example: beltcomm tune runs/first
    """
    frame.run = run
    opened = webbrowser.open if browser else None
    options = options_of(**given)
    return frame.show(
        api().tune(run, token=secrets.token_urlsafe(16), port=port, move=move, opened=opened, options=options, talk=frame.talk())
    )
