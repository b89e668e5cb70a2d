"""One stage of a diagnosis: every effect scored, the best ones refitted with everything free, ranked by evidence.

    evidence = O_before - O_after - (n ln N + 2 ln starts),   n : parameters that the effect adds

(Bayes' information criterion with the number of ways that were tried.)  ``explained`` is the share of what lies above the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from beltcomm.effects import EFFECTS, Effect, Ground
from beltcomm.errors import UsageError
from beltcomm.identify.problem import free_parameters
from beltcomm.laboratory.data import Data
from beltcomm.laboratory.fitting import Fitted, fit
from beltcomm.laboratory.score import Scored, Scorer

#: O per sample of a healthy machine, and that above which something is missing: measured on simulated healthy machines
#: (tests/benchmarks), where they hold for any noise because the residual is in units of it.
FLOOR, MISSING = 0.95, 1.02
#: Evidence that the best of all effects must have; healthy machines stay far below.
EVIDENCE = 150.0
#: Share of the misfit above the floor that a named effect must explain, and loss on held-out records beyond which it is refused,
#: as a share of the evidence.
EXPLAINED, HELD_OUT_LOSS = 0.10, 0.1
#: How many effects are refitted, and how many ways of each.
REFITTED, WAYS = 5, 3
#: An effect whose score promises less than this share of the best, or less than this many nats, is not refitted.
PROMISE_SHARE, PROMISE = 0.02, 20.0
#: Iterations of a refit.
ITERATIONS = 8


@dataclass(frozen=True)
class Candidate:
    """An effect on trial.

    evidence, explained : see the module.   promised : drop by the score test.   fitted : with the effect, None where it was not
    refitted.   held_gain : drop of O on the held-out records.   accepted : by the rule of this module.
    """

    effect: Effect
    promised: float
    evidence: float
    explained: float
    held_gain: float
    fitted: Fitted | None
    accepted: bool


def search(
    data: Data, base: Fitted, ground: Ground, effects: Sequence[Effect] | None = None, progress: Callable[[float], None] = lambda _f: None
) -> list[Candidate]:
    """All effects that the model does not have yet, best first."""
    scorer = Scorer(base)
    wanted = [e for e in (effects or EFFECTS) if e.trials is not None and may_add(base, e)]
    scored: list[list[Scored]] = []
    for number, effect in enumerate(wanted):
        found = scorer.score(effect, ground)
        if found:
            scored.append(found)
        progress(0.4 * (number + 1) / len(wanted))
    scored.sort(key=lambda ways: -promise(ways, base))
    best = promise(scored[0], base) if scored else 0.0
    candidates = []
    for number, ways in enumerate(scored):
        promised = promise(ways, base)
        if number < REFITTED and promised > max(PROMISE, PROMISE_SHARE * best):
            candidates.append(refitted(data, base, ways))
        else:
            candidates.append(Candidate(ways[0].effect, ways[0].drop, promised, 0.0, 0.0, None, False))
        progress(0.4 + 0.6 * min(1.0, (number + 1) / REFITTED))
    return sorted(candidates, key=lambda c: (c.fitted is None, -c.evidence))


def may_add(base: Fitted, effect: Effect) -> bool:
    """Whether the model can take the effect, one of a numbered family at a time."""
    present = base.model.effects
    if effect.name in present:
        return False
    if base.model.side == "load" and (effect.harmonic or effect.slot in ("kinematics", "sensor")):
        return False  # at the load side no angle is known
    family, _, number = effect.name.rpartition("_")
    if number.isdigit():
        before = family if number == "2" else f"{family}_{int(number) - 1}"
        if before not in present:
            return False
    try:
        base.model.with_effect(effect.name)
    except UsageError:
        return False
    return True


def promise(ways: Sequence[Scored], base: Fitted) -> float:
    """What the best way of an effect promises, its price taken off."""
    return ways[0].drop - price(ways[0].effect, base, len(ways))


def price(effect: Effect, base: Fitted, starts: int) -> float:
    """n ln N + 2 ln starts."""
    added = sum(p.fitted for p in effect.parameters) + len(effect.bodies)
    return added * math.log(base.problem.samples) + 2.0 * math.log(max(starts, 1))


def refitted(data: Data, base: Fitted, ways: Sequence[Scored]) -> Candidate:
    """Everything fitted again with the effect, from its best ways."""
    effect = ways[0].effect
    tried = []
    for way in ways[:WAYS] if len(effect.parameters) > 1 and not way_is_linear(ways[0]) else ways[:1]:
        model = base.model.with_effect(effect.name, way.values)
        own = [n for n in free_parameters(model) if n not in base.model.parameters]
        tried.append(fit(data, model, ITERATIONS, offsets=base.offsets, settled=own))
    best = min(tried, key=lambda fitted: fitted.objective)
    drop = base.objective - best.objective
    evidence = drop - price(effect, base, len(ways))
    above = base.objective - FLOOR * base.problem.samples
    explained = drop / above if above > 0.0 else 0.0
    held_gain = base.held_objective - best.held_objective
    accepted = evidence > EVIDENCE and held_gain > -HELD_OUT_LOSS * evidence and explained > EXPLAINED
    return Candidate(effect, ways[0].drop, evidence, explained, held_gain, best, accepted)


def way_is_linear(way: Scored) -> bool:
    """Whether the score test has already found the best values of this way."""
    return bool(way.trial.amplitudes)
