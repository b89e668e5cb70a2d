"""Known-truth examination of the laboratory: is a hidden effect named, is a healthy machine left alone?

Every draw is a machine of the independent simulator ``tests/truth/hidden`` with nothing, one effect of the catalogue, or one that the
catalogue does not hold.  Its session is written into a run folder without the answer, and the diagnosis gets that folder only.

    python tests/benchmarks/hidden_effects.py run FILE FIRST LAST [STRENGTH ...]    seeds FIRST..LAST-1, one line of JSON per draw
    python tests/benchmarks/hidden_effects.py table FILE                            right names, wrong names, false alarms

It goes on where it was stopped.  Draws that the motor cannot see are marked before the diagnosis, by ``truth.hidden.visibility``.
Thresholds must be set on other seeds than those that are reported.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scipy.stats import binomtest

from beltcomm.errors import BeltcommError
from beltcomm.laboratory.diagnosis import diagnose
from beltcomm.laboratory.start import start_model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session
from truth.hidden.catalogue import EFFECTS
from truth.hidden.outside import OUTSIDE
from truth.hidden.visibility import visibility

STRENGTHS = (1.0, 0.7, 0.4, 0.2, 0.1)
#: Names that no motion of the axis can tell apart count as one.
FAMILY = {"tilt": "constant_offset", "coulomb_asymmetry": "constant_offset"}


def draws(first: int, last: int, strengths: tuple[float, ...]) -> list[tuple[int, str, float]]:
    """Seed, effect ("" for a healthy machine) and strength; the same list for the same arguments."""
    names = ["", *(name for name in EFFECTS if name != "belt_damping"), *OUTSIDE]
    return [(seed, name, strengths[(seed + i) % len(strengths)]) for seed in range(first, last) for i, name in enumerate(names)]


def examined(seed: int, name: str, strength: float) -> dict[str, Any]:
    """One draw: what was hidden, and what the laboratory said."""
    machine = draw(seed, (name,) if name else (), strength, "sheet")
    seen = visibility(machine, "thorough").visible if name in EFFECTS else True
    line: dict[str, Any] = {"seed": seed, "effect": name, "strength": strength, "visible": bool(seen)}
    with tempfile.TemporaryDirectory() as folder:
        write_session(machine, folder, plan="thorough")
        run = RunFolder.open(Path(folder))
        begin = time.process_time()
        try:
            recordings = run.recordings()
            found = diagnose(recordings, run.axis, start_model(run.axis, recordings))
        except BeltcommError as error:
            return line | {"verdict": f"{type(error).__name__}: {error}"}
    line |= {"cpu_s": time.process_time() - begin}
    line |= {"verdict": found.verdict, "added": [step.added for step in found.steps if step.added], "twins": list(found.twins)}
    line |= {"ranking": [(c.effect.name, round(c.evidence)) for c in found.steps[0].candidates[:3]]}
    line |= {"base": [found.base.ratio, found.base.held_ratio], "after": [found.after.ratio, found.after.held_ratio]}
    return line | {"level": [f.objective / f.problem.samples for f in (found.base, found.after)]}


def run_all(file: Path, first: int, last: int, strengths: tuple[float, ...]) -> None:
    """All draws that the file does not have yet."""
    done = {(r["seed"], r["effect"]) for r in read(file)}
    for seed, name, strength in draws(first, last, strengths):
        if (seed, name) not in done:
            with open(file, "a", encoding="utf-8") as out:
                out.write(json.dumps(examined(seed, name, strength)) + "\n")


def read(file: Path) -> list[dict[str, Any]]:
    """The lines of a file; none where it is missing."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []


def share(right: int, count: int) -> str:
    """A share with its 95 % interval (Clopper, Pearson)."""
    if not count:
        return "none drawn"
    interval = binomtest(right, count).proportion_ci(0.95)
    return f"{right} of {count}, {100 * right / count:.1f} % ({100 * interval.low:.1f} to {100 * interval.high:.1f} %)"


def first_named(line: dict[str, Any]) -> str:
    """The effect that was added first, or ""."""
    return line["added"][0] if line.get("added") else ""


def table(file: Path) -> None:
    """Counts by effect, what was named instead, and the shares that the thresholds are judged by."""
    lines = read(file)
    for name in dict.fromkeys(line["effect"] for line in lines):
        own = [line for line in lines if line["effect"] == name and line["visible"]]
        if not own:
            continue
        wanted = FAMILY.get(name, name)
        named = Counter(first_named(line) or line["verdict"] for line in own)
        right = sum(first_named(line) == wanted for line in own)
        told = sum(line["verdict"] == "explained" for line in own)
        print(f"{name or 'healthy':22} n {len(own):3}  right {right:3}  explained {told:3}  first named: {dict(named)}")
    known = [line for line in lines if line["visible"] and line["effect"] in EFFECTS]
    for low, high in ((0.4, 1.0), (0.1, 1.0)):
        some = [line for line in known if low <= line["strength"] <= high]
        wanted_of = {id(line): FAMILY.get(line["effect"], line["effect"]) for line in some}
        right = [line for line in some if first_named(line) == wanted_of[id(line)]]
        third = [line for line in some if wanted_of[id(line)] in [entry[0] for entry in line.get("ranking", [])]]
        wrong = [line for line in some if first_named(line) not in ("", wanted_of[id(line)])]
        print(f"strength {low} to {high}: right first {share(len(right), len(some))};  in the first three {share(len(third), len(some))}")
        print(f"    wrong name {share(len(wrong), len(some))}")
    done = [line for line in known if "after" in line and first_named(line) == FAMILY.get(line["effect"], line["effect"])]
    if done:
        after = sorted(line["after"][0] for line in done)
        print(f"ratio after adding: median {after[len(after) // 2]:.3f}, 95 % below {after[int(0.95 * (len(after) - 1))]:.3f}")
        print(f"within 1.00 ± 0.05: {share(sum(abs(value - 1.0) <= 0.05 for value in after), len(after))}")
    invisible = [line for line in lines if not line["visible"]]
    healthy = [line for line in lines if not line["effect"]]
    outside = [line for line in lines if line["effect"] in OUTSIDE]
    print(f"not visible by physics, left out: {len(invisible)}")
    print(f"false alarms: {share(sum(bool(first_named(line)) for line in healthy), len(healthy))}")
    print(f"healthy and said so: {share(sum(line['verdict'] == 'nothing missing' for line in healthy), len(healthy))}")
    if healthy:
        ratios = [line["base"][0] for line in healthy if "base" in line]
        print(f"healthy machines read {min(ratios):.3f} to {max(ratios):.3f}")
    print(f"outside the catalogue and called explained: {share(sum(line['verdict'] == 'explained' for line in outside), len(outside))}")
    seconds = sorted(line["cpu_s"] / max(len(line.get("added", [])) + 1, 1) for line in lines if "cpu_s" in line)
    if seconds:
        print(f"CPU per stage: median {seconds[len(seconds) // 2]:.1f} s, longest {seconds[-1]:.1f} s")


if __name__ == "__main__":
    verb, file, *rest = sys.argv[1:]
    if verb == "run":
        run_all(Path(file), int(rest[0]), int(rest[1]), tuple(map(float, rest[2:])) or STRENGTHS)
    else:
        table(Path(file))
