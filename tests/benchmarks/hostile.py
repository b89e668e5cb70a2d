"""Strangers and unlucky moments: what a hostile page, file, drive value or terminal, a kill or a full disk does; fine, weak or broken.

    python tests/benchmarks/hostile.py                               every group
    python tests/benchmarks/hostile.py --only page terminal          some of them

Each case runs the command itself on a copy of a commissioned run.  Fine: done, or refused with a sentence and a documented exit code, and
nothing is lost.  Weak: harmless, but not told well.  Broken: a traceback, a hang, something lost, written or shown that must not be.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import kills
from strangers import files, forged, odd, page, terminal
from strangers.outcome import Outcome, judged, table

GROUPS = ("page", "files", "forged", "kills", "disks", "drives", "terminal", "odd")


def cases(group: str, place: kills.Place, seed: int, named: Sequence[str] = ()) -> Iterator[Outcome]:
    """The cases of a group."""
    base, folder = place.folder / "base", place.folder
    match group:
        case "page":
            yield from page.attacks(base, folder)
        case "terminal":
            yield from terminal.cases(base, folder)
        case "odd":
            yield from odd.cases(base, folder, named)
        case "files":
            yield from files.cases(base, folder, seed)
        case "forged":
            yield from forged.cases(base, folder, seed)
        case "drives":
            yield from files.drives()
        case "kills":
            for name in kills.COMMANDS:
                for told in kills.kills_of(place, name, 2, seed):
                    yield judged(group, name, "" if told == "fine" else told)
        case "disks":
            for told in kills.disks(place, list(kills.COMMANDS), 34, seed):
                yield judged(group, told.split(" with ")[0], "" if told.endswith("fine") else told)


def main() -> int:
    """The table; exit code 1 when a case was broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=list(GROUPS), choices=GROUPS)
    parser.add_argument("--named", nargs="*", default=[], help="of the odd ones, those with these words in their names")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="beltcomm-hostile-") as made:
        place = kills.Place(Path(made))
        for group in asked.only:
            for outcome in cases(group, place, asked.seed, asked.named):
                found.append(outcome)
                if outcome.verdict != "fine":
                    print(f"{outcome.verdict}: {outcome.group}: {outcome.case}: {outcome.said}", file=sys.stderr, flush=True)
    print(*table(found), sep="\n")
    return int(any(one.verdict == "broken" for one in found))


if __name__ == "__main__":
    sys.exit(main())
