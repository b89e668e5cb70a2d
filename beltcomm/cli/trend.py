"""``beltcomm trend``: one axis over many runs."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.newest import of_newest_axis


@click.command("trend")
@click.argument("runs", nargs=-1, type=click.Path(path_type=Path, file_okay=False))
@click.option("--limit", "limits", multiple=True, metavar="KEY=LIMIT", help="KEY=-20%, KEY=+50% of the first run, or KEY=0.2 in SI.")
@click.option("--date", "dates", multiple=True, metavar="DATE", help="When a run was made, once for each RUN in the same order.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Where the page goes (trend.html of the newest run).")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, runs: tuple[Path, ...], limits: tuple[str, ...], dates: tuple[str, ...], out: Path | None) -> int:
    """Follow one axis over many RUNS, without any named all of the newest run's axis: what drifts, and when it reaches its limit.

    Example: beltcomm trend runs/2025-* --limit coulomb_total=+30%
    """
    runs = runs or tuple(of_newest_axis())
    return frame.show(api("beltcomm.pages").trend(runs, limits=limits, dates=dates, out=out))
