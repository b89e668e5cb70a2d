"""One long recording through import, compare and diagnose: processor time and most memory of each.

    python tests/benchmarks/long_recording.py FOLDER [--minutes M] [--plant P]

Makes (unless it is there) a record at 1 kHz of an axis that goes to random places under its own cascade, excited now and then, and runs
the commands on it.  The figures to be kept for an hour: import 20 s and 500 MB, compare 60 s, diagnose 120 s of processor time.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

PERIOD = 1e-3
RAD = 2.0 * np.pi / 65536
AXIS = "egc-70-600"


def made(path: Path, minutes: float, plant: str, seed: int = 1) -> None:
    """The record as a foreign CSV file, written in pieces."""
    from beltcomm.control import Cascade, Feedforward
    from beltcomm.model import load_plant
    from beltcomm.simulate.loop import LoopDrive, close_loop
    from beltcomm.simulate.plant import SimulatedPlant

    draw, model = np.random.default_rng(seed), load_plant(plant).model
    ratio = model["transmission.ratio"]
    bench = SimulatedPlant(model, position_m=0.3)
    drive = LoopDrive(PERIOD, 1e-3, 3.0, 65536)
    cascade = Cascade(kp_nm_s_rad=0.02, ki_nm_rad=0.0, kpp_1_s=4.0, velocity_filter_s=0.001, feedforward=Feedforward(2.1e-3, 2.5e-3, 0.1))
    rows, place = round(60.0 * minutes / PERIOD), 0.3
    with path.open("w", encoding="ascii") as file:
        file.write("Time [s],Torque [Nm],Angle [rad]\n")
        written = 0
        while written < rows:
            positions, excited = [], []
            while sum(map(len, positions)) < 60_000:
                goal, fastest = draw.uniform(0.15, 0.45), draw.uniform(0.05, 0.6)
                lasts = max(1.9 * abs(goal - place) / fastest, 0.2)
                s = np.arange(1, round(lasts / PERIOD) + 1) / round(lasts / PERIOD)
                move = place + (goal - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
                rest = np.full(round(draw.uniform(0.1, 1.0) / PERIOD), goal)
                positions += [move, rest]
                shaken = np.kron(draw.choice([-0.15, 0.15], len(move) // 8 + 1), [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])[: len(move)]
                excited += [shaken * (draw.random() < 0.2), np.zeros(len(rest))]
                place = goal
            reference = (np.concatenate(positions) - 0.3) / ratio
            speed = np.gradient(reference, PERIOD)
            run = close_loop(bench, cascade, drive, "position", reference, speed, np.concatenate(excited))
            n = min(len(reference), rows - written)
            angle = np.round(run.position_rad[:n] / RAD) * RAD
            torque = run.torque_nm[:n] + draw.normal(0.0, 0.004, n)
            t = (written + np.arange(n)) * PERIOD
            np.savetxt(file, np.column_stack([t, torque, angle]), fmt=("%.3f", "%.5f", "%.7f"), delimiter=",")
            written += n


def measured(command: list[str]) -> tuple[float, float, float, int, str]:
    """Processor and elapsed time, s, most memory, MB, exit code and what a command said."""
    begun = os.times()
    child = subprocess.Popen([sys.executable, "-m", "beltcomm", *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert child.stdout is not None
    said = child.stdout.read()
    _, status, used = os.wait4(child.pid, 0)
    took = os.times()
    return used.ru_utime + used.ru_stime, took.elapsed - begun.elapsed, used.ru_maxrss / 1e3, os.waitstatus_to_exitcode(status), said


def main(folder: Path, minutes: float, plant: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    file, run = folder / f"{plant}-{minutes:g}.csv", folder / f"run-{plant}-{minutes:g}"
    if not file.exists():
        made(file.with_suffix(".tmp"), minutes, plant)
        file.with_suffix(".tmp").rename(file)
    print(f"{file.name}: {file.stat().st_size / 1e6:.0f} MB", flush=True)
    shutil.rmtree(run, ignore_errors=True)
    place = ["--axis", AXIS, "--experiment", "trajectory", "--closed-loop", "--start-position", "300mm"]
    for name, command in {
        "import": ["import", str(file), "--run", str(run), *place],
        "compare": ["compare", str(run)],
        "diagnose": ["diagnose", str(run)],
    }.items():
        processor, elapsed, memory, code, said = measured(command)
        print(f"{name:10} {processor:7.1f} s processor {elapsed:7.1f} s elapsed {memory:6.0f} MB  exit code {code}", flush=True)
        (folder / f"{name}-{plant}-{minutes:g}.txt").write_text(said, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--plant", default="g_a")
    main(**vars(parser.parse_args()))
