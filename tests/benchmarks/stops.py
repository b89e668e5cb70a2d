"""Stops at random instants over variants of the drive: the belt's force against what was planned, the way, the settings.

    python tests/benchmarks/stops.py                     (200 stops; half an hour on a quiet core)
    python tests/benchmarks/stops.py --stops 20 --seed 3 (others)
    python tests/benchmarks/stops.py --keep FILE         (goes on with what is there)
    python tests/benchmarks/stops.py --paths lag,filter,both --each 4    (of the torque path; stops on a variant)

A variant is a drive (each that can be commissioned, in turn; one with ``+`` has the profile that its first motions ask for), a SYNC period
of 1, 2 or 4 ms (6.4 or 10 ms where the drive has no shorter one), and a torque path: ideal; "lag": a setpoint filter and a current loop;
"filter": a reading that is filtered, late and in steps; their numbers are drawn.
On each a short commissioning is run once.  A stop is one
command on it (verify mostly; identify; the commissioning itself) that is ended while the carriage moves, at an instant that is drawn: by
Ctrl-C, by the death of the host, or by a fault of the drive that brakes.  Counted from that instant to standstill: the largest force in the
belt, the way, whether the axis came to rest inside its travel, and whether every setting of the drive was put back (not of a dead host).

Planned: the force that the session noted for a stop out of its top speed ("N in the belt" in the journal), for a host that is lost in a
move what it noted for that, or what the belt bears where no loop is closed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from campaign.judge import TRAVEL_M
from campaign.rig import STANDING_M_S
from slaves.bench import AXIS, BELT_N, SlaveRig, sentence, told_profile

PATHS = ("ideal", "lag", "filter", "both")
#: N m, of which the steps of a reading are shares.
RATED_NM = 1.43
DRIVES = ("reference", "cmmp-as", "epos4", "accelnet", "pd4-e", "kinco-fd", "ipos", "cmms-as", "lexium32+", "asda-a2+", "akd+")
PERIODS_S = (0.001, 0.002, 0.004)
SLOW_S = {"cmms-as": (0.0064, 0.01)}
ENDS = ("Ctrl-C", "host lost", "EMCY, braked")
COMMANDS = ("verify", "verify", "verify", "verify", "verify", "identify", "commission")
#: s: until a dead host's axis stands.
AFTERWARDS_S = 3.0
START = ("--position", "250mm")


@dataclass(frozen=True)
class Variant:
    drive: str
    period_s: float
    path: str
    instruments: tuple[tuple[str, float], ...] = ()


def drawn_path(path: str, draw: np.random.Generator) -> tuple[tuple[str, float], ...]:
    """Instruments of a torque path, by key of a plant file's drive section."""
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
    return tuple(found.items())


#: Ticks in which the carriage moves when nothing disturbs.
_moving: dict[tuple[Variant, str], Any] = {}


@dataclass(frozen=True)
class Stopped:
    """One stop.   before_n : largest force before it, N.   belt_n, way_m : from it to standstill.   planned_n : see the module."""

    variant: Variant
    command: str
    end: str
    speed_m_s: float
    before_n: float
    belt_n: float
    planned_n: float
    way_m: float
    stands: bool
    inside: bool
    restored: bool
    code: int | None
    said: str


def rig_of(variant: Variant, seed: int) -> SlaveRig:
    return SlaveRig(variant.drive.removesuffix("+"), seed, variant.period_s, **dict(variant.instruments))


def words(command: str, run: Path, variant: Variant) -> list[str]:
    period = ["--sample-period", f"{1e3 * variant.period_s:g}ms", *told_profile(variant.drive, run.parent)]
    if command == "verify":
        return ["verify", "--drive", "virtual", "--run", str(run), "--yes", *period, *START]
    quick = ["--quick", "--no-report"] if command == "commission" else []
    return [command, "--drive", "virtual", "--axis", AXIS, "--run", str(run), "--yes", *quick, *period, *START]


def prepared(variant: Variant, place: Path, kept: dict[Variant, tuple[Path, int | None, str]]) -> Path | None:
    """A finished run of the variant, None where the product refuses it."""
    if variant not in kept:
        run, rig = place / f"variant-{len(kept)}" / "run", rig_of(variant, 1)
        run.parent.mkdir()
        outcome = rig.call(*words("commission", run, variant))
        _moving[variant, "commission"] = np.flatnonzero(np.abs(rig.examiner.speed_m_s) > 5 * STANDING_M_S)
        rig.close()
        kept[variant] = run, outcome.code, sentence(outcome.text) or outcome.error
        print(f"{variant}: commission ends with {outcome.code} {kept[variant][2]}", file=sys.stderr, flush=True)
    run, code, _ = kept[variant]
    return run if code in (0, 1) and (run / "results").is_dir() else None


def planned_n(run: Path, end: str) -> float:
    """What the session noted last for such a stop, of its loop and of its move; before it closed a loop, what the belt bears."""
    journal = run / "journal.txt"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.is_file() else []
    kinds = ("a stop brakes with", "a stop out of the move", *(["lost in the move"] if end == "host lost" else []))
    found = [re.findall(r"([\d.]+) N in the belt", "\n".join(line for line in lines if kind in line)) for kind in kinds]
    return max((float(some[-1]) for some in found if some), default=BELT_N)


