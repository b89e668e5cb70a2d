"""What single records say of one parameter while everything else stays as fitted: start values where the whole fit took one side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.identify.residual import Stretch, dressed, whitened
from beltcomm.laboratory.data import SUBSTEPS
from beltcomm.laboratory.fitting import BLOCK_S, Fitted

#: m; a record whose carriage stays within this is taken at one place.
ONE_PLACE_M = 0.06
#: Values of the residual that a record needs, and the torque, rms, as a share of the loudest one's.
ENOUGH, LOUD = 300, 0.2
#: Factor by which the stiffness is searched up and down, and points of the first grid.
RANGE, GRID = 3.0, 25
#: Rise of the objective on both sides that makes a minimum, nats.
CLEAR = 30.0
STIFFNESS = "belt_stiffness.stiffness"


def stiffness_by_record(fitted: Fitted) -> tuple[tuple[float, float, float], ...]:
    """(place m, rms torque N m, stiffness N/m) of every record at one place that shows it; () where the model has no plain belt."""
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
        if np.ptp(theta) < ONE_PLACE_M and len(piece.counted) >= ENOUGH:
            stiffness = likeliest(fitted, piece)
            if stiffness is not None:
                found.append((float(np.mean(theta)), float(np.std(piece.torque)), stiffness))
    return tuple(found)


def likeliest(fitted: Fitted, piece: Stretch) -> float | None:
    """The stiffness that explains a record best, N/m; None where half and double of it explain it as well."""
    rough = replace(piece, motion=piece.motion.coarser(min(SUBSTEPS, piece.motion.substeps)))
    vector, place = fitted.model.vector(), fitted.model.index(STIFFNESS)
    start = vector[place]
    size = max(1, int(BLOCK_S / piece.motion.sample_s))
    blocks = np.arange(0, len(piece.counted), size)

    def cost(logarithm: float) -> float:
        vector[place] = start * np.exp(logarithm)
        model = fitted.model.with_vector(vector)
        squares = whitened(dressed(rough, model), model, vector) ** 2
        means = np.add.reduceat(squares, blocks) / np.diff([*blocks, len(squares)])
        return float(np.sum(np.log(np.maximum(means, 1.0))))

    grid = np.linspace(-np.log(RANGE), np.log(RANGE), GRID)
    values = [cost(point) for point in grid]
    best = int(np.argmin(values))
    if best in (0, GRID - 1) or min(max(values[:best]), max(values[best + 1 :])) - values[best] < CLEAR:
        return None
    step = grid[1] - grid[0]
    inner = minimize_scalar(cost, bounds=(grid[best] - step, grid[best] + step), method="bounded", options={"xatol": 1e-3})
    return float(start * np.exp(inner.x))
