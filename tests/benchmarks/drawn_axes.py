"""Belt axes drawn at random, each commissioned whole on the independent plant: verdict, model, belt force.

    python tests/benchmarks/drawn_axes.py 1 21              (20 axes; a minute each)
    python tests/benchmarks/drawn_axes.py 1 21 --highest 400   (motors that swing faster than rows of 1 ms show well)

An axis is right when it is judged by its move (exit 0 or 1 with a model that is trusted), the truth lies within two of its model's
intervals, the belt never carried more than its limit and friction, and the carriage stayed on its travel.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import yaml

from beltcomm import api
from beltcomm.configfiles import find_config
from beltcomm.errors import BeltcommError
from beltcomm.study.summary import share_of
from session.bench import Bench
from truth import TruthPlant
from truth.drawn_axes import draw_axis

NAMES = {"cart.mass": "mass_kg", "motor.inertia": "inertia_kg_m2"}


def commissioned(seed: int, folder: Path, highest_hz: float) -> dict[str, Any]:
    """What came of one axis."""
    drawn = draw_axis(seed, highest_hz)
    file, plant, start = folder / "axis.yaml", folder / "plant.yaml", 0.5 * drawn.travel_m
    file.write_text(yaml.safe_dump(drawn.sheet), encoding="utf-8")
    shown = yaml.safe_load(find_config("plants", "g_a").read_text(encoding="utf-8"))  # the drive's zero; the machine is the truth
    shown["parameters"]["transmission.ratio"]["value"], shown["drive"] = drawn.axis.transmission_m_rad, drawn.drive
    plant.write_text(yaml.safe_dump(shown), encoding="utf-8")
    bench = Bench(name=f"virtual:{plant}", plant=TruthPlant(drawn.axis, start_position_m=start), start_m=start)
    row: dict[str, Any] = {"seed": seed, "resonance_hz": round(drawn.resonance_hz), "counts": drawn.drive["counts_per_rev"]}
    began = time.process_time()
    try:
        with patch.object(api, "open_drive", bench.open):
            result = api.commission(bench.name, str(file), folder / "run", options=api.Options(yes=True, seed=1))
        row |= {"exit": result.exit_code, "said": result.text[1].strip()}
        found = result.data["model"]["parameters"]
        for name, true in NAMES.items():
            value, half, truth = found[name]["value"], found[name]["interval"], getattr(drawn.axis, true)
            row[name] = (
                round(value / truth - 1.0, 5),
                round((value - truth) / half, 2) if half else None,
            )
    except BeltcommError as problem:
        row |= {"exit": problem.exit_code, "said": f"{type(problem).__name__}: {problem}"}
    finally:
        bench.close()
    friction = drawn.axis.coulomb_cart_n
    force, places = bench.plant.belt_force_n, start + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    row |= {"belt": round(float(np.abs(force).max(initial=0.0))), "bears": round(drawn.sheet["limits"]["feed_force_n"] + friction)}
    row |= {"inside": bool(len(places) == 0 or (places.min() >= 0.0 and places.max() <= drawn.travel_m))}
    row |= {"machine_s": round(bench.now_s), "cpu_s": round(time.process_time() - began)}
    told = [row[name][1] for name in NAMES if name in row]
    row["right"] = (
        len(told) == len(NAMES)
        and all(off is not None and abs(off) < 2.0 for off in told)
        and "NOT TRUSTED" not in row["said"]
        and row["belt"] <= row["bears"]
        and row["inside"]
    )
    return row


def main() -> None:
    """Print a row for each axis, then the count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    parser.add_argument("--highest", type=float, default=200.0, help="Hz, of the motor's resonance in the middle of the travel")
    given = parser.parse_args()
    rows = []
    for seed in range(given.first, given.end):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(commissioned(seed, Path(folder), given.highest))
        print(json.dumps(rows[-1]), flush=True)
    right = share_of("right", sum(row["right"] for row in rows), len(rows))
    beyond, outside = sum(row["belt"] > row["bears"] for row in rows), sum(not row["inside"] for row in rows)
    share = f"{right.count} of {right.of} right ({100 * right.low:.0f} to {100 * right.high:.0f} %)"
    print(f"{share}; belt beyond its limit {beyond}, off its travel {outside}")


if __name__ == "__main__":
    main()
