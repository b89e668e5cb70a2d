"""A profile that is wrong in one field, for every field: what is said of it, and when.

    python tests/benchmarks/wrong_profiles.py                      (all; half an hour)
    python tests/benchmarks/wrong_profiles.py --only position_unit,save --seed 7
    python tests/benchmarks/wrong_profiles.py --keep FILE          (cases that are there already are not run again)

The drive is a played one that tells none of its units, with a profile that states all of them; each case states one field wrongly and lets
the axis be identified, or commissioned where the field is about loops.  "before": refused before any motion.  "creep": refused in the first
motions.  "stopped": ended later, by a check.  "told": done, right or not, and something that is said names it.  "harmless": done, and the
model is right.  SILENT: done, the model is wrong, and nobody says a word.  The machine's numbers are those of the plant file.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import yaml

from beltcomm.model import load_plant
from campaign.judge import UNMOVED_M
from campaign.rig import PLANT
from slaves.bench import BELT_N, CREEP_M, START_M, SlaveRig, sentence, words

_TRUE = load_plant(PLANT).model
#: Share by which a model may be off its machine.
RIGHT = 0.03
A_PER_RPM, TORQUE_CONSTANT = 9.549e-4, 0.65
RIGHT_PROFILE: dict[str, Any] = {
    "name": "told",
    "title": "as it is",
    "position_unit": "6.103515625e-05 rev",
    "velocity_unit": "1 rpm",
    "acceleration_unit": "1 rpm/s",
    "gain_meaning": "documented",
    "parameters": {
        "kp_nm_s_rad": {"index": 0x3012, "subindex": 3, "type": "uint16", "scale": A_PER_RPM * TORQUE_CONSTANT},
        "ki_nm_rad": {"index": 0x3012, "subindex": 4, "type": "uint16", "scale": 1.0e-5, "law": "integral_time"},
        "kpp_1_s": {"index": 0x3012, "subindex": 5, "type": "uint16", "scale": 0.1},
    },
}
_KP, _KI, _KPP = (("parameters", name) for name in ("kp_nm_s_rad", "ki_nm_rad", "kpp_1_s"))
#: Of a case: field, value that is stated, verb.
CASES: dict[str, tuple[tuple[str, ...], Any, str]] = {
    "right": ((), None, "commission"),
    "position_unit 4 times": (("position_unit",), "2.44140625e-04 rev", "identify"),
    "position_unit a quarter": (("position_unit",), "1.52587890625e-05 rev", "identify"),
    "position_unit 2 times, velocity_unit too": (("position_unit+velocity_unit",), ("1.220703125e-04 rev", "2 rpm"), "identify"),
    "velocity_unit a tenth": (("velocity_unit",), "0.1 rpm", "identify"),
    "velocity_unit in counts": (("velocity_unit",), "1 counts/s", "identify"),
    "acceleration_unit ten times": (("acceleration_unit",), "10 rpm/s", "commission"),
    "acceleration_unit a tenth": (("acceleration_unit",), "0.1 rpm/s", "commission"),
    "acceleration_unit as a time": (("acceleration_unit",), "ms to 3000 rpm", "commission"),
    "acceleration_unit in counts": (("acceleration_unit",), "1 counts/s2", "commission"),
    "acceleration_unit a thousand times": (("acceleration_unit",), "1000 rpm/s", "commission"),
    "acceleration_unit a thousandth": (("acceleration_unit",), "0.001 rpm/s", "commission"),
    "acceleration_unit a tenth, identified": (("acceleration_unit",), "0.1 rpm/s", "identify"),
    "acceleration_unit ten times, identified": (("acceleration_unit",), "10 rpm/s", "identify"),
    "rated_torque_unit_nm": (("rated_torque_unit_nm",), 1.0, "identify"),
    "torque_scale 2 times": (("torque_scale",), {"of": "drive_peak", "nm": 2.86, "check": "the inertia"}, "identify"),
    "torque_scale 1.2 times": (("torque_scale",), {"of": "drive_peak", "nm": 1.716, "check": "the inertia"}, "identify"),
    "modes: a mode that it has not": (("modes",), {"torque": 4, "position": 7, "velocity": 3}, "identify"),
    "supported_modes": (("supported_modes",), [1, 3], "identify"),
    "units factor_group": (("units",), "factor_group", "identify"),
    "offsets": (("offsets",), True, "commission"),
    "guarding": (("guarding",), "node_guarding", "identify"),
    "torque_sampling": (("torque_sampling",), "over", "identify"),
    "sync too short": (("sync",), {"shortest_ms": 0.25, "step_ms": 0.25}, "identify"),
    "sync after reset": (("sync",), {"change": "after_reset"}, "identify"),
    "structure: a notch": (("structure",), {"prefilters": ["notch"]}, "commission"),
    "gain of other unit": ((*_KP, "scale"), 10 * A_PER_RPM * TORQUE_CONSTANT, "commission"),
    "gain twice": ((*_KP, "scale"), 2 * A_PER_RPM * TORQUE_CONSTANT, "commission"),
    "gain half": ((*_KP, "scale"), 0.5 * A_PER_RPM * TORQUE_CONSTANT, "commission"),
    "gain in another object": ((*_KP, "subindex"), 6, "commission"),
    "gain is the integral time": ((*_KP, "subindex"), 4, "commission"),
    "integral time ten times": ((*_KI, "scale"), 1.0e-4, "commission"),
    "position gain ten times": ((*_KPP, "scale"), 1.0, "commission"),
    "gain of another type": ((*_KP, "type"), "uint32", "commission"),
    "gain in a locked object": ((*_KP, "index"), 0x60F6, "identify"),
    "enable_logic": (("enable_logic",), {"index": 0x2000, "subindex": 1, "type": "uint16", "value": 1}, "identify"),
    "torque_slope_permille_s": (("torque_slope_permille_s",), 10, "identify"),
    "torque_exit": (("torque_exit",), "velocity", "identify"),
    "torque_limit_lowest_permille": (("torque_limit_lowest_permille",), 1000, "identify"),
    "referenced": (("referenced",), {"index": 0x2000, "subindex": 1, "bit": 3}, "identify"),
    "loop_period": (("loop_period",), {"index": 0x6065, "subindex": 0}, "identify"),
    "overload_time": (("overload_time",), {"index": 0x2000, "subindex": 3}, "identify"),
    "output_limit": (("output_limit",), {"index": 0x60FB, "subindex": 4}, "commission"),
    "dead_zone": (("dead_zone",), {"index": 0x6065, "subindex": 0}, "commission"),
    "actual_torque in another object": (("actual_torque",), {"index": 0x6078}, "identify"),
    "actual_torque is the position": (("actual_torque",), {"index": 0x6064, "type": "int32"}, "identify"),
    "actual_torque is the demand": (("actual_torque",), {"index": 0x6071}, "identify"),
    "actual_torque 2 times": (("actual_torque",), {"nm": 2.86e-3}, "identify"),
    "actual_torque of another type": (("actual_torque",), {"type": "int32"}, "identify"),
    "actual_torque filtered": (("actual_torque",), {"filter_ms": 4.0}, "identify"),
    "actual_torque late": (("actual_torque",), {"late_ms": 3.0}, "identify"),
    "actual_torque the command": (("actual_torque",), {"command": True}, "identify"),
    "error_behaviour": (("error_behaviour",), {"node": 0, "axis": 2}, "identify"),
    "save": (("save",), {"index": 0x607A, "subindex": 0}, "identify"),
    "homing": (("homing",), {"method": 99}, "home"),
    "emergency": (("emergency",), {0x8611: "nothing"}, "identify"),
    "signals": (("signals",), {"ready_for_enable": {"index": 0x2000, "subindex": 1, "bit": 2}}, "identify"),
}


def profile_of(case: str) -> dict[str, Any]:
    """The right profile with the field of a case stated otherwise."""
    field, value, _ = CASES[case]
    made = copy.deepcopy(RIGHT_PROFILE)
    if len(field) == 1 and "+" in field[0]:
        made |= dict(zip(field[0].split("+"), value, strict=True))
    elif field:
        place = made
        for key in field[:-1]:
            place = place[key]
        place[field[-1]] = value
    return made


def tried(case: str, folder: Path, seed: int, slave: str = "lexium32") -> dict[str, Any]:
    """What came of a case."""
    verb = CASES[case][2]
    file, run = folder / "wrong.yaml", folder / "run"
    file.write_text(yaml.safe_dump(profile_of(case)))
    rig = SlaveRig(slave, seed)
    before = rig.call("doctor", "--drive", "virtual", "--as", slave, "--axis", "egc-70-600", "--profile", str(file))
    moving = words("identify" if verb == "home" else verb, run, ["--profile", str(file)])
    place = ["--home"] if verb == "home" else ["--position", f"{1e3 * START_M:g}mm"]
    outcome = rig.call(*moving, *place)
    watch, said = rig.examiner, sentence(outcome.text)
    way = float(np.ptp(watch.place_m)) if watch.place_m else 0.0
    rig.run_on(1.0)
    row: dict[str, Any] = {
        "verb": verb, "doctor": before.code, "code": outcome.code, "error": outcome.error, "said": said, "way_mm": round(1e3 * way, 2),
        "belt_n": round(max(watch.belt_n, default=0.0)), "restored": not rig.changed(),
        "stands": bool(np.abs(watch.speed_m_s[-50:]).max() < 1e-3 and not watch.powered[-1]),
        "wrong": re.findall(r"(?m)^ *WRONG +(.*)$", before.text), "remarks": re.findall(r"(?m)^ *[!-] +(.*)$", outcome.text)[:12],
        "text": outcome.text[-6000:],
    }  # fmt: skip
    rig.close()
    off = {}
    models = sorted((run / "models").glob("*.yaml"), key=lambda one: one.stat().st_mtime) if (run / "models").is_dir() else []
    if models:
        found = yaml.safe_load(models[-1].read_text())["parameters"]
        for name in ("cart.mass", "belt_stiffness.stiffness"):
            if name in found:
                off[name] = round(found[name]["value"] / _TRUE[name] - 1.0, 4)
    row["off"] = off
    done = outcome.code in (0, 1) and bool(models)
    if outcome.code is None:
        row["state"] = "RED"
    elif done:
        wrong = any(abs(one) > RIGHT for one in off.values())
        row["state"] = ("told" if _tells(outcome.text) else "SILENT") if wrong else "harmless"
    else:
        row["state"] = "before" if way < UNMOVED_M else "creep" if way < CREEP_M else "stopped"
    if row["belt_n"] > BELT_N or not row["stands"] or not row["restored"] or (not done and not said):
        row["state"] = "RED"
    return row


def _tells(text: str) -> bool:
    """True if the words of an answer doubt its numbers."""
    return bool(re.search(r"torque_scale|6076h|inertia .* times|encoder|units|profile|data sheet", text.partition("Result")[2] or text))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    kept: dict[str, dict[str, Any]] = json.loads(given.keep.read_text()) if given.keep and given.keep.is_file() else {}
    for case in CASES:
        if case in kept or not any(case.startswith(one) for one in given.only.split(",")):
            continue
        with tempfile.TemporaryDirectory(prefix="wrong-") as folder:
            kept[case] = tried(case, Path(folder), given.seed)
        row = kept[case]
        print(f"| {case} | {row['state']} | {row['code']} | {row['way_mm']} mm | {row['off']} | {row['said'][:160]} |", flush=True)
        if given.keep:
            given.keep.write_text(json.dumps(kept, indent=1))
    states = [row["state"] for row in kept.values()]
    print({state: states.count(state) for state in sorted(set(states))})


if __name__ == "__main__":
    main()
