"""The whole loop through the CAN bus: a machine with a hidden effect is commissioned, diagnosed, extended, redesigned and driven again.

The machine is one of the independent simulator ``tests/truth/hidden`` (other laws than the candidates) behind the virtual drive.  Is the
effect named from the folder alone, does the tracking error fall, and as far as predicted?  Errors of the motor as the drive reports them.

    python tests/benchmarks/hidden_can.py FILE SEED STRENGTH EFFECT...      one line of JSON per machine; goes on where it was stopped
    python tests/benchmarks/hidden_can.py FILE                              the lines of a file as a table

``healthy`` is the machine without an effect.  The run folders stay in ``FILE.runs``; a machine is commissioned with ``--thorough``,
with ``BELTCOMM_EXTENT=standard`` in the environment as without it.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm import api
from beltcomm.api import Options
from beltcomm.drive import Drive
from beltcomm.errors import BeltcommError
from session.bench import Bench
from truth.hidden import draw
from truth.hidden.plant import HiddenPlant

AXIS = "egc-70-600"
THOROUGH = os.environ.get("BELTCOMM_EXTENT", "thorough") == "thorough"
START_M = 0.25
#: s; a date, for a machine that goes on from command to command.
EPOCH_S = 1.7e9
#: Families that no motion of the axis can tell apart.
FAMILY = {"tilt": "constant_offset", "coulomb_asymmetry": "constant_offset"}


class LastingBench(Bench):
    """A machine that is as warm at the next command as it was at the end of the one before: it is not told as a new one each time."""

    def open(self, name: str, options: Mapping[str, object] | None = None) -> Drive:
        """See :meth:`Bench.open`."""
        drive = super().open(name, options)
        identity = {key: value for key, value in drive.capabilities.identity.items() if key != "plant"}
        drive.capabilities = replace(drive.capabilities, identity=identity)
        return drive


def errors(verdict: Any) -> dict[str, list[float]]:
    """Dynamic error, mm, and static error, um: measured, predicted, and the range of the prediction."""
    data = verdict if isinstance(verdict, dict) else vars(verdict)
    spread = data.get("predicted_range") or (data["predicted"], data["predicted"])
    four = [one if isinstance(one, dict) else vars(one) for one in (data["measured"], data["predicted"], *spread)]
    return {
        "dynamic_mm": [round(1e3 * one["dynamic_m"], 4) for one in four],
        "static_um": [round(1e6 * one["static_m"], 1) for one in four],
    }


def examined(seed: int, effect: str, strength: float, run: Path) -> dict[str, Any]:
    """One machine."""
    machine = draw(seed, (effect,) if effect else (), strength, "rig")
    line: dict[str, Any] = {"seed": seed, "effect": effect, "strength": strength}
    bench = LastingBench("g_a", plant=HiddenPlant(machine, START_M), start_m=START_M)
    yes = Options(yes=True, seed=1, thorough=THOROUGH, wall_clock=lambda: EPOCH_S + bench.now_s)
    opened, api.open_drive = api.open_drive, bench.open  # type: ignore[assignment]
    clock = time.process_time()

    def took() -> float:
        nonlocal clock
        before, clock = clock, time.process_time()
        return round(clock - before, 1)

    try:
        with redirect_stdout(StringIO()):
            before = api.commission(bench.name, AXIS, run, options=yes)
            line |= {"machine_s": round(before.data["machine_seconds"], 1), "commission_cpu_s": took()}
            line["before"] = errors(before.data["verdict"])
            found = api.diagnose(run, auto=True, cost=False).data
            line |= {"verdict": found["verdict"], "added": [step["added"] for step in found["steps"] if step["added"]]}
            line["base"] = found["base"]["effects"]
            line["ranking"] = [one["effect"] for one in found["ranking"][:3]]
            line["ratio"] = [round(found[key]["ratio"], 3) for key in ("base", "after")]
            line["held_out"] = [round(found[key]["held_out"], 3) for key in ("base", "after")]
            line["diagnose_cpu_s"] = took()
            designed = api.design(run, options=yes).data
            line |= {"revision": designed["revision"], "compensated": designed["compensated"]}
            after = api.verify(bench.name, run, options=yes)
            line["after"] = errors(after.data)
            line["design_verify_cpu_s"] = took()
    except BeltcommError as error:
        line["failed"] = f"{type(error).__name__}: {error}"
    finally:
        api.open_drive = opened
        bench.close()
    return line


def right(line: dict[str, Any]) -> str:
    """Whether the first name is the hidden effect's."""
    if "verdict" not in line:
        return "failed"
    if not line["effect"]:
        return "right" if line["verdict"] == "nothing missing" else "FALSE ALARM"
    wanted = FAMILY.get(line["effect"], line["effect"])
    if wanted in line.get("base", ()) and not line["added"]:
        return "in base"  # the commissioning itself has it in its model
    return "right" if line["added"][:1] == [wanted] else "missed" if not line["added"] else "WRONG"


def table(lines: list[dict[str, Any]]) -> None:
    """All lines for people."""
    for line in lines:
        name = f"{line['seed']} {line['effect'] or 'healthy'} {line['strength']:g}"
        if "failed" in line:
            print(f"{name:28} {line['failed'][:160]}")
            continue
        moves = []
        for key in ("before", "after"):
            seen, expected, low, high = line[key]["dynamic_mm"]
            inside = "in" if low <= seen <= high else "out of"
            moves.append(f"{1e3 * seen:.0f} um (predicted {1e3 * expected:.0f}, {inside} {1e3 * low:.0f}..{1e3 * high:.0f})")
        ratios = f"{line['ratio'][0]:.2f} -> {line['ratio'][1]:.2f}, held out {line['held_out'][0]:.2f} -> {line['held_out'][1]:.2f}"
        cpu = line["commission_cpu_s"] + line["diagnose_cpu_s"] + line["design_verify_cpu_s"]
        print(f"{name:28} {right(line):7} {line['verdict']:38} {'+'.join(line['added']) or '-':32} {ratios}")
        print(f"{'':28} {line['machine_s']:.0f} s on the machine, {cpu:.0f} s CPU; move {' -> '.join(moves)}")


def main(file: Path, seed: int, strength: float, effects: list[str]) -> None:
    """All effects that the file does not have yet for this seed and strength."""
    lines = read(file)
    done = {(line["seed"], line["effect"], line["strength"]) for line in lines}
    for effect in effects:
        name = "" if effect == "healthy" else effect
        if (seed, name, strength) not in done:
            run = Path(f"{file}.runs") / f"{effect}_{strength:g}_{seed}"
            shutil.rmtree(run, ignore_errors=True)
            line = examined(seed, name, strength, run)
            with open(file, "a", encoding="utf-8") as out:
                out.write(json.dumps(line) + "\n")
            table([line])


def read(file: Path) -> list[dict[str, Any]]:
    """The lines of a file."""
    return [json.loads(text) for text in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []


if __name__ == "__main__":
    if len(sys.argv) == 2:
        table(read(Path(sys.argv[1])))
    else:
        main(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:])
