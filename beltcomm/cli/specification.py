"""Options of what is asked of a design: margins, and the depths of its prefilters."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from beltcomm.cli.help import About, option
from beltcomm.cli.options import Function, QuantityType, WordChoice, with_options

if TYPE_CHECKING:
    from beltcomm.design.specification import Specification

#: What is asked of a design: names of the specification's fields.
ASKED = ("phase_margin_deg", "suppression_db", "position_phase_margin_deg", "notch_db", "butterworth_db", "velocity_filters_s")


def specification_options(command: Function) -> Function:
    """The three knobs of the design source (4.4), all at once or one by one, the depths of its prefilters and T_R.

    Parameters
    ----------
    command : Function
        Of the verb.
    """
    demand = option(
        "--demand",
        type=WordChoice(["robust", "balanced", "fast"]),
        help="Margins: robust 60°, -12 dB, 80°; balanced (if left out) 45°, -10 dB, 70°; fast 35°, -8 dB, 60°.",
        brief="Margins: robust, balanced (if left out) or fast.",
    )
    knobs = [
        option(knob, name, topic=About.CONTROLLER, type=float, metavar=unit, help=text)
        for knob, name, unit, text in (
            ("--phase-margin", ASKED[0], "DEG", "Knob 1: of the velocity loop, on every variant; 45."),
            ("--suppression", ASKED[1], "DB", "Knob 2: open loop at the resonance at most, dB; -10."),
            ("--position-phase-margin", ASKED[2], "DEG", "Knob 3: of the position loop; 70."),
            ("--notch-depth", ASKED[3], "DB", "A_Notch: of a notch at the antiresonance, dB; -6."),
            ("--butterworth-depth", ASKED[4], "DB", "A_bw: of a Butterworth low-pass at the antiresonance, dB; -3."),
        )
    ]
    lag = option(
        "--velocity-filter",
        ASKED[5],
        topic=About.CONTROLLER,
        type=QuantityType("velocity_filter_s"),
        help="T_R; the best of six when left out.",
    )
    return with_options(command, demand, *knobs, lag)


def specification_of(given: dict[str, Any]) -> Specification | None:
    """Specification made of these options, which are taken out of what was given; None without any.

    Parameters
    ----------
    given : dict of str to Any
        Options of the line; changed in place.

    Raises
    ------
    UsageError
        For a value out of its range.
    """
    demand = given.pop("demand")
    asked = {name: value for name in ASKED if (value := given.pop(name)) is not None}
    if not asked and demand is None:
        return None
    from dataclasses import asdict

    from beltcomm.design.specification import PRODUCT_SPECIFICATION
    from beltcomm.tuning.presets import PACES

    knobs = asdict(next(one.asked for one in PACES if one.key == demand)) if demand else {}
    if "velocity_filters_s" in asked:
        asked["velocity_filters_s"] = (asked["velocity_filters_s"],)
    return replace(PRODUCT_SPECIFICATION, **{**knobs, **asked})
