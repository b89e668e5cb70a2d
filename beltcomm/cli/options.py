"""Options that several verbs share, as decorators."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from beltcomm.cli import completion
from beltcomm.cli.help import About, help_options, option
from beltcomm.cli.hold import option as held_key
from beltcomm.cli.newest import or_begun, or_newest, runs_here, told_drive
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.quantities import parse_quantity, unit_of

if TYPE_CHECKING:
    Numbers = click.ParamType[float]
    Pairs = click.ParamType[tuple[float, float]]
    Words = click.Choice[str]
else:  # before click 8.2 the classes take no type argument
    Numbers = Pairs = click.ParamType
    Words = click.Choice

_UNIT = re.compile(r"[a-zA-Zµμ°]*\s*$")
#: An angle where a way is asked for.
_ANGLE = re.compile(r"(?:deg|°)(?:/s[23²³]?)?\s*$")
Function = TypeVar("Function", bound=Callable[..., Any])


def _parsed(text: str, name: str, ctx: click.Context | None) -> float:
    """The SI value of a quantity; a way in degrees for an axis whose load turns.   Raises UsageError."""
    if not _ANGLE.search(text) or not _turns(getattr(ctx.obj, "words", ()) if ctx is not None else ()):
        return parse_quantity(text, name)
    from beltcomm.axis.kinds import DEGREE_M

    return DEGREE_M * parse_quantity(text, re.sub(r"m((_s\d?)?)$", r"deg\1", name))


def _turns(words: Sequence[str]) -> bool:
    """True if a command is about an axis whose load turns, by the axis or the run that it names."""
    from beltcomm.axis import load_axis

    named = dict(pairwise(part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])))
    axis, run = named.get("--axis"), named.get("--run")
    try:
        return load_axis(axis or f"{run}/axis.yaml").kind == "rotary" if axis or run else False
    except BeltcommError:
        return False


class WordChoice(Words):
    """One of some words; a wrong one is answered with the word that resembles it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The word.  Raises click.BadParameter for any other."""
        try:
            return str(super().convert(value, param, ctx))
        except click.BadParameter as error:
            from beltcomm.configfiles import did_you_mean

            raise click.BadParameter(f"{error.message.rstrip('.')}{did_you_mean(value, map(str, self.choices))}", ctx, param) from error


class QuantityType(Numbers):
    """A number with its unit: SI when none is written (``0.3``, ``300mm``).

    Parameters
    ----------
    name : str
        Whose suffix says the unit.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The unit that a bare number is taken in, such as ``[m]``."""
        return f"[{unit_of(self.name)}]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The value in SI.  Raises click.BadParameter for a number or a unit that cannot be read."""
        if isinstance(value, float):
            return value
        try:
            return _parsed(str(value), self.name, ctx)
        except UsageError as error:
            self.fail(str(error), param, ctx)


