"""Unlucky moments: every command that writes, killed by SIGKILL or without room on the disk, and then typed again.

    python tests/benchmarks/kills.py                      (3 kills of each command at drawn instants, 3 at drawn steps of its files)
    python tests/benchmarks/kills.py --disks 36           (commands that may write no file longer than a drawn length)
    python tests/benchmarks/kills.py --kills 0 --only add (one of them)

Each case works in a copy of a commissioned run.  A kill falls at an instant drawn over the time that the command takes, or before the nth
of the calls that change files (open for writing, fsync, rename, make, delete), n drawn.  It went fine when afterwards every file is whole,
every command that reads the run takes it, the same command (a session: with --resume) ends as it does undisturbed, and nothing is left of
files on their way.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from beltcomm.errors import BeltcommError
from beltcomm.runfolder import RunFolder

#: The command line whose process counts its steps on files and dies before the one that it was given; 0 counts only.
STEPS = """
import builtins, os, sys
steps, last, told = 0, int(sys.argv.pop(1)), sys.argv.pop(1)
def before(call, counts=lambda *given, **more: True):
    def counted(*given, **more):
        global steps
        if counts(*given, **more):
            steps += 1
            if steps == last:
                os.kill(os.getpid(), 9)
        return call(*given, **more)
    return counted
def writes(*given, **more):
    return any(letter in str(given[1] if len(given) > 1 else more.get("mode", "r")) for letter in "wax+")
builtins.open = before(builtins.open, writes)
import io
io.open = builtins.open
for name in ("replace", "rename", "fsync", "mkdir", "unlink", "rmdir"):
    setattr(os, name, before(getattr(os, name)))
from beltcomm.cli.main import main
try:
    main()
finally:
    with open(told, "a") as file:
        file.write(f"{steps}\\n")
"""


@dataclass(frozen=True)
class Command:
    """words : as typed, RUN for the run.   resumes : goes on with --resume.   new : makes the run.   done : exit codes of an end."""

    words: Sequence[str]
    resumes: bool = False
    new: bool = False
    done: Sequence[int] = (0, 1)
    before: Sequence[Sequence[str]] = ()


ADD = ("add", "cogging", "RUN", "--no-cost", "--no-pictures")
COMMANDS = {
    "import": Command(("import", "LOGS", "--run", "RUN", "--axis", "egc-70-600"), new=True),
    "add": Command(ADD),
    "remove": Command(("remove", "cogging", "RUN", "--no-pictures"), before=[ADD]),
    "fit": Command(("fit", "RUN")),
    "design": Command(("design", "RUN")),
    "compare": Command(("compare", "RUN")),
    "diagnose": Command(("diagnose", "RUN", "--auto", "--no-cost")),
    "ladder": Command(("ladder", "RUN"), before=[ADD]),
    "report": Command(("report", "RUN")),
    "export": Command(("export", "RUN", "--format", "c", "--out", "RUN/controller.c", "--yes")),
    "bundle": Command(("bundle", "RUN", "--out", "RUN/bundle.zip")),
    "verify": Command(("verify", "--drive", "virtual", "--run", "RUN", "--yes")),
    "friction": Command(("friction", "--drive", "virtual", "--run", "RUN", "--yes")),
    "calibrate": Command(("calibrate", "--drive", "virtual", "--run", "RUN", "--yes")),
    "apply": Command(("apply", "--drive", "virtual", "--run", "RUN", "--yes")),
    "rollback": Command(("rollback", "--drive", "virtual", "--run", "RUN", "--yes")),
    "identify": Command(("identify", "--drive", "virtual", "--run", "RUN", "--yes"), resumes=True, new=True),
    "commission": Command(("commission", "--drive", "virtual", "--run", "RUN", "--yes", "--quick"), resumes=True, new=True),
    "simulate": Command(("simulate", "g_b", "--axis", "egc-70-600", "--run", "RUN"), new=True),
    "init": Command(("init", "RUN.yaml", "--from", "egc-70-600", "--yes"), new=True),
    "drives": Command(("drives", "--drive", "virtual", "--new", "RUN.yaml", "--yes"), new=True),
    "trajectory": Command(
        ("trajectory", "RUN.csv", "--from", "0", "--to", "0.5", "--speed", "1", "--acceleration", "10", "--jerk", "200", "--yes"), new=True
    ),
    "study": Command(("study", "tolerances", "--out", "RUN", "--limit", "12", "--workers", "1"), new=True),
    "trend": Command(("trend", "RUN", "BASE")),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """The table; exit code 1 when a case did not go fine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=3, help="of each command at instants, and as many at steps")
    parser.add_argument("--disks", type=int, default=0, help="cases without room")
    parser.add_argument("--only", nargs="*", default=list(COMMANDS))
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="beltcomm-kills-") as made:
        place = Place(Path(made))
        bad = 0
        for name in asked.only if asked.kills else ():
            told = kills_of(place, name, asked.kills, asked.seed)
            bad += sum(not line.startswith("fine") for line in told)
            print(f"{name:12} {sum(line.startswith('fine') for line in told)} of {len(told)} fine", flush=True)
            for line in told:
                if line != "fine":
                    print(f"             {line}", flush=True)
        if asked.disks:
            told = disks(place, asked.only, asked.disks, asked.seed)
            bad += sum(not line.endswith("fine") for line in told)
            print(f"small disks: {sum(line.endswith('fine') for line in told)} of {len(told)} fine", *told, sep="\n  ", flush=True)
    return int(bool(bad))


