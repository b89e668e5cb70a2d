"""What the analysis of a recording set costs: ``compare`` and ``diagnose`` cold and warm, their memory, their growth, import and report.

Every command is a process of its own, as a user runs it; processor time and the largest resident memory are the operating system's.
Cold: the commands' caches of compiled code are empty (an own ``NUMBA_CACHE_DIR`` and ``XDG_CACHE_HOME``), as after an installation.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from beltcomm.runfolder import RunFolder
from benchmarks.speeds.measure import Figure, growth, spread
from truth.hidden import draw
from truth.hidden.folder import write_records
from truth.hidden.session import run_session

#: Seed and what is hidden in the machines on which a search is looked at, each at strength 0.7: what the motor sees at once, what needs
#: an observer, two behind one, and one that the catalogue does not hold.
HIDDEN = (
    (892000, ()),
    (892005, ("stribeck",)),
    (892001, ("end_pulley",)),
    (892002, ("backlash",)),
    (892006, ("backlash", "encoder_eccentricity")),
    (892003, ("payload_impact",)),
)
#: s and MB that one stage of a search may take.
STAGE_S, PEAK_MB = 10.0, 500.0
#: How often every record stands in the set.
LENGTHS = (1, 2, 4, 8)


@dataclass(frozen=True)
class Cost:
    """One process.   cpu_s, wall_s : s.   peak_mb : largest resident memory, MB.   code : exit code."""

    cpu_s: float
    wall_s: float
    peak_mb: float
    code: int


def cost(words: Sequence[str], folder: Path, more: Mapping[str, str] = {}) -> Cost:  # never changed
    """Run one command of the tool in ``folder`` and take the system's account of it."""
    begin = time.perf_counter()
    with open(os.devnull, "w") as nothing:
        process = subprocess.Popen(
            [sys.executable, "-m", "beltcomm", *words], cwd=folder, stdout=nothing, stderr=nothing, env={**os.environ, **more}
        )
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return Cost(used.ru_utime + used.ru_stime, time.perf_counter() - begin, used.ru_maxrss / 1024.0, process.returncode)


def copied(run: Path, folder: Path, times: int = 1) -> Path:
    """A copy of a run in which every record stands ``times`` times, under names of their own."""
    target = folder / f"run_{times}"
    shutil.copytree(run, target)
    for file in sorted((target / "recordings").iterdir()):
        for n in range(2, times + 1):
            shutil.copy(file, file.with_name(f"{file.stem}_again{n}{file.suffix}"))
    return target


def anew(run: Path) -> None:
    """Take away what earlier commands kept beside a run, or they would be answered without a search."""
    shutil.rmtree(run / "kept", ignore_errors=True)


def recorded_s(run: Path) -> float:
    """Seconds of all records of a run that have a time."""
    return sum(float(r.t_s[-1] - r.t_s[0]) for r in RunFolder.open(run).recordings() if not r.is_static_map)


def told(name: str, costs: Sequence[Cost], aim: float | None = None) -> Iterator[Figure]:
    """Processor seconds and memory of one command."""
    s = spread([c.cpu_s for c in costs])
    wall = spread([c.wall_s for c in costs]).median
    note = f"wall {wall:.2f} s" + ("" if {c.code for c in costs} <= {0, 1} else f", exit codes {sorted({c.code for c in costs})}")
    yield Figure("analysis", f"{name}, processor time", s.median, "s", aim, False, s.low, s.high, note)
    yield Figure("analysis", f"{name}, largest memory", max(c.peak_mb for c in costs), "MB")


