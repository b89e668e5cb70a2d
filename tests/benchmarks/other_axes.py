"""Whole commissionings of every other kind of axis: what was found against the truth, and the move as measured and predicted.

python tests/benchmarks/other_axes.py [SEED]              the five shipped ones
python tests/benchmarks/other_axes.py drawn SEED ...      drawn ones, each typed: beltcomm init --set ..., then beltcomm commission

A drawn axis has the motor of the shipped one and a load, a stiffness, frictions and a lead or a pinion of its own; its data sheet is
off by up to 7 % of inertia and 25 % of stiffness.  Of every third seed the elastic kinds are rigid and the table has a coupling.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from beltcomm import api
from beltcomm.axis import Axis, load_axis
from beltcomm.axis.kinds import ARC_M
from beltcomm.model import Model, load_model, load_plant
from beltcomm.model.value import Value
from beltcomm.runfolder import RunFolder

#: Virtual plant -> shipped axis.
AXES = {
    "ball_screw": "ball-screw",
    "rack": "rack",
    "coupled_load": "coupled-load",
    "torque_table": "torque-table",
    "linear_motor": "linear-motor",
}
#: N/m at the arc: a coupling of 900 N m/rad under a table.
TABLE_N_M = 900.0 / ARC_M**2
CONFIGS = Path(__file__).resolve().parents[2] / "configs"


class Row(NamedTuple):
    """A quantity: its name with unit, the truth and what was found, in SI inside, and the factor to the unit shown."""

    what: str
    true: float
    found: Value
    scale: float


def rows(axis: Axis, truth: Model, model: Model) -> Iterator[Row]:
    """Load, stiffness and friction, in the units of the axis."""
    turns, ratio = axis.kind == "rotary", axis.transmission_m_rad
    behind = (truth["motor.inertia"] - axis.motor_side_inertia_kg_m2) / ratio**2
    load = truth["cart.mass"] if "cart.mass" in truth.parameters else behind
    yield Row("load, kg m²" if turns else "load, kg", load, model.parameters["cart.mass"], ARC_M**2 if turns else 1.0)
    if "belt_stiffness.stiffness" in truth.parameters:
        stiffness = truth["belt_stiffness.stiffness"], model.parameters["belt_stiffness.stiffness"]
        yield Row("stiffness, N m/rad", *stiffness, ARC_M**2) if turns else Row("stiffness, N/µm", *stiffness, 1e-6)
    straight = axis.kind == "linear"
    friction = "Coulomb friction at the motor, N" if straight else "Coulomb friction at the motor, mN m"
    yield Row(friction, truth["coulomb.level"], model.parameters["coulomb.level"], 1.0 / ratio if straight else 1e3)


def shown(axis: Axis, truth: Model, run: Path, mark: str) -> Iterator[str]:
    """Lines of the table of one axis."""
    if not (run / "models" / "final.yaml").is_file():
        yield f"| {axis.name} ({axis.kind}): {mark} | | | | | | |"
        return
    model, kept = load_model(run / "models" / "final.yaml"), run / "results" / "verify_move_1.yaml"
    unit, errors = "m°" if axis.kind == "rotary" else "µm", ["-", "-"]
    if kept.is_file():
        verdict = RunFolder.open(run).load("results", "verify_move_1")
        errors = [f"{1e6 * verdict[key]['dynamic_m']:.2f} {unit}" for key in ("measured", "predicted")]
    cells = [f"{axis.name} ({axis.kind}, {'rigid' if axis.rigid else 'elastic'}): {mark}", *errors]
    for row in rows(axis, truth, model):
        half = row.found.interval or float("nan")
        found = f"{row.scale * row.found.value:.5g} ± {row.scale * half:.2g}"
        off = f"{abs(row.found.value - row.true) / half:.2f}"
        yield f"| {cells[0]} | {row.what} | {row.scale * row.true:.5g} | {found} | {off} | {cells[1]} | {cells[2]} |"
        cells = ["", "", ""]


class Drawn(NamedTuple):
    """Plant file and what is typed after ``--set``."""

    plant: dict[str, Any]
    entries: dict[str, Any]


def drawn(kind: str, seed: int) -> Drawn:
    """A machine and its data sheet."""
    rng = np.random.default_rng((seed, list(AXES).index(kind)))
    plant = yaml.safe_load((CONFIGS / "plants" / f"{kind}.yaml").read_text(encoding="utf-8"))
    entries = flat(yaml.safe_load((CONFIGS / "axes" / f"{AXES[kind]}.yaml").read_text(encoding="utf-8")))
    values, turned = plant["parameters"], seed % 3 == 2

    def times(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.uniform())

    load, stiff, wear, grease = times(0.5, 2.0), times(0.6, 1.8), times(0.6, 1.7), times(0.6, 1.7)
    geometry = times(0.7, 1.4) if kind in ("ball_screw", "rack") else 1.0
    ratio = values["transmission.ratio"]["value"] = geometry * values["transmission.ratio"]["value"]
    for entry in ("transmission.lead_m", "transmission.pinion_radius_m"):
        if entry in entries:
            entries[entry] *= geometry
    if kind in ("torque_table", "linear_motor"):  # motor and load are one inertia
        motor = entries["motor.inertia_kg_m2"] if kind == "torque_table" else entries["motor.mass_kg"] * ratio**2
        mass = load * (values["motor.inertia"]["value"] - motor) / ratio**2
    else:
        motor, mass = values["motor.inertia"]["value"], load * values["cart.mass"]["value"]
    frictions = {"coulomb.level": wear, "viscous.damping": grease, "cart_friction.level": wear}
    for name, factor in frictions.items():
        if name in values:
            values[name]["value"] *= factor
    elastic = (kind in ("torque_table",)) if turned else kind not in ("torque_table", "linear_motor")
    if elastic:
        stiffness = stiff * values.get("belt_stiffness.stiffness", {"value": TABLE_N_M})["value"]
        damping = 0.04 * math.sqrt(stiffness / (ratio**2 / motor + 1.0 / mass))
        plant["bodies"] = ["motor", "cart"]
        plant["effects"] = ["belt_stiffness", "belt_damping", *(e for e in plant["effects"] if not e.startswith("belt_"))]
        given = {"motor.inertia": (motor, "kg m2", "motor"), "cart.mass": (mass, "kg", "cart")}
        given |= {"belt_stiffness.stiffness": (stiffness, "N/m", "belt"), "belt_damping.damping": (damping, "N s/m", "belt")}
        values |= {
            n: {"value": v, "unit": u, "side": s, "low": 1e-9, "high": 1e11, "interval": None, "origin": "drawn"}
            for n, (v, u, s) in given.items()
        }
    else:
        values["motor.inertia"]["value"] = motor + mass * ratio**2
        if "cart_friction.level" in values:
            values["coulomb.level"]["value"] += ratio * values["cart_friction.level"]["value"]
        plant["bodies"] = ["motor"]
        plant["effects"] = [e for e in plant["effects"] if not e.startswith(("belt_", "cart_"))]
        plant["parameters"] = {n: one for n, one in values.items() if not n.startswith(("belt_", "cart"))}
    for entry in ("transmission.stiffness_n_m", "coupling.stiffness_nm_rad"):
        if entry in entries:
            entries[entry] *= stiff * rng.uniform(0.8, 1.25)
            if not elastic:
                del entries[entry]
    if elastic and kind == "torque_table":
        entries["transmission.stiffness_nm_rad"] = stiff * TABLE_N_M * ARC_M**2 * rng.uniform(0.8, 1.25)
    for entry in ("motor.inertia_kg_m2", "motor.mass_kg"):
        if entry in entries:
            entries[entry] *= rng.uniform(0.93, 1.07)
    return Drawn(plant, entries)


def flat(tree: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Entries of a file by their dotted names."""
    found = {}
    for key, value in tree.items():
        found |= flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return found


