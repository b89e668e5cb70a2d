"""The fault campaign: seeded cases of faults in drive, bus, host and disk, in virtual time, each judged behind the bus.

    python tests/benchmarks/fault_campaign.py                       (the table of 528 cases; less than 20 minutes on two cores)
    python tests/benchmarks/fault_campaign.py --accesses --cases 0  (every single SDO transfer of two commands, aborted and unanswered)
    python tests/benchmarks/fault_campaign.py --rewritten 60 --cases 0   (somebody else writes to the drive while it runs)
    python tests/benchmarks/fault_campaign.py --profiles "reference 4ms lag,epos4 2ms,accelnet filter" --cases 88   (other drives)
    python tests/benchmarks/fault_campaign.py --kills 8 --cases 0   (processes killed by SIGKILL: what is left in their folders)
    python tests/benchmarks/fault_campaign.py --first 3000 --cases 88   (others than those of the table)
    python tests/benchmarks/fault_campaign.py --seed 17 [--seed N]  (these again, with all that was said)
    python tests/benchmarks/fault_campaign.py --keep FOLDER         (goes on with what is there: healthy runs, cases; --seconds S of it)

A case is a command (identify, a commissioning that goes on, friction, verify, apply, move, rollback), a profile of the drive, a fault and
its instant, drawn uniformly over the phases of a healthy run.  It is survived when the axis stands in the end (looked at behind the bus),
the drive has its settings again or a backup brings them back, recordings can be read, exit code and sentence are right, and the carriage
never left its travel by more than the predicted run-on (tests/campaign/judge.py).
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import multiprocessing
import os
import pickle
import resource
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from campaign import sharing
from campaign.cases import COMMANDS, FIRST_ACCESS, FIRST_REWRITTEN, KINDS, REWRITTEN, Case, Healthy, access_cases, healthy_run, make_case
from campaign.judge import Verdict, lay_out, run_case, words_of
from campaign.killed import killed_folder
from campaign.rig import Rig

CASES = 528
_profiles = ["reference", "cmmp-as"]
_prepared: dict[str, Path] = {}
_healthy: dict[tuple[str, str], Healthy] = {}


def prepare(profile: str, place: Path) -> None:
    """A finished short commissioning of a profile, and a healthy run of each command on it."""
    rig, run = Rig(profile), place / profile.replace(" ", "-")
    outcome = rig.call(*(word for word in words_of("commission", run, profile) if word != "--resume"))
    rig.close()
    assert outcome.code in (0, 1), outcome.text
    _prepared[profile] = run


def healthy(command: str, profile: str) -> Healthy:
    """Of a command on a profile, run once."""
    if (command, profile) not in _healthy:
        with tempfile.TemporaryDirectory(prefix="campaign-") as place:
            run = Path(place) / "run"
            lay_out(command, _prepared[profile], run)
            rig = Rig(profile)
            found, outcome = healthy_run(rig, words_of(command, run, profile), run)
            rig.close()
        assert found.code in (0, 1, 3, 4), outcome.text  # a loop that nobody has typed in is stopped
        print(f"healthy {command} on {profile}: exit code {found.code}, {found.machine_s:.1f} s, {found.transfers} transfers", flush=True)
        _healthy[command, profile] = found
    return _healthy[command, profile]


def keep(place: Path) -> None:
    """Healthy runs and what was computed for them, into a folder."""
    sharing.save(place / "known.pickle")
    (place / "healthy.pickle").write_bytes(pickle.dumps(_healthy))


def recall(place: Path) -> None:
    """What :func:`keep` has left there."""
    place.mkdir(exist_ok=True)
    ready = {profile: place / profile.replace(" ", "-") for profile in _profiles}
    _prepared.update({profile: run for profile, run in ready.items() if (run / "verdict.txt").is_file()})
    if (place / "known.pickle").is_file():
        sharing.load(place / "known.pickle")
    if (place / "healthy.pickle").is_file():
        _healthy.update(pickle.loads((place / "healthy.pickle").read_bytes()))


def made(seed: int) -> Case:
    """The case of a seed, of either sequence."""
    return (
        make_case(seed, healthy, profiles=tuple(_profiles))
        if not FIRST_ACCESS <= seed < FIRST_REWRITTEN
        else access_cases(healthy)[seed - FIRST_ACCESS]
    )


def judged_before(place: Path) -> dict[int, Verdict]:
    """Cases that an earlier campaign has left in the folder, by seed; without what was said."""
    file, found = place / "verdicts.jsonl", {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        seed, kind, code, failures, stop_m, stop_s = json.loads(line)
        found[seed] = Verdict(Case(seed, kind, "", "", "", 0.0), code, "", tuple(failures), stop_m, stop_s, "")
    return found


def note(place: Path, v: Verdict) -> None:
    """A case for :func:`judged_before`."""
    with (place / "verdicts.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps([v.case.seed, v.case.kind, v.code, v.failures, v.stop_m, v.stop_s]) + "\n")


def one(case: Case, until_s: float = math.inf) -> Verdict | None:
    """Run a case in a worker, unless it is too late; what breaks the campaign itself is a failure too."""
    if time.monotonic() > until_s:
        return None
    try:
        return run_case(case, _prepared.get(case.profile))
    except BaseException:  # a worker that dies would be waited for in vain
        return Verdict(case, None, "", ("the campaign itself broke",), None, None, traceback.format_exc())


def told(verdict: Verdict, whole: bool) -> None:
    """One line on a case, with what failed; the whole text when it is asked for."""
    c = verdict.case
    where = f"{c.command} on {c.profile}: {c.about} at {c.at_s:.3f} s"
    print(f"seed {c.seed}: {c.kind}, {where} -> {verdict.code}: {verdict.sentence}", flush=True)
    print("".join(f"    {failure}\n" for failure in verdict.failures), end="", flush=True)
    if whole:
        print(verdict.text, flush=True)


def table(verdicts: Sequence[Verdict]) -> list[str]:
    """Kinds against cases run and survived, worst stop of those that moved."""
    lines = [f"{'fault':24} {'cases':>6} {'survived':>9} {'exit codes':26} {'longest way':>12} {'longest time':>13}"]
    for kind in [*KINDS, REWRITTEN, "all"]:
        of = [v for v in verdicts if kind in ("all", v.case.kind)]
        codes = sorted({-1 if v.code is None else v.code for v in of})
        counted = " ".join(f"{'dead' if c < 0 else c}:{sum((-1 if v.code is None else v.code) == c for v in of)}" for c in codes)
        ways = [(v.stop_m, v.stop_s) for v in of if v.stop_m is not None and v.stop_s is not None]
        way = f"{1e3 * max(m for m, _ in ways):9.1f} mm" if ways else f"{'-':>12}"
        last = f"{1e3 * max(s for _, s in ways):10.0f} ms" if ways else f"{'-':>13}"
        lines.append(f"{kind:24} {len(of):6} {sum(not v.failures for v in of):9} {counted:26} {way} {last}")
    return lines


def _cpu_s() -> float:
    """Of this process and its workers."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def main() -> int:
    """All cases, or those asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, action="append", help="replay these cases")
    parser.add_argument("--cases", type=int, default=CASES)
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--accesses", action="store_true", help="every single SDO transfer too")
    parser.add_argument("--rewritten", type=int, default=0, help="drives to which somebody else writes while they run")
    parser.add_argument("--kills", type=int, default=0, help="processes to kill")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--say", action="store_true", help="print every case's sentence")
    parser.add_argument("--keep", type=Path, help="where healthy runs and cases are kept for the next time; not across changes of the code")
    parser.add_argument("--seconds", type=float, default=math.inf, help="no case is begun later")
    parser.add_argument("--profiles", help='drives, such as "reference 4ms lag,epos4 2ms"')
    given = parser.parse_args()
    if given.profiles:
        _profiles[:] = given.profiles.split(",")
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="campaign-") as folder, sharing.shared():
        place = given.keep or Path(folder)
        recall(place)
        for profile in _profiles:
            if profile not in _prepared:
                prepare(profile, place)
        keep(place)
        cases = [
            made(seed)
            for seed in (
                given.seed or (*range(given.first, given.first + given.cases), *range(FIRST_REWRITTEN, FIRST_REWRITTEN + given.rewritten))
            )
        ]
        cases += access_cases(healthy) if given.accesses and not given.seed else []
        keep(place)
        print(f"prepared in {time.monotonic() - began:.0f} s", flush=True)
        known = {} if given.seed else judged_before(place)
        verdicts = [known[case.seed] for case in cases if case.seed in known]
        left = [case for case in cases if case.seed not in known]
        until_s = began + given.seconds
        # forked after all that is shared was computed; a worker's cache dies with it, so that it does not grow for ever
        with multiprocessing.get_context("fork").Pool(given.workers, maxtasksperchild=60) as pool:
            for verdict in filter(None, pool.imap_unordered(functools.partial(one, until_s=until_s), left)):
                verdicts.append(verdict)
                if not given.seed:
                    note(place, verdict)
                if verdict.failures or given.seed or given.say:
                    told(verdict, bool(given.seed))
        kills = [killed_folder(seed, Path(folder)) for seed in range(given.kills)]
    print("\n".join(table(verdicts)))
    if kills:
        sound = sum(not wrong for wrong in kills)
        print(f"killed by SIGKILL: {len(kills)}, folders sound: {sound}", *(word for wrong in kills for word in wrong))
    failed = sum(bool(v.failures) for v in verdicts) + sum(map(bool, kills))
    print(f"{len(verdicts)} cases, {failed} failed, {len(COMMANDS)} commands, {time.monotonic() - began:.0f} s, {_cpu_s():.0f} s CPU")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
