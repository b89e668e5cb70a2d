"""The command ``beltcomm``: its verbs, loaded when one is called, signals that end it, and the exit code of whatever happens."""

from __future__ import annotations

import difflib
import gc
import importlib
import keyword
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

import click

from beltcomm import language
from beltcomm.cli.frame import Invocation
from beltcomm.cli.help import help_options
from beltcomm.cli.streams import prepare
from beltcomm.cli.terminal import fitted
from beltcomm.errors import LeaveNow
from beltcomm.language import tr
from beltcomm.version import __version__

#: s, within which a second Ctrl-C means: leave at once.
TWICE_S = 2.0


# The matrices here are tall and narrow: more threads cost more than they bring, and results must not depend on the number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: What a shell sets that wants words completed, or the lines that make it ask.
COMPLETING = "_BELTCOMM_COMPLETE"

#: Groups of verbs -> verb -> its line in ``--help-all``, in the order of the work.  The verb's own file is imported only when it is called.
GROUPS: dict[str, dict[str, str]] = {
    "Begin": {
        "init": "Write axis.yaml by questions from the data sheets.",
        "doctor": "What stands in the way: adapters, bus, drive; moves nothing.",
        "demo": "A hidden fault of a virtual axis, found in a minute.",
    },
    "Commission": {
        "commission": "All of it: identify, fit, friction, design, verify.",
        "identify": "Frequency responses, rising inside predicted limits.",
        "friction": "Constant-speed sweep: Coulomb and viscous friction.",
        "verify": "Predicted against measured tracking error of a move.",
        "apply": "Write the designed gains to the drive.",
        "rollback": "Write back what the drive had before, from any backup.",
        "move": "A small, safe move.",
        "calibrate": "What the drive's gains mean, by small steps.",
    },
    "Model and gains": {
        "fit": "Model with intervals from the recordings of a run.",
        "design": "Controller gains with margins from the model of a run.",
        "export": "The designed controller as YAML, C or structured text.",
        "convert": "Gains of a P-PI cascade as a PID controller, and back.",
    },
    "What is wrong": {
        "improve": "Diagnose, add, design, verify: before and after.",
        "compare": "Model against measurement: where does it fail?",
        "diagnose": "Which physical effect is missing in the model.",
        "add": "One more effect in the model: error before and after.",
        "remove": "One effect less.",
        "ladder": "All revisions of a model, down to the noise.",
        "effects": "The physical effects a model can have.",
    },
    "Runs and reports": {
        "open": "A run on a local page: model, design with sliders, live.",
        "runs": "The runs here, the newest first, and what is said of each.",
        "report": "Everything known of a run, as one page.",
        "watch": "Production moves judged by a run's model; reads only.",
        "trend": "One axis over many runs: what drifts.",
        "study": "Thousands of virtual axes, or a fleet's runs.",
        "bundle": "A run in one zip, for whoever helps: no paths, no user name.",
        "import": "Foreign measurements into a run folder.",
    },
    "Simulation, drives": {
        "simulate": "A virtual experiment from a model or plant into a run folder.",
        "serve": "The virtual drive for other processes, on a CAN interface.",
        "drives": "Drive adapters found, or why one is broken.",
        "trajectory": "A jerk-limited motion into a file.",
        "thesis": "What the design source compares, recomputed.",
    },
}

#: Group -> an example of it, and what that does.
EXAMPLES = {
    "Begin": ("beltcomm demo", "a hidden fault, found"),
    "Commission": ("beltcomm commission --drive can0", "shows its plan and asks"),
    "Model and gains": ("beltcomm design", "gains with margins"),
    "What is wrong": ("beltcomm improve", "what the model misses"),
    "Runs and reports": ("beltcomm open", "the newest run, a page"),
    "Simulation, drives": ("beltcomm commission --drive virtual", "no hardware"),
}

#: What the whole is, and what every verb has in common.
SUMMARY = "Commissions toothed-belt axes by itself: identified model, tuned loop, proof."
COMMON = (
    "Each command in a line: beltcomm --help-all    Of one: beltcomm COMMAND --help",
    "RUN: where none is named, the newest.    German screens: BELTCOMM_LANG=de",
    "Of a command, --help-all explains every option, --details shows what no screen has room for.",
    "Exit codes: 0 done, 1 refused or target missed, 2 wrong usage, 3 unusable data, 4 stopped for safety, 5 drive or bus.",
)

VERBS = {verb: words for group in GROUPS.values() for verb, words in group.items()}

#: Verbs of some seconds that make many things and drop few: they end before anything is worth collecting.
SHORT = ("report",)


