"""Known-truth examination: how right is the final fit, and do its intervals hold?

Every run commissions, through the CAN bus, a virtual axis whose machine is the independent simulator of ``tests/truth`` with all
parameters drawn ±20 % around a rig of the thesis; the pipeline gets frames and axis.yaml only.  Run it with

    python tests/benchmarks/known_truth.py measure FOLDER g_a 0 200     records runs, one run folder each
    python tests/benchmarks/known_truth.py fit FOLDER g_a 0 200         fits them, one line of JSON each
    python tests/benchmarks/known_truth.py table FOLDER g_a g_b         errors and coverage

Each step goes on where it was stopped.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.errors import BeltcommError
from beltcomm.experiments.commission import (
    Findings,
    Settings,
    close_first_loop,
    identify_here,
    record_steps,
)
from beltcomm.experiments.referencing import reference
from beltcomm.identify.final import final_model
from beltcomm.machine.machine import Machine
from beltcomm.rundata import analyse
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from truth.rigs import draw

AXIS = "egc-70-600"
#: (name in the table, name in the fit, name in the truth, target in %)
COMPARED = (
    ("inertia", "motor.inertia", "inertia_kg_m2", None),
    ("mass", "cart.mass", "mass_kg", 3.0),
    ("stiffness", "belt_stiffness.stiffness", "stiffness_n_m", 3.0),
    ("belt damping", "belt_damping.damping", "belt_damping_n_s_m", None),
    ("viscous", "viscous.damping", "viscous_nm_s_rad", None),
    ("Coulomb motor", "coulomb.level", "coulomb_motor_nm", None),
    ("Coulomb cart", "cart_friction.level", "coulomb_cart_n", None),
    ("resonance", "resonance", "resonance_hz", 1.0),
    ("antiresonance", "antiresonance", "antiresonance_hz", 1.0),
    ("Coulomb", "coulomb_total", "coulomb_total_nm", 5.0),
)
#: Whose intervals are pooled.
POOLED = ("mass", "stiffness", "resonance", "antiresonance", "Coulomb")


def measure(folder: Path, rig: str, seed: int) -> None:
    """Record one drawn axis up to the friction sweep."""
    run = folder / f"{rig}_{seed}"
    if (run / "truth.json").exists():
        return
    axis = load_axis(AXIS)
    plant = draw(rig, np.random.default_rng([seed, 1]))
    findings = Findings()
    with open_drive("virtual:" + rig, {"plant": plant, "seed": seed}) as drive:
        record = RunFolder.create(run, axis)
        with Machine(drive, axis, record, Silence()) as machine:
            reference(machine, Settings())
            model = identify_here(machine, findings)
            cascade = close_first_loop(machine, findings, model)
            record_steps(machine, findings, model, cascade, "standard")
        record.save("models", "first", model.to_dict())
    (run / "truth.json").write_text(json.dumps({**plant.truth, "machine_seconds": machine.machine_seconds}))


def fit(folder: Path, rig: str, seed: int) -> None:
    """Fit one recorded axis; the truth is read only to write it beside the result."""
    run = folder / f"{rig}_{seed}"
    out = run / "fit.json"
    if out.exists() or not (run / "truth.json").exists():
        return
    record = RunFolder.open(run)
    final = final_model(record.recordings(), record.axis, 65536)
    numbers = {n: (v.value, v.interval) for n, v in final.fit.model.parameters.items()}
    numbers |= {n: (c.value, c.interval) for n, c in analyse.characteristics(final.fit, 0.28).items()}
    truth = json.loads((run / "truth.json").read_text())
    out.write_text(json.dumps({"found": numbers, "truth": truth, "misfit": final.fit.misfit, "remarks": final.fit.remarks}))


def table(folder: Path, rigs: list[str]) -> None:
    """Errors in % and coverage of the 95 % intervals."""
    pooled: list[bool] = []
    for rig in rigs:
        rows = [json.loads(p.read_text()) for p in sorted(folder.glob(f"{rig}_*/fit.json"))]
        failed = len(list(folder.glob(f"{rig}_*/failed.txt")))
        print(
            f"{rig}: {len(rows)} runs fitted, {failed} failed, misfit {np.mean([r['misfit'] for r in rows]):.3f} "
            f"(largest {max(r['misfit'] for r in rows):.3f}), machine time {np.mean([r['truth']['machine_seconds'] for r in rows]):.1f} s"
        )
        for title, found, true, target in COMPARED:
            value = np.array([r["found"][found][0] if found in r["found"] else np.nan for r in rows], dtype=float)
            half = np.array([(r["found"][found][1] or 0.0) if found in r["found"] else np.nan for r in rows], dtype=float)
            right = np.array([r["truth"][true] for r in rows])
            error = 100.0 * (value / right - 1.0)
            inside = np.abs(value - right) <= half
            if title in POOLED:
                pooled += list(inside)
            share = f"{100 * np.mean(np.abs(error) < target):5.1f} % within {target:g} %" if target else ""
            score = (value - right) / half * 1.96
            print(
                f"  {title:14} bias {np.mean(error):+7.3f} %  std {np.std(error):6.3f} %  worst {np.max(np.abs(error)):6.3f} %  "
                f"coverage {100 * np.mean(inside):5.1f} %  z {np.mean(score):+5.2f} ± {np.std(score):4.2f}  {share}"
            )
    print(f"pooled coverage of {', '.join(POOLED)}: {100 * np.mean(pooled):.1f} %")


def main() -> None:
    """Command line."""
    step, folder = sys.argv[1], Path(sys.argv[2])
    if step == "table":
        table(folder, sys.argv[3:])
        return
    rig, first, last = sys.argv[3], int(sys.argv[4]), int(sys.argv[5])
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(first, last):
        try:
            (measure if step == "measure" else fit)(folder, rig, seed)
        except BeltcommError as error:
            (folder / f"{rig}_{seed}" / "failed.txt").write_text(f"{step}: {type(error).__name__}: {error}")
            print(rig, seed, error, flush=True)


if __name__ == "__main__":
    main()