class Place:
    """Where the cases are made: ``base`` is a commissioned run, of which each gets a copy."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._number, self._prepared = folder, 0, {(): folder / "base"}
        for seed in (1, 2):
            _log(folder / f"log_{seed}.csv", seed)
        done = call(folder, ("commission", "--drive", "virtual", "--run", "base", "--yes", "--quick"))
        assert done.returncode == 0, done.stderr

    def case(self, command: Command) -> Path:
        """The folder of a new case; in it the run, unless the command makes it."""
        self._number += 1
        case = self.folder / f"case-{self._number}"
        case.mkdir()
        if not command.new:
            shutil.copytree(self._after(tuple(map(tuple, command.before))), case / "run")
        return case

    def _after(self, before: tuple[tuple[str, ...], ...]) -> Path:
        if before not in self._prepared:
            made = self.folder / f"prepared-{len(self._prepared)}"
            shutil.copytree(self.folder / "base", made / "run")
            for words in before:
                done = call(made, [word.replace("RUN", "run") for word in words])
                assert done.returncode in (0, 1), done.stderr
            self._prepared[before] = made / "run"
        return self._prepared[before]

    def words(self, command: Command, again: bool = False) -> list[str]:
        """As typed in the folder of a case."""
        logs = [str(self.folder / f"log_{seed}.csv") for seed in (1, 2)]
        words = [part for word in command.words for part in (logs if word == "LOGS" else [word])]
        words = [word.replace("RUN", "run").replace("BASE", str(self.folder / "base")) for word in words]
        return words + ["--resume"] * (again and command.resumes)


def _log(path: Path, seed: int) -> None:
    """A measurement that can be imported without a word."""
    draw, t_s = np.random.default_rng(seed), 1e-3 * np.arange(3000)
    torque = 0.4 * np.sin(2 * np.pi * (3 + seed) * t_s) + draw.normal(0.0, 1e-3, t_s.size)
    speed = np.cumsum(torque) * 1e-3 / 2e-3
    rows = np.column_stack([t_s, torque, np.cumsum(speed) * 1e-3])
    np.savetxt(path, rows, delimiter=",", header="t_s,torque_nm,position_rad", comments="")


def call(folder: Path, words: Sequence[str], *, step: int | None = None, largest: int | None = None) -> subprocess.CompletedProcess[str]:
    """The command line in a folder.   step : before which it dies, 0 only counts.   largest : bytes of a file."""
    program = ["-m", "beltcomm"] if step is None else ["-c", STEPS, str(step), str(folder / "steps.log")]
    limit = None if largest is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    return subprocess.run(
        [sys.executable, *program, *words], cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL, preexec_fn=limit
    )


def kills_of(place: Place, name: str, count: int, seed: int) -> list[str]:
    """Kills of one command, ``count`` at drawn instants and as many at drawn steps: "fine", or what went wrong."""
    command, draw = COMMANDS[name], np.random.default_rng([seed, *name.encode()])
    healthy = place.case(command)
    began = time.monotonic()
    done = call(healthy, place.words(command), step=0)
    lasts_s = time.monotonic() - began
    if done.returncode not in command.done:
        return [f"undisturbed it ends with exit code {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"]
    steps = int((healthy / "steps.log").read_text().split()[-1])
    (healthy / "steps.log").unlink()
    told = []
    for k in range(2 * count):
        case = place.case(command)
        if k < count:
            at = f"after {(instant_s := float(draw.uniform(0.0, lasts_s))):.2f} of {lasts_s:.2f} s"
            _killed(case, place.words(command), instant_s)
        else:
            at = f"before step {(step := int(draw.integers(1, steps + 1)))} of {steps}"
            call(case, place.words(command), step=step)
        wrong = damages(case) or _not_again(place, case, command, done.returncode)
        told.append(f"{at}: {wrong}" if wrong else "fine")
        if not wrong:
            shutil.rmtree(case)
    return told


def _killed(case: Path, words: Sequence[str], instant_s: float) -> None:
    quiet = subprocess.DEVNULL
    with subprocess.Popen(
        [sys.executable, "-m", "beltcomm", *words], cwd=case, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
    ) as process:
        try:
            process.wait(instant_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)


def _not_again(place: Place, case: Path, command: Command, code: int) -> str:
    """What is wrong with the same command afterwards; "" for nothing."""
    complete = command.new and not command.resumes and _refuses_to_repeat(place, case, command)
    done = call(case, place.words(command, again=(case / "run").is_dir()))
    if done.returncode != code and not complete:
        return f"again it ends with exit code {done.returncode}, not {code}: {' '.join(done.stderr.split())[-300:]}"
    left = [path.name for path in case.rglob("*") if path.name.startswith(".beltcomm-") or path.name == ".lock"]
    return damages(case) or (f"left are {left}" if left and (case / "run").is_dir() and not complete else "")


def _refuses_to_repeat(place: Place, case: Path, command: Command) -> bool:
    """Whether it had come to its end before it was killed, so that the same command has nothing to do."""
    if command.words[0] not in ("import", "simulate"):
        return False
    try:
        return len(RunFolder.open(case / "run").finished_names()) == (2 if command.words[0] == "import" else 1)
    except BeltcommError:
        return False


def damages(case: Path) -> str:
    """The first file that is not whole, or what keeps a run from being read; "" for nothing."""
    for path in sorted(case.rglob("*")):
        if path.is_file() and not path.name.startswith(".") and (wrong := _unreadable(path)):
            return f"{path.relative_to(case)} is not whole: {wrong}"
    run = case / "run"
    if (run / "axis.yaml").is_file() or (run / "recordings").is_dir():
        try:
            folder = RunFolder.open(run)
            for name in folder.finished_names():
                folder.recording(name)
            for kind in ("models", "designs", "results"):
                for name in folder.names(kind):
                    folder.load(kind, name)
        except BeltcommError as error:
            return f"the run cannot be read: {error}"
    return ""


def _unreadable(path: Path) -> str:
    """Why a file cannot be what its name says."""
    try:
        content = path.read_bytes()
        match path.suffix:
            case ".yaml":
                assert yaml.safe_load(content) is not None
            case ".json":
                json.loads(content)
            case ".jsonl":  # written line by line, of which the last may be torn
                [json.loads(line) for line in content.splitlines()[:-1]]
            case ".csv":
                rows = content.decode().splitlines()
                assert content.endswith(b"\n")
                assert len({row.count(",") for row in rows}) == 1
            case ".html":
                assert content.rstrip().endswith(b"</html>")
            case ".png":
                assert content.endswith(b"IEND\xaeB`\x82")
            case ".zip":
                assert zipfile.ZipFile(path).testzip() is None
            case ".gz":
                gzip.decompress(content)
            case ".c" | ".txt":
                assert content.endswith(b"\n")
    except Exception as error:
        return f"{type(error).__name__} {error}"
    return ""


def disks(place: Place, names: Sequence[str], count: int, seed: int) -> list[str]:
    """Commands that can write no file longer than a drawn length: each with "fine", or what went wrong."""
    draw, told = np.random.default_rng(seed), []
    for k in range(count):
        name = names[k % len(names)]
        command, largest = COMMANDS[name], int(10 ** draw.uniform(1.0, 5.3))
        case = place.case(command)
        done = call(case, place.words(command), largest=largest)
        wrong = damages(case)
        if "Traceback" in done.stderr or "unexpected error" in done.stderr:
            wrong = wrong or f"it says {' '.join(done.stderr.split())[-300:]}"
        free = call(case, place.words(command, again=(case / "run").is_dir())) if not wrong and done.returncode else None
        if free is not None and free.returncode not in command.done and not _refuses_to_repeat(place, case, command):
            wrong = f"with room it ends with exit code {free.returncode}: {' '.join(free.stderr.split())[-300:]}"
        told.append(f"{name} with {largest} bytes a file (exit code {done.returncode}): {wrong or 'fine'}")
    return told


if __name__ == "__main__":
    sys.exit(main())
