"""``beltcomm add``: a model revision with one more effect."""

from __future__ import annotations

import math
from pathlib import Path

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, today
from beltcomm.errors import UsageError


@click.command("add")
@click.argument("effect", shell_complete=completion.effects_to_add)
@shared.run_argument
@click.option("--start", multiple=True, metavar="NAME=VALUE", help="Where the fit begins, instead of a search: order=12, sine=0.02.")
@shared.pictures_option
@shared.cost_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, effect: str, run: Path, start: tuple[str, ...], pictures: bool, cost: bool) -> int:
    """Add EFFECT to the model of RUN, fit everything again and show the error before and after.

    Example: beltcomm add cogging runs/axis-1
    """
    frame.run = run
    given = [_value(effect, text) for text in start]
    values = dict(given)
    if twice := next((name for name in values if sum(name == other for other, _ in given) > 1), ""):
        raise UsageError(f"--start says {twice} twice; give each value once")
    return frame.show(
        api("beltcomm.jobs.change").add_to_run(
            effect, run, start=values or None, cost=cost, pictures=pictures, command=frame.line(), when=today(), talk=frame.talk()
        )
    )


def _value(effect: str, text: str) -> tuple[str, float]:
    """``name=value``; the effect's own name before it does no harm."""
    name, equals, number = (part.strip() for part in text.partition("="))
    try:
        value = float(number) if equals and name else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"--start {text} is no start value; write NAME=VALUE in SI, such as order=12")
    return name.removeprefix(f"{effect}."), value
