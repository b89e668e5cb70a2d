"""Options for reading foreign rows, options of every verb that takes a file or frames of somebody else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.help import About, option
from beltcomm.errors import UsageError
from beltcomm.outside import read_text
from beltcomm.quantities import parse_quantity

MAP = option(
    "--map",
    "mapping",
    multiple=True,
    metavar="OURS=THEIRS*SCALE|FILE",
    help="torque_nm=Iq*0.65, t_s=time*ms, position_rad=enc*rev/65536; or a file of such lines.",
    brief="torque_nm=Iq*0.65, t_s=time*ms; or a file of such.",
)
RATE = click.option("--rate", metavar="HZ", help="Rows per second, when there is no time column (1000Hz, 2kHz).")
PERIOD = option("--period", topic=About.ROWS, metavar="S", help="The same as time between rows (1ms).")
TORQUE_ACTS = option(
    "--torque-acts",
    topic=About.ROWS,
    type=shared.WordChoice(["after", "before"]),
    help="After its row's time stamp, as in a table when left out, or before it; in a log of frames as the drive's profile says.",
)
FLIP = option(
    "--flip",
    topic=About.ROWS,
    multiple=True,
    type=shared.WordChoice(["torque", "position"]),
    help="Turn the sign of all columns of the kind.",
)
UNWRAP = option(
    "--unwrap",
    topic=About.ROWS,
    metavar="SPAN",
    help="The position is a counter that starts anew after SPAN, after scaling (1rev, 200mm).",
)
DROP = option("--drop-incomplete", topic=About.ROWS, is_flag=True, help="Leave out rows in which a value is missing.")
SEPARATOR = option(
    "--separator",
    topic=About.ROWS,
    type=shared.WordChoice(["comma", "semicolon", "tab", "bar", "space"]),
    help="Of a text file; recognised when left out.",
)
DECIMAL = option(
    "--decimal", topic=About.ROWS, type=shared.WordChoice(["point", "comma"]), help="Of a text file; recognised when left out."
)
CHANNEL = option("--channel", topic=About.BUS, metavar="NAME", help="Of a log of several interfaces: can0.")
NODE = option("--node", topic=About.BUS, type=click.IntRange(1, 127), help="Of a log of several drives: the node.")
SIGNAL = option(
    "--signal", "signals", topic=About.BUS, multiple=True, metavar="NAME=ID:BYTE:TYPE", help="What frames carry: 6064h=181:0:i32."
)
DBC = option("--dbc", topic=About.BUS, type=click.Path(path_type=Path), help="DBC file that says what frames carry.")


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of reading that a stream has, which has no first and no last row.

    Parameters
    ----------
    command : callable
        Of the verb.
    """
    for each in (DBC, SIGNAL, NODE, CHANNEL, DROP, DECIMAL, SEPARATOR, UNWRAP, FLIP, TORQUE_ACTS, PERIOD, RATE, MAP):
        command = each(command)
    return command


def _mappings(written: tuple[str, ...]) -> tuple[str, ...]:
    """Each mapping, those in files too.   Raises UsageError for a file that is not there or is no text."""
    from beltcomm.foreign.guess import mappings_in

    found: list[str] = []
    for text in written:
        if "=" in text and not Path(text).is_file():
            found.append(text)
            continue
        try:
            found += mappings_in(read_text(Path(text), failure=UsageError))
        except (OSError, ValueError) as error:
            raise UsageError(
                f"--map {text} is no mapping and no file of mappings; write OURS=THEIRS*SCALE, such as torque_nm=Iq*0.65"
            ) from error
    return tuple(found)


def reading_of(given: dict[str, Any]) -> Any:
    """Reading of rows as the options ask for it, a :class:`beltcomm.foreign.convert.Reading`.

    Parameters
    ----------
    given : dict of str to Any
        Options of the line.

    Raises
    ------
    UsageError
        For a mapping or a period that is wrong.
    """
    from beltcomm.foreign.convert import Reading

    first, last = given.get("rows") or (None, None)
    same = (
        *("keep", "separator", "decimal", "skip_lines", "from_s", "until_s", "torque_acts", "unwrap", "drop_incomplete"),
        *("flip", "record", "channel", "node", "signals"),
    )
    return Reading(
        mapping=_mappings(given["mapping"]),
        **{key: given[key] for key in same if key in given},
        dbc=str(given["dbc"]) if given["dbc"] else None,
        edges=str(given["edges"]) if given.get("edges") else None,
        period_s=_period_s(given["rate"], given["period"]),
        even_s=_period_s(given.get("resample"), None, "--resample"),
        first_row=first,
        last_row=last,
    )


def _period_s(rate: str | None, period: str | None, option: str = "--rate") -> float | None:
    """The time between rows from --rate or --period.  Raises UsageError for both, or what is no positive number."""
    if rate is not None and period is not None:
        raise UsageError("--rate and --period say the same; give one of them")
    if period is not None:
        return parse_quantity(period, "period_s")
    if rate is None:
        return None
    value = parse_quantity(rate, "rate_hz")
    if value <= 0.0:
        raise UsageError(f"{option} is {value:g} Hz; it must be positive")
    return 1.0 / value
