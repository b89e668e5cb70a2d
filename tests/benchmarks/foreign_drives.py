"""The table drive x verb: the product on each drive that the virtual one can play, every cell judged behind the bus.

    python tests/benchmarks/foreign_drives.py                                  (all; two minutes for each that is commissioned)
    python tests/benchmarks/foreign_drives.py --drives epos4,akd --verbs doctor,commission
    python tests/benchmarks/foreign_drives.py --period 0.002                   (at a SYNC period)
    python tests/benchmarks/foreign_drives.py --keep FILE                      (rows that are there already are not run again)

"done": the verb reached its end, whatever its verdict.  "refused": nothing moved, with a sentence that says what to do (of the doctor:
something is WRONG).  "found": refused with such a sentence within the room that the plan gives its first motions, which showed a unit that
the drive does not tell; the row with ``+`` is the same drive with the profile that the sentence asks for.  RED: anything else: motion and
then a failure, a setting that is not restored, a belt force above what a plan allows, an axis that does not stand in the end, a doctor that
finds nothing wrong where commissioning is refused.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm.configfiles import config_names
from campaign.sharing import shared
from slaves.bench import TOLD, VERBS, Cell, run_row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", default=",".join(("reference", "cmmp-as", *config_names("slaves"), *(f"{name}+" for name in TOLD))))
    parser.add_argument("--verbs", default=",".join(VERBS))
    parser.add_argument("--period", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    kept: dict[str, list[dict[str, object]]] = {}
    if given.keep and given.keep.is_file():
        kept = json.loads(given.keep.read_text())
    verbs = tuple(given.verbs.split(","))
    for drive in given.drives.split(","):
        if drive not in kept:
            begun = time.perf_counter()
            with shared():  # Ctrl-C and a lost host come in a command that was run before
                kept[drive] = [asdict(cell) for cell in run_row(drive, verbs, given.seed, given.period)]
            if given.keep:
                given.keep.write_text(json.dumps(kept, indent=1))
            print(f"{drive}: {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    cells = [Cell(**row) for rows in kept.values() for row in rows]  # type: ignore[arg-type]
    print("| drive | " + " | ".join(verbs) + " | belt |")
    print("|---" * (len(verbs) + 2) + "|")
    for drive in kept:
        own = {cell.verb: cell for cell in cells if cell.slave == drive}
        states = (own[verb].state if verb in own else "" for verb in verbs)
        print(f"| {drive} | " + " | ".join(states) + f" | {max(cell.belt_n for cell in own.values()):.0f} N |")
    print()
    for cell in cells:
        if cell.state != "done" or cell.code == 1:
            print(f"{cell.slave} {cell.verb}: {cell.state}, {cell.code}: {cell.why}")


if __name__ == "__main__":
    main()
