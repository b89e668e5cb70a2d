"""Stops at random instants over variants of the drive: the belt's force against what was planned, the way, the settings.

    python tests/benchmarks/stops.py                       (3 variants of each drive; half an hour on a quiet core)
    python tests/benchmarks/stops.py --rounds 1 --seed 3   (one variant of each, others)
    python tests/benchmarks/stops.py --keep FILE           (goes on with what is there)
    python tests/benchmarks/stops.py --drives reference,epos4= --each 12    (of these; stops on a variant, on the average)
    python tests/benchmarks/stops.py --report FILE         (what a kept file says)

A variant is a drive, a SYNC period of 1, 2 or 4 ms (6.4 or 10 ms where the drive has no shorter one), and a torque path: ideal; "lag": a
setpoint filter and a current loop; "filter": a reading that is filtered, late and in steps; their numbers are drawn.  A drive with ``+``
has the profile that its first motions ask for, one with ``=`` units that are drawn and a profile that says what these and its gains are.

On each variant a short commissioning is run, and on a copy of its run a move and a study of friction.  While the carriage moves the process
is forked, at instants that are drawn; in the child the command is ended there: by Ctrl-C, by the death of the host, or by a fault of the
drive that brakes.  Counted from that instant to standstill: the largest force in the belt, the way, whether the axis came to rest inside
its travel, and whether every setting of the drive was put back (not of a dead host).  The same seed gives the same bytes.

Planned: in the move, and while positioning, what the journal says for a stop out of it, of its kind.  In other motions of a position or
velocity loop what it says for a stop along the drive's ramp, and where the host is lost what the plan allows.  In torque mode, and where
the gains in the drive are known to nobody, what the belt bears.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import yaml

from beltcomm.axis import load_axis
from beltcomm.configfiles import config_names, find_config
from beltcomm.experiments.stops_out_of_move import host_loss_limit_n
from beltcomm.study.summary import _share_of
from campaign.judge import TRAVEL_M
from campaign.rig import STANDING_M_S, Outcome
from campaign.sharing import shared
from slaves.bench import AXIS, BELT_N, DOCUMENTED, TOLD, SlaveRig, sentence, told_profile
from slaves.branch import Branches

PATHS = ("ideal", "lag", "filter", "both")
#: N m, of which the steps of a reading are shares.
RATED_NM = 1.43
DRIVES = ("reference", "cmmp-as", *config_names("slaves"), *(f"{name}+" for name in TOLD), *(f"{name}=" for name in DOCUMENTED))
PERIODS_S = (0.001, 0.002, 0.004)
SLOW_S = {"cmms-as": (0.0064, 0.01)}
ENDS = ("Ctrl-C", "host lost", "EMCY, braked")
#: Commands, which share of the stops falls on each, and roughly how long the carriage moves in it, s: where gains are written, else.
COMMANDS = {"commission": (0.4, 16.0, 2.5), "verify": (0.4, 2.0, 0.5), "friction": (0.2, 12.0, 0.5)}
#: Drives whose gains are written.
WRITTEN = ("reference", "cmmp-as", "cmms-as", *(f"{name}=" for name in DOCUMENTED))
#: s: until a dead host's axis stands.
AFTERWARDS_S = 3.0
START = ("--position", "250mm")
MOVING_M_S = 5.0 * STANDING_M_S
#: N: the journal's numbers are whole.
ROUNDED_N = 0.5
#: Modes of operation in which no loop is closed.
TORQUE_MODES = (4, 10)
#: Units that are drawn for a drive with "=", as its file names them, and its profile.
VELOCITIES = {"rpm": "1 rpm", "0.1 rpm": "0.1 rpm", "counts/s": "1 units/s", "0.1 counts/s": "0.1 units/s"}
ACCELERATIONS = {"rpm/s": "1 rpm/s", "0.1 rpm/s": "0.1 rpm/s", "counts/s2": "1 units/s2", "ms to 3000 rpm": "ms to 3000 rpm"}
#: Objects that tell units.
TELLING = ("608F", "6091", "6092", "60A8", "60A9", "60AA")
COUNTS = (4096, 16384, 65536, 100000)


@dataclass(frozen=True)
class Variant:
    """instruments : of the torque path, by key of a plant file's drive section.   units : of position, velocity, acceleration, drawn."""

    drive: str
    period_s: float
    path: str
    instruments: tuple[tuple[str, float], ...] = ()
    units: tuple[Any, ...] = ()


