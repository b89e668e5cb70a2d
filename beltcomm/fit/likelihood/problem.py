"""The inverse fit as a problem: whitened residual as a function of scaled unknowns, its block-robust objective and its minimum.

    O = Σ_b n_b φ(c_b - v(x) + v(x₀)),   φ(c) = c for c < 1,  1 + ln c above,   c_b : mean square of the whitened residual in block b

It is the likelihood with unknown scale in bad blocks: a disturbed segment costs what its length is worth and no more.  v is what rounding
alone adds to a block (``residual.rounding_bias``): it is no reason to prefer a lighter motor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import in_one_thread
from beltcomm.fit.likelihood.arrowhead import ArrowheadJacobian
from beltcomm.fit.likelihood.free_parameters import Touch, part_touched, touches_noise
from beltcomm.fit.residual.observer import Perturbation, slopes
from beltcomm.fit.residual.reversals import LEVEL
from beltcomm.fit.residual.rounding_bias import RoundingBias
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import in_noise, observed_residuals, with_observers
from beltcomm.model import Model, expected_parameters
from beltcomm.model.mounted import loaded
from beltcomm.simulate.inverse import (
    FineMotion,
    Lags,
    acting_torque,
    as_read,
    belt_load,
    belt_loads,
    motor_load,
    reading_lags,
    true_motion,
)

#: m; unit of the stretch of the belt at the start of a record, and the largest: friction holds up to 0.1 mm (10 N on 100 kN/m) at rest,
#: acceleration more where the record begins in motion.
OFFSET_M = 5e-4
#: Unit of a parameter that begins at zero and usually does, as a share of the room between its bounds; least unit of any.
ZERO_SHARE, LEAST_UNIT = 1e-3, 1e-9
#: Mean square of a block, rounding taken off, below which less is no better: then it was not as much as it was taken for.
LEAST_MEAN = 0.25
#: How much faster than in its last iteration a search may still get on.
PACE = 3.0


@dataclass(frozen=True)
class Parts:
    """The torque balance of one segment, N m, (n,) each:  residual = inertia + motor + belt, as read, - acting.

    Attributes
    ----------
    motion : FineMotion
        True.
    lags : Lags
        Of the torque's reading.
    """

    inertia: Array
    motor: Array
    belt: Array
    acting: Array

    motion: FineMotion
    lags: Lags = ()

    @property
    def residual(self) -> Array:
        """Residual, N m, (n,)."""
        return as_read(self.inertia + self.motor + self.belt, float(self.acting[1]), self.motion.sample_s, self.lags) - self.acting


@dataclass(frozen=True)
class Nuisance:
    """Quantities from elsewhere, not quite known: change of the whitened residual with each, (n, k), 1/variance, (k, k), and whether the
    records tell it too, (k,)."""

    columns: Array
    information: Array
    told: BoolArray


@dataclass(frozen=True)
class Minimum:
    """End of a search.

    Attributes
    ----------
    x : ndarray
        Scaled unknowns.
    residual : ndarray
        Whitened, (n,).
    objective : float
        O.
    """

    x: Array
    residual: Array
    objective: float


class Problem:
    """Unknowns are the free parameters, then one start offset of the carriage per segment."""

    def __init__(self, pieces: Sequence[Segment], model: Model, free: Sequence[str], block_s: float) -> None:
        self._bare = False
        self._pieces, self.model, self.free = list(pieces), model, tuple(free)
        self.vector = model.vector()
        self.places = [model.index(name) for name in free]
        values = [model.parameters[name] for name in free]
        # A start value of nearly nothing (no damping found at first) must not become the unit of its parameter.
        usual = expected_parameters(model.effects, model.base_bodies, model.side)
        units = [max(abs(v.value), 0.1 * abs(usual[n].start)) or ZERO_SHARE * (v.high - v.low) for n, v in zip(free, values, strict=True)]
        own = np.maximum(units, LEAST_UNIT)
        self.movable = "cart" in model.base_bodies
        offsets = np.full(len(self.pieces) if self.movable else 0, OFFSET_M)
        self.scale = np.concatenate([own, offsets])
        # No further than the friction of a carriage holds it, where one is known: beyond, where it sticks next is chance.
        held = np.array([min(piece.offset_m / OFFSET_M, 1.0) or 1.0 for piece in self._pieces]) if self.movable else offsets
        self.low = np.concatenate([np.array([v.low for v in values]) / own, -held])
        self.high = np.concatenate([np.array([v.high for v in values]) / own, held])
        self.touches = [part_touched(model, name) for name in self.free]
        self.touches_noise = [touches_noise(model, name) for name in self.free]
        self.ends = np.cumsum([0, *(len(piece.value_samples) for piece in self.pieces)])
        self.blocks = time_blocks(self.pieces, block_s)
        self.count = np.bincount(self.blocks).astype(np.float64)
        owners = np.repeat(np.arange(len(self._pieces)), [len(piece.value_samples) for piece in self._pieces])
        self.piece_of_block = np.zeros(len(self.count), dtype=np.intp)
        self.piece_of_block[self.blocks] = owners
        self.nuisance: Nuisance | None = None
        # What was worked out last of each piece: the search asks for it again.
        self.last: dict[int, tuple[tuple[bytes, float], Parts]] = {}
        self.seen: tuple[bytes, list[Array]] = (b"", [])

    @cached_property
    def bias(self) -> RoundingBias:
        """Expected share of the squares that the encoder's rounding adds, against the values of ``model``."""
        return RoundingBias(self._pieces, self.model)

    @property
    def pieces(self) -> list[Segment]:
        """The segments, each with the observer of its own where the model needs one."""
        if self._bare:
            self._pieces, self._bare = with_observers(self._pieces, [self.model] * len(self._pieces)), False
        return self._pieces

    def forget(self) -> None:
        """Give back the memory of what was worked out last, and of observers, which must be those of ``model``, until they are needed."""
        self.last.clear()
        self.seen = (b"", [])
        self._bare |= any(piece.observer is not None for piece in self._pieces)
        self._pieces = [replace(piece, observer=None) for piece in self._pieces]
        for piece in self._pieces:
            piece.motion.forget()

    @property
    def samples(self) -> int:
        """Number of residuals."""
        return int(self.ends[-1])

    def start(self, offsets: Array | None = None, model: Model | None = None) -> Array:
        """The unknowns at a model's values, those of the problem's own without one, within the bounds; start offsets, scaled, are 0
        without.
        """
        x = np.zeros(len(self.scale))
        x[: len(self.free)] = (self.vector if model is None else model.vector())[self.places] / self.scale[: len(self.free)]
        if offsets is not None and self.movable:
            x[len(self.free) :] = offsets
        return np.asarray(np.clip(x, self.low, self.high))

    def offsets(self, x: Array) -> Array:
        """The scaled start offsets among the unknowns, (segments,); empty where nothing moves at the start."""
        return x[len(self.free) :]

    def full(self, x: Array) -> Array:
        """The parameter vector of the model at the scaled unknowns, (k,), in the units of the model."""
        vector = self.vector.copy()
        vector[self.places] = (x * self.scale)[: len(self.free)]
        return vector

    def model_at(self, x: Array, origin: str) -> Model:
        """The model with the free parameters at the scaled unknowns, without intervals of these; ``origin`` is noted with the values."""
        values = (x * self.scale)[: len(self.free)]
        # Scaling and back may miss a bound by a rounding.
        bounds = [self.model.parameters[name] for name in self.free]
        inside = np.clip(values, [b.low for b in bounds], [b.high for b in bounds]) if len(bounds) else values
        return self.model.with_values(dict(zip(self.free, inside, strict=True)), origin)

    def _one(self, i: int, x: Array) -> Array:
        """Whitened residual of piece i."""
        if self.pieces[i].observer is not None:
            return self._observed_residuals(x)[i]
        offset = OFFSET_M * float(x[len(self.free) + i]) if self.movable else 0.0
        key = (x[: len(self.free)].tobytes(), offset)
        parts = self.balance(i, x, offset)
        self.last[i] = (key, parts)
        return in_noise(self.pieces[i], self.model, self.full(x), parts.residual)

    def _observed_residuals(self, x: Array) -> list[Array]:
        """Whitened residuals of all pieces, which have observers."""
        key = x[: len(self.free)].tobytes()
        if not self.seen[1] or self.seen[0] != key:
            self.seen = (key, observed_residuals(self.pieces, self.model, [self.full(x)] * len(self.pieces)))
        return self.seen[1]

    def balance(self, i: int, x: Array, offset_m: float) -> Parts:
        """The torque balance of piece i, its carriage moved by ``offset_m`` against its record; asked for it again, the same object."""
        key, parts = self.last.get(i, (None, None))
        if parts is not None and key == (x[: len(self.free)].tobytes(), offset_m):
            return parts
        piece, vector = self.pieces[i], self.full(x)
        motion = true_motion(self.model, piece.motion, vector)
        observed = piece.observer is not None  # then the belt's part is only known sample by sample, see ``_one``
        return Parts(
            self._inertia_of(motion, vector),
            self._motor_of(piece, motion, vector),
            np.zeros(motion.samples) if observed else belt_load(self.model, motion, vector, offset_m),
            acting_torque(self.model, motion, piece.torque, vector),
            motion,
            reading_lags(self.model, vector),
        )

    def _motor_of(self, piece: Segment, motion: FineMotion, vector: Array) -> Array:
        """Torque that the effects of the motor alone take, N m, (n,)."""
        load = motor_load(self.model, motion, vector)
        return load if piece.turns is None else load + vector[self.model.index(LEVEL)] * piece.turns

    def _inertia_of(self, motion: FineMotion, vector: Array) -> Array:
        """Torque that the motor's inertia takes, N m, (n,)."""
        inertia = np.zeros(motion.samples)
        inertia[1:-1] = (
            self.model.driven_inertia(loaded(self.model, vector, motion.mounted))
            * np.diff(motion.theta[:: motion.substeps], 2)
            / motion.sample_s**2
        )
        return inertia

    def _neighbour(self, i: int, x: Array, offset_m: float, old: Parts, touch: Touch) -> Parts:
        """The torque balance of piece i at neighbouring unknowns; parts that are not touched are taken from ``old``."""
        vector, motion = self.full(x), old.motion
        if touch == "inertia":
            return replace(old, inertia=self._inertia_of(motion, vector))
        if touch == "motor":
            return replace(old, motor=self._motor_of(self.pieces[i], motion, vector))
        if touch == "path":
            acting = acting_torque(self.model, motion, self.pieces[i].torque, vector)
            return replace(old, acting=acting, lags=reading_lags(self.model, vector))
        return self.balance(i, x, offset_m)

    def residual(self, x: Array) -> Array:
        """Whitened residual of all pieces, one after the other, (n,), at the scaled unknowns."""
        return np.concatenate([self._one(i, x) for i in range(len(self.pieces))])

    def jacobian(self, x: Array, only: Sequence[int] | None = None) -> ArrowheadJacobian:
        """Jacobian of the whitened residual, (n, unknowns), by one-sided differences; columns of unknowns other than ``only`` stay 0."""
        own = len(self.free)
        columns = np.zeros((self.samples, own + 1))
        offsets = OFFSET_M * x[own:] if self.movable else np.zeros(len(self.pieces))
        asked = set(range(len(x)) if only is None else only)
        shared = [j for j in range(own) if j in asked]
        vector = self.full(x)
        observed = [j for j in shared if self.touches[j] in ("belt", "all")] if self.pieces[0].observer is not None else []
        if observed:
            columns[:, observed] = self._observed_slopes(x, observed)
        for i, piece in enumerate(self.pieces):
            old = self.balance(i, x, float(offsets[i]))
            here = old.residual
            neighbours: dict[int, Array] = {}
            belts: dict[int, tuple[Array, float]] = {}
            # An observer knows itself how the carriage may stand at first.
            offset_of = [own + i] if own + i in asked and piece.observer is None else []
            for j in [j for j in shared if j not in observed] + offset_of:
                step, ahead = self.perturb(x, j)
                touch: Touch = self.touches[j] if j < own else "belt"
                offset = OFFSET_M * float(ahead[own + i]) if self.movable else 0.0
                if touch == "belt":
                    belts[j] = (self.full(ahead), offset)
                else:
                    neighbours[j] = self._neighbour(i, ahead, offset, old, touch).residual
            if belts:
                vectors, places = zip(*belts.values(), strict=True)
                loads = belt_loads(self.model, old.motion, vectors, places)
                neighbours |= {j: replace(old, belt=load).residual for j, load in zip(belts, loads.T, strict=True)}
            changes: dict[int, Array] = {}
            own_white = in_noise(piece, self.model, vector, here) if piece.own_noise else np.zeros(0)
            for j, beside in neighbours.items():
                step, ahead = self.perturb(x, j)
                if piece.own_noise and j < own and self.touches_noise[j]:
                    columns[self.ends[i] : self.ends[i + 1], j] = (in_noise(piece, self.model, self.full(ahead), beside) - own_white) / step
                else:
                    changes[j] = (beside - here) / step
            if changes:
                white = in_noise(piece, self.model, vector, np.stack(list(changes.values()), axis=1))
                columns[self.ends[i] : self.ends[i + 1], [min(j, own) for j in changes]] = white
        return ArrowheadJacobian(columns, self.ends if self.movable else self.ends[:1])

    def _observed_slopes(self, x: Array, numbers: Sequence[int]) -> Array:
        """Columns of unknowns behind the observers of the pieces, (n, numbers)."""
        steps = []
        for j in numbers:
            length, ahead = self.perturb(x, j)
            steps.append(Perturbation(length, self.full(ahead), self.touches[j] == "all"))
        found = slopes([one for piece in self.pieces for one in piece.observations], self.model, self.full(x), steps)
        return np.concatenate([piece.group_sums(white[piece.keep]) for piece, white in zip(self.pieces, found, strict=True)])

    def perturb(self, x: Array, j: int) -> tuple[float, Array]:
        """A small step of unknown j, to the side where there is room, negative below a bound, and the unknowns with it."""
        step = 1e-3 * max(abs(x[j]), 0.1)
        if x[j] + step > self.high[j]:
            step = -step
        ahead = x.copy()
        ahead[j] = x[j] + step
        return step, ahead

    def block_means(self, residual: Array) -> Array:
        """Mean square of every block of a whitened residual, (blocks,); infinite where a trial runs away."""
        with np.errstate(over="ignore"):
            return np.asarray(np.bincount(self.blocks, residual**2) / np.maximum(self.count, 1.0))

    def objective(self, residual: Array, x: Array) -> float:
        """O of the module, by the whitened residual at x; inf where a body flew off, or where rounding alone would make it."""
        bias = self.bias(self.full(x))
        if not np.all(np.isfinite(bias)):
            return math.inf
        left = self.block_means(residual)
        means = np.maximum(left - bias[self.piece_of_block], np.minimum(left, LEAST_MEAN))
        total = float(np.sum(self.count * np.where(means < 1.0, means, 1.0 + np.log(np.maximum(means, 1.0)))))
        return total if math.isfinite(total) else math.inf

    def weights(self, residual: Array) -> Array:
        """Square root of φ'(c) of every sample's block, (n,), 1 at most, by the whitened residual."""
        return np.asarray((1.0 / np.sqrt(np.maximum(1.0, self.block_means(residual))))[self.blocks])

    def rounding_derivatives(self, x: Array) -> tuple[Array, Array]:
        """Slope, (blocks, p), and curvature, (blocks, p, p), of what rounding adds to the squares of each block; p: shared unknowns."""
        own = len(self.free)
        moved = [j for j in range(own) if self.touches_noise[j]]
        steps, others = [], []
        for j in moved:
            step, ahead = self.perturb(x, j)
            steps.append(step)
            others.append(self.full(ahead))
        slope, curvature = self.bias.responses(self.full(x), others, np.array(steps))
        a, b = np.zeros((len(slope), own)), np.zeros((len(slope), own, own))
        a[:, moved] = slope
        at = np.array(moved, dtype=np.intp)
        b[:, at[:, None], at] = curvature
        return self.count[:, None] * a[self.piece_of_block], self.count[:, None, None] * b[self.piece_of_block]

    @in_one_thread
    def minimise(self, x: Array, iterations: int, enough: float = 0.02, goal: float = math.inf) -> Minimum:
        """Levenberg-Marquardt on O with the weights of each place; unknowns that push against a bound stay there.

        A step that gains less than ``enough`` nats ends the search; ``goal`` as of :func:`hopeless`.
        """
        residual = self.residual(x)
        value, damping = self.objective(residual, x), 1e-3
        asked = list(range(len(x)))
        for left in reversed(range(iterations if math.isfinite(value) else 0)):
            weights = self.weights(residual)
            jacobian = self.jacobian(x, asked).weighted_rows(weights)
            gradient, information = jacobian.transpose_times(residual * weights), jacobian.information()
            unit, own = np.diag(information).copy(), len(self.free)
            of_block = np.zeros(len(self.count))
            of_block[self.blocks] = weights**2
            slope, curvature = self.rounding_derivatives(x)
            gradient[:own] -= 0.5 * of_block @ slope
            information[:own, :own] -= np.tensordot(of_block, curvature, 1)
            outward = ((x <= self.low) & (gradient > 0.0)) | ((x >= self.high) & (gradient < 0.0))
            move = np.array([j for j in asked if not outward[j] and unit[j] > 0.0], dtype=np.intp)
            if not len(move):
                break
            gain = 0.0
            while damping < 1e7:
                system = information[np.ix_(move, move)] + damping * np.diag(unit[move])
                trial = x.copy()
                trial[move] = np.clip(x[move] - np.linalg.solve(system, gradient[move]), self.low[move], self.high[move])
                ahead = self.residual(trial)
                better = self.objective(ahead, trial)
                gain = value - better
                if gain > 0.0:
                    break
                damping *= 10.0
            if not gain > 0.0:
                break
            step = float(np.max(np.abs(trial - x)))
            x, residual, value, damping = trial, ahead, better, max(damping / 10.0, 1e-9)
            if gain < enough or step < 1e-6 or hopeless(value - goal, gain, left):
                break
        return Minimum(x, residual, value)


def hopeless(above: float, gain: float, left: int) -> bool:
    """True if a search that must come down to a goal to matter does not get there.

    Parameters
    ----------
    above : float
        How far O is above it, nats.
    gain : float
        By how much O fell in the last iteration, nats; later ones rarely gain more.
    left : int
        Iterations.
    """
    return above > PACE * gain * left


def time_blocks(pieces: Sequence[Segment], seconds: float) -> IntArray:
    """Running number of the time block of every value of the residual, blocks never crossing a segment.

    Parameters
    ----------
    pieces : sequence of Segment
        One after the other.
    seconds : float, s
        Length of a block.

    Returns
    -------
    ndarray, (n,) of int
        From 0.
    """
    labels, first = [], 0
    for piece in pieces:
        block = piece.value_samples // max(int(seconds / piece.motion.sample_s), 1)
        labels.append(block + first)
        first += piece.motion.samples
    if not labels:
        return np.zeros(0, dtype=np.int64)
    return np.unique(np.concatenate(labels), return_inverse=True)[1].astype(np.int64)
