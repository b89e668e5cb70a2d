"""The final estimate: explains torque from measured motion, with friction and the belt damper inside the model, all records at once.

Minimises the whitened residual of ``beltcomm.identify.residual`` over the free parameters.  Blocks of half a second whose residual is
larger than the noise are weighted down (a likelihood with unknown scale in bad blocks), so that one disturbed stretch cannot
outvote the rest.  Intervals come from the scatter of the gradient between groups of two seconds (sandwich form), so they hold
for correlated and uneven residuals too, and they grow with the misfit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from beltcomm.errors import DataError
from beltcomm.identify.residual import Stretch, stretches, torque_noise, whitened
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
USUAL_SEARCH = 10
#: Squared whitened residual beyond which a sample has no more weight when a start offset is looked for: five deviations.
OUTLIER = 25.0
#: m; largest stretch of the belt at the start of a record: friction holds up to 0.1 mm (10 N on 100 kN/m) at rest, acceleration
#: more where the record begins in motion.
OFFSET_M = 5e-4
#: A direction of the parameter space known worse than this share of its value is called not identifiable.
UNKNOWN_SHARE = 0.2


@dataclass(frozen=True)
class InverseFit:
    """Result of the final fit.

    model : with values and 95 % intervals.   free : names of the fitted parameters.   correlation : (k, k).
    misfit : mean square of the whitened residual on fitted records, 1 = noise floor.    held_out_misfit : same on held-out ones.
    record_misfit : by record.   samples : number that counted.   noise_nm : N m rms.
    freedom : degrees of freedom of the intervals (Student).     remarks : sentences (bounds, not identifiable).
    """

    model: Model
    free: tuple[str, ...]
    correlation: Array
    covariance: Array
    misfit: float
    held_out_misfit: float | None
    record_misfit: Mapping[str, float]
    samples: int
    noise_nm: float
    freedom: int
    remarks: tuple[str, ...]

    @property
    def suspect(self) -> bool:
        """Whether so much is left unexplained that the numbers should not be trusted."""
        return self.misfit > SUSPECT_MISFIT

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations."""
        return float(student.ppf(0.975, self.freedom))