def drawn(drive: str, seed: int) -> Variant:
    """A variant of a drive."""
    draw = np.random.default_rng([seed, DRIVES.index(drive)])
    period_s, path = draw.choice(SLOW_S.get(drive, PERIODS_S)), str(draw.choice(PATHS))
    found: dict[str, float] = {}
    if path in ("lag", "both"):
        found["setpoint_filter_s"] = float(draw.uniform(1e-4, 1e-3))
        if draw.random() < 0.5:
            found["current_loop_s"] = float(np.exp(draw.uniform(np.log(8e-5), np.log(5e-4))))
        else:
            found["current_loop_hz"] = float(np.exp(draw.uniform(np.log(300.0), np.log(2000.0))))
    if path in ("filter", "both"):
        found["reading_filter_s"] = float(np.exp(draw.uniform(np.log(5e-4), np.log(5e-3))))
        found["reading_late_ticks"] = float(draw.choice([0.0, 0.5, 1.0]))
        found["reading_step_nm"] = RATED_NM * float(draw.uniform(1e-3, 1e-2))
    units: tuple[Any, ...] = ()
    if drive.endswith("="):
        units = (int(draw.choice(COUNTS)), str(draw.choice(list(VELOCITIES))), str(draw.choice(list(ACCELERATIONS))))
    return Variant(drive, float(period_s), path, tuple(found.items()), units)


def played(variant: Variant, place: Path) -> tuple[str, list[str]]:
    """The drive that is played, and words that name its profile; both are written into a folder where they are drawn."""
    if not variant.units:
        return variant.drive.removesuffix("+"), told_profile(variant.drive, place)
    name, (position, velocity, acceleration) = variant.drive[:-1], variant.units
    facts = yaml.safe_load(find_config("slaves", name).read_text(encoding="utf-8"))
    facts["units"] = {"position": position, "velocity": velocity, "acceleration": acceleration}
    facts["without"] = [*facts["without"], *(index for index in TELLING if index not in map(str, facts["without"]))]
    facts["objects"] = {key: value for key, value in facts["objects"].items() if str(key).partition(":")[0] not in TELLING}
    stated = {
        "position_unit": f"{1.0 / position:.12g} rev",
        "velocity_unit": VELOCITIES[velocity],
        "acceleration_unit": ACCELERATIONS[acceleration],
    }
    profile = {"name": "told", "title": f"{name} as drawn", **stated, **DOCUMENTED[name]}
    (place / "slave.yaml").write_text(yaml.safe_dump(facts, sort_keys=False))
    (place / "told.yaml").write_text(yaml.safe_dump(profile, sort_keys=False))
    return str(place / "slave.yaml"), ["--profile", str(place / "told.yaml")]


def words(command: str, run: Path, period_s: float, profile: Sequence[str]) -> list[str]:
    common = ["--drive", "virtual", "--run", str(run), "--yes", "--sample-period", f"{1e3 * period_s:g}ms", *profile, *START]
    return [command, *common, *(["--axis", AXIS, "--quick", "--no-report"] if command == "commission" else [])]


def planned_n(run: Path, end: str, phase: str, known: bool) -> tuple[float, str]:
    """What was said for such a stop, and by whom.   known : somebody knows the gains in the drive."""
    journal = run / "journal.txt"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.is_file() else []

    def noted(kind: str) -> float | None:
        said = [re.findall(r"([\d.]+) N in the belt", line) for line in lines if kind in line]
        return float(said[-1][0]) if said and said[-1] else None

    if phase == "torque" or not known:
        return BELT_N, "what the belt bears"
    if phase == "move" and (found := noted("lost in the move" if end == "host lost" else "a stop out of the move")) is not None:
        return found, "journal, the move"
    if phase == "between" and (words := [line for line in lines if "positioning: " in line]):
        asked, lost = re.findall(r"(\d+) N", words[-1])[:2]
        return float(lost if end == "host lost" else asked), "journal, positioning"
    if end == "host lost":
        return host_loss_limit_n(load_axis(AXIS)), "plan"
    found = noted("a stop brakes with")
    return (found, "journal, the loop") if found is not None else (BELT_N, "what the belt bears")


