"""``beltcomm demo``: the model laboratory on a virtual axis with a hidden fault."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, run_folder


@click.command("demo")
@click.option("--seed", type=click.IntRange(0), default=None, help="Of the fault; drawn anew each time unless told.")
@shared.new_run_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, seed: int | None, run: Path | None) -> int:
    """Find a hidden fault of a virtual axis: measure, compare, diagnose, add it, watch the error fall.  No machine moves.

    Example: beltcomm demo
    """
    from beltcomm.demo import demo
    from beltcomm.language import tr
    from beltcomm.result import Line, command_lines

    chosen = time.time_ns() % 1000 if seed is None else seed
    frame.run = run_folder(run, f"demo-{chosen}")
    click.echo(tr("A virtual axis with a fault that is drawn by --seed {seed} and told at the end.", seed=chosen), err=True)
    steps: list[dict[str, Any]] = []
    for step in demo(frame.run, seed=chosen, talk=frame.talk()):
        steps.append({"command": step.command, "why": step.why, **step.data})
        if not frame.json:
            frame.print({}, ["", Line(("# ", "title"), (step.why, "title")), *([f"$ {step.command}"] if step.command else []), *step.lines])
    page = api().report(frame.run, talk=frame.talk()).to_json().get("page")
    data = {"run": str(frame.run), "seed": chosen, "steps": steps, "page": page}
    right = bool(steps[-1].get("right"))
    found = Line("  ", (tr("FOUND") if right else tr("NOT FOUND"), "good" if right else "note"), f"   {steps[-1].get('hidden')}")
    follow = command_lines("beltcomm commission --drive virtual", tr("the whole job on a virtual axis"))
    frame.print(data, ["", found, tr("Report: {page}", page=page), *follow])
    return 0
