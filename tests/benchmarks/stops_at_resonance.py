"""Stops while the belt swings at its resonance: what it bears then, held against feed force and the guide's friction.

    python tests/benchmarks/stops_at_resonance.py              (12 draws; a quarter of an hour on a quiet core)
    python tests/benchmarks/stops_at_resonance.py --draws 3 --seed 40
    python tests/benchmarks/stops_at_resonance.py --keep FILE  (goes on with what is there)
    python tests/benchmarks/stops_at_resonance.py --report FILE

A draw is a machine on the shipped axis' data sheet: carriage, belt, its damping and friction are drawn, and the SYNC period.  On each, an
identification in open loop with a chirp, which passes the resonance with all that the limits allow, and on its run two in closed loop
while the carriage travels: torque and speed setpoint excited.  Each runs undisturbed first, then again, and is forked at instants drawn
from those in which the belt swings most (the largest fiftieth of 20 ms); in the child it is ended by Ctrl-C, by the host's death or by a
fault that brakes.  The machine's equations are the product's own here; independent ones are asked in tests/session/drawn_stops.py.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from beltcomm.axis import load_axis
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.study.summary import _share_of
from campaign.judge import TRAVEL_M
from campaign.rig import BUFFERS_M, PLANT, STANDING_M_S, START_M
from campaign.sharing import shared
from slaves.bench import AXIS, SlaveRig, sentence
from slaves.branch import Branches

ENDS = ("Ctrl-C", "host lost", "EMCY, braked")
WAYS = ("open", "direct", "setpoint")
PERIODS_S = (0.001, 0.001, 0.002)
#: Largest share of the instants that are drawn from; s over which the belt's force is a maximum; s between two forks.
LARGEST, OVER_S, APART_S = 0.02, 0.02, 0.02
AFTERWARDS_S = 3.0
FEED_N = load_axis(AXIS).belt_force_limit_n
#: Of the model's parameters: low and high factor, drawn evenly in their logarithms.
FACTORS = {
    "cart.mass": (0.25, 1.5),
    "belt_stiffness.stiffness": (0.6, 1.3),
    "belt_damping.damping": (0.15, 1.0),
    "cart_friction.level": (0.3, 1.3),
    "coulomb.level": (0.3, 1.3),
}


def drawn(seed: int) -> tuple[SimulatedPlant, dict[str, Any]]:
    """A machine, and its numbers with the SYNC period."""
    draw, known = np.random.default_rng([seed, 77]), load_plant(PLANT).model
    values = {name: known[name] * float(np.exp(draw.uniform(*np.log(span)))) for name, span in FACTORS.items() if name in known.parameters}
    told: dict[str, Any] = {name: round(value, 4) for name, value in values.items()}
    return SimulatedPlant(known.with_values(values), START_M, end_stops_m=BUFFERS_M), {**told, "period_s": float(draw.choice(PERIODS_S))}


def words(way: str, run: Path, period_s: float) -> list[str]:
    common = ["identify", "--drive", "virtual", "--run", str(run), "--yes", "--excitation", "chirp", "--no-pictures"]
    place = ["--position", f"{1e3 * START_M:g}mm", "--sample-period", f"{1e3 * period_s:g}ms"]
    return [*common, *place, *(["--axis", AXIS] if way == "open" else ["--loop", way])]


def swinging(belt_n: np.ndarray, tick_s: float) -> np.ndarray:
    """Ticks in which the belt's force over the last ``OVER_S`` is among the largest."""
    over = max(1, round(OVER_S / tick_s))
    most = np.max(np.lib.stride_tricks.sliding_window_view(belt_n, over), axis=1)
    return over - 1 + np.flatnonzero(most >= np.quantile(most[most > 1.0], 1.0 - LARGEST))


@dataclass
class Fork:
    """Ends a copy of a command at each of some rows of the watch.   since : the row.   swing_n : largest force in the ``OVER_S`` before."""

    rig: SlaveRig
    branches: Branches
    at: frozenset[int]
    draw: np.random.Generator
    end: str = ""
    since: int = 0
    swing_n: float = 0.0

    def look(self, _tick: int) -> None:
        """Each tick."""
        row = len(self.rig.examiner.belt_n) - 1
        if self.branches.inside or row not in self.at:
            return
        end = str(self.draw.choice(ENDS))
        if self.branches.fork():
            over = round(OVER_S / self.rig.bus.tick_s)
            self.end, self.since, self.swing_n = end, row, max(self.rig.examiner.belt_n[-over:])
            self.rig.end(end)