def ended(rig: SlaveRig, run: Path, at: int, told: dict[str, Any], known: bool, outcome: Outcome) -> dict[str, Any]:
    """What came of a stop at row ``at`` of the watch."""
    rig.run_on(AFTERWARDS_S)
    watch = rig.examiner
    place, speed, belt = np.array(watch.place_m), np.array(watch.speed_m_s), np.array(watch.belt_n)
    rests = np.flatnonzero(np.abs(speed[at:]) < STANDING_M_S)
    still = [n for n in rests if np.all(np.abs(speed[at + n : at + n + 50]) < MOVING_M_S)]
    last = at + int(still[0]) if still else len(speed)
    planned, by = planned_n(run, told["end"], told["phase"], known)
    return {
        **told,
        "at_s": round(at * rig.bus.tick_s, 4),
        "speed_m_s": round(float(speed[at]), 4),
        "belt_n": round(float(belt[at : last + 50].max()), 2),
        "planned_n": planned,
        "by": by,
        "way_m": round(float(np.abs(place[at:last] - place[at]).max(initial=0.0)), 5),
        "stands": bool(np.abs(speed[-50:]).max() < STANDING_M_S and not watch.powered[-1]),
        "inside": bool(place[at:].min() >= TRAVEL_M[0] and place[at:].max() <= TRAVEL_M[1]),
        "restored": told["end"] == "host lost" or not rig.changed(),
        "code": outcome.code,
        "said": (sentence(outcome.text) or outcome.error).replace(str(run), "RUN")[:200],
    }


def phase_of(rig: SlaveRig, run: Path) -> str:
    """What moves the axis: "torque", "move" (the one that proves), or another motion of a loop, by its record or "between"."""
    if rig.device._servo._shown_mode.value in TORQUE_MODES:
        return "torque"
    records = [file.name.partition(".")[0] for file in (run / "recordings").glob("*.part")]
    return "between" if not records else "move" if records[0].startswith("move_") else records[0]


def stopped(variant: Variant, command: str, run: Path, place: Path, wanted: float, seed: int) -> tuple[Outcome, list[dict[str, Any]]]:
    """The command undisturbed, and what came of its stops, ``wanted`` of them on the average."""
    named, profile = played(variant, place)
    rig = SlaveRig(named, seed, variant.period_s, **dict(variant.instruments))
    branches, draw = Branches(place / "world"), np.random.default_rng(seed)
    gaps = COMMANDS[command][1 if variant.drive in WRITTEN else 2] / rig.bus.tick_s / wanted
    told: dict[str, Any] = {}
    left, at = int(draw.geometric(1.0 / gaps)), 0

    def look(tick: int) -> None:
        nonlocal left, at
        watch = rig.examiner
        if branches.inside or abs(watch.speed_m_s[-1]) < MOVING_M_S:
            return
        left -= 1
        if left:
            return
        left = int(draw.geometric(1.0 / gaps))
        end, phase = str(draw.choice(ENDS)), phase_of(rig, run)
        if branches.fork():
            at = len(watch.speed_m_s) - 1
            told.update(command=command, end=end, phase=phase)
            rig.end(end)

    rig.examiner.look = look
    outcome = rig.call(*words(command, run, variant.period_s, profile))
    branches.tell(lambda: ended(rig, run, at, told, rig.known_gains, outcome))
    rig.close()
    return outcome, branches.told