def fit_inverse(
    recordings: Sequence[Recording],
    start: Model,
    *,
    counts_per_rev: int,
    fixed: Sequence[str] = ("transmission.ratio",),
    noise_nm: float | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> InverseFit:
    """Fit all parameters of ``start`` but the ``fixed`` ones to the recordings that are not held out.

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
    solution, weights = problem.solve(problem.start(), lambda f: progress(0.4 * f), robust=False)
    better = problem.model_at(solution)
    pieces = [piece for recording in recordings for piece in stretches(recording, better, step, noise, fitted=True)]
    fitted = [piece for piece in pieces if not piece.held_out]
    groups = _labels(fitted, _check_enough(fitted, free))
    problem = _Problem(fitted, better, free)
    solution, weights = problem.solve(problem.start(), lambda f: progress(0.4 + 0.6 * f), robust=True)
    return _report(problem, solution, weights, groups, [piece for piece in pieces if piece.held_out], noise)


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
        offsets = np.full(len(pieces), OFFSET_M)
        self.scale = np.concatenate([own, offsets])
        self.low = np.concatenate([np.array([v.low for v in values]) / own, -np.ones(len(pieces))])
        self.high = np.concatenate([np.array([v.high for v in values]) / own, np.ones(len(pieces))])
        self.blocks = _labels(pieces, BLOCK_S)
        self.ends = np.cumsum([0, *(int(piece.keep.sum()) for piece in pieces)])

    def start(self) -> Array:
        x = np.zeros(len(self.scale))
        x[: len(self.free)] = self.vector[self.places] / self.scale[: len(self.free)]
        return np.asarray(np.clip(x, self.low, self.high))

    def full(self, x: Array) -> Array:
        vector = self.vector.copy()
        vector[self.places] = (x * self.scale)[: len(self.free)]
        return vector

    def model_at(self, x: Array) -> Model:
        return self.model.with_values(dict(zip(self.free, (x * self.scale)[: len(self.free)], strict=True)), "final fit")

    def one(self, i: int, x: Array) -> Array:
        return whitened(self.pieces[i], self.model, self.full(x), OFFSET_M * float(x[len(self.free) + i]))

    def residual(self, x: Array) -> Array:
        return np.concatenate([self.one(i, x) for i in range(len(self.pieces))])

    def jacobian(self, x: Array, *, central: bool = False) -> Array:
        """One-sided differences while searching, central ones for the covariance."""
        columns = np.zeros((self.ends[-1], len(x)))
        here = [self.one(i, x) for i in range(len(self.pieces))] if not central else []
        for j in range(len(x)):
            step = 1e-3 * max(abs(x[j]), 0.1)
            ahead, behind = x.copy(), x.copy()
            ahead[j] = x[j] + step if x[j] + step <= self.high[j] else x[j] - step
            behind[j] = max(x[j] - step, self.low[j]) if central and ahead[j] > x[j] else x[j]
            piece = j - len(self.free)
            touched = range(len(self.pieces)) if piece < 0 else (piece,)
            for i in touched:
                difference = self.one(i, ahead) - (self.one(i, behind) if central else here[i])
                columns[self.ends[i] : self.ends[i + 1], j] = difference / (ahead[j] - behind[j])
        return columns

    def weights(self, x: Array) -> Array:
        squares = self.residual(x) ** 2
        count = np.bincount(self.blocks)
        mean = np.bincount(self.blocks, squares) / np.maximum(count, 1)
        return np.asarray((1.0 / np.sqrt(np.maximum(1.0, mean)))[self.blocks])

    def minimised(self, x: Array, weights: Array, progress: Callable[[float], None]) -> Array:
        """Levenberg-Marquardt on the normal equations with fixed weights; unknowns that push against a bound are held there.

        Some 30 000 residuals stand against a dozen unknowns, so a step costs little beside the residuals themselves.
        """
        damping, residual = 1e-3, self.residual(x) * weights
        for number in range(1, LONGEST_SEARCH + 1):
            progress(number / (number + USUAL_SEARCH))
            jacobian = self.jacobian(x) * weights[:, None]
            gradient, information = jacobian.T @ residual, jacobian.T @ jacobian
            held = ((x <= self.low) & (gradient > 0.0)) | ((x >= self.high) & (gradient < 0.0))
            move = np.flatnonzero(~held & (np.diag(information) > 0.0))
            while True:
                system = information[np.ix_(move, move)] + damping * np.diag(np.diag(information)[move])
                trial = x.copy()
                trial[move] = np.clip(x[move] - np.linalg.solve(system, gradient[move]), self.low[move], self.high[move])
                ahead = self.residual(trial) * weights
                gain = float(residual @ residual - ahead @ ahead)
                if gain > 0.0 or damping > 1e8:
                    break
                damping *= 10.0
            if not gain > 0.0:
                return x
            step = float(np.max(np.abs(trial - x)))
            x, residual, damping = trial, ahead, max(damping / 10.0, 1e-9)
            if gain < 1e-7 * float(residual @ residual) or step < 1e-6:
                return x
        return x

    def solve(self, x: Array, progress: Callable[[float], None], *, robust: bool) -> tuple[Array, Array]:
        """Least squares, then reweighted by blocks until the weights settle, three rounds at most.

        The first round has equal weights: far from the solution all blocks are bad, and weighting them down would leave the search
        without a slope.
        """
        weights = np.ones(self.ends[-1])
        rounds = 4 if robust else 1
        for number in range(rounds):

            def within(share: float, number: int = number) -> None:  # every round is about half as long as the one before
                progress(1.0 - 0.5 ** (number + share) if robust else share)

            found = self.minimised(x, weights, within)
            if not np.all(np.isfinite(found)):
                raise DataError("the final fit did not converge; compare the recordings with the axis file (units, signs, feed constant)")
            moved = float(np.max(np.abs(found - x)))
            x = found
            weights = self.weights(x) if robust else weights
            if number > 0 and moved < 1e-4:
                break
        progress(1.0)
        return x, weights


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


def _report(problem: _Problem, x: Array, weights: Array, groups: NDArray[np.int64], held_out: list[Stretch], noise: float) -> InverseFit:
    residual = problem.residual(x)
    covariance, freedom = _covariance(problem, x, residual * weights, weights, groups)
    own = len(problem.free)
    deviation = np.sqrt(np.diag(covariance))[:own]
    half = deviation * problem.scale[:own] * float(student.ppf(0.975, freedom))
    model = problem.model_at(x)
    remarks = []
    parameters = dict(model.parameters)
    for i, name in enumerate(problem.free):
        item = parameters[name]
        if deviation[i] == 0.0:
            side = "lower" if x[i] <= problem.low[i] + 1e-6 else "upper"
            remarks.append(f"{name} sits at its {side} bound {item.value:g} {item.unit}: not determined by this data")
            continue
        parameters[name] = replace(item, interval=float(half[i]))
        if half[i] > UNKNOWN_SHARE * abs(item.value):
            remarks.append(f"{name} = {item.value:.3g} ± {half[i]:.2g} {item.unit} is not identifiable from this data")
    misfit = float(np.mean(residual**2))
    if misfit > SUSPECT_MISFIT:
        remarks.append(
            f"the model leaves {np.sqrt(misfit):.1f} times the noise unexplained: something it does not know acts on this axis, or a "
            "record is disturbed; its numbers may be off by more than their intervals"
        )
    spread = np.where(deviation > 0, deviation, 1.0)
    correlation = covariance[:own, :own] / np.outer(spread, spread)
    remarks += _correlated(problem.free, correlation)
    squares: dict[str, list[Array]] = {}
    for i, piece in enumerate(problem.pieces):
        squares.setdefault(piece.record, []).append(problem.one(i, x) ** 2)
    away = [_judged(piece, problem.model, problem.full(x)) for piece in held_out]
    for piece, part in zip(held_out, away, strict=True):
        squares.setdefault(piece.record, []).append(part)
    everything = np.concatenate(away) if away else np.zeros(0)
    return InverseFit(
        model=replace(model, parameters=parameters),
        free=problem.free,
        correlation=correlation,
        covariance=covariance[:own, :own] * np.outer(problem.scale[:own], problem.scale[:own]),
        misfit=misfit,
        held_out_misfit=float(np.mean(everything)) if len(everything) else None,
        record_misfit={name: float(np.mean(np.concatenate(parts))) for name, parts in squares.items() if sum(map(len, parts))},
        samples=len(residual),
        noise_nm=noise,
        freedom=freedom,
        remarks=tuple(remarks),
    )


def _judged(piece: Stretch, model: Model, vector: Array) -> Array:
    """Squared whitened residual of a held-out stretch; only where its carriage stuck at the start is fitted to it."""

    def cost(offset_m: float) -> float:
        return float(np.sum(np.minimum(whitened(piece, model, vector, offset_m) ** 2, OUTLIER)))

    best = minimize_scalar(cost, bounds=(-OFFSET_M, OFFSET_M), method="bounded", options={"xatol": 1e-7})
    return whitened(piece, model, vector, float(best.x)) ** 2


def _covariance(problem: _Problem, x: Array, weighted: Array, weights: Array, groups: NDArray[np.int64]) -> tuple[Array, int]:
    """Covariance of the scaled unknowns in sandwich form, zero for those at a bound, and its degrees of freedom."""
    jacobian = problem.jacobian(x, central=True) * weights[:, None]
    inside = np.flatnonzero((x > problem.low + 1e-6) & (x < problem.high - 1e-6))
    reduced = jacobian[:, inside]
    inverse = np.linalg.pinv(reduced.T @ reduced)
    number = int(groups.max()) + 1
    gradient = np.stack([np.bincount(groups, reduced[:, i] * weighted, number) for i in range(len(inside))], axis=1)
    freedom = max(number - len(problem.free), 1)
    sandwich = inverse @ (gradient.T @ gradient) @ inverse * number / freedom
    # The scatter between few groups can by chance fall below what the noise alone gives: never report less than that.
    plain = inverse * max(float(np.mean(weighted**2)), 1.0)
    floor = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(inside, inside)] = sandwich * np.outer(floor, floor)
    return covariance, freedom


def _correlated(names: tuple[str, ...], correlation: Array) -> list[str]:
    found = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            if abs(correlation[i, j]) > 0.95:
                found.append(f"{names[i]} and {names[j]} are told apart badly (correlation {correlation[i, j]:+.2f})")
    return found
