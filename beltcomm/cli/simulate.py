"""``beltcomm simulate``: a virtual experiment."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import VIRTUAL_AXIS, Invocation, api, options_of, run_folder


@click.command("simulate")
@click.argument("plant", shell_complete=completion.plants)
@shared.axis_option
@shared.new_run_option
@click.option(
    "--experiment",
    type=shared.WordChoice(["frf", "friction_sweep", "trajectory"]),
    default="frf",
    show_default=True,
    help="What is recorded.",
)
@click.option("--seed", type=click.IntRange(0), help="Seed of the noise: equal seeds give equal records.")
@click.option("--payload", "payload_kg", type=shared.QuantityType("payload_kg"), help="Mass carried beside the plant's own carriage.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation, /, plant: str, axis: str | None, run: Path | None, experiment: str, seed: int | None, payload_kg: float | None
) -> int:
    """Simulate an experiment on PLANT (a shipped plant such as g_a, or a model file) into a new run folder.

    Example: beltcomm simulate g_a
    """
    from beltcomm.axis import load_axis

    known = load_axis(axis or VIRTUAL_AXIS)
    frame.run = run_folder(run, f"simulated-{Path(plant).stem}")
    options = options_of(seed=seed, payload_kg=payload_kg)
    return frame.show(api().simulate(plant, known, frame.run, experiment=experiment, options=options, talk=frame.talk()))
