"""``beltcomm serve``: the virtual drive for other processes."""

from __future__ import annotations

from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of
from beltcomm.cli.help import option


@click.command("serve")
@option(
    "--on",
    required=True,
    metavar="INTERFACE",
    help="slcan: a pseudo-terminal that looks like a serial CAN adapter; socket:PORT: the same over TCP on this computer; can0, vcan0: "
    "SocketCAN; any other interface that --drive knows; rs232: the drive's RS-232 port on a pseudo-terminal, always at the wall clock.",
    brief="slcan, socket:PORT, rs232, can0, vcan0 ...",
)
@shared.serving_options
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, drive: str, on: str, **given: Any) -> int:
    """Let other processes reach the virtual drive over a CAN interface or RS-232, until Ctrl-C.

    Time is the drive's own: each SYNC is one of its periods, and it stands in between, however slow the computer is. With --realtime it
    runs at 1 kHz of the wall clock instead, as a real drive does.

    Example: beltcomm serve --on slcan
    """
    return frame.show(api().serve(drive, on, options=options_of(**given), talk=frame.talk()))
