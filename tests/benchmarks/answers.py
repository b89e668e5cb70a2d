"""One model of one run, whichever command is asked: commission, compare, fit, compare again and the report on drawn virtual axes.

    python tests/benchmarks/answers.py run FILE FIRST COUNT    draws FIRST …, one line of JSON each; those that are there are not run again
    python tests/benchmarks/answers.py table FILE …            largest difference in intervals, of what is read and of what is fitted anew

A draw: g_a and g_b by turns, 65536 or 2000 counts, with instruments or without, its parameters ±20 %.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import yaml
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.configfiles import find_config

#: Of the plant, drawn; the effective radius is the data sheet's.
DRAWN = (
    "motor.inertia",
    "cart.mass",
    "belt_stiffness.stiffness",
    "belt_damping.damping",
    "viscous.damping",
    "coulomb.level",
    "cart_friction.level",
)
READ = ("compare", "report", "compare again")


def plant(seed: int, file: Path) -> dict[str, Any]:
    """A drawn plant, written, with its axis.yaml beside it; what was drawn."""
    draw = np.random.default_rng([20261128, seed])
    name, counts, with_instruments = ("g_a", "g_b")[seed % 2], (65536, 2000)[seed // 2 % 2], bool(seed // 4 % 2)
    facts = yaml.safe_load(find_config("plants", name).read_text(encoding="utf-8"))
    for key in DRAWN:
        facts["parameters"][key]["value"] *= float(draw.uniform(0.8, 1.2))
    drive = facts["drive"] = {**facts["drive"], "counts_per_rev": counts}
    if with_instruments:
        drive["setpoint_filter_s"] = float(draw.uniform(1e-4, 8e-4))
        drive["current_loop_s"] = float(np.exp(draw.uniform(np.log(8e-5), np.log(4e-4))))
        drive["reading_filter_s"] = float(np.exp(draw.uniform(np.log(5e-4), np.log(3e-3))))
        drive["reading_late_ticks"] = float(draw.choice([0.0, 0.5, 1.0]))
        drive["reading_step_nm"] = float(draw.uniform(2e-3, 12e-3))
    file.write_text(yaml.safe_dump(facts, sort_keys=False), encoding="utf-8")
    axis = yaml.safe_load(find_config("axes", "egc-70-600").read_text(encoding="utf-8"))
    axis["motor"]["encoder_counts_per_rev"] = counts
    file.with_name("axis.yaml").write_text(yaml.safe_dump(axis, sort_keys=False), encoding="utf-8")
    truth = {key: one["value"] for key, one in facts["parameters"].items()}
    return {"plant": name, "counts": counts, "instruments": with_instruments, "drive": drive, "truth": truth}


def asked(*words: str) -> tuple[int, dict[str, Any]]:
    """Exit code and JSON of a command."""
    done = CliRunner().invoke(cli, [*words, "--json"])
    try:
        return done.exit_code, json.loads(done.stdout)
    except json.JSONDecodeError:
        return done.exit_code, {"said": done.output[-300:]}


def told(answer: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Value and interval of each parameter that has one."""
    parameters = answer.get("model", {}).get("parameters", {})
    return {name: (one["value"], one["interval"]) for name, one in parameters.items() if one.get("interval")}


def examined(seed: int) -> dict[str, Any]:
    """A line on a draw."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="answers-") as folder:
        run, file = f"{folder}/run", Path(folder) / "plant.yaml"
        line: dict[str, Any] = {"seed": seed, **plant(seed, file)}
        drive = ["--drive", f"virtual:{file}", "--axis", str(file.with_name("axis.yaml")), "--run", run]
        steps = {
            "commission": ["commission", *drive, "--yes", "--quick", "--no-report", "--seed", str(seed)],
            "compare": ["compare", run],
            "report": ["report", run],
            "fit": ["fit", run],
            "compare again": ["compare", run],
        }
        codes, models = {}, {}
        for name, words in steps.items():
            codes[name], answer = asked(*words)
            if name == "report":
                answer["model"] = yaml.safe_load((Path(run) / "models/final.yaml").read_text(encoding="utf-8"))
            models[name] = told(answer)
            line.setdefault("said", {})[name] = answer.get("said", answer.get("headline", answer.get("error")))
            if name == "commission" and not models[name]:
                break
        line |= {"codes": codes, "models": models, "ratio": answer.get("ratio"), "seconds": time.monotonic() - begun}
    return line


def difference(first: dict[str, Any], other: dict[str, Any]) -> float:
    """Largest difference of a value or an interval, in intervals of the first; infinite where one has other parameters."""
    if set(first) != set(other):
        return float("inf")
    return max((max(abs(v - w), abs(i - j)) / i for (v, i), (w, j) in ((first[k], other[k]) for k in first)), default=float("inf"))


def table(lines: list[dict[str, Any]]) -> None:
    """What they came to."""
    ended = [line for line in lines if "fit" in line["models"]]
    print(f"{len(lines)} runs, {len(ended)} with a model")
    for name in (*READ[:2], "fit", READ[2]):
        before = "fit" if name == "compare again" else "commission"
        off = [difference(line["models"][before], line["models"][name]) for line in ended]
        print(f"{name} against {before}: largest {max(off):.3g} intervals, above 0.1 in {sum(one > 0.1 for one in off)} of {len(off)}")
    held = [
        abs(value - line["truth"][key]) <= interval
        for line in ended
        for key, (value, interval) in line["models"]["commission"].items()
        if line["truth"].get(key)
    ]
    print(f"intervals of commission that hold the truth: {sum(held)} of {len(held)}")
    for line in lines:
        if line not in ended or difference(line["models"]["commission"], line["models"]["fit"]) > 0.1:
            print(line["seed"], line["plant"], line["counts"], line["instruments"], line["codes"], str(line["said"]["commission"])[:160])


def main() -> None:
    if sys.argv[1] == "table":
        table([json.loads(row) for file in sys.argv[2:] for row in Path(file).read_text(encoding="utf-8").splitlines()])
        return
    file, first, count = Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    there = {json.loads(row)["seed"] for row in file.read_text(encoding="utf-8").splitlines()} if file.is_file() else set()
    for seed in range(first, first + count):
        if seed not in there:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(examined(seed)) + "\n")


if __name__ == "__main__":
    main()
