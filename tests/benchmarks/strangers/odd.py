"""Places, limits, environments and values that nobody plans for: pipes in a run, a working directory that has gone, no descriptors left."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from strangers.outcome import NEVER, Outcome, judged

GROUP = "odd"
PATIENCE_S = 240.0
COMPARE, REPORT = ("compare", "run", "--no-pictures"), ("report", "run")
VERIFY = ("verify", "--drive", "virtual", "--run", "run", "--yes")
IDENTIFY = "BELTCOMM identify --drive virtual --run new --yes"
PLAN = ("commission", "--drive", "virtual", "--dry-run")
Limit = tuple[int, int]


@dataclass(frozen=True)
class Odd:
    """words : of the command.   before : what is done in its folder.   shell : instead of the command, BELTCOMM stands for it.
    limits : of the process.   more : of its environment.   codes : that it may end with."""

    words: Sequence[str] = ()
    before: Callable[[Path], object] = lambda _: None
    shell: str = ""
    limits: Sequence[Limit] = ()
    more: Mapping[str, str] = field(default_factory=dict)
    codes: Sequence[int] = (0, 1, 2, 3, 5)


def pipe(place: str) -> Callable[[Path], None]:
    """A named pipe in place of a file."""

    def made(case: Path) -> None:
        (case / place).unlink(missing_ok=True)
        (case / place).parent.mkdir(exist_ok=True)
        os.mkfifo(case / place)

    return made


def folder(place: str) -> Callable[[Path], None]:
    """A folder in place of a file."""

    def made(case: Path) -> None:
        (case / place).unlink(missing_ok=True)
        (case / place / "x").mkdir(parents=True)

    return made


def text(place: str, content: str | bytes) -> Callable[[Path], object]:
    """A file with this content."""
    data = content.encode() if isinstance(content, str) else content
    return lambda case: (case / place).write_bytes(data)


def of_axis(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """The run's axis file, changed."""
    return lambda case: (case / "run" / "axis.yaml").write_bytes(change((case / "run" / "axis.yaml").read_bytes()))


def many(case: Path) -> None:
    """A hundred thousand files where a few are meant."""
    for number in range(100_000):
        os.close(os.open(case / "run" / "results" / f"x{number}.txt", os.O_CREAT | os.O_WRONLY))


def table(*rows: str) -> Callable[[Path], object]:
    """A foreign table."""
    return text("a.csv", "\n".join(rows) + "\n")


