"""A model fitted to records from its start values: torque path, minimum, motion rebuilt, noise of the sensor, minimum again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from beltcomm.compiled import in_one_thread
from beltcomm.fit.estimate import AT_A_TIME, Fitted, fit, gone_on
from beltcomm.fit.likelihood import OFFSET_M
from beltcomm.fit.observer import follows
from beltcomm.fit.path_choice import choose_path
from beltcomm.fit.records import SUBSTEPS, Data, agitated, made, remade
from beltcomm.fit.sensor_noise import split_noise
from beltcomm.fit.torque_path import TorquePath
from beltcomm.model import Model

#: Iterations of the first fit from start values, of one that goes on from a neighbouring model, and of the last one.
FIRST_ITERATIONS, NEXT_ITERATIONS, LAST_ITERATIONS = 25, 12, 6
#: Fine steps a sample of the fit whose numbers are published: with :data:`SUBSTEPS` stiffness is 0.05 % off, with these 0.003 %.
PUBLISHED_SUBSTEPS = 16
#: How often a short fit and what an observer does not know are found anew, each by the other, before the fit.
ROUNDS = 3
#: Share of the values that must be left where a model rebuilds the motion, and factor by which the error may be larger with it.
LEAST_LEFT, WORSE = 0.5, 1.5


@in_one_thread
def fit_base(
    data: Data,
    start: Model,
    *,
    fixed: Sequence[str] = (),
    path: TorquePath | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> tuple[Data, Fitted]:
    """The start model fitted to records, and the records as it sees them.

    data : with the reading taken for the torque that acts.   fixed : parameters that stay.   path : where it is known already.
    """
    first = fit(data, start, FIRST_ITERATIONS, fixed=fixed)
    progress(0.3)
    chosen = path if path is not None else choose_path(data, first, start).path
    if chosen != data.path:
        data = made(data.recordings, start, data.noise_nm, data.step_rad, {}, path=chosen)
        first = fit(data, start, FIRST_ITERATIONS, fixed=fixed)
    progress(0.5)
    data, fitted = again(data, first, NEXT_ITERATIONS, fixed=fixed)
    progress(0.7)
    split = split_noise(data, fitted)
    if split is not None:
        data = replace(data, noise_nm=split.sensor_nm)
    found = again(data, fitted, LAST_ITERATIONS, PUBLISHED_SUBSTEPS, fixed=fixed)
    progress(1.0)
    return found


def again(data: Data, fitted: Fitted, iterations: int, substeps: int = SUBSTEPS, *, fixed: Sequence[str] = ()) -> tuple[Data, Fitted]:
    """Motion and noise rebuilt by a fitted model, and the model fitted to them; as they were where nothing comes of it."""
    ahead = remade(data, fitted.model, OFFSET_M * fitted.offsets, substeps)
    if sum(len(piece.counted) for piece in ahead.fitted) < LEAST_LEFT * fitted.problem.samples:
        return data, fitted  # by a model that is far off the motor rests nearly all the time
    begun = fitted
    for _ in range(ROUNDS if follows(fitted.model) else 0):
        begun = fit(ahead, begun.model, AT_A_TIME, fixed=fixed)
        calmer = agitated(ahead, begun.model)  # what a better model does not tell is less
        if calmer.fitted[0].agitation == ahead.fitted[0].agitation:
            found = gone_on(ahead, begun, iterations)
            break
        ahead = calmer
    else:
        found = fit(ahead, begun.model, iterations, offsets=begun.offsets, fixed=fixed)
    for piece in (*data.fitted, *data.held_out):
        piece.motion.forget()  # these records are looked at as they were once more at most
    # Behind an observer a light body may fly off; a motion rebuilt by a model far off makes it worse.
    sound = math.isfinite(found.objective) and found.ratio < WORSE * fitted.ratio
    return (ahead, found) if sound else (data, fitted)
