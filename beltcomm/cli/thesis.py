"""``beltcomm thesis``: what the design source compares, recomputed."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.errors import UsageError


@click.command("thesis")
@click.argument("topic", required=False)
@click.option("--pictures", type=click.Path(file_okay=False, path_type=Path), help="Folder for the topic's figures.")
@click.option(
    "--run",
    type=click.Path(file_okay=False, path_type=Path),
    help="On a run's own model and records: every topic but friction, and gravity.",
)
@click.option("--edges", type=click.Path(path_type=Path), help="Of estimators with --run: edge times of its own encoder to try them on.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, topic: str | None, pictures: Path | None, run: Path | None, edges: Path | None) -> int:
    """List what the design source compares, or recompute one TOPIC: its table, and its figures with --pictures.

    Example: beltcomm thesis
    """
    if run is not None:
        if topic is None:
            raise UsageError("--run takes one TOPIC: beltcomm thesis designs --run RUN")
        return frame.show(api("beltcomm.jobs.own_thesis").own_thesis(topic, run, edges, pictures=pictures, command=frame.line()))
    if edges is not None:
        raise UsageError("--edges goes with a run: beltcomm thesis estimators --run RUN --edges FILE")
    return frame.show(api("beltcomm.thesis.topics").thesis(topic, pictures=pictures, command=frame.line()))
