"""Tracking errors side by side: what feedforward and prefilter bring, and what a drive without them can do.

Through the CAN bus, on the independent simulator of ``tests/truth``: each rig is commissioned once on the reference profile, then
drives the 0 to 0.5 m move with the limits T_A four times; then it is commissioned on cmmp-as, and drives T_A as far as that drive
follows, slower ones, and the fastest that is predicted to stay within 1 mm.  Errors of the motor as the drive reports them, of the
carriage as the simulator has them, and both as predicted before.  Run it with

    python tests/benchmarks/verify_table.py [FOLDER] [g_a g_b] [reference cmmp-as]

FOLDER keeps the run folders; without one they are temporary.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm import api
from beltcomm.api import Options
from beltcomm.experiments import proving, verification
from beltcomm.machine.machine import Machine
from beltcomm.model import load_model
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm.verify import TrackingError, Verdict, tracking_error
from session.bench import RATIO, Bench

AXIS = "egc-70-600"
YES = Options(yes=True, seed=1)
#: Shares of T_A's speed that a drive without velocity feedforward is asked for, beside the one within 1 mm.
SHARES = (1.0, 0.3, 0.1)


@contextmanager
def bench_of(rig: str, profile: str) -> Iterator[Bench]:
    """A virtual drive on the truth simulator that every command of the API finds in place of its own."""
    bench = Bench(rig, profile=profile)
    opened, api.open_drive = api.open_drive, bench.open  # type: ignore[assignment]
    try:
        yield bench
    finally:
        api.open_drive = opened
        bench.close()


def commissioned(bench: Bench, run: Path) -> api.Result:
    """The whole job, with its two times."""
    begun = time.perf_counter()
    result = api.commission(bench.name, AXIS, run, options=YES)
    wall_s = time.perf_counter() - begun
    machine_s = result.data["machine_seconds"]
    print(f"  commissioned in {wall_s:.0f} s, {machine_s:.0f} s on the machine, {bench.now_s:.0f} s on the bus")
    design = RunFolder.open(run).load("designs", "final")
    gains = ", ".join(f"{name} {value:.4g}" for name, value in design["parameters"].items() if value)
    print(f"  {gains}")
    for line in design["remarks"]:
        print(f"  {line}")
    for line in result.data["remarks"]:
        print(f"  {line}")
    return result


def at_the_carriage(bench: Bench, run: Path, name: str) -> TrackingError:
    """Error of the true carriage against the recorded reference."""
    move = RunFolder.open(run).recording(name)
    assert move.reference_position is not None
    first = bench.plant.first_tick_of(move, bench.start_m)
    ticks = first + np.round((move.t_s - move.t_s[0]) / 1e-3).astype(int)
    cart = bench.start_m + bench.plant.cart_m(0, int(ticks[-1]) + 1)[ticks]
    return tracking_error(move.t_s, RATIO * move.reference_position, cart)


def head() -> None:
    print(f"  {'':34} {'dynamic, mm':>40} {'static, um':>40}")
    print(f"  {'':34}" + 2 * f" {'motor':>9} {'pred.':>9} {'cart':>9} {'pred.':>9}")


def row(title: str, verdict: Verdict, cart: TrackingError) -> None:
    parts = (verdict.measured, verdict.predicted, cart, verdict.predicted_cart)
    dynamic = " ".join(f"{1e3 * part.dynamic_m:9.3f}" for part in parts)
    static = " ".join(f"{1e6 * part.static_m:9.1f}" for part in parts)
    print(f"  {title:34} {dynamic} {static}", flush=True)


def verified(bench: Bench, run: Path, title: str, **options: Any) -> None:
    """One line: T_A with the run's design."""
    result = api.verify(bench.name, run, options=replace(YES, **options))
    name = result.data["recording"]
    number = RunFolder.open(run).load_result(f"verify_{name}")
    assert number is not None
    row(title, verdict_of(number), at_the_carriage(bench, run, name))


def verdict_of(saved: dict[str, Any]) -> Verdict:
    errors = {key: TrackingError(**saved[key]) for key in ("measured", "predicted", "predicted_cart")}
    return Verdict(saved["passed"], errors["measured"], errors["predicted"], None, errors["predicted_cart"], tuple(saved["reasons"]))


def reference(rig: str, folder: Path) -> None:
    """The thesis's comparison: feedforward nonlinear, linear and none, and no prefilter."""
    print(f"{rig}, reference profile, T_A from 0 to 0.5 m")
    run = folder / f"{rig}_reference"
    with bench_of(rig, "reference") as bench:
        commissioned(bench, run)
        head()
        for kind in ("nonlinear", "linear", "none"):
            verified(bench, run, f"feedforward {kind}", feedforward=kind)
        bare = folder / f"{rig}_bare"
        shutil.copytree(run, bare)
        design = api.design(bare, options=replace(YES, prefilter="none"))
        verified(bench, bare, "feedforward nonlinear, no prefilter")
        print("  without prefilter: " + "\n".join(design.text).partition("K_P")[2].partition("\n")[0].join(("K_P", "")))


def cmmp_as(rig: str, folder: Path) -> None:
    """The drive without feedforward: slower and slower, down to the fastest move within 1 mm."""
    print(f"{rig}, cmmp-as")
    run = folder / f"{rig}_cmmp-as"
    with bench_of(rig, "cmmp-as") as bench:
        result = commissioned(bench, run)
        head()
        row("move of the commissioning", result.data["verdict"], at_the_carriage(bench, run, "move_1"))
        record = RunFolder.open(run)
        model = load_model(record.file("models", "final"))
        with bench.open(bench.name) as drive, Machine(drive, record.axis, record, Silence()) as machine:
            cascade, delay_s = offline.cascade_of(record.load("designs", "final"), model, drive.capabilities.structure)
            standard = verification.standard_move(machine, model)
            moves = {f"T_A at {100 * share:.0f} % of its speed": standard.at(share, 1e-3) for share in SHARES}
            slow = verification.fastest(machine, model, cascade, delay_s, standard)
            if slow is not None:
                moves[f"fastest within 1 mm, {slow.duration_s:.0f} s"] = slow
            for number, (title, move) in enumerate(moves.items(), start=2):
                verdict, asked = proving.verify_move(machine, model, cascade, delay_s, move, f"move_{number}")
                row(f"{title}, {1e3 * asked.speed_m_s:.3g} mm/s", verdict, at_the_carriage(bench, run, f"move_{number}"))


def main() -> None:
    """Command line."""
    words = sys.argv[1:]
    rigs = [word for word in words if word in ("g_a", "g_b")] or ["g_a", "g_b"]
    profiles = [word for word in words if word in ("reference", "cmmp-as")] or ["reference", "cmmp-as"]
    kept = [Path(word) for word in words if word not in (*rigs, *profiles)]
    with tempfile.TemporaryDirectory() as temporary:
        folder = kept[0] if kept else Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for rig in rigs:
            for profile in profiles:
                (reference if profile == "reference" else cmmp_as)(rig, folder)


if __name__ == "__main__":
    main()
