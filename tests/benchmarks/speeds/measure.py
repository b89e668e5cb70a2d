"""Times of two things in turn, ratios pair by pair, figures against their aims, and the history of all of it.

A machine that others use drifts: a time alone says little, the ratio of two that were taken one after the other says more.  Processor
time is taken, not the wall's, where one process does the work.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from platformdirs import user_cache_path

#: Where figures are kept unless somebody says otherwise.
HISTORY = user_cache_path("beltcomm") / "benchmarks.json"
#: A busy processor: waiting and running processes per core at the start.
BUSY = 0.25


@dataclass(frozen=True)
class Figure:
    """One number.   topic, name : what.   aim : the bound, None for a figure that is only told.   least : the aim is a lower bound.

    low, high : between which it lay, None when it was taken once.
    """

    topic: str
    name: str
    value: float
    unit: str
    aim: float | None = None
    least: bool = True
    low: float | None = None
    high: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it meets its aim; None without one, and when the spread holds both answers."""
        if self.aim is None:
            return None
        if math.isnan(self.value):
            return False

        def good(value: float) -> bool:
            return value >= self.aim if self.least else value <= self.aim  # type: ignore[operator]

        ends = {good(self.value if end is None else end) for end in (self.low, self.high)}
        return good(self.value) if len(ends) == 1 else None

    def line(self) -> str:
        """The figure in one line of a table."""
        spread = "" if self.low is None or self.high is None else f" ({self.low:.4g} to {self.high:.4g})"
        aim = "" if self.aim is None else f"{'>=' if self.least else '<='} {self.aim:g}"
        word = {True: "met", False: "MISSED", None: "cannot tell" if self.aim is not None else ""}[self.met]
        return f"  {self.name:58} {self.value:>10.4g} {self.unit}{spread}  {aim} {word}  {self.note}".rstrip()


def seconds(action: Callable[[], object], least_s: float = 0.02) -> float:
    """Processor time of one call, s, over as many calls as take ``least_s``."""
    calls = 0
    start = time.process_time()
    while True:
        action()
        calls += 1
        spent = time.process_time() - start
        if spent >= least_s:
            return spent / calls


@dataclass(frozen=True)
class Spread:
    """Median of several values, and the quarter of them that lies below and above."""

    median: float
    low: float
    high: float


def spread(values: Sequence[float]) -> Spread:
    """Median and quartiles.   Raises ValueError without a value."""
    if not values:
        raise ValueError("no values were taken")
    if len(values) == 1:
        return Spread(values[0], values[0], values[0])
    low, _, high = statistics.quantiles(values, n=4, method="inclusive")
    return Spread(statistics.median(values), low, high)


def in_turn(actions: Sequence[Callable[[], object]], rounds: int = 7, least_s: float = 0.02) -> list[list[float]]:
    """Seconds of each action in each round, the actions one after the other within a round; a round before is not counted."""
    for action in actions:
        action()
    taken: list[list[float]] = [[] for _ in actions]
    for _ in range(rounds):
        for values, action in zip(taken, actions, strict=True):
            values.append(seconds(action, least_s))
    return taken


def ratio(taken: Sequence[float], against: Sequence[float]) -> Spread:
    """How many times as long the first takes as the second, pair by pair."""
    return spread([a / b for a, b in zip(taken, against, strict=True)])


def growth(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Exponent p of  cost ~ size^p,  by least squares of the logarithms.   Raises ValueError with fewer than two sizes."""
    x, y = [math.log(size) for size in sizes], [math.log(cost) for cost in costs]
    if len(set(x)) < 2:
        raise ValueError("growth needs two sizes at least")
    mean_x, mean_y = statistics.fmean(x), statistics.fmean(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / sum((a - mean_x) ** 2 for a in x)


def load() -> float:
    """Running and waiting processes per core over the last minute."""
    return os.getloadavg()[0] / (os.cpu_count() or 1)


def machine() -> str:
    """The machine and how busy it is, in one line."""
    cores, busy = os.cpu_count() or 1, load()
    start = time.process_time()
    for _ in range(1_000_000):
        pass
    step_ns = 1e3 * (time.process_time() - start) * 1e6 / 1e6
    state = f"LOADED, {busy:.1f} processes per core" if busy > BUSY else "quiet"
    return f"{cores} cores, {state}; an empty loop of Python takes {step_ns:.0f} ns a turn"


def keep(path: Path, when: str, described: str, figures: Sequence[Figure]) -> list[dict[str, object]]:
    """Append a run to the history, written whole or not at all, and return what stood there before.

    Raises ValueError when the file is no history.
    """
    before: list[dict[str, object]] = []
    if path.exists():
        found = json.loads(path.read_text())
        if not isinstance(found, list) or not all(isinstance(run, dict) and "figures" in run for run in found):
            raise ValueError(f"{path} is no history of benchmarks; name another file with --history")
        before = found
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps([*before, {"when": when, "machine": described, "figures": [asdict(f) for f in figures]}], indent=1))
    os.replace(draft, path)
    return before


def last(before: Sequence[dict[str, object]], figure: Figure) -> float | None:
    """What the figure was when it was last taken."""
    for run in reversed(before):
        figures = run["figures"]
        assert isinstance(figures, list)
        for item in figures:
            if item["topic"] == figure.topic and item["name"] == figure.name:
                return float(item["value"])
    return None
