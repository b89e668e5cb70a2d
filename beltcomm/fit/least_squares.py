"""A model far above the noise, as least squares has it: no likelihood holds there, and what is told is the plain error.

The block-robust likelihood gives up the blocks that such a model suits least, which may be most of the motion: on a real screw whose
friction differs by direction it left 9.2 % of the force where the same three terms by least squares leave 7.1 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from beltcomm.arrays import Array
from beltcomm.fit.band_error import QUIET_SHARE, band_limited_errors, band_of, in_band
from beltcomm.fit.estimate import ENOUGH, STRETCH_S, Fitted, evaluate_at, problem_of
from beltcomm.fit.likelihood.problem import Problem
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer

#: Error over the noise from which on a model is far off, and of a rigid one; share of the plain error by which another fit must be better.
FAR_ABOVE, FAR_ABOVE_RIGID, LESS = 2.0, 1.5, 0.02
#: Evaluations and relative change of the parameters at which least squares end, and step of their differences.
MOST, CLOSE, STEP = 30, 1e-4, 1e-4


def least_plain_error(data: Data, fitted: Fitted, iterations: int, fixed: Sequence[str] = ()) -> Fitted:
    """The fit of the same model that leaves least of the torque in plain units where it is far above the noise; else as it was.

    Tried are one weight for each segment and, without a belt, least squares in the band.  A belt's stiffness may lie above the band.
    No other is taken that leaves more on records held out.  What a model leaves may have been taken for noise itself: without a belt it is
    far off, too, where it leaves more of the torque than noise may have in the band.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        The likeliest fit.
    iterations : int
        At most.
    fixed : sequence of str
        Parameters that do not move.

    Returns
    -------
    Fitted
        ``fitted`` itself where it is not far above the noise, or nothing leaves less.
    """
    if needs_observer(fitted.model):
        return fitted
    band = band_of(data, fitted.model)
    movable = fitted.problem.movable
    if not fitted.ratio > (FAR_ABOVE if movable else FAR_ABOVE_RIGID) and (movable or _share_left(data, fitted, band) <= QUIET_SHARE):
        return fitted
    wide = problem_of(data, fitted.model, fixed, STRETCH_S)
    at = wide.minimise(wide.start(fitted.offsets), iterations, enough=ENOUGH)
    evenly = fitted.problem.start(wide.offsets(at.x), wide.model_at(at.x, "laboratory"))
    tried = [fitted, evaluate_at(data, fitted.problem, evenly)]
    left = [_plain(data, one, band) for one in tried]
    if not movable:
        nearest = tried[int(np.argmin([own for own, _ in left]))]
        tried.append(evaluate_at(data, fitted.problem, least_in_band(fitted.problem, nearest.x, band)))
        left.append(_plain(data, tried[-1], band))
    sound = [(own, one) for one, (own, held) in zip(tried, left, strict=True) if held <= left[0][1] and own < (1.0 - LESS) * left[0][0]]
    return replace(min(sound, key=lambda pair: pair[0])[1], likeliest=fitted) if sound else fitted


def _share_left(data: Data, fitted: Fitted, band_hz: float) -> float:
    """rms error in the band on the fitted records over the rms torque there."""
    parts = [part for part in band_limited_errors(data, fitted, band_hz) if not part.held_out]
    error, torque = (
        sum(float(np.sum(signal[part.keep] ** 2)) for part in parts for signal in [getattr(part, name)]) for name in ("error", "torque")
    )
    return float(np.sqrt(error / torque)) if torque > 0.0 else 0.0


def _plain(data: Data, fitted: Fitted, band_hz: float) -> tuple[float, float]:
    """rms error in the band on the fitted records and on those held out, N m; 0 where none counts."""
    parts = band_limited_errors(data, fitted, band_hz)
    errors = [[part.error[part.keep] for part in parts if part.held_out is out] for out in (False, True)]
    own, held = (float(np.sqrt(np.mean(np.concatenate(which) ** 2))) if sum(map(len, which)) else 0.0 for which in errors)
    return own, held


def least_in_band(problem: Problem, begin: Array, band_hz: float) -> Array:
    """Unknowns by least squares of the band-limited error, where a search begins at some.

    No likelihood leads there from a model that lacks so much that what it leaves was taken for noise.

    Parameters
    ----------
    problem : Problem
        Segments and free parameters.
    begin : ndarray
        Unknowns of the problem.
    band_hz : float, Hz
        Edge of the band.

    Returns
    -------
    ndarray
        Unknowns of the problem.
    """

    def error(x: Array) -> Array:
        model = problem.model_at(x, "laboratory")
        parts = [in_band(piece, model, model.vector(), band_hz) for piece in problem.pieces]
        return np.concatenate([part.error[part.keep] for part in parts])

    steps = np.full(len(begin), STEP)
    found = least_squares(error, begin, bounds=(problem.low, problem.high), max_nfev=MOST, xtol=CLOSE, diff_step=steps)
    return np.asarray(found.x)
