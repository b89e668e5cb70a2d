"""Types every command of the table of the design source's rows on one commissioned run: exit code, seconds, last line.

    python tests/benchmarks/rows.py [BEGINNING ...]     those that begin so; all without one, some twenty minutes

Placeholders: RUN is the run, OTHER a copy of it, D the virtual drive, FILE a file of encoder edges or one to be written, FOLDER a folder.
Each command works on a copy of the run.  Exit code 1 where one ends otherwise than it must.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm.encoder.edges import edges_of
from foreign.test_edges import DURATION_S, STEP, motion, rows_of

TESTS = Path(__file__).resolve().parents[1]
RUN, MOVING = "runs/axis", ("commission", "identify", "friction", "verify")
#: Refused with its reason, and a target missed on purpose.
ENDS_WITH_1 = ("fit --model three-mass", "verify --feedforward linear")
#: s: a page that is served until it is stopped; any other command.
SERVED_S, LONGEST_S = 90.0, 1200.0


def commands() -> dict[str, list[int]]:
    """Each line of the column to the rows in which it stands."""
    spec = importlib.util.spec_from_file_location("thesis_rows", TESTS.parent / "docs" / "thesis_rows.py")
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: dict[str, list[int]] = {}
    for number, row in enumerate(module.ROWS, start=1):
        found.setdefault(module.on_own_axis(row), []).append(number)
    return found


def typed(line: str) -> Iterator[str]:
    """The words of a line with its placeholders replaced, and what stands for a person."""
    words = line.split()
    file = "edges.csv" if "--edges" in words else "move.csv"
    known = {"RUN": RUN, "OTHER": "other", "D": "virtual", "FOLDER": "pictures", "FILE": file}
    yield from (known.get(word, word) for word in words)
    if words[0] in MOVING and "--compare" not in words:
        yield "--yes"
    if words[0] == "open":
        yield "--no-browser"
    if words[0] == "watch":
        yield from ("--moves", "12")


def run(words: list[str], folder: Path, longest_s: float = LONGEST_S) -> tuple[int, str, str]:
    """Exit code, stdout and stderr; of a page that was stopped, 0."""
    command = [sys.executable, "-m", "beltcomm", *words]
    try:
        found = subprocess.run(
            command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=longest_s, check=False
        )
    except subprocess.TimeoutExpired as late:
        said = (late.stderr or b"").decode()
        return (0 if "the page is at" in said else -1), "", said
    return found.returncode, found.stdout, found.stderr


def edges(path: Path) -> None:
    """Edges of a motion there and back, levels of A and B."""
    made = edges_of(motion, DURATION_S, increment_m=STEP)
    t, a, b, _, _ = rows_of(made)
    rows = [f"{at:.9f},{one},{other}" for at, one, other in zip(t, a, b, strict=True)]
    path.write_text("\n".join(["t_s,a,b", f"-0.001,{made.level_a},{made.level_b}", *rows]) + "\n", encoding="utf-8")


def main(beginnings: list[str]) -> int:
    """Print a line for each command."""
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        base = Path(place) / "base"
        base.mkdir()
        code, _, said = run(["commission", "--drive", "virtual", "--run", RUN, "--yes"], base)
        if code != 0:
            print(said)
            return 1
        shutil.copytree(base / RUN, base / "other")
        edges(base / "edges.csv")
        for line, rows in commands().items():
            if beginnings and not line.startswith(tuple(beginnings)):
                continue
            work = Path(place) / "work"
            shutil.copytree(base, work)
            begun = time.monotonic()
            code, out, said = run(list(typed(line)), work, SERVED_S if line == "open" else LONGEST_S)
            seconds = time.monotonic() - begun
            shutil.rmtree(work)
            as_told = code == (1 if line in ENDS_WITH_1 else 0)
            wrong += not as_told
            last = next((text for text in reversed((out if as_told else said).splitlines()) if text.strip()), "")
            print(
                f"{'' if as_told else 'WRONG ':6}{code:2d} {seconds:6.1f} s  {line}  rows {json.dumps(rows)}  {last.strip()[:100]}",
                flush=True,
            )
    print(f"{wrong} end otherwise than they must")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
