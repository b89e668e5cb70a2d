"""Whole commissionings of every other kind of axis: what was found against the truth, and the move as measured and predicted.

python tests/benchmarks/other_axes.py [SEED]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

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


def main(seed: int) -> None:
    """Commission each axis and print the table."""
    print("| axis | quantity | built in | found, 95 % | error / interval | following error, measured | predicted |")
    print("|---|---|---|---|---|---|---|")
    for plant, name in AXES.items():
        axis = load_axis(name)
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            done = api.commission(f"virtual:{plant}", name, run, options=api.Options(yes=True, seed=seed, report=False))
            model, verdict = load_model(run / "models" / "final.yaml"), RunFolder.open(run).load("results", "verify_move_1")
        unit = "m°" if axis.kind == "rotary" else "µm"
        errors = [f"{1e6 * verdict[key]['dynamic_m']:.2f} {unit}" for key in ("measured", "predicted")]
        shown = [f"{axis.name} ({axis.kind}, {'rigid' if axis.rigid else 'elastic'}): {'PASS' if done.exit_code == 0 else 'FAIL'}", *errors]
        for row in rows(axis, load_plant(plant).model, model):
            half = row.found.interval or float("nan")
            found = f"{row.scale * row.found.value:.5g} ± {row.scale * half:.2g}"
            off = f"{abs(row.found.value - row.true) / half:.2f}"
            print(f"| {shown[0]} | {row.what} | {row.scale * row.true:.5g} | {found} | {off} | {shown[1]} | {shown[2]} |", flush=True)
            shown = ["", "", ""]


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
