"""A model fitted to the records of a run, and judged on those held out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array
from beltcomm.fit.likelihood.free_parameters import free_parameters
from beltcomm.fit.likelihood.local_quadratic import LocalQuadratic
from beltcomm.fit.likelihood.problem import OFFSET_M, Minimum, Problem, hopeless, time_blocks
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import whitened_residual, with_observer, with_observers
from beltcomm.model import Model

#: Where the carriage of a held-out record may have stuck at its start: looked at so far apart, m, so many times to either side.
APART_M, SIDEWAYS = 0.25 * OFFSET_M, 4
#: Deviations beyond which a sample counts no more there.
OUTLIER = 5.0
#: s; blocks with one weight: longer than the resonance rings, short enough to keep what is wrong apart from what is right.
BLOCK_S = 0.2
#: The same where one weight is to hold for a whole segment: longer than any, s.
STRETCH_S = 1e6
#: Shares of the motor's inertia to begin with there: before a body was added the motor's made up for it.
LIGHTER = (1.0, 0.85, 0.7)
INERTIA = "motor.inertia"
#: Gain of O that is not worth another iteration, nats.
ENOUGH = 0.1
#: Where an observer follows the carriage: iterations after which it is made anew, and the gain that is worth more of them, nats.
AT_A_TIME, FOLLOWED_ENOUGH = 3, 5.0
#: How often in a row a model may be no better behind its own observer, and factor by which O may be larger there.
MISSES, ASTRAY = 2, 1.2


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its minimum; two are the same where they are one object.

    Attributes
    ----------
    problem, x
        Unknowns.
    residual : ndarray
        Whitened, (n,), of the fitted records.
    objective : float
        O.
    held_out_residuals : tuple of ndarray
        Of those held out, piece by piece.
    held_out_objective : float
        O there, 0 without any.
    onward : Model or None
        With which the search would go on, where its iterations ended it.
    likeliest : Fitted or None
        The likelihood's own minimum, from which a search begins, of a fit that is told with other values (``fit.least_squares``).
    """

    model: Model
    problem: Problem
    x: Array
    residual: Array
    objective: float
    held_out_residuals: tuple[Array, ...]
    held_out_objective: float
    onward: Model | None = None
    likeliest: Fitted | None = None

    @property
    def ratio(self) -> float:
        """rms of the residual over rms of the noise, fitted records; nan where no sample counts."""
        return float(np.sqrt(np.mean(self.residual**2))) if len(self.residual) else np.nan

    @property
    def held_out_ratio(self) -> float | None:
        """Ratio of residual to noise on the held-out records; None without any."""
        joined = np.concatenate(self.held_out_residuals) if self.held_out_residuals else np.zeros(0)
        return float(np.sqrt(np.mean(joined**2))) if len(joined) else None

    @property
    def held_out_level(self) -> float | None:
        """O of the held-out records for each of their values, to be held against fits with other samples; None without any."""
        held = sum(map(len, self.held_out_residuals))
        return self.held_out_objective / held if held else None

    @property
    def held_out_share(self) -> float:
        """Values of the records held out over those fitted."""
        return sum(map(len, self.held_out_residuals)) / max(self.problem.samples, 1)

    @property
    def offsets(self) -> Array:
        """Scaled start offsets; zeros where no carriage can be off."""
        return self.problem.offsets(self.x) if self.problem.movable else np.zeros(len(self.problem.pieces))

    @cached_property
    def local_quadratic(self) -> LocalQuadratic:
        """The neighbourhood of this minimum, worked out once: several questions in a row ask for it."""
        return LocalQuadratic(self.problem, self.x, self.residual)


