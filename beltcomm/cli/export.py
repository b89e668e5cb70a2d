"""``beltcomm export``: the designed controller as text."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of, today
from beltcomm.cli.help import option


@click.command("export")
@shared.run_argument
@option(
    "--format",
    "format_",
    required=True,
    type=shared.WordChoice(["yaml", "c", "st", "dcf", "mcap"]),
    help="yaml: coefficients and equations; c: one C99 file; st: an IEC 61131-3 function block; dcf: what goes into the drive (CiA 306); "
    "mcap: the recordings, for PlotJuggler and Foxglove.",
    brief="yaml, c, st (IEC 61131-3), dcf (CiA 306) or mcap.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Write to FILE; to stdout when left out.")
@option(
    "--torque-limit",
    "torque_limit_nm",
    type=shared.QuantityType("torque_limit_nm"),
    help="Largest torque of the controller at the motor shaft; the drive's peak torque when left out.",
    brief="Largest, at the motor shaft; the drive's peak without.",
)
@option(
    "--part",
    type=shared.WordChoice(["controller", "encoder"]),
    default="controller",
    show_default=True,
    help="Of yaml, c and st: the cascade; or velocity from the edges of the encoder, at the run's resolution and sampling.",
    brief="controller (if left out) or encoder.",
)
@click.option(
    "--tick", "tick_s", type=shared.QuantityType("tick_s"), default=None, help="Of the encoder: unit in which edges are timed; else 10 ns."
)
@click.option("--recording", metavar="NAME", help="Of mcap: this recording alone; all when left out.")
@click.option("--yes", is_flag=True, help="Overwrite an existing file.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    run: Path,
    format_: str,
    out: Path | None,
    torque_limit_nm: float | None,
    part: str,
    tick_s: float | None,
    recording: str | None,
    yes: bool,
) -> int:
    """Write the controller that was designed in the run folder RUN as text for another machine; nothing moves.

    With --part encoder: the encoder's state machine, and velocity by high-pass, event counter, gate and their combination.

    Example: beltcomm export runs/axis-1 --format st --out axis.st
    """
    return frame.show(
        api("beltcomm.jobs.export").export(
            run,
            format_,
            out=out,
            torque_limit_nm=torque_limit_nm,
            part=part,
            tick_s=tick_s,
            recording=recording,
            command=frame.line(),
            when=today(),
            options=options_of(yes=yes),
            talk=frame.talk(),
        )
    )