class Window(Pairs):
    """Option type of the travel allowed around the present position: ``-20mm..30mm``, or ``25mm`` either way."""

    name = "window"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """``LOW..HIGH``."""
        return "LOW..HIGH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """(low, high) in m.  Raises click.BadParameter for anything else than low < 0 < high."""
        if isinstance(value, tuple):
            return value
        low, _, high = str(value).partition("..")
        if high and not _UNIT.findall(low)[0]:  # a unit after HIGH alone is meant for both
            low += _UNIT.findall(high)[0]
        try:
            first = _parsed(low, "window_m", ctx)
            ends = (first, _parsed(high, "window_m", ctx)) if high else (-first, first)
        except UsageError as error:
            self.fail(str(error), param, ctx)
        if not ends[0] < 0.0 < ends[1]:
            self.fail(f"{value} does not reach to both sides of where the carriage stands; write -20mm..30mm, or 25mm for both", param, ctx)
        return ends


def with_options(function: Function, *options: Callable[[Function], Function]) -> Function:
    """A command with options, listed in the order of its help.

    Parameters
    ----------
    function : Function
        Of the verb.
    *options : callable
        Decorators.
    """
    for each in reversed(options):
        function = each(function)
    return function


def output_options(function: Function) -> Function:
    """``--json``, ``--details``, ``-v`` and the help: every verb has them.

    Parameters
    ----------
    function : Function
        Of the verb.
    """

    def set_details(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
        ctx.obj.details = value

    def set_verbose(ctx: click.Context, _param: click.Parameter, value: int) -> int:
        ctx.obj.verbose = value
        return value

    return with_options(
        function,
        option(
            "-v",
            "--verbose",
            topic=About.OUTPUT,
            count=True,
            expose_value=False,
            callback=set_verbose,
            help="Say more on stderr; -vv for everything.",
        ),
        option(
            "--details",
            topic=About.OUTPUT,
            is_flag=True,
            expose_value=False,
            callback=set_details,
            help="What does not fit on a screen, too.",
        ),
        option("--json", "_json", topic=About.OUTPUT, is_flag=True, expose_value=False, help="One JSON object on stdout."),
        help_options,
    )


def _note_drive(ctx: click.Context, param: click.Parameter, value: str | None, *, needed: bool, of_run: bool) -> str | None:
    """The drive given, else that of the run that is gone on with, which is said.   needed : it is an error to have none."""
    if value is None and of_run and not ctx.resilient_parsing and any(one.callback is or_newest for one in ctx.command.params):
        value, by = told_drive(ctx, ctx.params.get("run") or next(iter(runs_here()[-1:]), None))
        ctx.default_map = {**(ctx.default_map or {}), **by}  # of the options that come after this one; one that is given is the user's
    if value is None and needed and not ctx.resilient_parsing:
        raise click.MissingParameter("--drive can0 for instance (`beltcomm doctor` looks for them), or --drive virtual.", ctx, param)
    if value and value.startswith("virtual:") and Path(value.partition(":")[2]).is_file() and not ctx.resilient_parsing:
        from beltcomm.jobs.virtual_axis import machine_of

        value, said = machine_of(value)
        if said:
            click.echo(said, err=True)
    ctx.obj.drive = value or ""
    return value


def _note_bus_log(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    ctx.obj.bus_log = value


def _as_option(text: str) -> Callable[[Function], Function]:
    """``--as``, which drive a virtual one plays."""
    return option("--as", "slave", topic=About.BUS, metavar="NAME", shell_complete=completion.slaves, help=text)


def drive_options(function: Function, *, needed: bool = True, of_run: bool = True) -> Function:
    """``--drive`` and what an adapter needs to open it.

    Parameters
    ----------
    function : Function
        Of the verb.
    needed : bool
        False where a verb can do without.
    of_run : bool
        The run's, unless told.
    """
    return with_options(
        function,
        option(
            "--drive",
            metavar="DRIVE",
            shell_complete=completion.drives,
            callback=partial(_note_drive, needed=needed, of_run=of_run),
            help="can0, slcan:PORT, serial:PORT, ... (`beltcomm drives` lists them), virtual, virtual:PLANT or virtual:my_axis.yaml.",
            brief="can0, slcan:PORT, serial:PORT, virtual, ...",
        ),
        option(
            "--profile",
            topic=About.BUS,
            metavar="NAME",
            shell_complete=completion.profiles,
            help="Drive profile; recognised from the drive when left out.",
        ),
        option("--node", topic=About.BUS, type=click.IntRange(1, 126), help="CANopen node; searched for when left out."),
        option("--bitrate", topic=About.BUS, type=click.IntRange(9_600, 1_000_000), help="Bit rate of the CAN bus, or of the RS-232 line."),
        option(
            "--sample-period",
            "sample_period_s",
            topic=About.BUS,
            type=QuantityType("sample_period_s"),
            help="Between two samples; the shortest that drive and bit rate allow when left out.",
        ),
        _as_option("Virtual drive: play another maker's drive, epos4, akd, ... (`beltcomm drives`), or the facts in a .yaml file."),
        option("--realtime", topic=About.BUS, is_flag=True, help="Virtual drive: run at 1 kHz of real time, not as fast as possible."),
        option(
            "--bus-log",
            topic=About.BUS,
            is_flag=True,
            expose_value=False,
            callback=_note_bus_log,
            help="Keep the bus's log for a virtual drive too (RUN/bus).",
        ),
        option(
            "--seed",
            topic=About.BUS,
            type=click.IntRange(0),
            help="Virtual drive: seed of everything random; equal seeds give equal runs.",
        ),
    )


def serving_options(function: Function) -> Function:
    """Options of the virtual drive that is served, and of how its time passes.

    Parameters
    ----------
    function : Function
        Of the verb.
    """
    return with_options(
        function,
        click.option("--drive", default="virtual", metavar="DRIVE", help="virtual (when left out) or virtual:PLANT."),
        option("--profile", topic=About.BUS, metavar="NAME", help="reference (when left out) or cmmp-as."),
        _as_option("Play another maker's drive instead."),
        option("--node", topic=About.BUS, type=click.IntRange(1, 126), help="Its CANopen node number; 1 when left out."),
        option("--seed", topic=About.BUS, type=click.IntRange(0), help="Seed of its torque noise."),
        option("--realtime", topic=About.BUS, is_flag=True, help="Run at 1 kHz of the wall clock; else each SYNC is one period."),
    )


def machine_options(function: Function, *, needed: bool = True, of_run: bool = True) -> Function:
    """Options of every verb that moves an axis.

    Parameters
    ----------
    function : Function
        Of the verb.
    needed : bool
        As in :func:`drive_options`.
    of_run : bool
        As in :func:`drive_options`.
    """
    function = with_options(
        function,
        yes_option,
        click.option("--dry-run", is_flag=True, help="Show the plan and move nothing."),
        click.option("--home", is_flag=True, help="Let the drive search its zero first."),
        option(
            "--position",
            "position_m",
            type=QuantityType("position_m"),
            help="Where the carriage is now, when the drive has no zero.",
            brief="Where the carriage is, when the drive has no zero.",
        ),
        option(
            "--first-motion-confirmed",
            "first_motion",
            topic=About.MOTION,
            metavar="SERIAL",
            help="Serial number of a drive that beltcomm never moved: somebody has made sure of its first motion. --yes does not.",
        ),
        option(
            "--hold-to-run",
            "hold",
            topic=About.MOTION,
            is_flag=False,
            flag_value="key",
            metavar="[=FD]",
            callback=held_key,
            help="The axis moves only while the space bar is held, or while a script writes to the file descriptor FD.",
        ),
        option(
            "--longest",
            "longest_s",
            topic=About.MOTION,
            type=QuantityType("longest_s"),
            help="How long a plan may move the axis that --yes answers for; 15min when left out.",
        ),
        option(
            "--simulate-first",
            topic=About.MOTION,
            is_flag=True,
            help="Play the plan on a twin of the axis first; beyond a limit nothing moves.",
        ),
    )
    return drive_options(function, needed=needed, of_run=of_run)


def writing_options(function: Function, *, needed: bool = True) -> Function:
    """Options of every verb that writes a run's parameters to a drive.

    Parameters
    ----------
    function : Function
        Of the verb.
    needed : bool
        As in :func:`drive_options`.
    """
    return with_options(
        function,
        partial(drive_options, needed=needed),
        existing_run_option,
        click.option("--save", is_flag=True, help="Make them permanent in the drive; else they hold until power-off."),
        yes_option,
        click.option("--dry-run", is_flag=True, help="Show what would be written and write nothing."),
        output_options,
    )


def _targets(ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> dict[str, Any]:
    """Values of ``--target``, as ``targets`` of axis.yaml has them."""
    found: dict[str, Any] = {}
    for text in values:
        key, equals, value = text.partition("=")
        name = TARGETS.get(key.strip())
        if not equals or name is None:
            raise click.BadParameter(f"{text!r} is no target; write one of {', '.join(f'{key}=...' for key in TARGETS)}")
        try:
            found[name] = value.strip() if name in ("at", "move") else _parsed(value, name, ctx)
        except UsageError as error:
            raise click.BadParameter(str(error)) from error
    return found


#: Word of ``--target`` -> entry of axis.yaml.
TARGETS = {
    "following": "following_error_m",
    "settled": "settled_error_m",
    "after": "settled_after_s",
    "at": "at",
    "move": "move",
    "distance": "distance_m",
}
target_option = option(
    "--target",
    "targets",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_targets,
    help="In place of a target of axis.yaml, once for each: following=0.5mm, settled=50um, after=0.3s, at=motor, carriage or both, "
    "move=T_A (limits there), distance=300mm.",
    brief="For one of axis.yaml: following=0.5mm, settled=50um.",
)
yes_option = click.option("--yes", is_flag=True, help="Answer every question with yes.")
force_option = option("--force", topic=About.MOTION, is_flag=True, help="Also what was edited by hand, and gains that are in doubt.")
axis_option = click.option("--axis", metavar="FILE", shell_complete=completion.axes, help="axis.yaml, or the name of a shipped axis.")
resume_option = option("--resume", topic=About.MOTION, is_flag=True, help="Go on with a run: unfinished records are repeated.")
new_run_option = click.option(
    "--run",
    type=click.Path(path_type=Path),
    shell_complete=completion.runs,
    help="Folder to make; a dated one under runs/ when left out.",
)
existing_run_option = click.option(
    "--run",
    type=click.Path(path_type=Path),
    shell_complete=completion.runs,
    callback=or_newest,
    help="Run folder to go on with; the newest when left out.",
)
pictures_option = option(
    "--pictures/--no-pictures", topic=About.OUTPUT, default=True, help="Pictures into RUN/pictures; made when left out."
)
asked_pictures_option = option(
    "--pictures/--no-pictures", topic=About.OUTPUT, default=False, help="Pictures into RUN/pictures; only when asked for."
)
cost_option = click.option("--cost/--no-cost", default=True, help="Say what a missing effect costs in tracking error; said when left out.")
run_argument = click.argument("run", required=False, type=click.Path(path_type=Path), shell_complete=completion.runs, callback=or_newest)
run_to_open_argument = click.argument(
    "run", required=False, type=click.Path(path_type=Path), shell_complete=completion.runs, callback=or_begun
)
several_runs_argument = click.argument("runs", nargs=-1, type=click.Path(path_type=Path), shell_complete=completion.runs)
payload_option = click.option(
    "--payload", "payload_kg", type=QuantityType("payload_kg"), help="Heaviest to be moved; the design must hold for it."
)
prefilter_option = option(
    "--prefilter",
    topic=About.CONTROLLER,
    type=WordChoice(["none", "notch", "butterworth"]),
    help="Of the velocity loop; the best one when left out.",
)
feedforward_option = option(
    "--feedforward",
    topic=About.CONTROLLER,
    type=WordChoice(["nonlinear", "linear", "none"]),
    help="nonlinear: inertia, viscous and Coulomb friction; linear: all friction as damping; none: no velocity either.",
)
sent_feedforward_option = option(
    "--feedforward",
    topic=About.CONTROLLER,
    type=WordChoice(["led", "compliant", "nonlinear", "linear", "none"]),
    help="In place of the design's, for this move only. led: of a drive without feedforward, the reference leads by the inverse of its "
    "loops (the rule there; none is without); compliant: the motor leads the carriage by the stretch of the belt; "
    "nonlinear: inertia, viscous and Coulomb friction; linear: all friction as damping; none: no velocity either.",
)
window_option = option(
    "--window",
    "window_m",
    topic=About.MOTION,
    type=Window(),
    help="How far the carriage may move from where it stands, stops included: -20mm..30mm, or 25mm either way. Plus is where the drive's "
    "position counts up. With it a record is possible where nobody knows the carriage's place.",
)
apply_option = option(
    "--apply",
    type=WordChoice(["keep", "restore", "save"]),
    help="Gains at the end: keep until power-off, restore the old ones (with --yes), save for good.",
    brief="Gains at the end: keep, restore or save.",
)