class Verbs(click.Group):
    """The group of verbs; turns every outcome into one exit code and a sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All verbs in the order of the job."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a verb, its module imported only now; None for a word that is no verb."""
        if cmd_name not in VERBS:
            return None
        module = cmd_name + "_" * keyword.iskeyword(cmd_name)
        command: click.Command = importlib.import_module(f"beltcomm.cli.{module}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs for ``--help-all`` in groups, each with an example, without importing any."""
        for title, verbs in GROUPS.items():
            with formatter.section(f"{tr(title)}   ({tr('e.g.')} {EXAMPLES[title][0]})"):
                formatter.write_dl([(verb, tr(words)) for verb, words in verbs.items()])

    def overview(self) -> str:
        """Text of ``--help`` of the whole, one screen: each group's example and its verbs by name."""
        lines = [f"{tr('Usage')}: beltcomm COMMAND [OPTIONS] [RUN]", "", tr(SUMMARY), ""]
        for title, verbs in GROUPS.items():
            example, words = EXAMPLES[title]
            lines += [f"{tr(title):20}{example:36}{tr(words)}", f"  {'  '.join(verbs)}"]
        return "\n".join(fitted(line, sys.stdout) for line in (*lines, "", *map(tr, COMMON[:2])))

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[str | None, click.Command | None, list[str]]:
        """The command named first in ``args``.  Raises click.UsageError with the nearest verb."""
        name = args[0]
        if name not in VERBS and not name.startswith("-") and not ctx.resilient_parsing:
            close = difflib.get_close_matches(name, VERBS, n=1)
            hint = f"did you mean {close[0]}?" if close else f"the verbs are {', '.join(VERBS)}"
            raise click.UsageError(f"there is no verb {name!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command line and leave with its exit code, or return it when not ``standalone_mode``."""
        if COMPLETING in os.environ:
            importlib.import_module("beltcomm.cli.completion")
        words = list(sys.argv[1:] if args is None else args) or ["--help"]
        language.use(language.of_environment(os.environ))
        frame = Invocation(words)
        with like_ctrl_c(frame.note_end), twice_leaves():
            code = frame.guarded(
                lambda: click.Group.main(
                    self,
                    words,
                    prog_name or "beltcomm",
                    complete_var or COMPLETING,
                    standalone_mode=False,
                    windows_expand_args=windows_expand_args,
                    obj=frame,
                    **extra,
                )
            )
        if standalone_mode:
            sys.exit(code)
        return code


@click.command(cls=Verbs, context_settings={"max_content_width": 120}, help="\n\n".join((SUMMARY, *COMMON[1:])))
@help_options
@click.version_option(__version__, prog_name="beltcomm", help="The version, and nothing else.")
def cli() -> None:
    """Everything that can be typed."""


def main() -> None:
    """Entry point of the console script."""
    if sys.argv[1:2] and sys.argv[1] in SHORT:
        gc.disable()
    prepare()
    try:
        cli()
    finally:
        gc.freeze()  # the process ends: looking through all that it leaves took an eighth of a report


@contextmanager
def like_ctrl_c(noted: Callable[[], None]) -> Iterator[None]:
    """SIGTERM (``kill``, shutdown) and SIGHUP (closed terminal, dropped connection) raise KeyboardInterrupt in the main thread.

    Parameters
    ----------
    noted : callable
        Called first. From then on both are ignored: closing a terminal sends several, and none may disturb the restoring. A SIGHUP that
        was ignored before (``nohup``) stays so. Outside the main thread nothing changes.
    """
    names = ("SIGTERM", "SIGHUP")
    wanted = [signal.Signals[name] for name in names if name in signal.Signals.__members__]  # Windows has no SIGHUP
    if threading.current_thread() is not threading.main_thread():
        wanted = []
    before = {number: signal.getsignal(number) for number in wanted}
    mine = [number for number in wanted if before[number] is not signal.SIG_IGN]

    def end(_number: int, _frame: FrameType | None) -> None:
        for number in mine:
            signal.signal(number, signal.SIG_IGN)
        noted()
        raise KeyboardInterrupt

    for number in mine:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, before[number] or signal.SIG_DFL)


@contextmanager
def twice_leaves(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt as ever; another one within ``TWICE_S`` raises LeaveNow.

    Also where SIGINT is ignored: a script's job in the background is born deaf to it, and who ends the script must stop the axis too.
    Where it is handled by somebody else, and outside the main thread, nothing changes.

    Parameters
    ----------
    clock : callable
        Monotonic clock, s.
    """
    before = signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and before in (signal.default_int_handler, signal.SIG_IGN)
    heard: list[float] = []

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        now = clock()
        again = bool(heard) and now - heard[-1] <= TWICE_S
        heard.append(now)
        raise LeaveNow if again else KeyboardInterrupt

    if ours:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
