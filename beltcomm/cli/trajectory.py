"""``beltcomm trajectory``: a jerk-limited motion into a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of
from beltcomm.cli.help import About, option


def _quantity(words: str, name: str, meaning: str, *, needed: bool = False) -> Callable[[shared.Function], shared.Function]:
    """An option with its unit.   words : ``--speed``.   name : of the argument, whose suffix is the unit."""
    return option(words, name, topic=None if needed else About.MOVE, type=shared.QuantityType(name), help=meaning, required=needed)


@click.command("trajectory")
@click.argument("file", type=click.Path(path_type=Path))
@_quantity("--from", "start_m", "Where it begins.", needed=True)
@_quantity("--to", "end_m", "Where it ends.", needed=True)
@_quantity("--speed", "speed_m_s", "Largest speed towards the end.", needed=True)
@_quantity("--acceleration", "acceleration_m_s2", "Largest acceleration towards the end.", needed=True)
@_quantity("--jerk", "jerk_m_s3", "How fast the acceleration may rise.", needed=True)
@_quantity("--speed-back", "speed_back_m_s", "Largest speed the other way; --speed when left out, 0 forbids it.")
@_quantity("--deceleration", "deceleration_m_s2", "Largest deceleration; --acceleration when left out.")
@_quantity("--jerk-down", "jerk_down_m_s3", "How fast the acceleration may fall; --jerk when left out.")
@_quantity("--start-velocity", "start_velocity_m_s", "Velocity at the start, signed as the axis; 0 when left out.")
@_quantity("--start-acceleration", "start_acceleration_m_s2", "Acceleration at the start, signed; 0 when left out.")
@_quantity("--end-velocity", "end_velocity_m_s", "Velocity at the end, signed; 0 when left out.")
@_quantity("--end-acceleration", "end_acceleration_m_s2", "Acceleration at the end, signed; 0 when left out.")
@_quantity("--period", "period_s", "Time between rows; 1 ms when left out.")
@option(
    "--led",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Write the reference that leads this run's axis along the motion: for drives that take positions and have no feedforward.",
    brief="Write the reference that leads this run's axis.",
)
@click.option("--yes", is_flag=True, help="Overwrite an existing file.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, file: Path, start_m: float, end_m: float, led: Path | None, yes: bool, **given: float | None) -> int:
    """Write the fastest motion between two states to FILE (CSV): jerk, acceleration and speed limited, each way by its own.

    Limits are positive and hold along the way, whichever way it leads. A motion from rest to rest can be driven with
    `beltcomm verify --move FILE`.

    Example: beltcomm trajectory move.csv --from 0 --to 0.5 --speed 1 --acceleration 10 --jerk 200
    """
    said = {name: value for name, value in given.items() if value is not None}
    return frame.show(
        api("beltcomm.jobs.trajectory").trajectory(file, start_m, end_m, **said, led=led, options=options_of(yes=yes), talk=frame.talk())
    )
