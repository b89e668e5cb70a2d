"""``beltcomm verify``: predicted against measured tracking error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import About, option
from beltcomm.errors import UsageError


@click.command("verify")
@shared.machine_options
@shared.existing_run_option
@click.option("--move", type=click.Path(path_type=Path), metavar="CSV", help="Your own move: columns t_s, position_m.")
@option(
    "--trajectory",
    metavar="NAME",
    help="Limits of the 0 to 0.5 m move, from axis.yaml; T_A when left out.",
    brief="Limits of the move, from axis.yaml; T_A when left out.",
)
@shared.sent_feedforward_option
@shared.target_option
@option("--rungs", topic=About.MOVE, is_flag=True, help="The move five times: what each step beyond the design source brings.")
@option(
    "--learn",
    type=click.IntRange(2, 50),
    metavar="N",
    help="The move N times more: each time with a torque learnt from what was left before, as far as the model is trusted.",
    brief="The move N times more, each with a torque learnt before.",
)
@option(
    "--over-belt",
    topic=About.MOVE,
    is_flag=True,
    help="Virtual drives only: no limit of the belt, nor of the way of a stop, holds the move back (T_B of the thesis).",
)
@shared.force_option
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    drive: str,
    run: Path,
    move: Path | None,
    trajectory: str | None,
    rungs: bool,
    learn: int | None,
    over_belt: bool,
    targets: dict[str, Any],
    **given: Any,
) -> int:
    """Drive a move with the run's design and compare its error with the predicted one; the machine moves.

    Example: beltcomm verify --drive can0 --run runs/axis-1
    """
    if move is not None and trajectory is not None:
        raise UsageError("--move brings its own motion, --trajectory names limits for the standard one; give one of them")
    options = frame.options(targets=targets or None, **given)
    if rungs and options.feedforward is not None:
        raise UsageError("--rungs drives every feedforward in turn; leave --feedforward out")
    frame.run = run
    result = api().verify(
        drive, run, move=move, trajectory=trajectory, rungs=rungs, learn=learn, over_belt=over_belt, options=options, talk=frame.talk()
    )
    return frame.show(result)
