"""``beltcomm design``: gains with margins from the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of

#: What the design source turns with sliders (4.4): fields of the specification.
KNOBS = ("phase_margin_deg", "suppression_db", "position_phase_margin_deg")


@click.command("design")
@shared.run_argument
@shared.payload_option
@shared.prefilter_option
@shared.feedforward_option
@click.option("--phase-margin", "phase_margin_deg", type=float, metavar="DEG", help="Knob 1: of the velocity loop, on every variant; 45.")
@click.option("--suppression", "suppression_db", type=float, metavar="DB", help="Knob 2: open loop at the resonance at most, dB; -10.")
@click.option("--position-phase-margin", "position_phase_margin_deg", type=float, metavar="DEG", help="Knob 3: of the position loop; 70.")
@shared.asked_pictures_option
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, run: Path, pictures: bool, **given: Any) -> int:
    """Design the controller from the model of the run folder RUN; no machine is needed, nothing is written to a drive."""
    from beltcomm.design.specification import PRODUCT_SPECIFICATION

    frame.run = run
    turned = {name: given.pop(name) for name in KNOBS}
    asked = replace(PRODUCT_SPECIFICATION, **{name: value for name, value in turned.items() if value is not None})
    options = options_of(**given)
    return frame.show(api().design(run, specification=asked, pictures=pictures, command=frame.line(), options=options, talk=frame.talk()))