def stop(variant: Variant, command: str, end: str, seed: int, whole: Path, folder: Path) -> Stopped | None:
    """One; None where the command did not move the axis."""
    draw = np.random.default_rng(seed)
    run = folder / "run"
    if command == "verify":
        shutil.copytree(whole, run)
    if (variant, command) not in _moving:
        rig = rig_of(variant, 1)
        rig.call(*words(command, run, variant))  # as it goes undisturbed
        _moving[variant, command] = np.flatnonzero(np.abs(rig.examiner.speed_m_s) > 5 * STANDING_M_S)
        rig.close()
        shutil.rmtree(run, ignore_errors=True)
        if command == "verify":
            shutil.copytree(whole, run)
    moving = _moving[variant, command]
    if not len(moving):
        return None
    rig = rig_of(variant, seed)
    at = int(draw.choice(moving))
    after_s = at * rig.bus.tick_s
    if end == "EMCY, braked":
        rig.spoil({"emergency_at_s": after_s, "emergency_code": 0x8611, "emergency_effect": "brake"}, {})
        outcome = rig.call(*words(command, run, variant))
    else:
        with rig.at(after_s, end):
            outcome = rig.call(*words(command, run, variant))
    rig.run_on(AFTERWARDS_S)
    watch = rig.examiner
    place, speed, belt = np.array(watch.place_m), np.array(watch.speed_m_s), np.array(watch.belt_n)
    rests = np.flatnonzero(np.abs(speed[at:]) < STANDING_M_S)
    still = [n for n in rests if np.all(np.abs(speed[at + n : at + n + 50]) < 5 * STANDING_M_S)]
    last = at + int(still[0]) if still else len(speed)
    found = Stopped(
        variant,
        command,
        end,
        float(speed[at]),
        float(belt[:at].max(initial=0.0)),
        float(belt[at : last + 50].max(initial=0.0)),
        planned_n(run, end),
        float(np.abs(place[at:last] - place[at]).max(initial=0.0)),
        bool(np.abs(speed[-50:]).max() < STANDING_M_S and not watch.powered[-1]),
        bool(place.min() >= TRAVEL_M[0] and place.max() <= TRAVEL_M[1]),
        end == "host lost" or not rig.changed(),
        outcome.code,
        sentence(outcome.text)[:200],
    )
    rig.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--paths", default=",".join(PATHS))
    parser.add_argument("--each", type=int, default=8)
    given = parser.parse_args()
    rows: dict[str, dict[str, object] | None] = {}
    if given.keep and given.keep.is_file():
        rows = json.loads(given.keep.read_text())
    kept: dict[Variant, tuple[Path, int | None, str]] = {}
    with tempfile.TemporaryDirectory(prefix="stops-") as place:
        for seed in range(given.seed, given.seed + given.stops):
            if str(seed) in rows:
                continue
            draw = np.random.default_rng(seed)
            chosen = np.random.default_rng(seed // given.each)
            drive = DRIVES[seed // given.each % len(DRIVES)]
            period_s, path = (chosen.choice(some) for some in (SLOW_S.get(drive, PERIODS_S), given.paths.split(",")))
            variant = Variant(drive, float(period_s), str(path), drawn_path(str(path), chosen))
            whole = prepared(variant, Path(place), kept)
            found = None
            if whole is not None:
                with tempfile.TemporaryDirectory(prefix="stop-") as folder:
                    found = stop(variant, str(draw.choice(COMMANDS)), str(draw.choice(ENDS)), seed, whole, Path(folder))
            rows[str(seed)] = asdict(found) if found else None
            if given.keep:
                given.keep.write_text(json.dumps(rows, indent=1))
    report([row for row in rows.values() if row is not None])


def report(rows: list[dict[str, object]]) -> None:
    """What they came to, in all and by drive, period, path and end."""

    def line(name: str, some: list[dict[str, object]]) -> str:
        belt = np.array([float(str(row["belt_n"])) for row in some])
        planned = np.array([float(str(row["planned_n"])) for row in some])
        way = np.array([float(str(row["way_m"])) for row in some])
        bad = [sum(not row[key] for row in some) for key in ("stands", "inside", "restored")]
        share = (belt / planned).max()
        return (
            f"{name}: {len(some)} stops, belt {belt.max():.0f} N at most, {share:.2f} of what was planned, way {1e3 * way.max():.0f} mm; "
            f"not at rest {bad[0]}, outside {bad[1]}, not restored {bad[2]}"
        )

    if not rows:
        print("no stop")
        return
    print(f"the belt bears {BELT_N:.0f} N")
    print(line("all", rows))
    for key, name in (("drive", "drive"), ("period_s", "period"), ("path", "path")):
        values = sorted({str(dict(row["variant"])[key]) for row in rows})  # type: ignore[call-overload]
        for value in values:
            print(line(f"{name} {value}", [row for row in rows if str(dict(row["variant"])[key]) == value]))  # type: ignore[call-overload]
    for key in ("end", "command"):
        for value in sorted({str(row[key]) for row in rows}):
            print(line(f"{key} {value}", [row for row in rows if row[key] == value]))
    for row in rows:
        if not (row["stands"] and row["inside"] and row["restored"]) or float(str(row["belt_n"])) > BELT_N:
            print(row)


if __name__ == "__main__":
    main()
