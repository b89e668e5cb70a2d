"""``beltcomm doctor``: adapters, bus and drive examined; what is wrong, and what to do."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import VIRTUAL_AXIS, Invocation, api, options_of
from beltcomm.cli.help import About, option


@click.command("doctor")
@partial(shared.drive_options, needed=False)
@shared.axis_option
@click.option("--try-bitrates", is_flag=True, help="When nobody answers: try the usual bit rates, listening first.")
@option(
    "--sync-test",
    topic=About.MOTION,
    is_flag=True,
    help="Map two transmit PDOs for a second, stage off, and count the answers to SYNC.",
)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, drive: str | None, axis: str | None, try_bitrates: bool, sync_test: bool, **given: Any) -> int:
    """Find what stands in the way of commissioning; without --drive, what this machine has to reach one.

    Nothing moves. With its stage off the drive's PDO mapping and the limits of a record are tried and put back; no command, no setpoint
    and no gain is written. With --axis the drive's data are compared with axis.yaml. Exit codes: 0 nothing is wrong, 1 something is, 5 the
    drive cannot be reached.

    Example: beltcomm doctor --drive can0 --axis axis.yaml
    """
    if axis is None and drive is not None and drive.partition(":")[0] == "virtual":
        axis = VIRTUAL_AXIS
    return frame.show(
        api().doctor(drive, axis, try_bitrates=try_bitrates, sync_test=sync_test, options=options_of(**given), talk=frame.talk())
    )
