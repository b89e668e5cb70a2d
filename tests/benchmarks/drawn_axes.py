"""Belt axes drawn at random, each commissioned whole on the independent plant: verdict, model, belt force.

    python tests/benchmarks/drawn_axes.py 1 21              (20 axes; a minute each)
    python tests/benchmarks/drawn_axes.py 1 21 --highest 400   (motors that swing faster than rows of 1 ms show well)

What makes one right: tests/session/drawn_axis.py.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm.study.summary import _share_of
from session.drawn_axis import commissioned


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
    right = _share_of("right", sum(row["right"] for row in rows), len(rows))
    beyond, outside = sum(row["belt"] > row["bears"] for row in rows), sum(not row["inside"] for row in rows)
    share = f"{right.count} of {right.of} right ({100 * right.low:.0f} to {100 * right.high:.0f} %)"
    print(f"{share}; belt beyond its limit {beyond}, off its travel {outside}")


if __name__ == "__main__":
    main()
