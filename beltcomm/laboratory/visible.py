"""Detection limits of these data: the weakest strength of every effect that would still be named.

At the fitted model, an effect of strength s (1: the size that its trials call typical) changes the weighted residual by s c.  What the
free parameters would do as well is taken out, c⊥ = c - A (AᵀA)⁻¹ Aᵀ c, so it would lower the objective by s² c⊥ᵀc⊥.  Named it can be where

    s² c⊥ᵀc⊥ - (n ln N + 2 ln ways)  >  EVIDENCE        (laboratory.selection)

Two amplitudes (sine and cosine) count with the phase that shows least.  Nothing is refitted: to first order, and a search from the
same model has worked out most of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from beltcomm.compiled import in_one_thread
from beltcomm.effects import EFFECTS, AxisSummary, Effect, Trial
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.score import Scorer
from beltcomm.laboratory.selection import bic_penalty, may_add

#: Strength from which on an effect counts as invisible: a typical one would not be named.
TYPICAL = 1.0


@dataclass(frozen=True)
class DetectionLimit:
    """Detection limit of one effect.

    Attributes
    ----------
    weakest, hardest : float
        Strength that can just be named, in the way that shows best (the best place, speed or order) and in the median way; inf where
        nothing can.
    parameter, size, unit
        What strength 1 is, by the parameter that scales it.
    """

    effect: Effect
    weakest: float
    hardest: float
    parameter: str
    size: float
    unit: str

    @property
    def is_detectable(self) -> bool:
        """True if a typical one would be named."""
        return self.hardest <= TYPICAL


@in_one_thread
def detection_limits(scorer: Scorer, ground: AxisSummary) -> list[DetectionLimit]:
    """Every effect that the model could still take, the least visible first.

    Parameters
    ----------
    scorer : Scorer
        A search from this model has filled most of it.
    ground : AxisSummary
        Of the axis, for the trials.
    """
    fitted, found = scorer.fitted, []
    for effect in EFFECTS:
        if effect.trials is None or effect.bound or not ground.may_have(effect) or not may_add(fitted, effect):
            continue
        every = scorer.powers_of(effect, ground)
        falls = [entry for entry in every if not entry[1].base] or every  # what a trial changes of the base is not the effect
        if not falls:
            continue
        falls = sorted(falls, key=lambda entry: -entry[0])
        needed = EVIDENCE + bic_penalty(effect, fitted, len(falls))
        strengths = [math.sqrt(needed / fall) if fall > 0.0 else math.inf for fall, _ in falls]
        middle = strengths[(len(strengths) - 1) // 2]
        name, size, unit = _scale_of(effect, falls[0][1])
        found.append(DetectionLimit(effect, strengths[0], middle, name, size, unit))
    return sorted(found, key=lambda sight: -sight.hardest)


def _scale_of(effect: Effect, trial: Trial) -> tuple[str, float, str]:
    """Parameter that scales an effect, its typical size and unit."""
    own = [p.name for p in effect.parameters if p.fitted and p.name in trial.values]
    wanted = next(iter((*trial.amplitudes, *own)), "")
    for parameter in effect.parameters:
        if parameter.name == wanted:
            return parameter.name, abs(float(trial.values[wanted])), parameter.unit
    return "", 1.0, ""
