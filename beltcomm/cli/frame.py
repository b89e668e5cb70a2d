"""Frame of every verb: results to stdout, talk to stderr, one exit code for whatever happens."""

from __future__ import annotations

import errno
import importlib
import os
import re
import shlex
import shutil
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

import click

from beltcomm.borders import for_file_name, for_json, for_terminal
from beltcomm.cli.aftermath import OF_VALUES, aftermath, again_command, edited_files
from beltcomm.cli.streams import NAMES
from beltcomm.cli.terminal import echo, failure
from beltcomm.errors import BeltcommError, DataError, UsageError
from beltcomm.given import pasted, place
from beltcomm.journal import events_of
from beltcomm.language import told, tr
from beltcomm.locks import UNWRITABLE
from beltcomm.version import __version__

if TYPE_CHECKING:
    from beltcomm.axis import Axis
    from beltcomm.cli.talk import PlainTalk, RichTalk
    from beltcomm.cli.traces import Traces
    from beltcomm.talk import Talk

#: Exit code of a broken-off command: that of a safety stop, which is what Ctrl-C is on a machine.
INTERRUPTED = 4
#: What it says of a path that cannot be: too long, no folder, a folder, in a circle.
NO_PATH = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.ELOOP)
#: Verbs that go on with ``--resume``, and all that record.
RESUMABLE = ("commission", "identify")
RECORDING = (*RESUMABLE, "friction", "verify", "simulate")
#: A line that ends with what to type next, and why.
NEXT = re.compile(r"Next: (beltcomm (?:(?!   \().)+)(?:   \((.*)\)\.?)?")
#: The same of a doctor: words around a command in backticks.
DOCTORS_NEXT = re.compile(r"next: ([^`]*)`(beltcomm [^`]+)`(.*)")
#: The same of a failed command: command, why, what comes after it.
LEFT_NEXT = re.compile(r"(beltcomm (?:(?!   \(|; |, then ).)+)(?:   \(([^)]*)\))?(?:[;,] (.*))?")
#: The shipped axis that a virtual drive is commissioned with when no other is given.
VIRTUAL_AXIS = "egc-70-600"
#: What a command without memory says, and what a loader of libraries says then in place of ``MemoryError``.
_NO_MEMORY = "this computer has no memory left for it; end other programs, or give shorter or fewer records"
_SAID_WITHOUT_MEMORY = ("annot allocate memory", "failed to map segment", "cannot apply additional memory protection")


class CommandResult(Protocol):
    """Protocol of the result of a function of :mod:`beltcomm.api`."""

    @property
    def exit_code(self) -> int:
        """0, or 1 when the target was missed."""
        ...

    def to_json(self) -> Mapping[str, Any]:
        """Everything, for programs."""
        ...

    def lines(self) -> Iterable[str]:
        """Result as lines for people."""
        ...