def everyday(run: Path, folder: Path, rounds: int) -> Iterator[Figure]:
    """Each command on the run, the commands in turn so that all see the same drift, after one that is not counted; then cold."""
    place = copied(run, folder)
    record = max((place / "recordings").glob("*.csv"), key=lambda file: file.stat().st_size)
    foreign = shutil.copy(record, folder / "foreign.csv")
    words: dict[str, list[str]] = {
        "--help": ["--help"],
        "import of one record": ["import", str(foreign), "--run", "imported", "--name", "foreign"],
        "compare, nothing kept": ["compare", str(place), "--no-pictures"],
        "diagnose after it": ["diagnose", str(place), "--no-cost"],
        "compare again": ["compare", str(place), "--no-pictures"],
        "diagnose again": ["diagnose", str(place), "--no-cost"],
        "report": ["report", str(place)],
    }
    costs: dict[str, list[Cost]] = {name: [] for name in words}
    cost(words["compare, nothing kept"], folder)
    for _ in range(rounds):
        anew(place)
        for name, command in words.items():
            shutil.rmtree(folder / "imported", ignore_errors=True)
            costs[name].append(cost(command, folder))
    for name, values in costs.items():
        yield from told(name, values, 0.3 if name == "--help" else None)
    with tempfile.TemporaryDirectory() as empty:
        fresh = {"NUMBA_CACHE_DIR": empty, "XDG_CACHE_HOME": empty}
        anew(place)
        for key, name in (
            ("compare, nothing kept", "compare, first use after an installation"),
            ("diagnose after it", "diagnose, second use"),
        ):
            yield from told(name, [cost(words[key], folder, fresh)])


def lengths(run: Path, folder: Path) -> Iterator[Figure]:
    """Processor time and memory with 1, 2, 4 and 8 times the records; every command by itself, with nothing kept."""
    for verb, more in (("compare", "--no-pictures"), ("diagnose", "--no-cost")):
        costs = []
        for times in LENGTHS:
            place = folder / f"run_{times}"
            if not place.exists():
                copied(run, folder, times)
            anew(place)
            costs.append(cost([verb, str(place), more], folder))
        note = ", ".join(f"{n}x {c.cpu_s:.1f} s {c.peak_mb:.0f} MB" for n, c in zip(LENGTHS, costs, strict=True))
        yield Figure("analysis", f"{verb}, time ~ data^p", growth(LENGTHS, [c.cpu_s for c in costs]), "p", 1.2, False, note=note)
        last = growth(LENGTHS[-2:], [c.cpu_s for c in costs[-2:]])  # what a command costs before its first sample counts least there
        yield Figure("analysis", f"{verb}, time ~ data^p from {LENGTHS[-2]} to {LENGTHS[-1]} times", last, "p", 1.2, False)


def searches(folder: Path) -> Iterator[Figure]:
    """``diagnose`` on machines with a hidden effect, after ``compare``: seconds a stage, and memory."""
    for seed, effects in HIDDEN:
        name = " and ".join(effects) or "healthy"
        machine = draw(seed, effects, 0.7, "sheet")
        place = folder / f"hidden_{seed}"
        write_records(machine, run_session(machine, "thorough"), place)
        cost(["compare", str(place), "--no-pictures"], folder)
        found = cost(["diagnose", str(place), "--no-cost"], folder)
        kept = RunFolder.open(place).load_result("diagnosis") or {"steps": [], "verdict": f"exit code {found.code}", "named": []}
        stages = max(1, len(kept["steps"]))
        note = f"{stages} stages, {kept['verdict']}: {', '.join(kept['named']) or 'nothing'}"
        yield Figure("analysis", f"diagnose, {name}, whole command", found.cpu_s, "s", note=note)
        yield Figure("analysis", f"diagnose, {name}, a stage", found.cpu_s / stages, "s", STAGE_S, False)
        yield Figure("analysis", f"diagnose, {name}, largest memory", found.peak_mb, "MB", PEAK_MB, False)


def run(rounds: int, run: Path | None) -> Iterator[Figure]:
    """All figures of the topic."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if run is None:
            run = folder / "commissioned"
            made = cost(["commission", "--drive", "virtual", "--thorough", "--yes", "--run", str(run)], folder)
            yield from told("commission --thorough", [made])
        yield Figure("analysis", "seconds recorded in the set", recorded_s(run), "s")
        yield from everyday(run, folder, min(rounds, 3))
        yield from searches(folder)
        yield from lengths(run, folder)