IMPORT = ("import", "a.csv", "--run", "new", "--axis", "egc-70-600")
ROWS = [f"{k / 1000},{k % 7},{k}" for k in range(40)]
CASES: dict[str, Odd] = {
    **{f"{place} is a pipe: {words[0]}": Odd(words, pipe(f"run/{place}")) for place, words in (
        ("axis.yaml", COMPARE), ("run.yaml", VERIFY), ("journal.txt", VERIFY), ("events.jsonl", VERIFY), (".lock", COMPARE),
        ("kept/fit.json", COMPARE), ("results/backup.yaml", VERIFY), ("designs/final.yaml", VERIFY), ("recordings/x.csv", COMPARE),
        ("recordings/x.yaml", COMPARE), ("journal.txt", ("bundle", "run")), ("report.html", REPORT), ("models/x.yaml", REPORT),
    )},
    **{f"{place} is a folder: {words[0]}": Odd(words, folder(f"run/{place}")) for place, words in (
        ("axis.yaml", COMPARE), ("journal.txt", VERIFY), ("events.jsonl", VERIFY), (".lock", COMPARE), ("kept/fit.json", COMPARE),
        ("results/backup.yaml", VERIFY), ("recordings/x.csv", COMPARE), ("report.html", REPORT),
    )},
    "recordings is a file": Odd(COMPARE, lambda case: (shutil.rmtree(case / "run/recordings"), text("run/recordings", "x")(case))),
    "a run that is a file": Odd(("fit", "a"), text("a", "x")),
    "100 000 files more": Odd(COMPARE, many),
    "the axis in UTF-16": Odd(COMPARE, of_axis(lambda data: data.decode().encode("utf-16"))),
    "the axis with CRLF and BOM": Odd(COMPARE, of_axis(lambda data: b"\xef\xbb\xbf" + data.replace(b"\n", b"\r\n"))),
    "the axis twice": Odd(COMPARE, of_axis(lambda data: data + data)),
    "the axis as two documents": Odd(COMPARE, of_axis(lambda data: data + b"\n---\n" + data)),
    "the axis of nulls": Odd(COMPARE, of_axis(lambda data: bytes(len(data)))),
    "a run called -x": Odd(shell="mv run ./-x; BELTCOMM fit -- -x"),
    "a run with a line end in its name": Odd(shell="mv run 'a\nb'; BELTCOMM report 'a\nb'"),
    "a run of other bytes": Odd(shell="mv run $'\\xff\\xfe'; BELTCOMM report $'\\xff\\xfe'"),
    "a run called $(touch owned)": Odd(shell="mv run '$(touch owned)'; BELTCOMM fit '$(touch owned)'; test ! -e owned"),
    "the root as run": Odd(("fit", "/")),
    "no name as run": Odd(("fit", "")),
    "/dev/null as run": Odd(("verify", "--drive", "virtual", "--run", "/dev/null", "--yes")),
    "/dev/zero is imported": Odd(("import", "/dev/zero", "--run", "new", "--axis", "egc-70-600")),
    "/proc/self/mem is imported": Odd(("import", "/proc/self/mem", "--run", "new", "--axis", "egc-70-600")),
    "/proc/cpuinfo is imported": Odd(("import", "/proc/cpuinfo", "--run", "new", "--axis", "egc-70-600")),
    "the axis from standard input": Odd(shell="BELTCOMM commission --drive virtual --dry-run --axis /dev/stdin < run/axis.yaml"),
    "the working directory has gone": Odd(shell="mkdir gone; cd gone; rmdir ../gone; BELTCOMM effects"),
    "it has gone, with a motion": Odd(shell="mkdir gone; cd gone; rmdir ../gone; BELTCOMM identify --drive virtual --yes"),
    "yes for ever": Odd(shell="yes | BELTCOMM identify --drive virtual --run new", codes=(0, 1, 2)),
    "questions and --json": Odd(("identify", "--drive", "virtual", "--run", "new", "--json")),
    "16 descriptors": Odd(COMPARE, limits=[(resource.RLIMIT_NOFILE, 16)]),
    "16 descriptors and a page": Odd(REPORT, limits=[(resource.RLIMIT_NOFILE, 16)]),
    "200 MB of memory": Odd(COMPARE, limits=[(resource.RLIMIT_AS, 200 << 20)], codes=(0, 1, 2, 3, 5)),
    "500 MB of memory": Odd(("diagnose", "run"), limits=[(resource.RLIMIT_AS, 500 << 20)]),
    "small stack": Odd(COMPARE, limits=[(resource.RLIMIT_STACK, 256 << 10)]),
    "no home": Odd(VERIFY, more={"HOME": "/nonexistent", "XDG_STATE_HOME": "", "XDG_CACHE_HOME": ""}),
    "state in a file": Odd(VERIFY, text("state", "x"), more={"XDG_STATE_HOME": "state"}),
    "no temporary folder": Odd(REPORT, more={"TMPDIR": "/nonexistent"}),
    "the caches nowhere": Odd(COMPARE, more={"NUMBA_CACHE_DIR": "/dev/null/x", "XDG_CACHE_HOME": "/dev/null"}),
    "warnings are errors": Odd(REPORT, more={"PYTHONWARNINGS": "error"}),
    "without assertions": Odd(VERIFY, more={"PYTHONOPTIMIZE": "2"}),
    "a time zone that is none": Odd(VERIFY, more={"TZ": "Nowhere/Nothing"}),
    "threads that are none": Odd(COMPARE, more={"OPENBLAS_NUM_THREADS": "abc", "OMP_NUM_THREADS": "-3", "NUMBA_NUM_THREADS": "0"}),
    "a backend that is none": Odd(REPORT, more={"MPLBACKEND": "nothing", "MPLCONFIGDIR": "/dev/null"}),
    "PYTHONPATH of a stranger": Odd(shell="echo 'open(\"owned\",\"w\")' > numpy.py; PYTHONPATH=. BELTCOMM compare run; test ! -e owned"),
    "one column": Odd(IMPORT, table("t", *(row.split(",")[0] for row in ROWS))),
    "a head and nothing": Odd(IMPORT, table("t_s,torque_nm,position_rad")),
    "time that stands": Odd(IMPORT, table("t_s,torque_nm,position_rad", *("0," + row.partition(",")[2] for row in ROWS))),
    "time backwards": Odd(IMPORT, table("t_s,torque_nm,position_rad", *reversed(ROWS))),
    "all the same name": Odd(IMPORT, table("t_s,t_s,t_s", *ROWS)),
    "numbers at the end of all": Odd(IMPORT, table("t_s,torque_nm,position_rad", *(f"{k / 1000},1e308,-1e308" for k in range(40)))),
    "quotes without end": Odd(IMPORT, text("a.csv", '"' * 1_000_001)),
    "a formula": Odd(IMPORT, table("t_s,torque_nm,=cmd|' /C calc'!A0", *ROWS)),
    **{f"--seed {seed}": Odd((*PLAN, "--seed", seed)) for seed in ("-1", "1e100", "9" * 60, "nan", "٣")},
    **{f"--set {entry}": Odd((*IMPORT, "--set", entry), table("t_s,torque_nm,position_rad", *ROWS)) for entry in (
        "motor.inertia=nan", "a.b.c.d=1", "motor.__class__=1", "=", "travel.max_m=1e400", "name=[1,2]")},
    **{f"study, {' '.join(words)}": Odd(("study", "tolerances", "--out", "out", *words)) for words in (
        ("--workers", "-1", "--limit", "1"), ("--workers", "1000000000", "--limit", "1"), ("--limit", "-5"), ("--limit", "0"))},
    "trend of one run three times": Odd(("trend", "run", "run", "run")),
    "completion of evil names": Odd(shell="mkdir '$(touch owned)' 'a;touch owned'; COMP_WORDS='beltcomm fit ' COMP_CWORD=2 "
        "_BELTCOMM_COMPLETE=bash_complete BELTCOMM; test ! -e owned"),
    "two at once in one run": Odd(shell=f"{IDENTIFY} & {IDENTIFY}; wait; BELTCOMM fit new"),
    "the run is moved meanwhile": Odd(shell="BELTCOMM verify --drive virtual --run run --yes & sleep 2.5; mv run moved; wait $!"),
    "the run is deleted meanwhile": Odd(shell="BELTCOMM verify --drive virtual --run run --yes & sleep 2.5; rm -rf run; wait $!"),
    "stopped for a while": Odd(shell=f"{IDENTIFY} & sleep 4; kill -STOP $!; sleep 3; kill -CONT $!; wait $!"),
}  # fmt: skip


