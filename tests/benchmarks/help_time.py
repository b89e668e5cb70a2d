"""How long ``beltcomm --help`` takes, process start included:  ``python tests/benchmarks/help_time.py [REPEATS]``."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path


def seconds(words: list[str]) -> float:
    """Wall time of one process, s."""
    start = time.perf_counter()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    """Print least, median and largest time of --help, of one verb's --help, and of an empty Python for comparison."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    beltcomm = str(Path(sys.executable).with_name("beltcomm"))
    for title, words in (
        ("beltcomm --help", [beltcomm, "--help"]),
        ("beltcomm commission --help", [beltcomm, "commission", "--help"]),
        ("python -c pass", [sys.executable, "-c", "pass"]),
    ):
        seconds(words)  # the first run fills the disk cache and writes the byte code
        times = sorted(seconds(words) for _ in range(repeats))
        print(f"{title:28} {times[0]:.3f} s least, {statistics.median(times):.3f} s median, {times[-1]:.3f} s largest of {repeats}")


if __name__ == "__main__":
    main()