def fit(
    data: Data,
    model: Model,
    iterations: int,
    *,
    offsets: Array | None = None,
    fixed: Sequence[str] = (),
    enough: float = ENOUGH,
    goal: float = math.inf,
) -> Fitted:
    """All free parameters of the model fitted to the records.

    Parameters
    ----------
    data : Data
    model : Model
    iterations : int
        At most.
    offsets : ndarray or None
        Scaled start offsets to begin with.
    fixed : sequence of str
        Parameters that are held, by full name.
    enough : float
        Gain of O that is not worth another iteration, nats.
    goal : float
        O above which the fit does not matter: it ends where it does not get there.
    """
    return fit_of(problem_of(data, model, fixed), data, iterations, offsets=offsets, fixed=fixed, enough=enough, goal=goal)


def fit_of(
    problem: Problem,
    data: Data,
    iterations: int,
    *,
    offsets: Array | None = None,
    fixed: Sequence[str] = (),
    enough: float = ENOUGH,
    goal: float = math.inf,
) -> Fitted:
    """Fit of a problem made by :func:`problem_of`.

    Parameters
    ----------
    problem : Problem
        Model, segments and free parameters.
    data : Data
        The same records, for those held out.
    iterations : int
        At most.
    offsets : ndarray (segments,) or None
        Scaled start offsets to begin with.
    fixed : sequence of str
        Parameters that do not move, for a fit behind observers; another problem has its own.
    enough : float
        Fall of O in an iteration that is not worth another.
    goal : float
        O at which the search may end.
    """
    if needs_observer(problem.model):  # then an observer knows itself how the carriage may stand at first
        return _fit_with_observers(problem, data, iterations, fixed, enough, goal)
    return _fit_result(problem, problem.minimise(problem.start(offsets), iterations, enough=enough, goal=goal), data)


def resume_fit(data: Data, begun: Fitted, iterations: int) -> Fitted:
    """A fit behind observers gone on with, on the same records.

    Parameters
    ----------
    data : Data
        As in the fit.
    begun : Fitted
        Whose iterations ended it.
    iterations : int
        At most, from here on.

    Returns
    -------
    Fitted
        ``begun`` itself where it has come to its end.
    """
    if begun.onward is None:
        return begun
    best = begun.problem, Minimum(begun.x, begun.residual, begun.objective)
    return _fit_with_observers(problem_of(data, begun.onward), data, iterations, best=best)


def _fit_with_observers(
    problem: Problem,
    data: Data,
    iterations: int,
    fixed: Sequence[str] = (),
    enough: float = ENOUGH,
    goal: float = math.inf,
    best: tuple[Problem, Minimum] | None = None,
) -> Fitted:
    """A few iterations at a time, each behind an observer made for the model that they begin with; the best of them is kept.

    A model is judged behind its own observer only: behind another's a rattling carriage can look better than it is.
    best : of the iterations before these.
    """
    left, misses, gain = iterations, 0, math.inf
    while True:
        x = problem.start()
        residual = problem.residual(x)
        here = Minimum(x, residual, problem.objective(residual, x))
        least = best[1].objective if best is not None else math.inf
        if here.objective <= least:
            best, misses = (problem, here), 0
        else:
            misses += 1
        assert best is not None
        lost = misses == MISSES or here.objective > ASTRAY * best[1].objective
        lost |= hopeless(best[1].objective - goal, least - best[1].objective, math.ceil(left / AT_A_TIME))
        through = not gain >= FOLLOWED_ENOUGH  # also where a body flew off, and it is no number
        if left <= 0 or through or lost:
            return _fit_result(*best, data, None if through or lost else problem.model)
        found = problem.minimise(x, min(left, AT_A_TIME), enough=enough)
        left, gain = left - AT_A_TIME, here.objective - found.objective
        if best[0] is not problem:
            problem.forget()  # before the next ones' observers are made
        problem = problem_of(data, problem.model_at(found.x, "laboratory"), fixed)


def _fit_result(problem: Problem, at: Minimum, data: Data, onward: Model | None = None) -> Fitted:
    """A minimum, and what its model makes of the records held out."""
    problem.forget()  # most fits are only compared; what they looked at would be kept with each of them
    best = problem.model_at(at.x, "laboratory")
    held_out_residuals = tuple(_held_out_residual(piece, best) for piece in data.held_out)
    return Fitted(best, problem, at.x, at.residual, at.objective, held_out_residuals, _held_out_objective(data, held_out_residuals), onward)


