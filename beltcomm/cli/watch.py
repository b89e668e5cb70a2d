"""``beltcomm watch``: the model of a run runs along in production."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from beltcomm.borders import for_json
from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import About, option
from beltcomm.cli.reading import reading_of, reading_options
from beltcomm.cli.terminal import echo

if TYPE_CHECKING:
    from beltcomm.jobs.watch import WatchedMove


class WaitingClock:
    """Time of the computer, to wait for a log that grows."""

    def now(self) -> float:
        """s, never back."""
        return time.monotonic()

    def sleep_until(self, t_s: float) -> None:
        """Return when ``now() >= t_s``."""
        while (left_s := t_s - time.monotonic()) > 0.0:
            time.sleep(left_s)


@click.command("watch")
@option(
    "--drive",
    metavar="DRIVE",
    shell_complete=completion.drives,
    help="Bus that is listened to while its own controller moves the drive: can0, slcan:/dev/ttyACM0, ...; virtual plays a production.",
    brief="Bus to listen to: can0, slcan:/dev/ttyACM0, virtual.",
)
@click.option("--log", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="A log of CAN frames or a table; it may grow.")
@shared.existing_run_option
@option(
    "--limit",
    "limits",
    multiple=True,
    metavar="KEY=LIMIT",
    help="KEY=-20%, KEY=+50% of the run, KEY=0.2 in SI, KEY=none.",
    brief="KEY=-20% or KEY=+50% of the run, KEY=0.2 in SI.",
)
@click.option("--moves", type=click.IntRange(1), metavar="N", help="End after so many moves.")
@click.option("--until-alarm", is_flag=True, help="End with the first alarm.")
@option(
    "--idle",
    "idle_s",
    type=shared.QuantityType("idle_s"),
    help="End when nothing has come for so long: 10s for a log, never for a bus.",
    brief="End when nothing has come for so long.",
)
@click.option("--follow", is_flag=True, help="Wait for a log to grow, however long that takes.")
@option(
    "--anew",
    is_flag=True,
    help="After a maintenance: the next moves are the base that changes are held against.",
    brief="After a maintenance: the next moves are the new base.",
)
@option("--silent", topic=About.BUS, is_flag=True, help="Not even ask the drive what its process data mean: --signal and --map say it.")
@option("--bitrate", topic=About.BUS, type=click.IntRange(9_600, 1_000_000), help="Bit rate of the CAN bus.")
@option("--seed", topic=About.BUS, type=click.IntRange(0), help="Virtual drive: seed of everything random.")
@reading_options
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    drive: str | None,
    log: Path | None,
    run: Path,
    idle_s: float | None,
    follow: bool,
    bitrate: int | None,
    seed: int | None,
    **given: Any,
) -> int:
    """Judge each move of production by the model of RUN: friction, stiffness, load, and what the model does not know.

    It reads only: it sends no setpoint, moves nothing, writes nothing to the drive. A line for each move (JSON lines with --json), kept in
    RUN/watch, from which `beltcomm trend RUN` tells the months. Exit code 1 after an alarm; Ctrl-C ends it.

    Example: beltcomm watch --drive can0 --run runs/axis-1 --until-alarm
    """
    own = {name: given.pop(name) for name in ("limits", "moves", "until_alarm", "silent", "anew")}
    reading = reading_of(given)
    frame.run = run
    adapter = {"bitrate": bitrate, "seed": seed, "node": reading.node}

    def tell(move: WatchedMove) -> None:
        if frame.json:
            click.echo(for_json(move.data), file=sys.stdout)
        else:
            echo(move.lines, sys.stdout)
        sys.stdout.flush()

    return frame.show(
        api("beltcomm.jobs.watch").watch(
            run,
            drive=drive,
            log=log,
            reading=reading,
            idle_s=math.inf if follow else idle_s,
            options={name: value for name, value in adapter.items() if value is not None},
            clock=WaitingClock(),
            wall_clock=time.time,
            tell=tell,
            hour=lambda date_s: time.strftime("%H:%M:%S", time.localtime(date_s)),
            talk=frame.talk(),
            **own,
        )
    )
