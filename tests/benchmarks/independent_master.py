"""An independent master on every drive that the virtual one can play: checks of CiA 301 and CiA 402 in random order, with random values.

    python tests/benchmarks/independent_master.py               (10 seeds for each drive; five minutes)
    python tests/benchmarks/independent_master.py --seeds 100 --drives reference

The master (tests/independent) is written from the standards and shares no code with the virtual drive, the adapter or python-canopen.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm.configfiles import config_names
from independent.checks import CHECKS
from independent.rounds import rounds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", default=",".join(("reference", "cmmp-as", *config_names("slaves"))))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="seed of the first round")
    given = parser.parse_args()
    print(f"{len(CHECKS)} checks, {given.seeds} rounds on each drive")
    for name in given.drives.split(","):
        found = Counter(text for seed in range(given.first, given.first + given.seeds) for text in rounds(name, seed))
        print(f"{name}: {sum(found.values())} deviations")
        for text, count in found.most_common():
            print(f"    {count} x {text}")


if __name__ == "__main__":
    main()
