"""Summary of the results of all members: shares with intervals, quantiles, what drives the failures, the worst members."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import betaincinv

from beltcomm.arrays import Array
from beltcomm.configfiles import is_number
from beltcomm.model.value import NORMAL_95

#: Quantiles told.
QUANTILES = (0.05, 0.5, 0.95)
#: Members named as the worst; fewest members from which a rank correlation is told; what its 95 % interval is made with.
WORST, FEWEST = 5, 10
#: How a driver is named that is the distance of a parameter from its nominal value.
DISTANCE = "distance from nominal of"
#: What a larger value of is better; of all else a smaller one is.
MORE_IS_BETTER = frozenset({"phase_margin_deg", "position_phase_margin_deg", "gain_margin_db", "passed", "stable"})
#: The share that the exit code follows, for which members without a result count as missed.
HEADLINE = "passed"
#: What a diagnosis names that finds nothing, and one that was not made.
NOTHING_NAMED, NO_RESULT = "nothing", "no result"

Line = Mapping[str, Any]


@dataclass(frozen=True)
class Share:
    """Of ``of`` members ``count`` have ``key``.

    Attributes
    ----------
    low, high : float
        95 % interval of the share (Clopper and Pearson).
    """

    key: str
    count: int
    of: int
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class QuantitySpread:
    """Of one quantity over ``of`` members.

    Attributes
    ----------
    quantiles : tuple of float
        At :data:`QUANTILES`.
    worst : float
        And which member has it.
    """

    key: str
    of: int
    quantiles: tuple[float, ...]
    worst: float
    member: int


@dataclass(frozen=True)
class Driver:
    """Correlation of a drawn parameter with a result: Spearman's rank correlation with its 95 % interval (Bonett and Wright 2000)."""

    parameter: str
    key: str
    rank_correlation: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """True if the interval leaves zero out."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True)
class Answers:
    """Effects named for ``of`` members with the same hidden effect ("" where nobody knows), and of how many, most often first.

    The name is that of an effect, of several with " + " between them in the order of their names, :data:`NOTHING_NAMED` or
    :data:`NO_RESULT`.
    """

    hidden: str
    of: int
    named: Mapping[str, int]


@dataclass(frozen=True)
class Summary:
    """Of all members computed so far.

    Attributes
    ----------
    failed : dict of int to str
        Sentence by member without a result.
    worst : tuple of int
        Members, worst first.
    answers : tuple of Answers
        Of a diagnosis, by hidden effect.
    """

    planned: int
    done: int
    failed: Mapping[int, str]
    exit_codes: Mapping[int, int]
    shares: tuple[Share, ...]
    spreads: tuple[QuantitySpread, ...]
    drivers: tuple[Driver, ...]
    worst: tuple[int, ...]
    answers: tuple[Answers, ...] = ()

    def share(self, key: str) -> Share | None:
        """The share of that name, None where there is none."""
        return next((one for one in self.shares if one.key == key), None)


def summary_of(lines: Sequence[Line], planned: int, targets: Mapping[str, float], nominal: Mapping[str, float]) -> Summary:
    """Summary of the lines of ``members.jsonl``.

    Parameters
    ----------
    lines : sequence of Line
        Of the members that have been computed.
    planned : int
        Members of the study.
    targets : dict of str to float
        By result, the value it is to stay below; what is worst is told by them.
    nominal : dict of str to float
        Of what was drawn, where there is one.
    """
    lines = sorted(lines, key=lambda line: int(line["member"]))
    codes: dict[int, int] = {}
    for line in lines:
        codes[int(line["exit_code"])] = codes.get(int(line["exit_code"]), 0) + 1
    failed = {int(line["member"]): str(line["error"]) for line in lines if "error" in line}
    told = [line for line in lines if "error" not in line]
    keys = list(dict.fromkeys(key for line in told for key in line["found"]))
    flags = [key for key in keys if any(isinstance(line["found"].get(key), bool) for line in told)]
    shares = [_share(key, told, len(failed) if key == HEADLINE else 0) for key in flags]
    if HEADLINE not in flags and failed and not told:
        shares = [_share_of(HEADLINE, 0, len(failed))]
    numbers = [key for key in keys if any(is_number(line["found"].get(key)) for line in told)]
    return Summary(
        planned,
        len(lines),
        failed,
        dict(sorted(codes.items())),
        tuple(shares),
        tuple(_spread(key, told) for key in numbers),
        tuple(_drivers(lines, [*flags[:1], *targets, "phase_margin_deg"], nominal)),
        _worst(lines, targets),
        _answers(lines) if any("named" in line["found"] for line in told) else (),
    )


def _share_of(key: str, count: int, of: int) -> Share:
    """A share with its interval.     Source: Clopper and Pearson, Biometrika 26 (1934) 404."""
    low = float(betaincinv(count, of - count + 1, 0.025)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 0.975)) if count < of else 1.0
    return Share(key, count, of, count / of, low, high)


def _share(key: str, told: Sequence[Line], missed: int) -> Share:
    answers = [bool(line["found"][key]) for line in told if isinstance(line["found"].get(key), bool)]
    return _share_of(key, sum(answers), len(answers) + missed)


def _answers(lines: Sequence[Line]) -> tuple[Answers, ...]:
    kinds: dict[str, Counter[str]] = {}
    for line in lines:
        named = NO_RESULT if "error" in line else " + ".join(sorted(line["found"]["named"])) or NOTHING_NAMED
        kinds.setdefault(str(line["values"].get("hidden", "")), Counter())[named] += 1
    return tuple(Answers(hidden, named.total(), dict(named.most_common())) for hidden, named in kinds.items())


def _spread(key: str, told: Sequence[Line]) -> QuantitySpread:
    known = [(float(line["found"][key]), int(line["member"])) for line in told if is_number(line["found"].get(key))]
    values = np.array([value for value, _ in known])
    at = int(np.argmin(values) if key in MORE_IS_BETTER else np.argmax(values))
    return QuantitySpread(key, len(known), tuple(float(q) for q in np.quantile(values, QUANTILES)), *known[at])


def _drivers(lines: Sequence[Line], keys: Sequence[str], nominal: Mapping[str, float]) -> list[Driver]:
    """Every drawn number against every result; by result, the strongest first.

    A friction that the feedforward does not know is as bad when it is smaller as when it is larger, which no rank correlation sees: where
    values lie on both sides of the nominal one, their distance to it is looked at too.
    """
    found = []
    for name in dict.fromkeys(name for line in lines for name, value in line["values"].items() if is_number(value)):
        here = [line for line in lines if name in line["values"]]
        drawn = np.array([float(line["values"][name]) for line in here])
        sides = {f"{name}": drawn}
        if name in nominal and drawn.min() < nominal[name] < drawn.max():
            sides[f"{DISTANCE} {name}"] = np.abs(drawn - nominal[name])
        for label, values in sides.items():
            found += [one for key in keys if (one := _driver(label, key, values, [_result(line, key) for line in here])) is not None]
    return sorted(found, key=lambda one: (keys.index(one.key), -abs(one.rank_correlation), one.parameter))


def _driver(label: str, key: str, drawn: Array, results: Sequence[float | None]) -> Driver | None:
    known = np.array([result is not None for result in results])
    x, y = drawn[known], np.array([result for result in results if result is not None])
    if len(x) < FEWEST or min(len(np.unique(x)), len(np.unique(y))) < 2:
        return None
    rho = float(np.corrcoef(_ranks(x), _ranks(y))[0, 1])
    half = NORMAL_95 * math.sqrt((1.0 + 0.5 * rho**2) / (len(x) - 3))
    z = math.atanh(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12))
    return Driver(label, key, rho, math.tanh(z - half), math.tanh(z + half))


def _ranks(values: Array) -> Array:
    """1 for the smallest; equal values share the mean of their ranks."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[place], dtype=np.float64)


def _result(line: Line, key: str) -> float | None:
    """A result as a number; a member without results has missed."""
    value = line.get("found", {}).get(key)
    if isinstance(value, bool):
        return float(value)
    return float(value) if is_number(value) else 0.0 if key == HEADLINE and "error" in line else None


def _worst(lines: Sequence[Line], targets: Mapping[str, float]) -> tuple[int, ...]:
    """Members without a result or an unstable loop first, then by how far the farthest target is missed."""

    def badness(line: Line) -> float:
        found = line.get("found")
        if found is None or found.get("stable") is False:
            return math.inf
        shares = [float(found[key]) / target if is_number(found.get(key)) else math.inf for key, target in targets.items() if key in found]
        return max(shares, default=float(any(value is False for value in found.values())))

    ranked = sorted(lines, key=lambda line: (-badness(line), int(line["member"])))
    return tuple(int(line["member"]) for line in ranked[:WORST] if badness(line) > 0.0)