def typed(seeds: list[int]) -> None:
    """Each drawn axis from ``init --set`` to its verdict."""
    for seed in seeds:
        for kind in AXES:
            made = drawn(kind, seed)
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder)
                (place / "plant.yaml").write_text(yaml.safe_dump(made.plant), encoding="utf-8")
                sets = [word for key, value in made.entries.items() for word in ("--set", f"{key}={value}")]
                lines = ([["init", "axis.yaml", *sets]], [["commission", "--drive", "virtual:./plant.yaml", "--axis", "axis.yaml"]])
                code, out = 0, ""
                for (line,), more in zip(lines, ([], ["--run", "run", "--seed", str(seed), "--yes"]), strict=True):
                    done = subprocess.run(
                        [sys.executable, "-m", "beltcomm", *line, *more], cwd=place, capture_output=True, text=True, check=False
                    )
                    code, out = done.returncode, f"{out}{done.stdout}{done.stderr}"
                    if code:
                        break
                mark = {0: "PASS"}.get(code, f"exit {code}")
                truth = load_plant(str(place / "plant.yaml")).model
                if (place / "axis.yaml").is_file():
                    print(*shown(load_axis(str(place / "axis.yaml")), truth, place / "run", f"{mark}, seed {seed}"), sep="\n", flush=True)
                if code:
                    print("\n".join(out.strip().splitlines()[-25:]), flush=True)


def main(seed: int) -> None:
    """Commission each shipped axis."""
    for plant, name in AXES.items():
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            done = api.commission(f"virtual:{plant}", name, run, options=api.Options(yes=True, seed=seed, report=False))
            mark = "PASS" if done.exit_code == 0 else "FAIL"
            print(*shown(load_axis(name), load_plant(plant).model, run, mark), sep="\n", flush=True)


if __name__ == "__main__":
    print("| axis | quantity | built in | found, 95 % | error / interval | following error, measured | predicted |")
    print("|---|---|---|---|---|---|---|")
    if sys.argv[1:2] == ["drawn"]:
        typed([int(seed) for seed in sys.argv[2:]])
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
