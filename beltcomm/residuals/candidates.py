"""Candidates for a part of the residual, by the first-order score: each effect beside everything fitted.

With r the whitened residual and c the column of an effect, what everything fitted can do taken off it (``nearby.beside``), the best amount
on any set S of cells and the fall of the squares there are

    a = -M⁻¹ b,   fall = bᵀ M⁻¹ b,   b = Σ_S c r,   M = Σ_S c cᵀ

so that only sums over S of what each cell holds are needed: a choice on a page is answered at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray
from beltcomm.axis import Axis
from beltcomm.compiled import in_one_thread
from beltcomm.effects import EFFECTS, AxisSummary, Effect
from beltcomm.fit.estimate import Fitted
from beltcomm.laboratory.score import Scored, Scorer, amplitude_columns, ground_of
from beltcomm.laboratory.selection import bic_penalty, may_add
from beltcomm.residuals.cells import Cells
from beltcomm.residuals.law import LawCurve, curve_of

#: Trials of an effect that are kept, and a fall of O below which its law is not drawn.
TRIALS, DRAWN = 3, 15.0


@dataclass(frozen=True)
class TrialSums:
    """One way to switch an effect on.

    Attributes
    ----------
    b : ndarray (cells, k)
    m : ndarray (cells, k, k)
    signed : bool
        Amounts below 0 count.
    """

    b: Array
    m: Array
    signed: bool

    def fall(self, chosen: BoolArray) -> float:
        """Fall of the squares on the chosen cells with the amount that is best there."""
        slope, square = self.b[chosen].sum(axis=0), self.m[chosen].sum(axis=0)
        if not np.all(np.diag(square) > 0.0):
            return 0.0
        amounts = -np.linalg.pinv(square, rcond=1e-9, hermitian=True) @ slope
        return -float(amounts @ slope) if self.signed or len(amounts) > 1 or amounts[0] > 0.0 else 0.0


@dataclass(frozen=True)
class CandidateEffect:
    """An effect that the model could take.

    Attributes
    ----------
    evidence : float
        Fall of O over all less its price, by the score.
    values : dict of str to float
        Own parameters at its best.
    left : ndarray of float32
        Whitened residual of the fitted samples with it, everything fitted giving way to first order; none where only an observer of its own
        would tell.
    """

    effect: str
    title: str
    evidence: float
    values: Mapping[str, float]
    left: NDArray[np.float32]
    trials: tuple[TrialSums, ...]
    law: LawCurve | None


@in_one_thread
def candidates_of(
    fitted: Fitted, cells: Cells, axis: Axis, progress: Callable[[float], None] = lambda _share: None
) -> Iterator[CandidateEffect]:
    """Every effect that the model can take, with what it would explain, as it is worked out; without those that show nothing.

    Parameters
    ----------
    fitted : Fitted
        The model whose residual is explained.
    cells : Cells
        In which the residual is shown.
    axis : Axis
        For what the effects are tried with.
    progress : callable
        Hears the share that is done, 0 to 1.

    Yields
    ------
    CandidateEffect
        In the order in which they are worked out.
    """
    scorer = Scorer(fitted)
    ground = ground_of(fitted, fitted.problem.pieces, axis)
    wanted = [e for e in EFFECTS if e.trials is not None and not e.bound and may_add(fitted, e)]
    wanted.sort(key=lambda e: bool(e.harmonic))  # these take longest: the others are shown meanwhile
    for number, effect in enumerate(wanted):
        found = _candidate(scorer, effect, cells, ground)
        progress((number + 1) / len(wanted))
        if found is not None:
            yield found


def _candidate(scorer: Scorer, effect: Effect, cells: Cells, ground: AxisSummary) -> CandidateEffect | None:
    """An effect with its best trials; None where it shows nothing."""
    ways = _ways(scorer, effect, ground)
    if not ways or not ways[0][0].drop > 0.0:
        return None
    best = ways[0][0]
    evidence = best.drop - bic_penalty(effect, scorer.fitted, len(ways))
    if effect.needs_observer:
        return CandidateEffect(effect.name, effect.title, evidence, dict(best.values), np.zeros(0, dtype=np.float32), (), None)
    nearby, residual = scorer.nearby, scorer.fitted.residual
    trials = []
    for one, columns in ways:
        own = nearby.beside(columns)
        b = np.stack([cells.sums(column * residual) for column in own.T], axis=1)
        m = np.stack([np.stack([cells.sums(left * right) for right in own.T], axis=1) for left in own.T], axis=1)
        trials.append(TrialSums(b, m, one.trial.signed))
    change = scorer.columns(effect, [scorer.model_with(effect, best.values, best.trial)])[:, 0]
    left = nearby.predicted_residual(change, nearby.best(change).step)
    law = _law(scorer, effect, best, cells) if best.drop > DRAWN else None
    return CandidateEffect(effect.name, effect.title, evidence, dict(best.values), left.astype(np.float32), tuple(trials), law)


def _ways(scorer: Scorer, effect: Effect, ground: AxisSummary) -> list[tuple[Scored, Array]]:
    """The best trials with their columns, best first."""
    if effect.needs_observer:
        return [(one, np.zeros((0, 0))) for one in scorer.score(effect, ground)[:1]]
    found = []
    for _, trial, columns in scorer.screen(effect, ground):
        one = scorer.score_columns(effect, trial, columns)
        if one.drop > 0.0:
            exact = effect.harmonic == "angle" or trial.base
            ways = [scorer.model_with(effect, values, trial) for values in amplitude_columns(trial)]
            found.append((one, scorer.columns(effect, ways) if exact else columns))
    return sorted(found, key=lambda way: -way[0].drop)[:TRIALS]


def _law(scorer: Scorer, effect: Effect, best: Scored, cells: Cells) -> LawCurve:
    """The torque that the model would gain, everything fitted giving way, along the coordinate in which that is a curve."""
    grown = scorer.model_with(effect, best.values, best.trial)
    x = np.clip(scorer.fitted.x + best.step, scorer.problem.low, scorer.problem.high)
    gained = []
    for i, piece in enumerate(scorer.problem.pieces):
        here, moved = (scorer.problem.balance(i, at, float(scorer.offsets[i])).residual for at in (scorer.fitted.x, x))
        change = scorer.torques(effect, [grown], [grown.vector()], i)[:, 0] + moved - here
        gained.append(change[piece.value_samples])
    torque = cells.mean(np.concatenate(gained))
    fitted = cells.sums(np.ones(sum(map(len, gained)))) > 0.0
    return curve_of(cells, fitted, torque, cells.more)
