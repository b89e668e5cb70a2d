"""``beltcomm study``: a population of axes, or a fleet's runs, through a design, a commissioning or a diagnosis."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import option


@click.command("study")
@click.argument("file", metavar="STUDY")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Folder of the results; studies/STUDY when left out.")
@option(
    "--workers",
    type=click.IntRange(1, 1024),
    help="Processes on this machine; one per processor when left out.",
    brief="Processes here; one per processor when left out.",
)
@option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask scheduler whose workers compute instead, such as tcp://10.0.0.5:8786.",
    brief="Dask scheduler whose workers compute instead.",
)
@option(
    "--limit",
    type=click.IntRange(0),
    metavar="N",
    help="Compute at most N more members, then say what is known; 0: only say it.",
    brief="Compute at most N more; 0: say what is known.",
)
@option(
    "--member",
    type=click.IntRange(0),
    metavar="K",
    help="Compute member K alone and show it; with --out its plant and run stay.",
    brief="Compute member K alone and show it.",
)
@click.option("--report/--no-report", default=True, help="The page study.html in the folder; made when left out.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    file: str,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    limit: int | None,
    member: int | None,
    report: bool,
) -> int:
    """Compute every member of STUDY (a file, or a shipped study's name): which share of the axes meets its targets, and what drives it.

    A study that was stopped or killed goes on by the same command. The results do not depend on who computes them.

    Example: beltcomm study tolerances --limit 100
    """
    if member is not None:
        return frame.show(api().study_member(file, member, out=out))
    folder = out or Path("studies") / Path(file).stem
    return frame.show(api().study(file, folder, workers=workers, scheduler=scheduler, limit=limit, report=report, talk=frame.talk()))
