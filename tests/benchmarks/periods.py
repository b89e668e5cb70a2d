"""The shipped axis commissioned at bus periods from 0.5 to 10 ms, and stops at random instants on drives with other units.

    python tests/benchmarks/periods.py [periods] [stops] [--extent quick|standard] [--count 200] [--only 4] [--lag] [--seed 7]

    --lag : the drive filters its torque setpoint with 0.5 ms, and its current loop has 0.2 ms

The machine is the independent simulator's rig; its truth is compared with what a command found through frames only.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError
from truth.plant import TruthPlant
from truth.rigs import nominal

START_M = 0.25
PERIODS_MS = (0.5, 1.0, 2.0, 4.0, 6.4, 10.0)
#: Drives whose stops are watched: ordinary ones, rpm and rpm/s, factors as from the factory, counts in tenths.
DRIVES = ("reference", "epos4", "pd4-e", "elmo-gold", "accelnet")
LAG = {"setpoint_filter_s": 5e-4, "current_loop_s": 2e-4}
TRUE = {"cart.mass": "mass_kg", "belt_stiffness.stiffness": "stiffness_n_m"}


class Watched:
    """The independent simulator's rig g_a, with the largest force of its belt; interrupts the command once after ``after_s`` of moving."""

    def __init__(self, after_s: float = float("inf")) -> None:
        self.plant = TruthPlant(nominal("g_a").axis, truth=nominal("g_a").truth)
        self.moved_s, self.after_s, self.before_n, self.stop_n = 0.0, after_s, 0.0, 0.0
        self.stopping = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)

    def brake(self, torque_nm: float) -> None:
        self.plant.brake(torque_nm)

    def step(self, torque_nm: float, duration_s: float) -> None:
        self.plant.step(torque_nm, duration_s)
        force = abs(self.plant.belt_force_n)
        if self.stopping:
            self.stop_n = max(self.stop_n, force)
        else:
            self.before_n = max(self.before_n, force)
        if abs(self.plant.velocity_rad_s) > 1.0:
            self.moved_s += duration_s
        if self.moved_s > self.after_s and not self.stopping:
            self.stopping = True
            signal.raise_signal(signal.SIGINT)


def commissioned(plant: Watched, options: dict[str, Any], drive: dict[str, Any]) -> dict[str, Any]:
    """What ``commission`` found, as a program reads it."""
    with tempfile.TemporaryDirectory() as folder:
        given = api.Options(yes=True, position_m=START_M, drive={"plant": plant, "start_position": START_M, **drive}, **options)
        return api.commission("virtual:g_a", load_axis("egc-70-600"), Path(folder) / "run", options=given).to_json()


def periods(extent: str, drive: dict[str, Any]) -> None:
    print(
        "SYNC ms |        mass kg (error %) |  stiffness kN/m (error %) | dynamic um: measured, predicted | static um | machine s | verdict"
    )
    for period_ms in PERIODS_MS:
        plant = Watched()
        try:
            found = commissioned(plant, {"quick": extent == "quick", "sample_period_s": 1e-3 * period_ms}, drive)
        except BeltcommError as problem:
            print(f"{period_ms:7g} | {type(problem).__name__}: {problem}", flush=True)
            continue
        parameters, verdict = found["model"]["parameters"], found["verdict"]
        cells = []
        for name, of in TRUE.items():
            item, true = parameters[name], plant.truth[of]
            scale = 1e3 if "stiffness" in name else 1.0
            cells.append(f"{item['value'] / scale:8.2f} ± {item['interval'] / scale:.2f} ({100 * (item['value'] / true - 1):+.2f})")
        print(
            f"{period_ms:7g} | {' | '.join(cells)} | {1e6 * verdict['measured']['dynamic_m']:.0f}, "
            f"{1e6 * verdict['predicted']['dynamic_m']:.0f} | {1e6 * verdict['measured']['static_m']:.0f} | "
            f"{found.get('machine_seconds', float('nan')):.0f} | {'passed' if verdict['passed'] else 'missed'}",
            flush=True,
        )


def stops(count: int, seed: int) -> None:
    limit_n = float(load_axis("egc-70-600").limits.feed_force_n or 0.0)
    random, worst = np.random.default_rng(seed), {name: (0.0, 0.0, 0) for name in DRIVES}
    for number in range(count):
        name, period_s = DRIVES[number % len(DRIVES)], float(random.choice([1e-3, 2e-3, 4e-3]))
        plant = Watched(float(random.uniform(0.05, 6.0)))
        drive = {"seed": seed} | ({} if name == "reference" else {"as": name})
        try:
            commissioned(plant, {"quick": True, "sample_period_s": period_s}, drive)
            end = "ended before"
        except KeyboardInterrupt:
            end = "stopped"
        except BeltcommError as problem:
            end = f"{type(problem).__name__}: {str(problem)[:120]}"
        before, after, stopped = worst[name]
        worst[name] = max(before, plant.before_n), max(after, plant.stop_n), stopped + (end == "stopped")
        print(
            f"{name:10} {1e3 * period_s:g} ms, after {plant.moved_s:.2f} s: {plant.before_n:5.1f} N, stop {plant.stop_n:5.1f} N  {end}",
            flush=True,
        )
    print(f"\nfeed force of the axis: {limit_n:g} N")
    for name, (before, after, stopped) in worst.items():
        print(f"{name:10} {stopped} stops: at most {after:.1f} N in a stop, {before:.1f} N before", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", nargs="*", default=["periods", "stops"])
    parser.add_argument("--extent", default="quick")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--lag", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=float, nargs="*")
    asked = parser.parse_args()
    if asked.only:
        PERIODS_MS = tuple(asked.only)
    begun = time.perf_counter()
    for word in asked.what:
        {
            "periods": lambda: periods(asked.extent, {"seed": asked.seed, **(LAG if asked.lag else {})}),
            "stops": lambda: stops(asked.count, asked.seed),
        }[word]()
    print(f"\n{time.perf_counter() - begun:.0f} s")