def _lacks_memory(error: BaseException | None) -> bool:
    """True if a library could not be loaded, or a program started, for want of memory: that has other errors than Python's own."""
    while error is not None:
        if isinstance(error, MemoryError) or any(words in str(error) for words in _SAID_WITHOUT_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


class Invocation:
    """One call of the command line.

    Attributes
    ----------
    run : Path or None
        The run folder, once known: where the log of an unexpected error goes.
    verbose
        -v once or more.
    details
        --details.
    ended
        By a signal from outside.
    drive, bus_log
        As given on the command line.
    """

    def __init__(self, words: list[str]) -> None:
        self.words = words
        self.json = "--json" in words
        self.verbose = 0
        self.details = False
        self.ended = False
        self._run: Path | None = None
        self._events_before = 0
        self.drive = ""
        self.bus_log = False
        self._traces: Traces | None = None
        self._talk: PlainTalk | RichTalk | None = None

    @property
    def run(self) -> Path | None:
        """The run folder, once known."""
        return self._run

    @run.setter
    def run(self, folder: Path | None) -> None:
        self._run = None if folder is None else place(folder)  # a path that cannot be is said before anything is done there
        self._events_before = len(events_of(folder)) if folder else 0

    def _events(self) -> list[str]:
        """Events that this command wrote into the run's journal; how an earlier one left the drive says nothing of today."""
        return events_of(self._run)[self._events_before :] if self._run else []

    def guarded(self, command: Callable[[], Any]) -> int:
        """Run a command and return its exit code; every exception becomes a sentence on stderr.  Then what it leaves behind is written.

        Parameters
        ----------
        command : callable
            Its exit code counts where it returns one.
        """
        code = self._guarded(command)
        if self._traces is not None:
            verb = self.words[0]
            for line in self._traces.leave(self.run or run_folder(None, verb), verb, code):
                echo([f"beltcomm: {line}"], sys.stderr)
        return code

    def options(self, **values: Any) -> Any:
        """:func:`options_of` for a command that opens a drive, whose frames may have to be kept.

        Parameters
        ----------
        **values : Any
            As of :func:`options_of`, but for ``drive``.
        """
        from beltcomm.cli.traces import Traces

        self._traces = Traces(self.drive, self.bus_log)
        return options_of(**values, drive=self._traces.drive_options() or None)

    def _guarded(self, command: Callable[[], Any]) -> int:
        try:
            outcome = command()
            sys.stdout.flush()
            return outcome if isinstance(outcome, int) else 0
        except BeltcommError as error:
            return self._failed(str(error), error.exit_code, self._aftermath(error), error.diagnosis)
        except click.ClickException as error:
            context = getattr(error, "ctx", None)
            remedy = f" (see {context.command_path} --help)" if context is not None else ""
            return self._failed(" ".join(error.format_message().split()).rstrip(".") + remedy, error.exit_code)
        except (KeyboardInterrupt, click.Abort) as error:
            cause = error.__cause__  # click takes the end of any file for one at a question
            return self._unexpected(cause) if isinstance(cause, EOFError) else self._interrupted()
        except BrokenPipeError:  # the reader of our output has gone: nobody is left to tell
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except OSError as error:
            if self.ended:
                return self._interrupted()
            if error.errno not in UNWRITABLE + NO_PATH or not error.filename:
                return self._unexpected(error)
            if error.filename in NAMES:
                return self._failed(
                    f"{error.filename} cannot be written: {error.strerror}; make room, or send it elsewhere", UsageError.exit_code
                )
            remedy = "check the path" if error.errno in NO_PATH else "choose a folder that can be written, or make room"
            return self._failed(f"{error.filename} cannot be used: {error.strerror}; {remedy}", UsageError.exit_code)
        except MemoryError:
            return self._failed(_NO_MEMORY, 1)
        except Exception as error:  # what nobody thought of: a sentence and a log with the traceback, never a bare traceback
            if self.ended:  # with the terminal gone, whatever writes to it fails
                return self._interrupted()
            return self._unexpected(error)

    def _left_behind(self) -> str:
        """Axis and drive as they were left, by the last event of the run's journal: nothing is promised that did not happen."""
        last = (self._events() or [""])[-1]
        backup = "" if self._run is None else f", they are in {self._run / 'results' / 'backup.yaml'}"
        return {
            "restored": "; the axis is stopped and the drive's own gains are restored",
            "not restored": "; the drive's own gains are NOT restored: `beltcomm rollback` writes them again",
            "left at once": f"; left at once, with the axis stopped: the drive's own gains are NOT restored{backup}; "
            "`beltcomm rollback` writes them again",
        }.get(last, "")

    def _unexpected(self, error: Exception) -> int:
        """The sentence and the log for what nobody thought of; exit code 1."""
        if _lacks_memory(error):
            return self._failed(_NO_MEMORY, 1)
        log = self._write_log()
        if self.verbose:
            click.echo(for_terminal(traceback.format_exc()), err=True)
        where = f"; details are in {log}" if log else ""
        if isinstance(error, OF_VALUES) and (edited := edited_files([*filter(None, [self._run]), *map(Path, self.words)])):
            return self._failed(
                f"{edited} is not as beltcomm wrote it, and a value in it cannot be used here ({error}); bring it back, or delete it and "
                f"make it again{where}",
                DataError.exit_code,
            )
        return self._failed(f"an unexpected error stopped this command: {type(error).__name__}: {error}{where}", 1)

    def show(self, result: CommandResult) -> int:
        """Print a result, as one JSON object or as lines; returns its exit code."""
        lines, details = list(result.lines()), list(getattr(result, "details", ()))
        told = getattr(result, "told", 0) if sys.stdout.isatty() and sys.stderr.isatty() else 0
        self.print(result.to_json(), [*lines[told:], *(["", *details] if self.details and details else [])])
        return result.exit_code

    def print(self, data: Mapping[str, Any], lines: Iterable[str]) -> None:
        """Print a result given as a mapping for ``--json`` and lines for people."""
        self._end_talk(done=True)
        if self.json:
            from beltcomm.result import jsonable  # numpy, which a command that prints help does without

            click.echo(for_json(jsonable(data)), file=sys.stdout)
            return
        echo(_typed(lines), sys.stdout)

    def line(self) -> str:
        """The command as it was typed."""
        return shlex.join(["beltcomm", *self.words])

    def talk(self) -> Talk:
        """Listener that shows progress and questions on stderr."""
        from beltcomm.cli.talk import terminal_talk

        if self._talk is None:
            self._talk = terminal_talk(self.verbose, self.details)
        return self._talk

    def _end_talk(self, done: bool = False) -> None:
        """Before anything else is printed: a progress line must not stay in the terminal.   done : the last phase came to its end."""
        if self._talk is not None:
            self._talk.close(done)

    def note_end(self) -> None:
        """Somebody ends this program from outside; perhaps nobody reads any more."""
        self.ended = True

    def _interrupted(self) -> int:
        return self._failed(f"interrupted{self._left_behind()}{self._kept()}", INTERRUPTED, self._goes_on())

    def _goes_on(self) -> dict[str, str]:
        """The command that goes on with an interrupted run; only a verb that can resume promises that."""
        verb = self.words[0] if self.words else ""
        if verb not in RESUMABLE or not self.run or not any((self.run / "recordings").glob("*.csv*")):
            return {}
        return {"next": f"{again_command(self.words, self.run, resumes=True)}   (goes on where it stopped)"}

    def _kept(self) -> str:
        """Records of an interrupted run that are kept, in words."""
        verb = self.words[0] if self.words else ""
        if not self.run or not self.run.is_dir() or verb not in RECORDING:
            return ""
        if verb in RESUMABLE and not any((self.run / "recordings").glob("*.csv*")):
            return "; nothing was recorded yet"
        return f"; what was recorded is kept in {self.run}"

    def _aftermath(self, error: BeltcommError) -> Mapping[str, str]:
        """State of drive and run folder after a failed command; empty without a run folder, or where a wrong option stopped it."""
        verb = self.words[0] if self.words else ""
        unbegun = error.exit_code == UsageError.exit_code and error.run is None
        if verb not in RECORDING or self.run is None or not self.run.is_dir() or unbegun:
            return {}
        return aftermath(self.words, self.run, self._events(), self.drive, error, resumes=verb in RESUMABLE)

    def _failed(
        self, sentence: str, code: int, left: Mapping[str, str] = MappingProxyType({}), diagnosis: Mapping[str, object] | None = None
    ) -> int:
        try:
            self._end_talk()
            failure(f"beltcomm: {told(sentence)}", sys.stderr)
            echo(_left_lines(left), sys.stderr)
            if self.json:
                more = {} if diagnosis is None else {"diagnosis": diagnosis}
                click.echo(for_json({"error": sentence, "exit_code": code, **left, **more}), file=sys.stdout)
        except OSError as error:
            if not self.ended and error.filename not in NAMES:
                raise
        return code

    def _write_log(self) -> str:
        """The traceback into the run folder, or the temporary folder when there is none; returns its path, "" on failure."""
        text = f"beltcomm {__version__}\nbeltcomm {' '.join(self.words)}\n\n{traceback.format_exc()}"
        for folder in (self.run, None):
            if folder is not None and not folder.is_dir():
                continue
            try:
                with tempfile.NamedTemporaryFile(
                    "w", prefix="beltcomm-error-", suffix=".log", dir=folder, delete=False, encoding="utf-8"
                ) as file:
                    file.write(text)
                return file.name
            except OSError:
                continue
        return ""


def _left_lines(left: Mapping[str, str]) -> Iterator[str]:
    """Lines on the state that a failed command left; the command to type next stands alone on its line."""
    for label, words in left.items():
        first = LEFT_NEXT.fullmatch(words) if label == "next" else None
        if first is None:
            yield f"{label.capitalize() + ':':8}{words}"
            continue
        yield from _typed([f"Next: {first[1]}   ({first[2]})" if first[2] else f"Next: {first[1]}"])
        if first[3]:
            yield f"Then:   {first[3].removeprefix('then ')}"


def _typed(lines: Iterable[str]) -> Iterator[str]:
    """Next command, alone on its line, as this terminal finds it: by its path where no folder of ``PATH`` holds the program."""
    from beltcomm.result import Line, command_lines

    program = Path(sys.argv[0])
    there = ""
    if program.name == "beltcomm" and shutil.which("beltcomm") is None and program.is_file():
        there = pasted(os.path.relpath(program))
    for line in lines:
        rows: Sequence[str] = [line]
        if not isinstance(line, Line) and (told := DOCTORS_NEXT.fullmatch(line)):
            why = " ".join(part for part in (told[1].strip(" ,"), told[3].strip(" ,")) if part)
            line = f"Next: {told[2]}   ({why or tr('one step more')})"
        if not isinstance(line, Line) and (found := NEXT.fullmatch(line)):
            rows = command_lines(found[1], found[2] or "")
        for row in rows:
            command = isinstance(row, Line) and any(style == "command" for _, style in row.parts)
            yield Line("    ", (re.sub(r"^beltcomm", lambda _: there, row.strip()), "command")) if command and there else row


def api(home: str = "beltcomm.api") -> Any:
    """:mod:`beltcomm.api`, imported when a verb runs: numba takes longer to import than ``--help`` may last.

    Parameters
    ----------
    home : str
        Module of a function that needs no machine; without what moves one it is there in half the time.
    """
    from beltcomm.cli import kernels

    module = importlib.import_module(home)
    kernels.listen()
    return module


def axis_for(axis: str | None, drive: str, run: Path | None, resume: bool) -> Axis:
    """The axis a machine verb works on: ``--axis``, else that of a resumed run, else the shipped one for a virtual drive.

    Parameters
    ----------
    axis : str or None
        Of ``--axis``; None without it.
    drive : str
        As for ``--drive``.
    run : Path or None
        Of ``--run``; None without it.
    resume : bool
        True if the run goes on.

    Raises
    ------
    UsageError
        When there is none, or its file is wrong.
    """
    from difflib import get_close_matches

    from beltcomm.axis import load_axis
    from beltcomm.drive import simulated

    if axis is not None:
        return load_axis(axis)
    if resume and run is not None and (run / "axis.yaml").is_file():
        return load_axis(run / "axis.yaml")
    if simulated(drive):
        from beltcomm.jobs.virtual_axis import axis_behind

        return load_axis(axis_behind(drive) or VIRTUAL_AXIS)
    if get_close_matches(drive.partition(":")[0], ["virtual"], cutoff=0.7):
        raise UsageError(f"there is no drive {drive}, did you mean virtual?")
    raise UsageError(f"--drive {drive} moves a real axis, so --axis is needed; write its axis.yaml with `beltcomm init`")


def run_folder(run: Path | None, name: str) -> Path:
    """``--run``, or a dated folder ``runs/NAME-DATE-TIME``.   The clock is read here: the core has none.

    Parameters
    ----------
    run : Path or None
        Of ``--run``; None without it.
    name : str
        Of the axis.
    """
    from datetime import datetime

    if run is not None:
        return run
    return Path("runs") / f"{for_file_name(name.lower(), 'axis')}-{datetime.now():%Y%m%d-%H%M%S}"


def options_of(**values: Any) -> Any:
    """``api.Options`` from what was given on the command line, and the clock on the wall; its defaults hold for the rest.

    Parameters
    ----------
    **values : Any
        By name; None counts as not given.
    """
    import time

    return api("beltcomm.experiments.options").Options(
        wall_clock=time.time, **{name: value for name, value in values.items() if value is not None}
    )


def today() -> str:
    """Date and time as ISO 8601, to the second."""
    from datetime import datetime

    return datetime.now().isoformat(timespec="seconds")
