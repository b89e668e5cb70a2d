"""The whole loop through the CAN bus: a machine with a hidden effect is commissioned, diagnosed, extended, redesigned and driven again.

The machine is one of the independent simulator ``tests/truth/hidden`` (other laws than the candidates) behind the virtual drive.  Does the
tracking error fall, and as far as predicted?  Errors of the motor as the drive reports them.  Run it with

    python tests/benchmarks/hidden_can.py FILE SEED STRENGTH EFFECT...      one line of JSON per machine; goes on where it was stopped
"""

from __future__ import annotations

import json
import sys
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm import api
from beltcomm.api import Options
from beltcomm.errors import BeltcommError
from session.bench import Bench
from truth.hidden import draw
from truth.hidden.plant import HiddenPlant

AXIS = "egc-70-600"
YES = Options(yes=True, seed=1)
START_M = 0.25


def errors(verdict: Any) -> list[float]:
    """Measured and predicted dynamic error, mm, measured and predicted static error, um."""
    data = verdict if isinstance(verdict, dict) else vars(verdict)
    seen = [data["measured"], data["predicted"]]
    pair = [one if isinstance(one, dict) else vars(one) for one in seen]
    return [round(1e3 * one["dynamic_m"], 4) for one in pair] + [round(1e6 * one["static_m"], 1) for one in pair]


def examined(seed: int, effect: str, strength: float) -> dict[str, Any]:
    """One machine."""
    machine = draw(seed, (effect,) if effect else (), strength, "rig")
    line: dict[str, Any] = {"seed": seed, "effect": effect, "strength": strength}
    bench = Bench("g_a", plant=HiddenPlant(machine, START_M), start_m=START_M)
    opened, api.open_drive = api.open_drive, bench.open  # type: ignore[assignment]
    try:
        with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
            run = Path(folder) / "run"
            before = api.commission(bench.name, AXIS, run, options=YES)
            line["before"] = errors(before.data["verdict"])
            found = api.diagnose(run, auto=True).data
            line |= {"verdict": found["verdict"], "added": [step["added"] for step in found["steps"] if step["added"]]}
            line["ratio"] = [found["base"]["ratio"], found["after"]["ratio"]]
            designed = api.design(run, options=YES).data
            line |= {"revision": designed["revision"], "compensated": designed["compensated"]}
            after = api.verify(bench.name, run, options=YES)
            line["after"] = errors(after.data)
    except BeltcommError as error:
        line["failed"] = f"{type(error).__name__}: {error}"
    finally:
        api.open_drive = opened
        bench.close()
    return line


def main(file: Path, seed: int, strength: float, effects: list[str]) -> None:
    """All effects that the file does not have yet for this seed and strength."""
    lines = [json.loads(text) for text in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []
    done = {(line["seed"], line["effect"], line["strength"]) for line in lines}
    for effect in effects:
        name = "" if effect == "healthy" else effect
        if (seed, name, strength) not in done:
            line = examined(seed, name, strength)
            with open(file, "a", encoding="utf-8") as out:
                out.write(json.dumps(line) + "\n")
            print(line)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:])
