"""Terminals nobody has seen: widths, colours, character sets, pipes that close, signals, names that a terminal would obey."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import pty
import re
import select
import shutil
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from beltcomm.errors import BeltcommError
from beltcomm.runfolder import RunFolder
from strangers.outcome import NEVER, Outcome, judged

GROUP = "terminal"
PATIENCE_S = 300.0
#: What this program may tell a terminal: colours and weights, where the cursor stands, that a line is erased.
ALLOWED = re.compile(r"\x1b\[(?:[0-9;]*m|\?25[lh]|[0-9]*[ABCDGK]|2K)")
COLOUR = re.compile(r"\x1b\[[0-9;]*(?:3[0-9]|4[0-9]|9[0-9]|38;[0-9;]*)m")
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202eevil\x00\x08\r"
Steps = Callable[[int, "subprocess.Popen[bytes]"], None]


def environment(more: Mapping[str, str | None]) -> dict[str, str]:
    """That of a plain terminal, with what is given; None takes one out."""
    left_out = {"COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "CLICOLOR_FORCE", "PYTHONIOENCODING"}
    found = {name: value for name, value in os.environ.items() if name not in left_out} | {"TERM": "xterm-256color", "LC_ALL": "C.UTF-8"}
    for name, value in more.items():
        found.pop(name, None)
        if value is not None:
            found[name] = value
    return found


def in_terminal(
    words: Sequence[str],
    folder: Path,
    *,
    columns: int = 80,
    rows: int = 24,
    more: Mapping[str, str | None] | None = None,
    typed: bytes = b"",
    until: bytes = b"",
    then: Steps | None = None,
) -> tuple[int, str]:
    """Exit code and everything that the terminal got; the code is -999 where the command does not end.

    typed : once, before anything is read.   until, then : what is done with terminal and process once these bytes have come.
    """
    here, there = pty.openpty()
    fcntl.ioctl(there, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def own_terminal() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        [sys.executable, "-m", "beltcomm", *words],
        cwd=folder,
        stdin=there,
        stdout=there,
        stderr=there,
        env=environment(more or {}),
        preexec_fn=own_terminal,
    )
    os.close(there)
    if typed:
        os.write(here, typed)
    told, end, closed = b"", time.monotonic() + PATIENCE_S, False
    while time.monotonic() < end:
        if not closed and select.select([here], [], [], 0.1)[0]:
            try:
                told += os.read(here, 1 << 16)
            except OSError as error:
                if error.errno != errno.EIO:
                    raise
                closed = True
        elif process.poll() is not None:
            break
        if then is not None and until in told:
            step, then = then, None
            try:
                step(here, process)
                os.fstat(here)
            except OSError:
                closed = True
    code = process.poll()
    if code is None:
        process.kill()
        process.wait()
    with contextlib.suppress(OSError):
        os.close(here)
    return -999 if code is None else code, told.decode("utf-8", "replace")


def wrong_in(code: int, told: str, codes: Sequence[int]) -> str:
    """What must not be; "" for nothing."""
    never = next((word for word in NEVER if word in told), "")
    left = ALLOWED.sub("", told)
    obeyed = re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\x80-\x9f\u202a-\u202e]", left)
    if code not in codes:
        return f"exit code {code}: {told[-300:]}"
    return f"it says {never}" if never else f"the terminal is told {obeyed[0]!r}" if obeyed else ""


def too_wide(told: str, columns: int) -> str:
    """A line that is wider than the terminal although it could be broken; "" for none.   A command is not: it is copied as a whole."""
    for line in ALLOWED.sub("", told).replace("\r", "\n").split("\n"):
        if line.lstrip().startswith("beltcomm "):
            continue
        if len(line) > columns and len(line.split()) > 1 and max(map(len, line.split())) + len(line) - len(line.lstrip()) < columns:
            return f"{len(line)} columns on {columns}: {line}"
    return ""


def piped(words: Sequence[str], folder: Path, shell: str = "", **more: str | None) -> subprocess.CompletedProcess[bytes]:
    """The command in a shell.   shell : what stands behind it."""
    line = " ".join(["exec" if not shell.lstrip().startswith("|") else "", f"'{sys.executable}'", "-m beltcomm", *words, shell])
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"],
        cwd=folder,
        capture_output=True,
        timeout=PATIENCE_S,
        env=environment(more),
        check=False,
    )


COMPARE = ("compare", "run", "--no-pictures")
PLAN = ("commission", "--drive", "virtual", "--dry-run")
MOVING = ("identify", "--drive", "virtual", "--run", "moved", "--yes")


def cases(base: Path, folder: Path) -> Iterator[Outcome]:
    """All of them.   base : a commissioned run.   folder : for a copy of it."""
    place = folder / "terminal"
    shutil.copytree(base, place / "run")
    yield from sizes(place)
    yield from kinds(place)
    yield from character_sets(place)
    yield from pipes(place)
    yield from signals(place)
    yield from typed(place)
    yield from obeyed(place)


def sizes(place: Path) -> Iterator[Outcome]:
    for columns, words in ((40, COMPARE), (40, PLAN), (20, COMPARE), (1, COMPARE), (0, PLAN), (1000, COMPARE)):
        code, told = in_terminal(words, place, columns=columns)
        wide = too_wide(told, columns) if columns >= 40 else ""
        yield judged(GROUP, f"{words[0]}, {columns} columns", wrong_in(code, told, (0, 1)), wide)
    for columns in ("0", "-5", "abc", "99999999999", "1e3", ""):
        code, told = in_terminal(COMPARE, place, more={"COLUMNS": columns})
        yield judged(GROUP, f"COLUMNS={columns}", wrong_in(code, told, (0, 1)))
    code, told = in_terminal(MOVING, place, rows=1, columns=40)
    yield judged(GROUP, "identify, 40 columns, one row", wrong_in(code, told, (0, 1)) or _not_whole(place), too_wide(told, 40))


def kinds(place: Path) -> Iterator[Outcome]:
    for name, more in {
        "NO_COLOR": {"NO_COLOR": "1"},
        "TERM=dumb": {"TERM": "dumb"},
        "TERM=unknown": {"TERM": "unknown"},
        "without TERM": {"TERM": None},
        "TERM is empty": {"TERM": ""},
        "TERM that is none": {"TERM": "../../etc/passwd"},
        "TERM=vt100": {"TERM": "vt100"},
    }.items():
        told = ""
        for words in (COMPARE, ("fit", "nothing")):
            code, more_told = in_terminal(words, place, more=more)  # type: ignore[arg-type]
            told += more_told
        weak = "colours" if COLOUR.search(told) and name in ("NO_COLOR", "TERM=dumb", "TERM=unknown") else ""
        weak = weak or ("escapes" if "\x1b" in told and name in ("TERM=dumb", "TERM=unknown") else "")
        yield judged(GROUP, name, wrong_in(code, told, (2, 3)), weak)


def character_sets(place: Path) -> Iterator[Outcome]:
    for name, more in {
        "LC_ALL=C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        "LC_ALL=POSIX": {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        "ASCII": {"PYTHONIOENCODING": "ascii"},
        "Latin 1": {"PYTHONIOENCODING": "latin-1"},
        "code page 1252": {"PYTHONIOENCODING": "cp1252"},
        "code page 437": {"PYTHONIOENCODING": "cp437"},
        "a locale that is none": {"LC_ALL": "xx_YY.UTF-9"},
    }.items():
        for words in (COMPARE, PLAN, MOVING):
            done = piped([word.replace("moved", f"moved-{name.replace(' ', '-')}") for word in words], place, **more)
            told = (done.stdout + done.stderr).decode("utf-8", "replace")
            never = next((word for word in (*NEVER, "UnicodeEncodeError") if word in told), "")
            yield judged(
                GROUP,
                f"{name}: {words[0]}",
                f"exit code {done.returncode}: {never} {told[-200:]}" if never or done.returncode not in (0, 1) else "",
            )


def pipes(place: Path) -> Iterator[Outcome]:
    for name, shell, codes in (
        ("read by head", "| head -1", (0, 1, 141)),
        ("nobody reads", "| true", (0, 1, 141)),
        ("without standard output", ">&-", (0, 1, 2)),
        ("without standard error", "2>&-", (0, 1)),
        ("without standard input", "<&-", (0, 1)),
        ("without any", "<&- >&- 2>&-", (0, 1, 2)),
        ("standard output is full", "> /dev/full", (1, 2)),
        ("standard error is full", "2> /dev/full", (0, 1, 2)),
    ):
        for words in (
            COMPARE,
            (*COMPARE, "--json"),
            ("identify", "--drive", "virtual", "--run", f"piped-{name.replace(' ', '-')}", "--yes"),
        ):
            done = piped(words, place, shell)
            told = done.stderr.decode("utf-8", "replace")
            never = next((word for word in (*NEVER, "BrokenPipeError") if word in told), "")
            run = place / words[words.index("--run") + 1] if "--run" in words else None
            moved = run is not None and done.returncode in (0, 1) and not _sound(run)
            broken = f"{never} {told[-200:]}" if never else f"exit code {done.returncode}" if done.returncode not in codes else ""
            yield judged(
                GROUP,
                f"{name}: {' '.join(words[:1])}{' --json' * ('--json' in words)}",
                broken or ("its run is not whole" if moved else ""),
            )


def signals(place: Path) -> Iterator[Outcome]:
    def resized(here: int, process: subprocess.Popen[bytes]) -> None:
        for columns in (30, 200, 1, 80):
            fcntl.ioctl(here, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            process.send_signal(signal.SIGWINCH)
            time.sleep(0.2)

    def paused(_: int, process: subprocess.Popen[bytes]) -> None:
        process.send_signal(signal.SIGTSTP)
        time.sleep(1.0)
        process.send_signal(signal.SIGCONT)

    def sent(number: int) -> Steps:
        return lambda _, process: process.send_signal(number)

    def twice(_: int, process: subprocess.Popen[bytes]) -> None:
        process.send_signal(signal.SIGINT)
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)

    def closed(here: int, _: subprocess.Popen[bytes]) -> None:
        os.close(here)

    def key(letter: bytes) -> Steps:
        return lambda here, _: os.write(here, letter) and None

    for name, step, codes in (
        ("SIGWINCH while it moves", resized, (0, 1)),
        ("paused and on again", paused, (0, 1, 4, 5)),
        ("SIGINT", sent(signal.SIGINT), (4,)),
        ("SIGINT twice", twice, (4, 5, 130)),
        ("SIGTERM", sent(signal.SIGTERM), (4, 143)),
        ("SIGHUP", sent(signal.SIGHUP), (4, 129)),
        ("SIGPIPE", sent(signal.SIGPIPE), (0, 1, 4)),
        ("SIGUSR1", sent(signal.SIGUSR1), (0, 1, 4, -signal.SIGUSR1)),
        ("the terminal is closed", closed, (4, 129)),
        ("Ctrl-C typed", key(b"\x03"), (4,)),
    ):
        run = f"signal-{name.replace(' ', '-')}"
        words = [word.replace("moved", run) for word in MOVING]
        code, told = in_terminal(words, place, until=b"frf", then=step)
        yield judged(GROUP, f"{name} in a motion", wrong_in(code, told, codes) or ("" if _sound(place / run) else "its run is not whole"))


def typed(place: Path) -> Iterator[Outcome]:
    """Answers to the question before a motion: whatever is no yes moves nothing, and is asked again until it is left with q."""
    words = ("identify", "--drive", "virtual", "--run", "asked")
    for name, answer in {
        "the end of input": b"\x04",
        "an escape": b"\x1b[A\x1b[200~yes\x1b[201~\nq\n",
        "64 KB": b"n" * 4000 + b"\nq\n",
        "other bytes": b"\xff\xfe\x9b\nq\n",
        "an empty line": b"\nq\n",
        "yes and more": b"yes; rm -rf /\nq\n",
    }.items():
        code, told = in_terminal(words, place, until=b"[y/N]", then=lambda here, _, answer=answer: os.write(here, answer) and None)
        moved = any((place / "asked" / "recordings").glob("*.csv")) if (place / "asked").is_dir() else False
        broken = "it moved" if moved else wrong_in(code, re.sub(r"[\x00-\x1f\x80-\x9f\ufffd]+", " ", told), (1, 2, 4))
        yield judged(GROUP, f"answered by {name}", broken)
        shutil.rmtree(place / "asked", ignore_errors=True)


def obeyed(place: Path) -> Iterator[Outcome]:
    """Names and sentences of a stranger's run that a terminal would obey."""
    run = place / "evil"
    shutil.copytree(place / "run", run)
    escaped = EVIL.encode("unicode_escape").decode()
    axis = run / "axis.yaml"
    axis.write_text(re.sub(r"(?m)^name:.*$", lambda _: f'name: "{escaped}"', axis.read_text(encoding="utf-8"), count=1), encoding="utf-8")
    (run / "journal.txt").write_text(f"2026-01-01 00:00:00  {EVIL.replace(chr(13), ' ')}\n" * 3, encoding="utf-8")
    (run / "results" / "notes.yaml").write_text(f'"{escaped}": "{escaped}"\n', encoding="utf-8")
    for words in (
        ("compare", "evil", "--no-pictures"),
        ("report", "evil"),
        ("ladder", "evil"),
        ("verify", "--drive", "virtual", "--run", "evil", "--yes"),
        ("rollback", "--drive", "virtual", "--run", "evil", "--backup", "list"),
        ("bundle", "evil", "--out", "evil.zip"),
        ("fit", EVIL.replace("\x00", "")),
        ("export", "evil", "--format", "c", "--out", "evil.c", "--yes"),
        ("trend", "evil", "run"),
    ):
        code, told = in_terminal(words, place)
        yield judged(GROUP, f"escapes in names: {words[0]}", wrong_in(code, told, (0, 1, 2, 3)))
    code_file = place / "evil.c"
    text = code_file.read_text(encoding="utf-8") if code_file.is_file() else ""
    yield judged(GROUP, "escapes in exported C", "one is in it" if "\x1b" in text or "\u202e" in text else "")


def _sound(run: Path) -> bool:
    try:
        opened = RunFolder.open(run)
        for name in opened.finished_names():
            opened.recording(name)
    except BeltcommError:
        return not run.exists()
    return True


def _not_whole(place: Path) -> str:
    return "" if _sound(place / "moved") else "its run is not whole"
