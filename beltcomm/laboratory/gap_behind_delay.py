"""A gap behind a torque that acts late: each hides the other, so that neither alone leads out of a base that made up for both.

Where the fit left the start values of masses and belt, and nothing explains most of what is missing, both are fitted together from those
values.  If that explains nearly all of it, the gap goes on trial for what both explain, as that fit sees it without the delay: beside the
right masses the next stage finds the delay by itself, and tells lag from dead time.
"""

from __future__ import annotations

import itertools
import math

from beltcomm.effects import EFFECTS, Effect
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.laboratory.acceptance import EVIDENCE, STIFFNESS, drop_by, explained_share, impossible
from beltcomm.laboratory.forward_selection import Candidate, bic_penalty, candidate, may_add
from beltcomm.model import Model

#: m and s; gaps and delays that are tried with each other: smaller ones hide nothing.
GAPS_M, DELAYS_S = (3e-5, 6e-5, 1.2e-4), (5e-4, 1e-3, 2e-3)
#: Share of what lies above the noise that both together must explain.
NEARLY_ALL = 0.8
#: Iterations of the fit of both.
ITERATIONS = 9


def gap_with_delay(data: Data, current: Fitted, held: Fitted) -> Candidate | None:
    """The gap as a candidate for what it explains beside a delay; None where both together do not explain nearly all.

    evidence = O_current - O_both - (n ln N + 2 ln ways),   n : parameters of both   (see ``forward_selection``)

    Parameters
    ----------
    current : Fitted
        Model that they must be better than.
    held : Fitted
        The same with masses and belt as the start values have them.
    """
    if STIFFNESS not in held.model.parameters or needs_observer(held.model):
        return None
    fits: list[tuple[Effect, Effect, Fitted]] = []
    for gap in EFFECTS:
        for delay in EFFECTS:
            if gap.rattles and delay.slot == "torque_delay" and may_add(held, gap) and may_add(held, delay):
                goal = min((fitted.objective for _, _, fitted in fits), default=math.inf)
                fits.append((gap, delay, both_fitted(data, held.model, gap, delay, goal)))
    if not fits:
        return None
    gap, delay, best = min(fits, key=lambda fitted: fitted[2].objective)
    drop = drop_by(current, best)
    ways = len(fits) * len(GAPS_M) * len(DELAYS_S)
    evidence, explained = drop - bic_penalty(gap, current, ways) - bic_penalty(delay, current, 1), explained_share(drop, current)
    if evidence <= EVIDENCE or explained <= NEARLY_ALL or best.ratio >= current.ratio or impossible(best.model):
        return None
    alone = candidate(data, current, gap, 0.0, fit(data, best.model.without_effect(delay.name), 0), 1)
    if alone.fitted is None or alone.fitted.ratio >= current.ratio:
        return None
    held_out_gain = current.held_out_objective - best.held_out_objective
    return Candidate(gap, drop, evidence, explained, held_out_gain, alone.fitted, True, beside=delay.name)


def both_fitted(data: Data, model: Model, gap: Effect, delay: Effect, goal: float) -> Fitted:
    """A model fitted with a gap and a delay, from the width and time that suit it best as they are.

    Parameters
    ----------
    goal : float
        See ``fitting.fit``.
    """
    sizes = itertools.product(GAPS_M, DELAYS_S)
    ways = [
        model.with_effect(gap.name, {gap.parameters[0].name: width}).with_effect(delay.name, {delay.parameters[0].name: time})
        for width, time in sizes
    ]
    begun = min((fit(data, way, 0) for way in ways), key=lambda fitted: fitted.objective)
    return fit(data, begun.model, ITERATIONS, goal=goal)
