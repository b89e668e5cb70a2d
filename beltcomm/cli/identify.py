"""``beltcomm identify``: frequency responses from the machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, axis_for, run_folder
from beltcomm.cli.help import About, option
from beltcomm.errors import UsageError
from beltcomm.given import EXCITATION_KINDS
from beltcomm.quantities import parse_quantity


@click.command("identify")
@shared.machine_options
@shared.window_option
@shared.axis_option
@shared.new_run_option
@shared.resume_option
@option(
    "--excitation",
    type=shared.WordChoice(EXCITATION_KINDS),
    default="prbs",
    help="Signal of the frequency response; prbs when left out. A multisine tells nonlinearity from noise.",
    brief="prbs (if left out), multisine ...",
)
@option(
    "--order",
    "prbs_order",
    topic=About.EXCITATION,
    type=click.IntRange(3, 16),
    metavar="N",
    help="Of a PRBS: 2^N - 1 bits; chosen when left out.",
)
@option("--clock", "bit", topic=About.EXCITATION, metavar="SAMPLES|TIME", help="Of a PRBS: how long a bit lasts, 2 samples or 8ms.")
@option(
    "--amplitude",
    "amplitude_nm",
    topic=About.EXCITATION,
    type=shared.QuantityType("amplitude_nm"),
    help="± at the motor; refused beyond the limits.",
)
@option("--periods", topic=About.EXCITATION, type=click.IntRange(3), metavar="N", help="Measured ones, after one of run-in.")
@option(
    "--loop",
    type=shared.WordChoice(("open", "direct", "indirect", "setpoint")),
    default="open",
    help="Way of identification; the closed ones travel with a loop from the run's model (--run), so that friction does not pose as "
    "damping: direct and indirect excite the torque, setpoint the speed.",
    brief="open (if left out); direct, indirect, setpoint travel.",
)
@option(
    "--base-speed",
    "base_speed_m_s",
    topic=About.EXCITATION,
    type=shared.QuantityType("base_speed_m_s"),
    help="Of the carriage in a closed way; 0 stands.",
)
@shared.pictures_option
@option(
    "--plan",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Go on with a run by the plan that `beltcomm diagnose --next` wrote.",
    brief="Records by the plan of `beltcomm diagnose --next`.",
)
@shared.force_option
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    drive: str,
    axis: str | None,
    run: Path | None,
    resume: bool,
    plan: Path | None,
    bit: str | None,
    **given: Any,
) -> int:
    """Measure frequency responses; the machine moves by some millimetres, with --loop along its travel.

    The amplitude rises step by step inside limits that are predicted before each step. A drive that does not know where the carriage
    stands needs --position or --home, or --window for a record at this place alone.

    Example: beltcomm identify --drive can0 --axis axis.yaml
    """
    given["bit_s"] = _bit_s(bit, given["sample_period_s"])
    closed = given["loop"] != "open"
    if closed and (run is None or plan is not None):
        raise UsageError(f"--loop {given['loop']} goes on with a run that has a model: give its folder with --run, and no --plan")
    if plan is not None:
        if run is None:
            raise UsageError("--plan goes on with a run; give its folder with --run")
        frame.run = run
        return frame.show(api().follow(drive, run, plan, options=frame.options(**given), talk=frame.talk()))
    known = axis_for(axis, drive, run, resume or closed)
    frame.run = run_folder(run, known.name)
    options = frame.options(resume=resume, search=True, **given)
    return frame.show(api().identify(drive, known, frame.run, options=options, talk=frame.talk()))


def _bit_s(text: str | None, sample_period_s: float | None) -> float | None:
    """Duration of a bit: a time, or samples of the period that is asked for, 1 ms where none is.   Raises UsageError."""
    if text is None:
        return None
    if text.strip().isdigit():
        return int(text) * (sample_period_s or 1e-3)
    return parse_quantity(text, "bit_s")
