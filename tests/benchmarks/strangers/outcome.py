"""What a case came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["fine", "weak", "broken"]
#: What no command may say.
NEVER = ("Traceback (most recent", "unexpected error", "Exception ignored", "<class '")


@dataclass(frozen=True)
class Outcome:
    """One case.   verdict : fine: done, or refused with a sentence and a documented exit code; weak: harmless, but not told well; broken:
    whatever may hurt or is lost.   said : why not fine."""

    group: str
    case: str
    verdict: Verdict
    said: str = ""


def judged(group: str, case: str, broken: str = "", weak: str = "") -> Outcome:
    """An outcome from what is wrong.   broken, weak : "" for nothing."""
    return Outcome(group, case, "broken" if broken else "weak" if weak else "fine", " ".join((broken or weak).split())[:300])


def table(outcomes: list[Outcome]) -> list[str]:
    """Counts of each group, then every case that was not fine."""
    groups = list(dict.fromkeys(one.group for one in outcomes))
    lines = [f"{'group':12} {'cases':>6} {'fine':>6} {'weak':>6} {'broken':>6}"]
    for group in [*groups, "all"]:
        of_it = [one.verdict for one in outcomes if group in ("all", one.group)]
        lines.append(f"{group:12} {len(of_it):6} " + " ".join(f"{of_it.count(verdict):6}" for verdict in ("fine", "weak", "broken")))
    return [*lines, *(f"{one.verdict}: {one.group}: {one.case}: {one.said}" for one in outcomes if one.verdict != "fine")]
