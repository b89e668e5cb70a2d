"""Estimates of one parameter from single records while everything else stays as fitted: start values where the whole fit took one side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.fit.estimate import BLOCK_S, Fitted
from beltcomm.fit.likelihood.problem import OFFSET_M, Problem
from beltcomm.fit.records import SUBSTEPS
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import in_noise, observed_residuals, with_observers
from beltcomm.laboratory.acceptance import STIFFNESS
from beltcomm.simulate.inverse import belt_loads, fine_load, true_motion
from beltcomm.simulate.kernels.vectors import LANES

#: m; a record whose carriage stays within this is taken at one place.
ONE_PLACE_M = 0.06
#: Values of the residual that a record needs, and the torque, rms, as a share of the loudest one's.
ENOUGH, LOUD = 300, 0.2
#: Factor by which the stiffness is searched up and down, and points of the first grid and of the one around its best; as many as run in
#: lock step behind an observer.
RANGE, GRID, FINE_GRID = 3.0, 3 * LANES, LANES
#: Rise of the objective on both sides that makes a minimum, nats; a short record has few blocks to rise with, nats each.
CLEAR, CLEAR_PER_BLOCK = 30.0, 1.0
#: Mean square of a block's residual up to which the model explains it, and share of such blocks that may have swung further by chance.
EXPLAINS, BY_CHANCE = 1.5, 0.01


def stiffness_at_places(fitted: Fitted) -> tuple[tuple[float, float, float], ...]:
    """(place m, rms torque N m, stiffness N/m) of every record at one place that shows it; () where the model has no plain belt.

    Parameters
    ----------
    fitted : Fitted
    """
    if STIFFNESS not in fitted.problem.free:
        return ()
    ratio = fitted.model["transmission.ratio"]
    # A slow stroke shows the belt only where it starts, and there the carriage may stand off: it says what the model says already.
    loud = LOUD * max(float(np.std(piece.torque)) for piece in fitted.problem.pieces)
    found = []
    for piece in fitted.problem.pieces:
        theta = piece.motion.theta * ratio
        if float(np.std(piece.torque)) < loud:
            continue
        if np.ptp(theta) < ONE_PLACE_M and len(piece.value_samples) >= ENOUGH:
            stiffness = _likeliest(fitted, piece)
            if stiffness is not None:
                found.append((float(np.mean(theta)), float(np.std(piece.torque)), stiffness))
    return tuple(found)


def explained_elongation(fitted: Fitted) -> tuple[float, float]:
    """Stretch of the belt, m, to the negative and positive side, in moments that the model explains; (0, 0) without a belt.

    A strand that goes slack does so beyond it, however little the moments beyond tell of where.

    Parameters
    ----------
    fitted : Fitted
    """
    model, problem = fitted.model, fitted.problem
    if STIFFNESS not in problem.free or needs_observer(model):
        return 0.0, 0.0
    vector, ratio = model.vector(), model["transmission.ratio"]
    ends: list[tuple[float, float]] = []
    first = 0
    for piece, offset in zip(problem.pieces, fitted.offsets, strict=True):
        motion = true_motion(model, piece.motion, vector)
        cart = fine_load(model, motion, vector, OFFSET_M * float(offset))[1]
        stretch = (ratio * motion.theta - cart)[:: motion.substeps]
        here = slice(first, first + len(piece.value_samples))
        first = here.stop
        squares, blocks = fitted.residual[here] ** 2, problem.blocks[here]
        for block in np.unique(blocks):
            mine = blocks == block
            if np.mean(squares[mine]) < EXPLAINS:
                at = piece.value_samples[mine]
                part = stretch[int(at.min()) : int(at.max()) + 1]
                ends.append((-float(part.min()), float(part.max())))
    if not ends:
        return 0.0, 0.0
    minus, plus = np.quantile(np.array(ends), 1.0 - BY_CHANCE, axis=0)
    return float(minus), float(plus)


def _likeliest(fitted: Fitted, piece: Segment) -> float | None:
    """The stiffness that explains a record best, N/m; None where a third or three times of it explain it nearly as well."""
    rough = replace(piece, motion=piece.motion.coarser(min(SUBSTEPS, piece.motion.substeps)))
    vector, place = fitted.model.vector(), fitted.model.index(STIFFNESS)
    size = max(1, int(BLOCK_S / piece.motion.sample_s))
    blocks = np.arange(0, len(piece.value_samples), size)
    counts = np.diff([*blocks, len(piece.value_samples)])
    problem = Problem([rough], fitted.model, (), BLOCK_S)
    parts = problem.balance(0, problem.start(), 0.0)

    def at(logarithm: float) -> Array:
        there = vector.copy()
        there[place] *= np.exp(logarithm)
        return there

    def costs(logarithms: Array) -> list[float]:
        vectors = [at(logarithm) for logarithm in logarithms]
        if needs_observer(fitted.model):
            models = [fitted.model.with_vector(there) for there in vectors]
            white = np.stack(observed_residuals(with_observers([rough] * len(models), models), models[0], vectors), axis=1)
        else:
            belts = belt_loads(fitted.model, parts.motion, vectors, [0.0] * len(vectors))
            white = in_noise(rough, fitted.model, vector, np.stack([replace(parts, belt=belt).residual for belt in belts.T], axis=1))
        means = np.add.reduceat(white**2, blocks) / counts[:, None]
        return [float(total) for total in np.sum(np.log(np.maximum(means, 1.0)), axis=0)]

    grid = np.linspace(-np.log(RANGE), np.log(RANGE), GRID)
    values = costs(grid)
    best = int(np.argmin(values))
    clear = min(CLEAR, CLEAR_PER_BLOCK * len(blocks))
    if best in (0, GRID - 1) or min(max(values[:best]), max(values[best + 1 :])) - values[best] < clear:
        return None
    fine = np.linspace(grid[best - 1], grid[best + 1], FINE_GRID + 2)[1:-1]
    near = costs(fine)
    middle = min(max(int(np.argmin(near)), 1), FINE_GRID - 2)
    curve, slope, _ = np.polyfit(fine[middle - 1 : middle + 2], near[middle - 1 : middle + 2], 2)
    lowest = float(np.clip(-0.5 * slope / curve, grid[best - 1], grid[best + 1])) if curve > 0.0 else float(fine[middle])
    return float(at(lowest)[place])
