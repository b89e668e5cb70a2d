"""Files and values of a stranger, each given to the command that reads it: damaged, exchanged, extreme; and what a drive is written."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.configfiles import CHECKSUM, read_yaml, sealed, to_yaml, unsealed
from fuzz.parsers import damaged
from strangers.outcome import NEVER, Outcome, judged

GROUP = "files"
PATIENCE_S = 180.0
VIRTUAL = ("--drive", "virtual", "--yes")
#: By place in a run: what reads it.
READERS: dict[str, Sequence[str]] = {
    "axis.yaml": ("compare", "RUN", "--no-pictures"),
    "run.yaml": ("verify", *VIRTUAL, "--run", "RUN"),
    "designs/final.yaml": ("export", "RUN", "--format", "st", "--out", "CASE/a.st", "--yes"),
    "results/backup.yaml": ("rollback", *VIRTUAL, "--run", "RUN", "--backup", "list"),
    "results/drive.yaml": ("design", "RUN"),
    "results/plan.yaml": ("report", "RUN"),
    "results/fit.yaml": ("design", "RUN"),
    "results/verify_move_1.yaml": ("report", "RUN"),
    "models/MODEL": ("design", "RUN"),
    "recordings/CSV": ("fit", "RUN"),
    "recordings/YAML": ("compare", "RUN", "--no-pictures"),
    "journal.txt": ("report", "RUN"),
    "events.jsonl": ("report", "RUN"),
    "kept/fit.json": ("compare", "RUN", "--no-pictures"),
    "plan.yaml": ("commission", *VIRTUAL, "--run", "RUN", "--plan", "FILE", "--dry-run"),
    "ours.csv": ("import", "FILE", "--run", "CASE/imported", "--axis", "egc-70-600"),
}
#: What people and programs write where a number, a name or a list is meant.
ODD: tuple[Any, ...] = (
    *(float("nan"), float("inf"), -float("inf"), 1e308, -1e-308, 0, -1, 10**400, 2**63, True, None, "", "0x10", "1,5", "~", [], {}, [[]]),
    *(
        "9" * 400,
        "\x1b[2J",
        "../../etc/passwd",
        "<script>",
        "{{7*7}}",
        "%s%n",
        "$(id)",
        "\u202e",
        "a" * 5000,
        [1] * 5000,
        {"__class__": "x"},
    ),
)


def cases(base: Path, folder: Path, seed: int) -> Iterator[Outcome]:
    """Six damages and six odd values for every file that a command reads.   base : a commissioned run.   folder : for copies."""
    for place, words in READERS.items():
        source = found(base, place)
        if not source.is_file():
            yield judged(GROUP, f"{place} is not there", "", "the run has no such file")
            continue
        original = source.read_bytes()
        for number in range(12):
            draw = np.random.default_rng([seed, number, *place.encode()])
            content = damaged(draw, original, [original]) if number < 6 else odd(draw, source, original)
            case = folder / f"file-{place.replace('/', '-')}-{number}"
            shutil.copytree(base, case / "run")
            target = case / "run" / source.relative_to(base)
            target.write_bytes(content)
            call = [word.replace("RUN", str(case / "run")).replace("CASE", str(case)).replace("FILE", str(target)) for word in words]
            before = others(case, target)
            code, told = apart(lambda call=call: CliRunner().invoke(cli, call, input=""))  # type: ignore[misc]
            never = next((word for word in NEVER if word in told), "")
            broken = f"{never}: {told[-250:]}" if never or code not in (0, 1, 2, 3, 4, 5) else ""
            lost = [name for name, size in before.items() if not (case / name).is_file() or ((case / name).stat().st_size == 0 and size)]
            weak = f"exit code {code} without a word" if code and not told.strip() else ""
            verdict = judged(
                GROUP, f"{place}, {'damage' if number < 6 else 'value'} {number}", broken or f"lost: {lost}" * bool(lost), weak
            )
            yield verdict
            if verdict.verdict == "fine":
                shutil.rmtree(case)


def found(base: Path, place: str) -> Path:
    """The file of the base run that stands for a place; plan and foreign file are made there once."""
    match place:
        case "models/MODEL":
            return next(iter(sorted((base / "models").glob("*.yaml"))), base / "none")
        case "recordings/CSV":
            return sorted((base / "recordings").glob("*.csv"))[0]
        case "recordings/YAML":
            return sorted((base / "recordings").glob("*.yaml"))[0]
        case "plan.yaml":
            steps = [
                {"kind": "strokes", "place": 0.2, "speeds_m_s": [0.02, 0.05], "held_out": True},
                {"kind": "moves", "seconds": 8.0, "seed": 2},
            ]
            (base / place).write_text(to_yaml({"reasons": {"cogging": "r"}, "steps": steps}), encoding="utf-8")
        case "ours.csv":
            source = sorted((base / "recordings").glob("*.csv"))[0]
            shutil.copy(source, base / place)
        case "kept/fit.json" if not (base / place).is_file():
            CliRunner().invoke(cli, ["compare", str(base), "--no-pictures"])
    return base / place


def odd(draw: np.random.Generator, source: Path, original: bytes) -> bytes:
    """The file with one to three of its values exchanged for odd ones; of a table, cells.  A checksum is made anew, as a forger does."""
    if source.suffix in (".yaml", ".json"):
        data = read_yaml(source) if source.suffix == ".yaml" else json.loads(original)
        for _ in range(int(draw.integers(1, 4))):
            put(data, draw)
        if CHECKSUM in data:
            data = sealed(unsealed(data)[0])
        text = to_yaml(data) if source.suffix == ".yaml" else json.dumps(data)
        return text.encode("utf-8", "surrogateescape")
    lines = original.decode().splitlines()
    for _ in range(int(draw.integers(1, 4))):
        at = int(draw.integers(len(lines)))
        cells = lines[at].split(",")
        cells[int(draw.integers(len(cells)))] = str(ODD[int(draw.integers(len(ODD)))])
        lines[at] = ",".join(cells)
    return ("\n".join(lines) + "\n").encode()


def put(data: Any, draw: np.random.Generator) -> None:
    """Exchange one leaf of nested settings."""
    while isinstance(data, dict | list) and data:
        keys: list[Any] = list(data) if isinstance(data, dict) else list(range(len(data)))
        key = keys[int(draw.integers(len(keys)))]
        inside = data[key]
        if not isinstance(inside, dict | list) or not inside or draw.random() < 0.2:
            data[key] = ODD[int(draw.integers(len(ODD)))]
            return
        data = inside


def others(case: Path, target: Path) -> dict[str, int]:
    """The files of a case but for the hostile one, with their sizes."""
    return {str(path.relative_to(case)): path.stat().st_size for path in case.rglob("*") if path.is_file() and path != target}


def apart(action: Callable[[], Any]) -> tuple[int, str]:
    """Exit code and words of a command in a process that is forked for it; -999 for a hang, below zero for a crash."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            outcome = action()
            code = outcome.exit_code
            text = outcome.output
            if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
                text += f"Traceback (most recent: {outcome.exception!r}"
            os.write(writing, f"{code} {text[-3000:]}".encode("utf-8", "replace"))
        finally:
            os._exit(0)
    os.close(writing)
    told = b""
    while select.select([reading], [], [], PATIENCE_S)[0]:
        more = os.read(reading, 1 << 16)
        if not more:
            break
        told += more
    else:
        os.kill(child, signal.SIGKILL)
    os.close(reading)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return (-999 if os.WTERMSIG(status) == signal.SIGKILL else -os.WTERMSIG(status)), "it did not end, or crashed"
    code, _, text = told.decode("utf-8", "replace").partition(" ")
    return (int(code) if code else -998), text


def drives() -> Iterator[Outcome]:
    """What a hostile file may have written to a drive: the tests that look at each frame of the host, 220 drawn files and the rest."""
    tests = Path(__file__).parents[2]
    names = ("session/test_hostile_files.py", "session/test_foreign_folder.py", "session/test_write_back.py")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-rA", "--no-header", *(str(tests / name) for name in names)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tests.parent, check=False)
    for line in done.stdout.splitlines():
        result, _, name = line.partition(" ")
        if result in ("PASSED", "FAILED", "ERROR") and "::" in name:  # a log line may begin so
            yield judged("drives", name.rpartition("::")[2], "" if result == "PASSED" else name)