def stopped(seed: int, way: str, run: Path, place: Path, wanted: int) -> tuple[str, list[dict[str, Any]]]:
    """Stops of one command: its end undisturbed, and what came of each."""
    draw = np.random.default_rng([seed, WAYS.index(way)])
    kept = place / "before"
    shutil.rmtree(kept, ignore_errors=True)
    if run.is_dir():
        shutil.copytree(run, kept)
    at: list[int] = []
    for forked in (False, True):
        shutil.rmtree(run, ignore_errors=True)
        if kept.is_dir():
            shutil.copytree(kept, run)
        plant, told = drawn(seed)
        rig = SlaveRig("reference", seed, told["period_s"], plant=plant)
        fork = Fork(rig, Branches(place / "world"), frozenset(at), draw)
        rig.examiner.look = fork.look
        outcome = rig.call(*words(way, run, told["period_s"]))
        fork.branches.tell(partial(judged, fork, way, told))
        if not forked:
            found = swinging(np.array(rig.examiner.belt_n), rig.bus.tick_s)
            for tick in draw.permutation(found).tolist():
                if len(at) < wanted and all(abs(tick - one) * rig.bus.tick_s > APART_S for one in at):
                    at.append(tick)
        rig.close()
    return f"{outcome.code} {sentence(outcome.text)[:160]}{outcome.error}".strip(), fork.branches.told


def judged(fork: Fork, way: str, told: dict[str, Any]) -> dict[str, Any]:
    """What came of a stop."""
    rig, watch, at = fork.rig, fork.rig.examiner, fork.since
    rig.run_on(AFTERWARDS_S)
    place, speed, belt = np.array(watch.place_m), np.array(watch.speed_m_s), np.array(watch.belt_n)
    return {
        "end": fork.end,
        "way": way,
        "at_s": round(at * rig.bus.tick_s, 4),
        "speed_m_s": round(float(speed[at]), 3),
        "belt_n": round(float(belt[at:].max()), 1),
        "swing_n": round(fork.swing_n, 1),
        "bears_n": round(FEED_N + float(told.get("cart_friction.level", 0.0)), 1),
        "stands": bool(np.abs(speed[-50:]).max() < STANDING_M_S and not watch.powered[-1]),
        "inside": bool(place[at:].min() >= TRAVEL_M[0] and place[at:].max() <= TRAVEL_M[1]),
        "restored": fork.end == "host lost" or not rig.changed(),
    }


def on_machine(seed: int, each: int) -> dict[str, Any]:
    """All stops on one machine, and how its commands ended undisturbed."""
    rows: list[dict[str, Any]] = []
    ends: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="swinging-") as folder:
        place, state = Path(folder), os.environ.get("XDG_STATE_HOME")
        world = place / "world"
        (world / "state").mkdir(parents=True)
        os.environ["XDG_STATE_HOME"] = str(world / "state")
        try:
            for way in WAYS:
                ends[way], found = stopped(seed, way, world / "run", place, each)
                rows += found
                if way == "open" and not ends[way].startswith("0"):
                    break
        finally:
            os.environ.pop("XDG_STATE_HOME") if state is None else os.environ.update(XDG_STATE_HOME=state)
    return {"machine": drawn(seed)[1], "rows": rows, "ends": ends}


def line(name: str, some: list[dict[str, Any]]) -> str:
    """One line on stops."""
    belt, bears, swing = (np.array([row[key] for row in some]) for key in ("belt_n", "bears_n", "swing_n"))
    above = int((belt > bears).sum())
    share = _share_of(name, above, len(some))
    bad = [sum(not row[key] for row in some) for key in ("stands", "inside", "restored")]
    wrong = f"not at rest {bad[0]}, outside {bad[1]}, not restored {bad[2]}"
    return (
        f"{name}: {len(some)} stops, {above} above what the belt bears ({100 * share.low:.1f} to {100 * share.high:.1f} %), worst "
        f"{(belt / bears).max():.2f} of it, {belt.max():.0f} N at most; up to {swing.max():.0f} N before, "
        f"{(belt / swing).max():.2f} times that at most; {wrong}"
    )


def report(kept: dict[str, Any]) -> None:
    """All, by way and end; then one by one what is above."""
    all_rows = [{**row, "machine": one["machine"]} for one in kept.values() for row in one["rows"]]
    rows = [row for row in all_rows if "belt_n" in row]
    print(f"{len(kept)} machines; children that broke: {len(all_rows) - len(rows)}")
    if not rows:
        return
    print(line("all", rows))
    for key in ("way", "end"):
        for value in sorted({row[key] for row in rows}):
            print(line(f"{key} {value}", [row for row in rows if row[key] == value]))
    for row in rows:
        if row["belt_n"] > row["bears_n"] or not (row["stands"] and row["inside"] and row["restored"]):
            print(row)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--each", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="no machine is begun later")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--report", type=Path)
    given = parser.parse_args()
    file = given.report or given.keep
    kept: dict[str, Any] = json.loads(file.read_text()) if file and file.is_file() else {}
    begun = time.monotonic()
    for seed in range(given.seed, given.seed + (0 if given.report else given.draws)):
        if str(seed) in kept or time.monotonic() - begun > given.seconds:
            continue
        at = time.monotonic()
        with shared():
            kept[str(seed)] = on_machine(seed, given.each)
        print(
            f"{seed}: {len(kept[str(seed)]['rows'])} stops, {time.monotonic() - at:.0f} s, {kept[str(seed)]['ends']}",
            file=sys.stderr,
            flush=True,
        )
        if given.keep:
            given.keep.write_text(json.dumps(kept, indent=1))
    report(kept)


if __name__ == "__main__":
    main()
