"""Colour of the torque's noise where no setpoint tells it beside the reading: as likely as what the model leaves has it.

    least of  Σ ν²/S + ln S  over level and pole,  the model as it is        (method sheet, section 3, second equation)

Without a setpoint noise is no more, and no slower, than periods of the excitation differ by.  Where the reading is only the command nothing
bounds it: there a colour must hold for most records alike, which an effect, by its place, speed or time, does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from beltcomm.arrays import Array
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise.process_torque import ProcessTorque, correlation_time
from beltcomm.fit.noise.whitening import whitener
from beltcomm.fit.records import Data
from beltcomm.fit.residual.segment import Segment, acting_noise
from beltcomm.fit.residual.whitened import noise_paths_of
from beltcomm.fit.torque.reading_fit import CLEAR
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95

#: Correlation of values, and deviations of it, below which the residual is white; neighbours up to which it is looked at.
WHITE, SURE, NEIGHBOURS = 0.03, 4.0, 4
#: Largest pole; poles and factors on the level to begin with; evaluations; step for the curvature.
LARGEST, FIRST_POLES, EVALUATIONS, STEP = 0.995, (0.3, 0.75, 0.93), 60, 0.05
#: ln of the factor by which a level may change, and deviations beyond which a value says no more.
LEVELS, STRAY = 3.0, 5.0
#: How far the mean square of a record may be from 1, share of the records of which that holds, and values of one that count.
EVEN, MOSTLY, FEWEST = 0.2, 0.65, 400


def with_likeliest_colour(data: Data, fitted: Fitted, residuals: Sequence[Array]) -> Data:
    """The records with another level and colour of the torque's noise; as they are where what is left is white, or no colour is clear.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    residuals : sequence of ndarray
        Of each fitted segment as it is, (n,) N m.
    """
    if data.single or _is_white(fitted):
        return data
    search = _ColourSearch(data, fitted.model, residuals)
    most = (0.0, LARGEST) if data.path.commanded else (0.0, data.colour)
    ends = [search.minimum_from(pole) for pole in FIRST_POLES if pole < most[1]] if most[1] > 0.0 else []
    white, here = search.level_at(0.0), search.cost(np.array([0.0, _logit(data.colour)]))
    price = math.log(search.count) + CLEAR
    best = min(ends, key=lambda end: end[0], default=None)
    if best is not None and best[0] + price < white[0] and search.pole_of(best[1]) <= most[1]:
        level, pole = search.level_of(best[1]), search.pole_of(best[1])
        if data.path.commanded and not search.is_even(best[1]):
            return data
        return _with_colour(data, level, pole, search.deviations(best[1]))
    if data.colour > 0.0 and white[0] < here:
        return replace(data, noise_nm=search.level_of(white[1]), colour=0.0)
    return data


def _with_colour(data: Data, level_nm: float, pole: float, deviations: Array) -> Data:
    """The records with a noise of first order; of a command it is torque that acts."""
    if not data.path.commanded:
        return replace(data, noise_nm=level_nm, colour=pole)
    time_s, deviation_s = correlation_time(pole, float(deviations[1]), data.recordings[0].sample_period_s)
    process = ProcessTorque(level_nm, time_s, NORMAL_95 * float(deviations[0]), NORMAL_95 * deviation_s)
    return replace(data, noise_nm=level_nm, colour=pole, path=replace(data.path, process=process))


class _ColourSearch:
    """-2 ln L of what a model leaves, over ln of a factor on the level, and the logit of the pole; bounded above by the level so far
    where periods tell that."""

    def __init__(self, data: Data, model: Model, residuals: Sequence[Array]) -> None:
        self.data, self.pieces = data, [piece for piece in data.fitted if piece.observer is None and piece.keep.any()]
        self.residuals = [left for piece, left in zip(data.fitted, residuals, strict=True) if piece.observer is None and piece.keep.any()]
        self.paths = [noise_paths_of(piece, model) for piece in self.pieces]
        self.count = max(sum(int(np.count_nonzero(piece.keep)) for piece in self.pieces), 2)
        self.high = LEVELS if data.path.commanded else 0.0
        # Beside noise that was far too loud and white a rounding was found to be next to nothing.
        self.rounding = (1.0, 0.0) if data.path.commanded else None
        self.period_of = {recording.name: recording.sample_period_s for recording in data.recordings}

    def level_of(self, x: Array) -> float:
        return self.data.noise_nm * math.exp(float(np.clip(x[0], -LEVELS, self.high)))

    def pole_of(self, x: Array) -> float:
        return LARGEST / (1.0 + math.exp(-float(np.clip(x[1], -30.0, 30.0))))

    def whites(self, x: Array, pole: float | None = None) -> list[tuple[Segment, Array, float]]:
        """Pieces, whitened values that are no strays, and 2 Σ ln of their deviations."""
        level, found = self.level_of(x), []
        pole = self.pole_of(x) if pole is None else pole
        for piece, left, along in zip(self.pieces, self.residuals, self.paths, strict=True):
            own = self.period_of[piece.record]
            colour = acting_noise(self.data.path, pole, own, round(piece.motion.sample_s / own))
            trial = whitener(piece.keep, along, piece.step_rad, piece.noise_factor * level, self.rounding or piece.rounding, colour)
            white = np.clip(trial(left, piece.keep), -STRAY, STRAY)
            found.append((piece, white, 2.0 * float(np.sum(np.log(trial.deviations[piece.keep])))))
        return found

    def cost(self, x: Array, pole: float | None = None) -> float:
        return sum(float(white @ white) + logarithms for _, white, logarithms in self.whites(x, pole))

    def minimum_from(self, pole: float) -> tuple[float, Array]:
        """The best end from a pole to begin with."""
        begun = np.array([min(0.0, self.high), _logit(pole)])
        simplex = begun + np.array([[0.0, 0.0], [-0.3, 0.0], [0.0, 0.8]])
        found = minimize(
            self.cost, begun, method="Nelder-Mead", options={"maxfev": EVALUATIONS, "initial_simplex": simplex, "xatol": 0.01, "fatol": 0.5}
        )
        return float(found.fun), np.asarray(found.x)

    def level_at(self, pole: float) -> tuple[float, Array]:
        """The best level of noise with a pole."""
        found = minimize_scalar(
            lambda level: self.cost(np.array([level, 0.0]), pole),
            bounds=(-LEVELS, self.high + 1e-6),
            method="bounded",
            options={"xatol": 0.01, "maxiter": 20},
        )
        return float(found.fun), np.array([float(found.x), 0.0])

    def is_even(self, x: Array) -> bool:
        """True if what is left is as much in most of the records."""
        squares: dict[str, list[Array]] = {}
        for piece, white, _ in self.whites(x):
            squares.setdefault(piece.record, []).append(white**2)
        joined = {name: np.concatenate(parts) for name, parts in squares.items()}
        means = [float(np.mean(values)) for values in joined.values() if len(values) >= FEWEST]
        return sum(abs(mean - 1.0) < EVEN for mean in means) > MOSTLY * len(means)

    def deviations(self, x: Array) -> Array:
        """One standard deviation of level, N m, and pole, by the curvature."""
        steps = STEP * np.eye(2)
        bent = [[sum(i * j * self.cost(x + i * a + j * b) for i in (1, -1) for j in (1, -1)) for b in steps] for a in steps]
        curvature = np.array(bent) / (4.0 * STEP**2)  # of -2 ln L: twice the information
        spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(0.5 * curvature, hermitian=True)), 0.0))
        pole = self.pole_of(x)
        return np.array([self.level_of(x) * spread[0], pole * (1.0 - pole / LARGEST) * spread[1]])


def _logit(pole: float) -> float:
    pole = min(max(pole, 1e-6), LARGEST - 1e-6)
    return math.log(pole / (LARGEST - pole))


def _is_white(fitted: Fitted) -> bool:
    """True if values of the residual do not go with their neighbours, nor with the next ones."""
    together, squares, number = np.zeros(NEIGHBOURS), 0.0, 0
    for piece, values in zip(fitted.problem.pieces, np.split(fitted.residual, fitted.problem.ends[1:-1]), strict=True):
        white, at = np.clip(values, -STRAY, STRAY), piece.value_samples
        for apart in range(1, NEIGHBOURS + 1):
            near = at[apart:] - at[:-apart] == apart * piece.group
            together[apart - 1] += float(np.sum((white[apart:] * white[:-apart])[near]))
        squares, number = squares + float(white @ white), number + len(white)
    if number < FEWEST or squares <= 0.0:
        return True
    return float(np.abs(together).max()) / squares < max(WHITE, SURE / math.sqrt(number))