def on_variant(variant: Variant, each: float, seed: int) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Stops on a variant, and how its commands ended undisturbed."""
    rows: list[dict[str, Any]] = []
    ends: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="stops-") as folder:
        place, state = Path(folder), os.environ.get("XDG_STATE_HOME")
        world, whole = place / "world", place / "whole"
        os.environ["XDG_STATE_HOME"] = str(world / "state")
        try:
            for number, (command, (share, *_)) in enumerate(COMMANDS.items()):
                shutil.rmtree(world, ignore_errors=True)
                (world / "state").mkdir(parents=True)
                if whole.is_dir():
                    shutil.copytree(whole, world / "run")
                outcome, found = stopped(variant, command, world / "run", place, share * each, 3 * seed + number)
                rows += [{"variant": asdict(variant), **row} for row in found]
                ends[command] = f"{outcome.code} {sentence(outcome.text)[:160]}{outcome.error}".strip()
                if command == "commission":
                    if not (outcome.code in (0, 1) and (world / "run" / "designs" / "final.yaml").is_file()):
                        break
                    (world / "run").rename(whole)
        finally:
            os.environ.pop("XDG_STATE_HOME") if state is None else os.environ.update(XDG_STATE_HOME=state)
    return rows, ends


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", default=",".join(DRIVES))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--each", type=float, default=7.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="no variant is begun later")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--report", type=Path)
    given = parser.parse_args()
    file = given.report or given.keep
    kept: dict[str, Any] = json.loads(file.read_text()) if file and file.is_file() else {}
    begun = time.monotonic()
    for number in range(0 if given.report else given.rounds):
        for drive in given.drives.split(","):
            seed = given.seed + number
            if f"{drive} {seed}" in kept or time.monotonic() - begun > given.seconds:
                continue
            variant, at = drawn(drive, seed), time.monotonic()
            with shared():
                rows, ends = on_variant(variant, given.each, 1000 * seed + DRIVES.index(drive))
            kept[f"{drive} {seed}"] = {"variant": asdict(variant), "rows": rows, "ends": ends}
            print(
                f"{drive} {1e3 * variant.period_s:g} ms {variant.path}: {len(rows)} stops, {time.monotonic() - at:.0f} s, {ends}",
                file=sys.stderr,
                flush=True,
            )
            if given.keep:
                given.keep.write_text(json.dumps(kept, indent=1))
    report([row for one in kept.values() for row in one["rows"]])


def line(name: str, some: list[dict[str, Any]]) -> str:
    """One line on stops."""
    belt, planned, way = (np.array([row[key] for row in some]) for key in ("belt_n", "planned_n", "way_m"))
    above = int((belt > planned + ROUNDED_N).sum())
    share = _share_of(name, above, len(some))
    bad = [sum(not row[key] for row in some) for key in ("stands", "inside", "restored")]
    beyond = f"{above} above the plan ({100 * share.low:.1f} to {100 * share.high:.1f} %)"
    wrong = f"not at rest {bad[0]}, outside {bad[1]}, not restored {bad[2]}"
    return (
        f"{name}: {len(some)} stops, {beyond}, worst {(belt / planned).max():.2f} of it, {belt.max():.0f} N at most, "
        f"way {1e3 * way.max():.0f} mm; {wrong}"
    )


def report(rows: list[dict[str, Any]]) -> None:
    """What they came to, in all and by drive, period, path, end and phase; those that are not right one by one."""
    broken = [row for row in rows if "belt_n" not in row]
    rows = [row for row in rows if "belt_n" in row]
    if not rows:
        print("no stop")
        return
    print(f"the belt bears {BELT_N:.0f} N; children that broke: {len(broken)}")
    print(line("all", rows))
    kinds: dict[str, Callable[[dict[str, Any]], str]] = {
        "drive": lambda row: row["variant"]["drive"],
        "period": lambda row: str(row["variant"]["period_s"]),
        "path": lambda row: row["variant"]["path"],
        "end": lambda row: row["end"],
        "command": lambda row: row["command"],
        "phase": lambda row: f"{row['phase']}, {'host lost' if row['end'] == 'host lost' else 'asked for'}",
        "planned by": lambda row: row["by"],
    }
    for key, of in kinds.items():
        for value in sorted(set(map(of, rows))):
            print(line(f"{key} {value}", [row for row in rows if of(row) == value]))
    for row in rows:
        if not (row["stands"] and row["inside"] and row["restored"]) or row["belt_n"] > row["planned_n"] + ROUNDED_N:
            print(row)


if __name__ == "__main__":
    main()