def escape_local_minimum(data: Data, fitted: Fitted, iterations: int) -> Fitted:
    """Fit of the same model from the best end of a fit in which each segment has one weight, also begun with a lighter motor.

    Far from the truth nearly every block is bad, and a bad one costs its logarithm: each has valleys of its own, and the fit stays where
    some blocks are suited well, however long it goes on.  A machine with an end pulley ended so at 8 times the noise.

    Parameters
    ----------
    data : Data
        Records ready for comparison.
    fitted : Fitted
        The minimum so far.
    iterations : int
        At most, for each fit.

    Returns
    -------
    Fitted
        Another minimum, whether better or not.
    """
    ends = []
    for share in LIGHTER:
        inertia = fitted.model.parameters[INERTIA]
        begun = fitted.model.with_values({INERTIA: max(share * inertia.value, inertia.low)}, "trial")
        wide = problem_of(data, begun, block_s=STRETCH_S)
        ends.append((wide, wide.minimise(wide.start(fitted.offsets), iterations, enough=ENOUGH)))
    wide, at = min(ends, key=lambda end: end[1].objective)
    return fit(data, wide.model_at(at.x, "laboratory"), iterations, offsets=wide.offsets(at.x))


def evaluate_at(data: Data, problem: Problem, x: Array) -> Fitted:
    """A model as it is on the records at these unknowns, whatever minimum it may be near.

    Parameters
    ----------
    data : Data
        The records of the problem.
    problem : Problem
        Model, segments and free parameters.
    x : ndarray, (k,)
        Scaled unknowns.

    Returns
    -------
    Fitted
        Without a search.
    """
    residual = problem.residual(x)
    return _fit_result(problem, Minimum(x, residual, problem.objective(residual, x)), data)


def problem_of(data: Data, model: Model, fixed: Sequence[str] = (), block_s: float = BLOCK_S) -> Problem:
    """The free parameters of a model as unknowns.

    Parameters
    ----------
    data : Data
    model : Model
    fixed : sequence of str
        Parameters that are held, by full name.
    block_s : float, s
        Segments of time with one weight.
    """
    pieces = with_observers(data.fitted, [model] * len(data.fitted))
    return Problem(pieces, model, free_parameters(model, ("transmission.ratio", *fixed)), block_s)


def _held_out_residual(piece: Segment, model: Model) -> Array:
    """Whitened residual of a held-out segment, (m,); only where its carriage stuck at the start is fitted to it."""
    vector, piece = model.vector(), with_observer(piece, model)
    here = whitened_residual(piece, model, vector)
    if "cart" not in model.base_bodies or piece.observer is not None:
        return here

    def cost(offset: float) -> float:
        return float(np.sum(np.minimum(whitened_residual(piece, model, vector, offset) ** 2, OUTLIER**2)))

    near = min((APART_M * k for k in range(-SIDEWAYS, SIDEWAYS + 1)), key=cost)
    found = minimize_scalar(cost, bounds=(near - APART_M, near + APART_M), method="bounded", options={"xatol": 1e-3 * APART_M})
    return whitened_residual(piece, model, vector, found.x) if found.fun < cost(0.0) else here


def _held_out_objective(data: Data, residuals: Sequence[Array]) -> float:
    """Robust objective O of the records held out, -2 ln likelihood, by the whitened residual of each segment, (m,); 0 without any."""
    if not residuals:
        return 0.0
    blocks = time_blocks(data.held_out, BLOCK_S)
    squares = np.concatenate(residuals) ** 2
    count = np.bincount(blocks).astype(np.float64)
    means = np.bincount(blocks, squares) / np.maximum(count, 1.0)
    return float(np.sum(count * np.where(means < 1.0, means, 1.0 + np.log(np.maximum(means, 1.0)))))
