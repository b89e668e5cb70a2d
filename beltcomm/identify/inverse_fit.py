"""The final estimate: explains torque from measured motion, with friction and the belt damper inside the model, all records at once.

Minimises the whitened residual of ``beltcomm.fit.segment`` over the free parameters.  Blocks of half a second whose residual is
larger than the noise are weighted down (a likelihood with unknown scale in bad blocks), so that one disturbed stretch cannot
outvote the rest.  Intervals come from the scatter of the gradient between groups of two seconds (sandwich form), so they hold
for correlated and uneven residuals too, and they grow with the misfit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from beltcomm.errors import DataError
from beltcomm.identify.bounded_step import bounded_step
from beltcomm.fit.noise_level import torque_noise
from beltcomm.fit.segment import Stretch, squares_left, stretches, whitened, whitened_beside
from beltcomm.fit.reversals import turns_at_once
from beltcomm.fit.remarks import remark_on, remark_on_rounding, remarks_on_pairs, sandwich
from beltcomm.model import Model, expected_parameters
from beltcomm.recording import Recording

Array = NDArray[np.float64]

#: s; blocks with one weight.  Longer than the resonance rings, shorter than a stroke.
BLOCK_S = 0.5
#: s; groups between which the gradient is independent: longer than the carriage rings at its antiresonance.
GROUP_S = 2.0
#: A short record is cut into shorter groups, so that there are this many more than parameters; its intervals are then too narrow
#: by what neighbouring groups share, and below the shortest group none are given.
FEWEST_GROUPS = 12
SHORTEST_GROUP_S = 0.2
FEWEST_SAMPLES = 50
#: Mean square of the whitened residual above which a fit is called suspect; healthy virtual axes lie between 0.9 and 1.1.
SUSPECT_MISFIT = 1.5
#: Iterations of one search; from the grid's start values it takes five to ten.
LONGEST_SEARCH = 40
#: Fall of the objective (minus twice the log likelihood) that is not worth a further step: a tenth of a standard deviation; and
#: the one below which a failed step is not tried again in smaller ones.
SMALLEST_GAIN = 0.01
ROUGH = 1.0
#: Parameters that are 0 until the data speak for them, and by how much the objective must fall for them: two deviations.
DOUBTFUL = ("viscous_cart.damping",)
WORTH_HAVING = 4.0
#: Mean square of the whitened residual in samples with a reversal, over that of the others, up to which they count; and standard
#: deviations by which they may move a mass or a stiffness: twice a 95 % interval, of two estimates of which one is up to twice as wide.
REVERSAL_MISFIT = 1.15
MOST_MOVED = 4.0
#: What they may move as they see it, for it is them that tell it.
RUBBING = ("coulomb.", "cart_friction.", "viscous")
#: What the intervals allow for: the encoder's rounding is white noise only roughly, its step counts as if it were this much larger.
ROUNDING_DOUBT = 2.0**0.5
#: Share of what rounding moves an unknown by, squared, below which its variance is none.
LEAST_SCATTER = 1e-12


@dataclass(frozen=True)
class InverseFit:
    """Result of the final fit.

    model : with values and 95 % intervals.   free : names of the fitted parameters.   correlation : (k, k).
    misfit : mean square of the whitened residual on fitted records, 1 = noise floor.    held_out_misfit : same on held-out ones.
    objective : minus twice the log likelihood, block-robust: what models of the same samples are compared by.
    record_misfit : by record.   samples : number that counted.   noise_nm : N m rms.
    freedom : degrees of freedom of the intervals (Student).     remarks : sentences (bounds, what is known badly and why).
    reversals : whether samples in which the motor passes through a reversal counted.
    """

    model: Model
    free: tuple[str, ...]
    correlation: Array
    covariance: Array
    misfit: float
    objective: float
    held_out_misfit: float | None
    record_misfit: Mapping[str, float]
    samples: int
    noise_nm: float
    freedom: int
    remarks: tuple[str, ...]
    reversals: bool = False

    @property
    def suspect(self) -> bool:
        """Whether so much is left unexplained that the numbers should not be trusted."""
        return self.misfit > SUSPECT_MISFIT

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations."""
        return float(stdtrit(self.freedom, 0.975))


