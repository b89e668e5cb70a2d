"""A model fitted to the records of a run, and judged on those held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.identify.problem import OFFSET_M, Problem, free_parameters, time_blocks
from beltcomm.identify.residual import Stretch, whitened
from beltcomm.laboratory.data import Data
from beltcomm.model import Model

Array = NDArray[np.float64]

#: s; blocks with one weight: longer than the resonance rings, short enough to keep what is wrong apart from what is right.
BLOCK_S = 0.2
#: Gain of O that is not worth another iteration, nats.
ENOUGH = 0.1
#: A carriage that rattles: share of the largest start offset, and number of offsets, that are looked at; rounds of looking and fitting,
#: and the gain that is worth another one, nats.
WIDEST, STARTS, ROUNDS, RATTLING_GAIN = 0.2, 41, 2, 50.0


@dataclass(frozen=True)
class Fitted:
    """A model at its minimum.

    problem, x : unknowns.   residual : whitened, (n,), of the fitted records.   objective : O.   held_residual : of those held out,
    piece by piece.   held_objective : O there, 0 without any.
    """

    model: Model
    problem: Problem
    x: Array
    residual: Array
    objective: float
    held_residual: tuple[Array, ...]
    held_objective: float

    @property
    def ratio(self) -> float:
        """rms of the residual over rms of the noise, fitted records."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def held_ratio(self) -> float | None:
        """The same on the held-out records; None without any."""
        joined = np.concatenate(self.held_residual) if self.held_residual else np.zeros(0)
        return float(np.sqrt(np.mean(joined**2))) if len(joined) else None

    @property
    def offsets(self) -> Array:
        """Scaled start offsets; zeros where no carriage can be off."""
        return self.problem.offsets(self.x) if self.problem.movable else np.zeros(len(self.problem.pieces))


def fit(
    data: Data, model: Model, iterations: int, *, offsets: Array | None = None, fixed: Sequence[str] = (), enough: float = ENOUGH
) -> Fitted:
    """All free parameters of the model fitted to the records.

    offsets : scaled start offsets to begin with.   enough : gain of O that is not worth another iteration, nats.
    """
    problem = problem_of(data, model, fixed)
    x = problem.start(offsets)
    if not rattles(model):
        found = problem.minimise(x, iterations, enough=enough)
    else:
        found = problem.minimise(with_best_starts(problem, x), iterations, enough=enough)
        for _ in range(ROUNDS):
            ahead = problem.minimise(with_best_starts(problem, found.x), iterations, enough=enough)
            gain = found.objective - ahead.objective
            found = ahead if gain > 0.0 else found
            if gain < RATTLING_GAIN:
                break
    best = problem.model_at(found.x, "laboratory")
    held_residual = tuple(judged(piece, best) for piece in data.held_out)
    return Fitted(best, problem, found.x, found.residual, found.objective, held_residual, held_objective(data, held_residual))


def rattles(model: Model) -> bool:
    """Whether the carriage is free at times."""
    return any(effect.rattles for effect in model.effect_list())


def with_best_starts(problem: Problem, x: Array) -> Array:
    """The unknowns with the best place of the carriage at the start of each stretch: one of many minima, so all are looked at."""
    out, first = x.copy(), len(problem.free)
    vector = problem.full(x)
    for i, piece in enumerate(problem.pieces):
        out[first + i] = best_start(piece, problem.model, vector, float(x[first + i]))
    return out


def best_start(piece: Stretch, model: Model, vector: Array, here: float) -> float:
    """The likeliest scaled start offset of a stretch.   here : one that is known."""
    blocks = np.arange(0, max(int(piece.keep.sum()), 1), max(1, int(BLOCK_S / piece.motion.sample_s)))

    def cost(offset: float) -> float:
        squares = whitened(piece, model, vector, OFFSET_M * offset) ** 2
        means = np.add.reduceat(squares, blocks) / np.diff([*blocks, len(squares)])
        return float(np.sum(np.log(np.maximum(means, 1.0))))

    if not piece.keep.any():
        return here
    wide = np.array([here, *np.linspace(-WIDEST, WIDEST, STARTS)])
    best = float(wide[int(np.argmin([cost(o) for o in wide]))])
    near = best + np.linspace(-1.0, 1.0, 9) * 2.0 * WIDEST / (STARTS - 1)
    return float(near[int(np.argmin([cost(o) for o in near]))])


def problem_of(data: Data, model: Model, fixed: Sequence[str] = ()) -> Problem:
    """The free parameters of a model as unknowns."""
    return Problem(data.fitted, model, free_parameters(model, ("transmission.ratio", *fixed)), BLOCK_S)


def judged(piece: Stretch, model: Model) -> Array:
    """Whitened residual of a held-out stretch; only where its carriage stuck at the start is fitted to it."""
    vector = model.vector()
    here = whitened(piece, model, vector)
    if "cart" not in model.base_bodies:
        return here
    if rattles(model):
        return whitened(piece, model, vector, OFFSET_M * best_start(piece, model, vector, 0.0))
    probe = 0.2 * OFFSET_M
    slope = (whitened(piece, model, vector, probe) - here) / probe
    weight = 1.0 / np.maximum(1.0, here**2 / 9.0)
    information = float(np.sum(weight * slope**2))
    if information <= 0.0:
        return here
    offset = float(np.clip(-np.sum(weight * slope * here) / information, -OFFSET_M, OFFSET_M))
    there = whitened(piece, model, vector, offset)
    return there if np.sum(np.minimum(there**2, 25.0)) < np.sum(np.minimum(here**2, 25.0)) else here


def held_objective(data: Data, residuals: Sequence[Array]) -> float:
    """O of the held-out records."""
    if not residuals:
        return 0.0
    blocks = time_blocks(data.held_out, BLOCK_S)
    squares = np.concatenate(residuals) ** 2
    count = np.bincount(blocks).astype(np.float64)
    means = np.bincount(blocks, squares) / np.maximum(count, 1.0)
    return float(np.sum(count * np.where(means < 1.0, means, 1.0 + np.log(np.maximum(means, 1.0)))))
