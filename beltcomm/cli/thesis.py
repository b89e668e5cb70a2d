"""``beltcomm thesis``: what the design source compares, recomputed."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api


@click.command("thesis")
@click.argument("topic", required=False)
@click.option("--pictures", type=click.Path(file_okay=False, path_type=Path), help="Folder for the topic's figures.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, topic: str | None, pictures: Path | None) -> int:
    """List what the design source compares, or recompute one TOPIC: its table, and its figures with --pictures.

    Example: beltcomm thesis
    """
    return frame.show(api("beltcomm.thesis.topics").thesis(topic, pictures=pictures, command=frame.line()))
