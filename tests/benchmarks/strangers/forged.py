"""Values of a forger: numbers that cannot be, of the right type, under a checksum made anew, given to the commands that read the file."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.configfiles import CHECKSUM, read_yaml, sealed, to_yaml, unsealed
from strangers.files import VIRTUAL, apart, found
from strangers.outcome import NEVER, Outcome, judged

GROUP = "forged"
#: By place in a run: what reads its numbers.
READERS: dict[str, Sequence[Sequence[str]]] = {
    "results/fit.yaml": (("design", "RUN"), ("report", "RUN"), ("diagnose", "RUN", "--no-cost"), ("friction", *VIRTUAL, "--run", "RUN")),
    "results/drive.yaml": (("design", "RUN"), ("verify", *VIRTUAL, "--run", "RUN"), ("compare", "RUN", "--no-pictures")),
    "designs/final.yaml": (
        ("export", "RUN", "--format", "st", "--out", "CASE/a.st", "--yes"),
        ("verify", *VIRTUAL, "--run", "RUN"),
        ("report", "RUN"),
    ),
    "results/verify_move_1.yaml": (("report", "RUN"), ("runs", "CASE"), ("improve", "RUN", "--yes")),
    "results/plan.yaml": (("report", "RUN"),),
    "results/ladder.yaml": (("ladder", "RUN", "--no-pictures"), ("report", "RUN"), ("remove", "cogging", "RUN", "--no-pictures")),
    "results/diagnosis.yaml": (("report", "RUN"),),
    "models/MODEL": (("design", "RUN"), ("compare", "RUN", "--no-pictures")),
    "recordings/YAML": (("fit", "RUN"), ("report", "RUN")),
    "kept/fit.json": (("compare", "RUN", "--no-pictures"),),
    "run.yaml": (("report", "RUN"),),
}
IMPOSSIBLE = (-5.0, 0.0, 1e99, -1e99, 1e-300, float("inf"), float("nan"), 3, -1)


def cases(base: Path, folder: Path, seed: int, draws: int = 12) -> Iterator[Outcome]:
    """So many numbers of every file, each exchanged for one that cannot be."""
    for words in (("add", "cogging", str(base), "--no-cost", "--no-pictures"), ("diagnose", str(base), "--no-cost")):
        CliRunner().invoke(cli, words)
    for place, calls in READERS.items():
        source = found(base, place)
        if not source.is_file():
            yield judged(GROUP, f"{place} is not there", "", "the run has no such file")
            continue
        for number in range(draws):
            draw = np.random.default_rng([seed, 77, number, *place.encode()])
            data = read_yaml(source) if source.suffix == ".yaml" else json.loads(source.read_bytes())
            at, value = exchanged(data, draw)
            if CHECKSUM in data:
                data = sealed(unsealed(data)[0])
            for words in calls:
                case = folder / f"forged-{place.replace('/', '-')}-{number}"
                shutil.copytree(base, case / "run")
                target = case / "run" / source.relative_to(base)
                target.write_text(to_yaml(data) if source.suffix == ".yaml" else json.dumps(data), encoding="utf-8")
                call = [word.replace("RUN", str(case / "run")).replace("CASE", str(case)) for word in words]
                code, told = apart(lambda call=call: CliRunner().invoke(cli, call, input=""))  # type: ignore[misc]
                never = next((word for word in NEVER if word in told), "")
                yield judged(
                    GROUP,
                    f"{place}, {at} = {value}, {words[0]}",
                    f"{never}: {told[-400:]}" if never or code not in range(6) else "",
                    f"exit code {code} without a word" if code and not told.strip() else told[-200:] if "Usage:" in told else "",
                )
                shutil.rmtree(case)


def exchanged(data: Any, draw: np.random.Generator) -> tuple[str, Any]:
    """Exchange one number in nested settings, chosen evenly among all; where it stood and what stands there now."""
    leaves: list[tuple[Any, Any, str]] = []

    def look(inside: Any, at: str) -> None:
        for key in inside if isinstance(inside, dict) else range(len(inside)):
            one, name = inside[key], f"{at}.{key}".removeprefix(".")
            if isinstance(one, dict | list):
                look(one, name)
            elif isinstance(one, int | float) and not isinstance(one, bool):
                leaves.append((inside, key, name))

    look(data, "")
    if not leaves:
        return "no number", None
    inside, key, name = leaves[int(draw.integers(len(leaves)))]
    value = IMPOSSIBLE[int(draw.integers(len(IMPOSSIBLE)))]
    inside[key] = value if isinstance(inside[key], float) else int(value) if np.isfinite(value) else -7
    return name, inside[key]
