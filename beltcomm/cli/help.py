"""``--help`` of a verb, one screen: the options needed most, the others by their names; ``--help-all`` explains each."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

import click

#: Verbs with no more options than this show all of them.
FEW = 14
#: Column that explanations begin near; a longer option stands alone on its line.
COLUMN = 18
#: Title -> options, by their last name, that a screen has no room to explain; two of a title or fewer it has.
FURTHER: Mapping[str, tuple[str, ...]] = {
    "drive and bus": (
        *("--profile", "--node", "--bitrate", "--sample-period", "--as", "--realtime", "--bus-log", "--seed"),
        *("--record", "--channel", "--signal", "--dbc"),
    ),
    "before it moves": (
        *("--home", "--position", "--window", "--simulate-first", "--visible", "--longest", "--hold-to-run"),
        *("--first-motion-confirmed", "--force"),
    ),
    "controller": (
        *("--feedforward", "--prefilter", "--velocity-filter", "--phase-margin", "--position-phase-margin", "--suppression"),
        *("--notch-depth", "--butterworth-depth"),
    ),
    "excitation": ("--excitation", "--order", "--clock", "--amplitude", "--periods", "--period-samples", "--first-sample", "--base-speed"),
    "rows of a file": (
        *("--rate", "--period", "--resample", "--rows", "--from", "--until", "--drop-incomplete", "--keep", "--edges", "--separator"),
        *("--decimal", "--skip-lines", "--torque-acts", "--flip", "--unwrap"),
    ),
    "of the record": (
        *("--name", "--held-out", "--closed-loop", "--start-position", "--session-time", "--payload-mounted", "--load", "--source"),
        "--accept",
    ),
    "output": ("--verbose", "--details", "--json", "--report", "--pictures", "--silent"),
}


def show(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    """Print the help that an option asks for, and leave.

    Parameters
    ----------
    ctx, param : Context
        Of click.
    value : bool
        True if the option was given.
    """
    if value and not ctx.resilient_parsing:
        click.echo(text(ctx, everything=param.opts[-1] == "--help-all"), color=ctx.color)
        ctx.exit()


def text(ctx: click.Context, *, everything: bool) -> str:
    """Help of the command of a context.   everything : each option is explained."""
    command, formatter = ctx.command, ctx.make_formatter()
    command.format_usage(ctx, formatter)
    command.format_help_text(ctx, formatter)
    options = {param.opts[-1]: record for param in command.params if (record := param.get_help_record(ctx)) and record[1]}
    titled = {title: [name for name in names if name in options] for title, names in FURTHER.items()}
    titled = {title: names for title, names in titled.items() if len(names) > 2 and len(options) > FEW}
    later = {name for names in titled.values() for name in names}
    with formatter.section("Options"):
        formatter.write_dl([record for name, record in options.items() if name not in later], col_max=COLUMN)
    if titled and not everything:
        with formatter.section(f"More, explained by {ctx.command_path} --help-all"):
            for title, names in titled.items():
                row = textwrap.fill(" ".join(names), formatter.width - COLUMN - 2, break_on_hyphens=False)
                formatter.write(textwrap.indent(f"{title:{COLUMN}}{textwrap.indent(row, ' ' * COLUMN).lstrip()}\n", "  "))
    for title, names in titled.items() if everything else ():
        with formatter.section(title.capitalize()):
            formatter.write_dl([options[name] for name in names], col_max=COLUMN)
    return formatter.getvalue().rstrip("\n")
