"""A fuzz of every parser: how many files were read, refused with a sentence, or ended in a traceback, a hang or a crash.

    python tests/benchmarks/fuzz.py FILE SECONDS [--seed SEED] [--words WORD ...]

Writes the counts of each parser to FILE as JSON, and what must not be beside it: FILE.found/NUMBER-PARSER.  With words only the parsers
with one of them in their names.  Cases run in a process that is forked for them, 200 at a time, so that a hang or a crash is counted and
the fuzz goes on.  Exit code 1 when there was a traceback, a hang, a crash of the main process, or a sentence that does not name the file.
A crash or hang of a reader that runs apart is counted and is none of the main process, which ends it.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.parsers import Parser, case, damaged, parsers

#: s of one case, on a machine that others load, too; what starts a process has its own limit.
LONGEST_S, LONGEST_APART_S = 60.0, 180.0
#: Bytes of memory of the process with the cases, and cases of one process.
MEMORY, BATCH, BATCH_APART = 6 << 30, 200, 8


def batch(parser: Parser, others: list[bytes], seed: int, first: int, count: int, folder: Path, out: int) -> None:
    """Cases in this process; tells of each before it begins and behind it, and keeps the file of the last."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    for number in range(first, first + count):
        content = damaged(np.random.default_rng([seed, number]), parser.good, others)
        outcome, words = case(parser, content, folder)
        if outcome in {"traceback", "unnamed"}:
            words = words[:300]
        os.write(out, (json.dumps([number, outcome, words[:300]]) + "\n").encode())


def run_batch(parser: Parser, others: list[bytes], seed: int, first: int, folder: Path) -> list[tuple[int, str, str]]:
    """The outcomes of the next cases; fewer where one hangs or crashes: the last of them is that."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            # few at first, so that a short fuzz sees every parser
            most, least = (BATCH_APART, 1) if parser.apart else (BATCH, 10)
            batch(parser, others, seed, first, min(most, max(least, first)), folder, writing)
        finally:
            os._exit(0)
    os.close(writing)
    text, ended, limit = b"", "", LONGEST_APART_S if parser.apart else LONGEST_S
    while True:
        ready, _, _ = select.select([reading], [], [], limit)
        if not ready:
            os.kill(child, signal.SIGKILL)
            ended = "hang"
            break
        more = os.read(reading, 1 << 16)
        if not more:
            break
        text += more
    os.close(reading)
    _, status = os.waitpid(child, 0)
    found = [tuple(json.loads(line)) for line in text.decode().splitlines() if line.endswith("]")]
    if ended or os.WIFSIGNALED(status):
        how = ended or f"crash by signal {os.WTERMSIG(status)}"
        found.append((first + len(found), how.split()[0], how))
    return found


def main(file: Path, seconds: float, seed: int, words: list[str]) -> int:
    """Rounds over all parsers until the time is over."""
    kept = file.with_name(f"{file.name}.found")
    with TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "good").mkdir()
        every = parsers(folder / "good")
        chosen = {name: parser for name, parser in every.items() if not words or any(word in name for word in words)}
        others = [parser.good for parser in every.values()]
        for name, parser in chosen.items():
            outcome = case(parser, parser.good, folder)
            if outcome[0] != "fine":
                print(f"{name}: the good file is {outcome[0]}: {outcome[1]}")
                return 2
        counts: dict[str, Counter[str]] = {name: Counter() for name in chosen}
        told: dict[str, list[str]] = {}
        next_case = dict.fromkeys(chosen, 0)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for name, parser in chosen.items():
                if time.monotonic() > end:
                    break
                found = run_batch(parser, others, seed, next_case[name], folder)
                next_case[name] += max(len(found), 1)
                counts[name].update(outcome for _, outcome, _ in found)
                for number, outcome, said in found:
                    if "reader broke down" in said:
                        counts[name]["readers apart broken down"] += 1
                    if "reader did not end" in said:
                        counts[name]["readers apart ended"] += 1
                    if outcome in {"fine", "refused"} or (outcome in {"crash", "hang"} and name.startswith("reader of")):
                        continue
                    group = told.setdefault(f"{name}: {outcome}: {said.replace(str(folder), '')}", [])
                    if len(group) < 3:
                        kept.mkdir(exist_ok=True)
                        content = damaged(np.random.default_rng([seed, number]), parser.good, others)
                        target = kept / f"{number}-{name.replace(' ', '_')}-{parser.name}"
                        target.write_bytes(content)
                        group.append(target.name)
                total: Counter[str] = sum(counts.values(), Counter())
                report = {"seed": seed, "total": dict(total), "parsers": {n: dict(c) for n, c in counts.items()}, "found": told}
                file.write_text(json.dumps(report, indent=1), encoding="utf-8")
    for name, counted in counts.items():
        print(f"{name:24}", ", ".join(f"{count} {what}" for what, count in counted.items()))
    print("all:", ", ".join(f"{count} {what}" for what, count in total.items()))
    for line, files in told.items():
        print(f"{line}  ({', '.join(files)})")
    return 1 if told else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--words", nargs="*", default=[])
    sys.exit(main(**vars(parser.parse_args())))
