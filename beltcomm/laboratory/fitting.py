"""A model fitted to the records of a run, and judged on those held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.identify.problem import OFFSET_M, Minimum, Problem, free_parameters, time_blocks
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
WIDEST, STARTS, ROUNDS, RATTLING_GAIN = 0.2, 41, 4, 50.0
#: Variation of ln of the misfit with the start below which a record has forgotten it.
FORGOTTEN = 0.1


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
    found = rattling_minimum(problem, x, iterations, enough) if rattles(model) else problem.minimise(x, iterations, enough=enough)
    best = problem.model_at(found.x, "laboratory")
    held_residual = tuple(judged(piece, best) for piece in data.held_out)
    return Fitted(best, problem, found.x, found.residual, found.objective, held_residual, held_objective(data, held_residual))


def rattles(model: Model) -> bool:
    """Whether the carriage is free at times."""
    return any(effect.rattles for effect in model.effect_list())


def rattling_minimum(problem: Problem, x: Array, iterations: int, enough: float) -> Minimum:
    """The minimum where the carriage is free at times: records that forget their start say what the parameters are."""
    own = len(problem.free)
    best: Minimum | None = None
    for _ in range(ROUNDS):
        looked = [best_start(piece, problem.model, problem.full(x), float(x[own + i])) for i, piece in enumerate(problem.pieces)]
        x = np.concatenate((x[:own], [start for start, _ in looked]))
        calm = [i for i, (_, spread) in enumerate(looked) if spread < FORGOTTEN]
        if not calm:
            break
        inner = Problem([problem.pieces[i] for i in calm], problem.model, problem.free, BLOCK_S)
        found = inner.minimise(np.concatenate((x[:own], x[own:][calm])), iterations, enough=enough)
        x = np.concatenate((found.x[:own], x[own:]))
        x[own:][calm] = found.x[own:]
        residual = problem.residual(x)
        ahead = Minimum(x, residual, problem.objective(residual))
        if best is not None and best.objective - ahead.objective < RATTLING_GAIN:
            return ahead if ahead.objective < best.objective else best
        best = ahead
    return best if best is not None else problem.minimise(x, iterations, enough=enough)


def best_start(piece: Stretch, model: Model, vector: Array, here: float) -> tuple[float, float]:
    """The likeliest scaled start offset of a stretch, and by how much ln of the misfit per block varies with it.   here : one known."""
    blocks = np.arange(0, max(len(piece.counted), 1), max(1, int(BLOCK_S / piece.motion.sample_s)))

    def cost(offset: float) -> float:
        squares = whitened(piece, model, vector, OFFSET_M * offset) ** 2
        means = np.add.reduceat(squares, blocks) / np.diff([*blocks, len(squares)])
        return float(np.mean(np.log(np.maximum(means, 1.0))))

    if not len(piece.counted):
        return here, 0.0
    wide = np.array([here, *np.linspace(-WIDEST, WIDEST, STARTS)])
    costs = [cost(offset) for offset in wide]
    best = float(wide[int(np.argmin(costs))])
    near = best + np.linspace(-1.0, 1.0, 9) * 2.0 * WIDEST / (STARTS - 1)
    return float(near[int(np.argmin([cost(offset) for offset in near]))]), float(np.ptp(costs))


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
        return whitened(piece, model, vector, OFFSET_M * best_start(piece, model, vector, 0.0)[0])
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