def fit_inverse(
    recordings: Sequence[Recording],
    start: Model,
    *,
    counts_per_rev: int,
    fixed: Sequence[str] = ("transmission.ratio",),
    noise_nm: float | None = None,
    reversals: bool | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> InverseFit:
    """Fit all parameters of ``start`` but the ``fixed`` ones to the recordings that are not held out.

    reversals : whether samples in which the motor passes through a reversal count too; None: where friction is seen to turn round at once.
    Raises DataError when too few samples are left or the fit does not converge to finite values.
    """
    noise = torque_noise([r for r in recordings if not r.sidecar.held_out]) if noise_nm is None else noise_nm
    step = 2.0 * np.pi / counts_per_rev
    pieces = [piece for recording in recordings for piece in stretches(recording, start, step, noise)]
    fitted = [piece for piece in pieces if not piece.held_out]
    free = tuple(name for name in start.parameters if name not in fixed and start.parameters[name].low < start.parameters[name].high)
    _check_enough(fitted, free)
    # The motion between samples is reconstructed with the inertia and the load at hand, so the fit is run twice.
    problem = _Problem(fitted, start, free)
    # Far from the solution all blocks are bad, and weighting them down would leave the search without a slope.
    solution, _ = problem.minimised(problem.start(), robust=False, progress=lambda f: progress(0.4 * f))
    better = problem.model_at(solution)
    pieces = _pieces(recordings, better, step, noise)
    group_s = _check_enough(_to_fit(pieces), free)
    problem = _Problem(_to_fit(pieces), better, free)
    solution, objective = _settled(problem, lambda f: progress(0.4 + 0.3 * f))
    through = None if reversals is False else _with_reversals(recordings, problem, solution, step, noise, anyway=reversals is True)
    if through is not None:
        pieces, problem, solution, objective = through
    progress(1.0)
    groups = _labels(problem.pieces, group_s)
    found = _report(problem, solution, objective, groups, [piece for piece in pieces if piece.held_out], noise)
    return replace(found, reversals=through is not None)


def _pieces(recordings: Sequence[Recording], model: Model, step_rad: float, noise_nm: float, *, reversals: bool = False) -> list[Stretch]:
    found = [stretches(recording, model, step_rad, noise_nm, fitted=True, reversals=reversals) for recording in recordings]
    return [piece for pieces in found for piece in pieces]


def _to_fit(pieces: Sequence[Stretch]) -> list[Stretch]:
    return [piece for piece in pieces if not piece.held_out]


def _settled(problem: _Problem, progress: Callable[[float], None] = lambda _fraction: None) -> tuple[Array, float]:
    """Minimum of the problem, doubtful parameters left out where they bring too little; unknowns and O."""
    solution, objective = problem.minimised(problem.start(), robust=True, progress=progress)
    for i, name in enumerate(problem.free):
        if name in DOUBTFUL and solution[i] > problem.low[i]:
            without, higher = problem.minimised(np.where(np.arange(len(solution)) == i, problem.low, solution), robust=True, fixed=(i,))
            if higher - objective < WORTH_HAVING:
                solution, objective = without, higher
    return solution, objective


def _with_reversals(
    recordings: Sequence[Recording], problem: _Problem, solution: Array, step_rad: float, noise_nm: float, *, anyway: bool
) -> tuple[list[Stretch], _Problem, Array, float] | None:
    """The fit with the samples in which the motor passes through a reversal; None where these do not fit to the others, but ``anyway``.

    Friction that needs a way to turn round, or is higher at low speed, is seen there first and would pull at all parameters.
    """
    model = problem.model_at(solution)
    if not turns_at_once(model):
        return None
    pieces = _pieces(recordings, model, step_rad, noise_nm, reversals=True)
    more = _Problem(_to_fit(pieces), model, problem.free)
    found, objective = _settled(more)
    added = np.concatenate([(a.keep & ~b.keep)[a.keep] for a, b in zip(more.pieces, problem.pieces, strict=True)])
    if anyway:
        return pieces, more, found, objective
    squares = more.residual(found) ** 2
    if not added.any() or float(np.mean(squares[added])) > REVERSAL_MISFIT * max(1.0, float(np.mean(squares[~added]))):
        return None
    jacobian = more.jacobian(found) * more.judged(np.sqrt(squares))[1][:, None]
    own = len(problem.free)
    told = np.array([not name.startswith(RUBBING) for name in problem.free])
    counted = np.flatnonzero(np.any(jacobian != 0.0, axis=0))
    deviation = np.zeros(len(found))
    variance = np.diag(np.linalg.pinv(jacobian[:, counted].T @ jacobian[:, counted]))
    deviation[counted] = np.sqrt(np.maximum(variance, 0.0))  # of data that tell nothing rounding makes it negative
    before = problem.full(solution)[problem.places] / more.scale[:own]
    moved = np.abs(found[:own] - before) > MOST_MOVED * deviation[:own]
    return None if np.any(moved & told & (deviation[:own] > 0.0)) else (pieces, more, found, objective)


def _check_enough(pieces: Sequence[Stretch], free: Sequence[str]) -> float:
    """Length of the groups, s.   Raises DataError when too few samples move, with the seconds that are needed."""
    samples = sum(int(piece.keep.sum()) for piece in pieces)
    span = sum(piece.motion.samples * piece.motion.sample_s for piece in pieces)
    group_s = min(GROUP_S, span / (len(free) + FEWEST_GROUPS))
    if samples < FEWEST_SAMPLES * len(free) or group_s < SHORTEST_GROUP_S:
        raise DataError(
            f"only {samples} moving samples in {span:.1f} s are usable for {len(free)} parameters; record at least "
            f"{SHORTEST_GROUP_S * (len(free) + FEWEST_GROUPS):.0f} s in which the axis keeps moving"
        )
    return group_s


class _Problem:
    """The whitened residual as a function of scaled unknowns: the free parameters, then one start offset per stretch."""

    def __init__(self, pieces: list[Stretch], model: Model, free: tuple[str, ...]) -> None:
        self.pieces, self.model, self.free = pieces, model, free
        self.vector = model.vector()
        self.places = [model.index(name) for name in free]
        values = [model.parameters[name] for name in free]
        # A start value of nearly nothing (no damping found at first) must not become the unit of its parameter.
        usual = expected_parameters(model.effects, model.base_bodies)
        own = np.array([max(abs(v.value), 0.1 * abs(usual[n].start), 1e-9) for n, v in zip(free, values, strict=True)])
        offsets = np.array([piece.offset_m for piece in pieces])
        self.scale = np.concatenate([own, offsets])
        self.low = np.concatenate([np.array([v.low for v in values]) / own, -np.ones(len(pieces))])
        self.high = np.concatenate([np.array([v.high for v in values]) / own, np.ones(len(pieces))])
        self.blocks = _labels(pieces, BLOCK_S)
        self.ends = np.cumsum([0, *(int(piece.keep.sum()) for piece in pieces)])
        # What was worked out last of each piece: the search asks for it again.
        self.last: dict[int, tuple[tuple[bytes, float], Array]] = {}

    def start(self) -> Array:
        x = np.zeros(len(self.scale))
        x[: len(self.free)] = self.vector[self.places] / self.scale[: len(self.free)]
        return np.asarray(np.clip(x, self.low, self.high))

    def full(self, x: Array) -> Array:
        vector = self.vector.copy()
        vector[self.places] = (x * self.scale)[: len(self.free)]
        return vector

    def model_at(self, x: Array) -> Model:
        bounds = [self.model.parameters[name] for name in self.free]
        low, high = [v.low for v in bounds], [v.high for v in bounds]  # scaling and back may miss a bound by a rounding
        values = np.clip((x * self.scale)[: len(self.free)], low, high)
        return self.model.with_values(dict(zip(self.free, values.tolist(), strict=True)), "final fit")

    def offset(self, i: int, x: Array) -> float:
        return self.pieces[i].offset_m * float(x[len(self.free) + i])

    def one(self, i: int, x: Array) -> Array:
        key = (x[: len(self.free)].tobytes(), self.offset(i, x))
        if self.last.get(i, (None,))[0] != key:
            self.last[i] = (key, whitened(self.pieces[i], self.model, self.full(x), key[1]))
        return self.last[i][1]

    def residual(self, x: Array) -> Array:
        return np.concatenate([self.one(i, x) for i in range(len(self.pieces))])

    def jacobian(self, x: Array, *, central: bool = False) -> Array:
        """One-sided differences while searching, central ones for the covariance; the unknowns of a piece side by side."""
        columns, own = np.zeros((self.ends[-1], len(x))), len(self.free)
        ahead, behind = np.tile(x, (len(x), 1)), np.tile(x, (len(x), 1))
        for j in range(len(x)):
            step = 1e-3 * max(abs(x[j]), 0.1)
            ahead[j, j] = x[j] + step if x[j] + step <= self.high[j] else x[j] - step
            behind[j, j] = max(x[j] - step, self.low[j]) if central and ahead[j, j] > x[j] else x[j]
        steps = np.diag(ahead) - np.diag(behind)
        for i, piece in enumerate(self.pieces):
            touching = [*range(own), own + i]
            places = [*ahead[touching], *(behind[touching] if central else ())]
            found = whitened_beside(piece, self.model, [self.full(at) for at in places], [self.offset(i, at) for at in places])
            here = found[:, len(touching) :] if central else self.one(i, x)[:, None]
            columns[self.ends[i] : self.ends[i + 1], touching] = (found[:, : len(touching)] - here) / steps[touching]
        return columns

    def with_coarser_encoder(self, factor: float) -> _Problem:
        """The same recordings, believed to come from an encoder with larger steps."""
        return _Problem([replace(piece, step_rad=factor * piece.step_rad) for piece in self.pieces], self.model, self.free)

    def judged(self, residual: Array, *, robust: bool = True) -> tuple[float, Array]:
        """Objective and the weight of every sample:  O = sum n φ(c),  c = mean square of a block of n samples, weights² = φ'.

        φ = c up to 1 and 1 + ln c above: minus twice the log likelihood where the noise of a bad block is not known.  Not robust: φ = c.
        """
        if not robust:
            return float(residual @ residual), np.ones(len(residual))
        count = np.bincount(self.blocks)
        mean = np.bincount(self.blocks, residual**2) / np.maximum(count, 1)
        bad = np.maximum(mean, 1.0)
        return float(count @ (np.minimum(mean, 1.0) + np.log(bad))), np.asarray((1.0 / np.sqrt(bad))[self.blocks])

    def minimised(
        self, x: Array, *, robust: bool, fixed: Sequence[int] = (), progress: Callable[[float], None] = lambda _fraction: None
    ) -> tuple[Array, float]:
        """Levenberg-Marquardt on the normal equations; unknowns that push against a bound are held there.   Returns x and O.

        Some 30 000 residuals stand against a dozen unknowns, so a step costs little beside the residuals themselves.
        Raises DataError when the search does not stay finite.
        """
        damping, residual = 1e-3, self.residual(x)
        value, weights = self.judged(residual, robust=robust)
        for number in range(LONGEST_SEARCH):
            jacobian = self.jacobian(x) * weights[:, None]
            gradient, information = jacobian.T @ (residual * weights), jacobian.T @ jacobian
            if not (np.isfinite(value) and np.all(np.isfinite(information))):
                raise DataError("the final fit did not converge; compare the recordings with the axis file (units, signs, feed constant)")
            held = ((x <= self.low) & (gradient > 0.0)) | ((x >= self.high) & (gradient < 0.0))
            held[list(fixed)] = True
            move = ~held & (np.diag(information) > 0.0)
            enough = SMALLEST_GAIN * max(1.0, value / len(residual))
            gain = 0.0
            while gain <= 0.0:
                damped = information + damping * np.diag(np.diag(information))
                step = bounded_step(damped, gradient, move, self.low - x, self.high - x)
                trial = np.clip(x + step, self.low, self.high)
                expected = -float(2.0 * gradient @ step + step @ information @ step)
                if expected < enough:
                    return x, value
                ahead = self.residual(trial)
                trial_value, trial_weights = self.judged(ahead, robust=robust)
                gain = value - trial_value if np.isfinite(trial_value) else -np.inf  # a step to where the load runs away is too long
                if gain <= 0.0 and expected < ROUGH:
                    return x, value  # where the carriage sticks makes the objective a little rough
                damping = max(damping / 10.0, 1e-9) if gain > 0.0 else 10.0 * damping
            x, residual, value, weights = trial, ahead, trial_value, trial_weights
            progress((number + 1.0) / (number + 3.0))
            if gain < enough:
                break
        return x, value


def _labels(pieces: Sequence[Stretch], seconds: float) -> NDArray[np.int64]:
    """Running number of the time block of every kept sample, blocks never crossing a stretch."""
    labels, first = [], 0
    for piece in pieces:
        block = np.flatnonzero(piece.keep) // max(int(seconds / piece.motion.sample_s), 1)
        labels.append(block + first)
        first += piece.motion.samples
    if not labels:
        return np.zeros(0, dtype=np.int64)
    return np.unique(np.concatenate(labels), return_inverse=True)[1].astype(np.int64)


def _report(problem: _Problem, x: Array, objective: float, groups: NDArray[np.int64], held_out: list[Stretch], noise: float) -> InverseFit:
    residual = problem.residual(x)
    _, weights = problem.judged(residual)
    own = len(problem.free)
    at_bound = (x <= problem.low + 1e-6) | (x >= problem.high - 1e-6)
    jacobian = problem.jacobian(x, central=True) * weights[:, None]
    # A parameter at its bound may as well be a little off it, and the intervals of the others must bear that; where the carriage
    # stuck is only of interest inside its bounds.
    counted = np.flatnonzero(np.any(jacobian != 0.0, axis=0) & ~(at_bound & (np.arange(len(x)) >= own)))
    reduced = jacobian[:, counted]
    scatter, freedom = sandwich(reduced, residual * weights, groups, own)
    newton = -np.linalg.pinv(reduced) @ (residual * weights)
    coarser = problem.with_coarser_encoder(ROUNDING_DOUBT)
    moved = -np.linalg.pinv(coarser.jacobian(x)[:, counted] * weights[:, None]) @ (coarser.residual(x) * weights) - newton
    quantile = float(stdtrit(freedom, 0.975))
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(counted, counted)] = scatter + np.outer(moved, moved) / quantile**2
    covariance = covariance[:own, :own] * np.outer(problem.scale[:own], problem.scale[:own])
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    wanted, widened = np.array(x), np.ones(len(x))
    wanted[counted] += newton
    widened[counted] = np.sqrt(1.0 + (moved / quantile) ** 2 / np.maximum(np.diag(scatter), LEAST_SCATTER * (moved / quantile) ** 2))
    model = problem.model_at(x)
    parameters = dict(model.parameters)
    for i, name in enumerate(problem.free):
        if deviation[i] > 0.0 and not at_bound[i]:
            parameters[name] = replace(parameters[name], interval=quantile * float(deviation[i]))
    remarks = [remark_on(n, parameters[n], float(wanted[i] * problem.scale[i]), float(deviation[i])) for i, n in enumerate(problem.free)]
    remarks.append(remark_on_rounding(problem.free, widened[:own]))
    misfit = float(np.mean(residual**2))
    if misfit > SUSPECT_MISFIT:
        remarks.append(
            f"the model leaves {np.sqrt(misfit):.1f} times the noise unexplained: something it does not know acts on this axis, or a "
            "record is disturbed; its numbers may be off by more than their intervals"
        )
    spread = np.where(deviation > 0, deviation, 1.0)
    correlation = covariance / np.outer(spread, spread)
    remarks += remarks_on_pairs(problem.free, [parameters[name] for name in problem.free], correlation)
    squares: dict[str, list[Array]] = {}
    for i, piece in enumerate(problem.pieces):
        squares.setdefault(piece.record, []).append(problem.one(i, x) ** 2)
    away = [squares_left(piece, problem.model, problem.full(x)) for piece in held_out]
    for piece, part in zip(held_out, away, strict=True):
        squares.setdefault(piece.record, []).append(part)
    everything = np.concatenate(away) if away else np.zeros(0)
    return InverseFit(
        model=replace(model, parameters=parameters),
        free=problem.free,
        correlation=correlation,
        covariance=covariance,
        misfit=misfit,
        objective=objective,
        held_out_misfit=float(np.mean(everything)) if len(everything) else None,
        record_misfit={name: float(np.mean(np.concatenate(parts))) for name, parts in squares.items() if sum(map(len, parts))},
        samples=len(residual),
        noise_nm=noise,
        freedom=freedom,
        remarks=tuple(remark for remark in remarks if remark),
    )