def cases(base: Path, place: Path, names: Sequence[str] = ()) -> Iterator[Outcome]:
    """All of them, or those with these words in their names.   base : a commissioned run.   place : for copies of it."""
    for number, (name, odd) in enumerate(CASES.items()):
        if names and not any(word in name for word in names):
            continue
        case = place / f"odd-{number}"
        shutil.copytree(base, case / "run")
        odd.before(case)
        yield judged(GROUP, name, *wrong(odd, case))
        shutil.rmtree(case, ignore_errors=True)


def wrong(odd: Odd, case: Path) -> tuple[str, str]:
    """What is broken and what is weak."""
    program = f"'{sys.executable}' -m beltcomm"
    command = ["bash", "-c", odd.shell.replace("BELTCOMM", program)] if odd.shell else [sys.executable, "-m", "beltcomm", *odd.words]

    def limited() -> None:
        for number, bound in odd.limits:
            resource.setrlimit(number, (bound, bound))

    with subprocess.Popen(
        command,
        cwd=case,
        env={**os.environ, **odd.more},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=limited,
        start_new_session=True,
    ) as process:
        try:
            out, err = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return "it does not end", ""
    said = (out + err).decode("utf-8", "replace")
    never = next((word for word in NEVER if word in said), "")
    if never or process.returncode not in odd.codes:
        return f"exit code {process.returncode} {never}: {said[-280:]}", ""
    return "", "" if said.strip() or not process.returncode else f"exit code {process.returncode} without a word"
