"""``beltcomm move``: a small, safe move, and what a ruler says of it."""

from __future__ import annotations

from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for
from beltcomm.cli.help import option


@click.command("move")
@shared.machine_options
@shared.axis_option
@click.option("--by", "by_m", required=True, type=shared.QuantityType("by_m"), help="How far, signed: 5mm, -0.005.")
@option(
    "--measured-travel",
    "measured_m",
    type=shared.QuantityType("measured_m"),
    help="Nothing moves: what a ruler says of a creep by --by before, negative for the other way; is the feed constant right?",
    brief="Nothing moves: what a ruler says of an earlier --by.",
)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, drive: str, axis: str | None, by_m: float, measured_m: float | None, **given: Any) -> int:
    """Move the carriage slowly by a small distance.

    Example: beltcomm move --drive can0 --axis axis.yaml --by 5mm
    """
    known = axis_for(axis, drive, None, False)
    if measured_m is not None:
        return frame.show(api().ruler(known, by_m, measured_m))
    return frame.show(api().move(drive, known, by_m, options=frame.options(**given), talk=frame.talk()))
