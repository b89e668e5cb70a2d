"""How fast, and how well for its time: simulation, virtual drive, estimation, analysis, and what others make of the same data.

    python tests/benchmarks/speed.py [TOPIC ...] [--rounds N] [--draws N] [--run FOLDER] [--history FILE]

TOPIC : simulation, drive, estimation, machine, analysis, peers; all of them when none is named.   --rounds : of each comparison (7), taken
in turn.   --draws : seeds of a Monte Carlo (8); those that the cache holds are not drawn again.   --run : a run folder for the analysis,
copied first; without one a commissioning makes it.   --history : where figures are kept, each beside what it was before (in the user's
cache).

Ratios and quartiles are printed, and whether the machine was loaded: a time alone says little on a machine that others use.  Nothing here
is a test: nothing fails when it is slow.  Other tools come with ``pip install -e '.[bench]'``; those that are missing are left out.
docs/benchmarks.md has the tables.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.speeds.measure import HISTORY, Figure, keep, last, machine

TOPICS = ("simulation", "drive", "estimation", "machine", "analysis", "peers")
#: Topics whose module has another name.
MODULES = {"machine": "machine_time"}


def figures(topic: str, options: argparse.Namespace) -> Iterator[Figure]:
    """The figures of one topic."""
    module: Any = importlib.import_module(f"benchmarks.speeds.{MODULES.get(topic, topic)}")
    own = {"estimation": (options.draws,), "analysis": (options.rounds, options.run), "peers": (options.draws,)}
    yield from module.run(*own.get(topic, (options.rounds,)))


def main(words: list[str] | None = None) -> None:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=", ".join(TOPICS))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--run", type=Path)
    parser.add_argument("--history", type=Path, default=HISTORY)
    options = parser.parse_args(words)
    if unknown := sorted(set(options.topics) - set(TOPICS)):
        parser.error(f"there is no topic {', '.join(unknown)}; there are {', '.join(TOPICS)}")
    described = machine()
    print(f"{datetime.date.today()}, {described}")
    for topic in options.topics or TOPICS:
        print(f"\n{topic}")
        found: list[Figure] = []
        for figure in figures(topic, options):
            print(figure.line(), flush=True)
            found.append(figure)
        before = keep(options.history, datetime.datetime.now().isoformat(timespec="seconds"), described, found)
        for figure in found:
            if (old := last(before, figure)) is not None and abs(figure.value / old - 1.0) > 0.2:
                print(f"  changed: {figure.name} was {old:.4g} {figure.unit}, is {figure.value:.4g}")


if __name__ == "__main__":
    main()
