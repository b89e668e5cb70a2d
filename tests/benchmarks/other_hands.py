"""Belt axes as other hands would measure them (tests/truth/other_hands.py), each diagnosed: what was named, the path, the parameters.

    python tests/benchmarks/other_hands.py 0 20     (20 axes; half a minute each)

Right: what is hidden is named, and friction at the carriage, which all of them have; nothing else is.
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

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm import api
from beltcomm.study.summary import _share_of
from truth.other_hands import draw, record

NAMES: dict[str, set[str]] = {
    "none": set(),
    "cogging": {"cogging"},
    "tight spot": {"friction_position"},
    "direction": {"constant_offset"},
    "drag": {"quadratic_drag"},
}
#: What every one of them has, and what says more of an effect that is there.
ALLOWED = {"cart_friction", "friction_position_cart"}
TRUE = {"motor.inertia": "inertia", "cart.mass": "mass", "belt_stiffness.stiffness": "stiffness"}


def diagnosed(seed: int, folder: Path) -> dict[str, Any]:
    """What came of one of them."""
    drawn = draw(seed)
    record(drawn, seed, folder / "run")
    began = time.process_time()
    data = api.diagnose(folder / "run").data
    told = data["after"] or data["base"]
    named, wanted = set(data["named"]), NAMES[drawn.hidden]
    row = {"seed": seed, "hidden": drawn.hidden, "period_ms": 1e3 * drawn.instruments.period_s, "named": sorted(named)}
    row |= {"verdict": data["verdict"], "base": round(data["base"]["ratio"], 2), "after": round(told["ratio"], 3)}
    row |= {"right": wanted <= named, "false": sorted(named - wanted - ALLOWED), "path": data["torque_path"]["words"][:1]}
    for name, true in TRUE.items():
        found = told["parameters"].get(name)
        half = found and found["interval"]
        row[true] = round((found["value"] - getattr(drawn.machine, true)) / half, 2) if half else None
    return row | {"cpu_s": round(time.process_time() - began)}


def main() -> None:
    """Print a row for each axis, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    given = parser.parse_args()
    rows = []
    for seed in range(given.first, given.end):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(diagnosed(seed, Path(folder)))
        print(json.dumps(rows[-1]), flush=True)
    offs = [row[true] for row in rows for true in TRUE.values() if row[true] is not None]
    hidden = [row for row in rows if row["hidden"] != "none"]
    for words, count, of in [
        ("without a false name", sum(not row["false"] for row in rows), len(rows)),
        ("hidden effect named", sum(row["right"] for row in hidden), len(hidden)),
        ("parameters in their intervals", sum(abs(off) <= 1.0 for off in offs), len(offs)),
    ]:
        share = _share_of(words, count, of)
        print(f"{words}: {share.count} of {share.of} ({100 * share.low:.0f} to {100 * share.high:.0f} %)")


if __name__ == "__main__":
    main()
