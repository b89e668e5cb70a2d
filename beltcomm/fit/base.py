"""A model fitted to records from its start values: torque path, minimum, motion rebuilt, noise of the sensor, minimum again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import in_one_thread
from beltcomm.errors import DataError
from beltcomm.fit.estimate import AT_A_TIME, Fitted, fit, resume_fit
from beltcomm.fit.least_squares import least_plain_error
from beltcomm.fit.likelihood.problem import OFFSET_M
from beltcomm.fit.noise.angle import NOISY
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.fit.noise.level import FEWEST, ORDER, rounding_of_reading, white_noise_deviation
from beltcomm.fit.path_fit.choice import BEHIND, EXPLAINED, GOOD, PathChoice, choose_path, reads_command
from beltcomm.fit.path_fit.residual_colour import with_likeliest_colour
from beltcomm.fit.path_fit.sensor_noise import NoiseSplit, split_noise
from beltcomm.fit.path_fit.values import by_path, refine_path
from beltcomm.fit.records import (
    PUBLISHED_SUBSTEPS,
    SUBSTEPS,
    Data,
    grouped_like,
    is_mostly_rounding,
    likeliest_noise,
    likeliest_step,
    prepare_records,
    remade,
    with_noise,
    with_process_noise,
)
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.reversals import turns_at_once
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.torque.reading_fit import clear_gain, fit_reading, unlikely_readings
from beltcomm.fit.uncertainty.intervals import UNEXPLAINED, with_intervals
from beltcomm.fit.uncertainty.nuisance import HELD, TOLERANCES, hold, hold_lost_inertia, next_to_hold, with_nuisance
from beltcomm.model import Model

#: Error over the noise below which only the noise may be wrong.
NEARLY = 1.25
#: Error over the noise up to which what is left is above all what the angle is rough by: noise of its own that its counts hide at rest.
ROUGH = 2.0
#: Iterations of the first fit from start values, of one that goes on from a neighbouring model, and of the last one.
FIRST_ITERATIONS, NEXT_ITERATIONS, LAST_ITERATIONS = 25, 12, 6
#: Mean square of the whitened residual in samples with a reversal, over that of the others, up to which they count; intervals by which
#: they may move a mass or a stiffness; what they may move as they see it, for it is them that tell it.
REVERSAL_MISFIT, MOST_MOVED, RUBBING = 1.15, 2.0, ("coulomb.", "cart_friction.", "viscous")
#: Share of the torque's rms that its noise is taken for at first where nothing tells; share below which noise is less than was thought.
LOUD, QUIET = 0.3, 0.95
#: Share of its noise so far up to which a torque's noise, once told, is worth asking the motion of the path again.
CALMER = 0.7
#: Factor by which white noise may look rougher between every second value.
ALIKE = 1.25
#: Least share of the noise so far that the noise may be.
QUIETEST = 1e-3
#: Factor by which the noise of the angle is more than was thought, from which on the fit made before is no place to go on from.
UNDERRATED = 1.1
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
    sheet: Model | None = None,
    publish: bool = True,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> tuple[Data, Fitted]:
    """The start model fitted to records, and the records as it sees them.

    Parameters
    ----------
    data : Data
        With the reading taken for the torque that acts.
    start : Model
        Model that the fit begins from.
    fixed : sequence of str
        Parameters that stay.
    path : TorquePath or None
        Where it is known already.
    sheet : Model or None
        The data sheets, for what the records do not tell.
    publish : bool
        With the finest steps, and reversals, for numbers that are shown; else as a search goes on from it.
    progress : callable
        Hears the share that is done, 0 to 1.

    Raises
    ------
    DataError
        Where no sample counts.
    """
    found = _fit_base(data, start, fixed, path, publish, progress)
    while sheet is not None and (name := next_to_hold(found[1], sheet)) is not None:
        start = hold(start, name, sheet[name], TOLERANCES[name] * sheet[name], HELD)
        held = _fit_base(data, start, fixed, path, publish, progress)
        now, then = ratio_in_groups_of(held[1], found[1]), ratio_in_groups_of(found[1], held[1])
        if found[1].problem.samples * (now**2 - then**2) > clear_gain(found[1].problem.samples):
            break  # these records have something to say against the data sheet
        found = held
    if sheet is None and (inertia := hold_lost_inertia(start, *found)) is not None:
        found = _fit_base(data, inertia, fixed, path, publish, progress)
    if not found[1].problem.samples:
        seconds = sum(piece.motion.samples * piece.motion.sample_s for piece in found[0].fitted)
        raise DataError(
            f"in none of the {seconds:.1f} s recorded does the axis surely move on, its position read in steps of {data.step_rad:.3g} "
            f"{data.recordings[0].position_unit}, and nothing can be fitted; record longer or faster strokes, or a position in finer steps"
        )
    return found


def _fit_base(
    data: Data, start: Model, fixed: Sequence[str], path: TorquePath | None, publish: bool, progress: Callable[[float], None]
) -> tuple[Data, Fitted]:
    chain = fit_reading([r for r in data.recordings if not r.sidecar.held_out])
    commanded = reads_command(chain, data.recordings)
    if commanded:  # then nothing but the motion tells how noisy the torque is
        loud = LOUD * max(float(np.sqrt(np.mean(piece.torque**2))) for piece in data.fitted)
        data = prepare_records(
            data.recordings, start, loud, data.step_rad, {}, path=TorquePath(chain.law if chain else None, commanded=True)
        )
    elif chain is not None and chain.noise_nm < CALMER * data.noise_nm:  # few samples of the setpoint do not tell a slow reading
        data = with_noise(data, chain.noise_nm, start)
    first = fit(data, start, FIRST_ITERATIONS, fixed=fixed)
    if commanded:
        data, first = _with_quieter_torque(*refit_with_rebuilt_motion(data, first, NEXT_ITERATIONS, fixed=fixed))
    progress(0.3)
    choice = choose_path(data, first, start, chain) if path is None else PathChoice(path, chain)
    if choice.between:
        return _fit_behind(data, start, choice.between, fixed, publish, progress)
    chosen = path if path is not None else replace(choice.path, commanded=commanded)
    if chosen != data.path:
        data = prepare_records(
            data.recordings, first.model if commanded else start, data.noise_nm, data.step_rad, {}, path=chosen, colour=data.colour
        )
        first = fit(data, first.model if commanded else start, FIRST_ITERATIONS, fixed=fixed)
    progress(0.5)
    data, fitted = refit_with_rebuilt_motion(data, first, NEXT_ITERATIONS, fixed=fixed)
    if path is None:
        data, fitted = likeliest_path(*refine_path(data, fitted), fixed=fixed)
        if chain is not None and not chain.delayed and fitted.ratio > ROUGH:
            data, fitted = _or_by_reading(data, fitted, start, fixed)
    progress(0.7)
    for _ in range(ROUNDS):  # the noise as another path leaves it is another one
        split = split_noise(data, fitted)
        if split is None:
            break
        quieter = split.sensor_nm < CALMER * data.noise_nm
        data = _with_split(data, split)
        if not quieter or path is not None:
            break
        # The motion tells more of the path now.
        data, fitted = refine_path(*refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS, fixed=fixed))
    if split is None and (chain is None or commanded):
        data, fitted = _as_quiet_as_it_is(data, fitted, fixed)
        data = with_likeliest_colour(data, fitted, _residuals(fitted))
    if fitted.ratio < ROUGH and is_mostly_rounding(data, fitted.model):
        data, fitted = refit_with_rebuilt_motion(replace(data, single=True), fitted, NEXT_ITERATIONS, fixed=fixed)
    least = _least_step(data)
    if (fitted.ratio < NEARLY and data.step_rad > NOISY * least) or (data.single and GOOD < fitted.ratio < ROUGH):
        step = likeliest_step(data, fitted.model, _residuals(fitted), least)
        underrated, data = step > UNDERRATED * data.step_rad, replace(data, step_rad=step)
        if underrated:  # what was fitted so far stands where noise that was taken for motion has pulled it
            data, fitted = _refit_from_start(*refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS, fixed=fixed), start, fixed)
            data = replace(data, step_rad=likeliest_step(data, fitted.model, _residuals(fitted), least))
    return _with_last_fit(data, fitted, fixed, publish, progress)


def _with_last_fit(
    data: Data, fitted: Fitted, fixed: Sequence[str], publish: bool, progress: Callable[[float], None]
) -> tuple[Data, Fitted]:
    """Records and fit with path and noise as they are: the last motion, reversals, and what a path leaves open."""
    data, fitted = refit_with_rebuilt_motion(data, fitted, LAST_ITERATIONS, PUBLISHED_SUBSTEPS if publish else SUBSTEPS, fixed=fixed)
    progress(0.9)
    data, fitted = _refit_with_reversals(data, fitted, fixed=fixed)
    if publish:
        fitted = least_plain_error(data, fitted, FIRST_ITERATIONS, fixed)
    progress(1.0)
    return data, with_nuisance(data, fitted)


def _fit_behind(
    data: Data, start: Model, between: str, fixed: Sequence[str], publish: bool, progress: Callable[[float], None]
) -> tuple[Data, Fitted]:
    """Records and fit where an effect between reading and motion tells the path: path and noises by a model that has it.

    ``between``, the effect, is not in the model that is returned: it is for the search to find.
    """
    known, _ = _fit_base(data, start.with_effect(between), fixed, None, False, lambda part: progress(0.8 * part))
    data = prepare_records(
        data.recordings, start, known.noise_nm, known.step_rad, {}, path=known.path, colour=known.colour, single=known.single
    )
    fitted = fit(data, start, FIRST_ITERATIONS, fixed=fixed)
    return _with_last_fit(*refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS, fixed=fixed), fixed, publish, progress)


def _refit_from_start(data: Data, fitted: Fitted, start: Model, fixed: Sequence[str]) -> tuple[Data, Fitted]:
    """Records and fit from the start values once more, with the noise as it is known now; those given where that ends worse."""
    ahead = prepare_records(
        data.recordings, start, data.noise_nm, data.step_rad, {}, path=data.path, colour=data.colour, single=data.single
    )
    ahead, found = refit_with_rebuilt_motion(ahead, fit(ahead, start, FIRST_ITERATIONS, fixed=fixed), NEXT_ITERATIONS, fixed=fixed)
    return (ahead, found) if ratio_in_groups_of(found, fitted) < ratio_in_groups_of(fitted, found) else (data, fitted)


def _or_by_reading(data: Data, fitted: Fitted, start: Model, fixed: Sequence[str]) -> tuple[Data, Fitted]:
    """Records and fit without a setpoint that goes with the reading behind a slow filter only, where that is nearer to the motion."""
    plain = prepare_records(data.recordings, start, data.noise_nm, data.step_rad, {}, colour=data.colour)
    first = fit(plain, start, FIRST_ITERATIONS, fixed=fixed)
    path = choose_path(plain, first, start, None).path
    plain = prepare_records(data.recordings, start, data.noise_nm, data.step_rad, {}, path=path, colour=data.colour)
    first = fit(plain, start, FIRST_ITERATIONS, fixed=fixed)
    plain, found = refine_path(*refit_with_rebuilt_motion(plain, first, NEXT_ITERATIONS, fixed=fixed))
    return (plain, found) if found.ratio < fitted.ratio else (data, fitted)


def likeliest_path(data: Data, fitted: Fitted, *, fixed: Sequence[str] = ()) -> tuple[Data, Fitted]:
    """Records and fit by the likeliest of the paths that a part of the records could not tell apart; its rivals those that all cannot.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    fixed : sequence of str
        Parameters that stay.

    Returns
    -------
    tuple of Data and Fitted
        As they were where the path has no rivals, or none is clearly likelier.
    """
    samples, rivals = fitted.problem.samples, data.path.rivals
    # A model that is far off itself does not tell small things of a path, and what it leaves counts as noise.
    far_off = EXPLAINED * (fitted.objective - samples) if fitted.ratio > ROUGH else 0.0
    clear = max(clear_gain(samples) * max(fitted.ratio, 1.0) ** 2, far_off)
    told = bool(rivals) and data.path.chain is not None and not data.path.commanded
    to_fit = [r for r in data.recordings if not r.sidecar.held_out]
    if told:  # what the readings speak against by more than any motion makes good need not be fitted
        own, *readings = unlikely_readings([data.path, *rivals], to_fit)
        rivals = tuple(rival for rival, more in zip(rivals, readings, strict=True) if more - own <= clear + BEHIND * samples)
    tried = [(data, fitted)]
    for rival in rivals:
        ahead = by_path(data, fitted.model, rival)
        tried.append(refine_path(ahead, fit(ahead, fitted.model, NEXT_ITERATIONS, fixed=fixed)))
    lacks = [samples * other.objective / max(other.problem.samples, 1) for _, other in tried]
    if told:
        readings = unlikely_readings([ahead.path for ahead, _ in tried], to_fit)
        lacks = [lack + more for lack, more in zip(lacks, readings, strict=True)]
    least = min(lacks)
    best = 0 if lacks[0] <= least + clear else lacks.index(least)
    near = tuple(ahead.path for number, (ahead, _) in enumerate(tried) if number != best and lacks[number] <= lacks[best] + clear)
    ahead, found = tried[best]
    return replace(ahead, path=replace(ahead.path, rivals=tuple(replace(path, rivals=()) for path in near))), found


def _as_quiet_as_it_is(data: Data, fitted: Fitted, fixed: Sequence[str]) -> tuple[Data, Fitted]:
    """Records and fit with the noise of a torque that no setpoint tells: each fit may show less of it, until one does not."""
    for _ in range(ROUNDS):
        before = data.noise_nm
        data, fitted = _with_quieter_torque(data, fitted)
        if data.noise_nm > QUIET * before:
            break
        data, fitted = refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS, fixed=fixed)
    return data, fitted


def _with_quieter_torque(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """The records with no more noise of the torque than what the model leaves tells; the fit as it was, unless that is much less.

    What a model leaves above the noise says nothing of the noise, and what it leaves slowly neither: that is the model's.  How rough the
    rest is from value to value no model changes, and where it is less so than the noise would be, the rest of that was excitation.
    """
    least_nm = 0.0 if data.path.commanded else min(rounding_of_reading(r) for r in data.recordings)
    if not is_mostly_rounding(data, fitted.model) and max(rough := _roughness(fitted), least_nm / data.noise_nm) < CALMER:
        quieter = with_noise(data, max(rough * data.noise_nm, QUIETEST * data.noise_nm, least_nm), fitted.model)
        return quieter, fit(quieter, fitted.model, NEXT_ITERATIONS, offsets=fitted.offsets)
    if fitted.ratio >= 1.0:
        return data, fitted
    noise = max(likeliest_noise(data, fitted.model, _residuals(fitted), data.noise_nm), least_nm)
    return (replace(data, noise_nm=noise) if noise < QUIET * data.noise_nm else data), fitted


def _least_step(data: Data) -> float:
    """Least step in which the angle of a record is read, rad."""
    return min(smallest_step(r.position) for r in data.recordings)


def with_noise_that_is_left(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Records and fit with the noises of angle and torque as a better model leaves them: what it lacked before was taken for some of them.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        Model that lacks nothing, fitted to the records.

    Returns
    -------
    tuple of Data and Fitted
        As they were where an observer follows the bodies.
    """
    if needs_observer(fitted.model):
        return data, fitted
    data = replace(data, step_rad=likeliest_step(data, fitted.model, _residuals(fitted), _least_step(data)))
    data, fitted = refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS)
    split = split_noise(data, fitted)
    if split is None:
        return data, fitted
    data = _with_split(data, split)
    return refit_with_rebuilt_motion(data, fitted, NEXT_ITERATIONS)


def _with_split(data: Data, split: NoiseSplit) -> Data:
    """Records whose torque has the sensor's noise and that of the process apart."""
    return replace(data, noise_nm=split.sensor_nm, colour=split.colour, path=replace(data.path, acts=split.acts, process=split.process))


def _roughness(fitted: Fitted) -> float:
    """Deviation of the white noise that the whitened residual's differences are of, 1 where the noise is right; 1 where none tell.

    Between every second value white noise is as rough as between neighbours; what grows with the distance has a colour.
    """
    parts = np.split(fitted.residual, fitted.problem.ends[1:-1])
    found = []
    for apart in (1, 2):
        differences = [np.zeros(0)]
        for piece, values in zip(fitted.problem.pieces, parts, strict=True):
            for first in range(apart):
                at, white = piece.value_samples[first::apart], values[first::apart]
                together = at[ORDER:] - at[:-ORDER] == ORDER * piece.group * apart
                differences.append(np.diff(white, ORDER)[together] if len(at) > ORDER else np.zeros(0))
        joined = np.concatenate(differences)
        found.append(white_noise_deviation(joined) if len(joined) >= FEWEST else math.inf)
    near, far = found
    return near if far < ALIKE * near else 1.0


def _residuals(fitted: Fitted) -> list[Array]:
    """Residual of each segment as it is, (n,) N m."""
    return [fitted.problem.balance(i, fitted.x, OFFSET_M * o).residual for i, o in enumerate(fitted.offsets)]


def _refit_with_reversals(data: Data, fitted: Fitted, *, fixed: Sequence[str] = ()) -> tuple[Data, Fitted]:
    """The fit with the samples in which the motor passes through a reversal; as it was where these do not fit to the others.

    Friction that needs a way to turn round, or is higher at low speed, is seen there first and would pull at all parameters.
    """
    if data.substeps != PUBLISHED_SUBSTEPS or not turns_at_once(fitted.model) or fitted.ratio > UNEXPLAINED:
        return data, fitted
    ahead = remade(data, fitted.model, OFFSET_M * fitted.offsets, PUBLISHED_SUBSTEPS, reversals=True)
    more = fit(ahead, fitted.model, LAST_ITERATIONS, offsets=fitted.offsets, fixed=fixed)
    added = np.concatenate([(a.keep & ~b.keep)[a.value_samples] for a, b in zip(ahead.fitted, data.fitted, strict=True)])
    squares = more.residual**2
    if not added.any() or added.all() or float(np.mean(squares[added])) > REVERSAL_MISFIT * max(1.0, float(np.mean(squares[~added]))):
        return data, fitted
    known = with_intervals(fitted).parameters
    for name in more.problem.free:
        half = known[name].interval
        if half and not name.startswith(RUBBING) and abs(more.model[name] - fitted.model[name]) > MOST_MOVED * half:
            return data, fitted
    return ahead, more


def refit_with_rebuilt_motion(
    data: Data, fitted: Fitted, iterations: int, substeps: int = SUBSTEPS, *, fixed: Sequence[str] = ()
) -> tuple[Data, Fitted]:
    """Motion and noise rebuilt by a fitted model, and the model fitted to them; as they were where nothing comes of it.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        By the motion as it is in ``data``.
    iterations : int
        At most.
    substeps : int
        Of a sample, for the rebuilt motion.
    fixed : sequence of str
        Parameters that are held, by full name.

    Returns
    -------
    tuple of Data and Fitted
        As they came where fewer than ``LEAST_LEFT`` of the samples are left, or the error grows.
    """
    ahead = remade(data, fitted.model, OFFSET_M * fitted.offsets, substeps)
    left, before = (sum(np.count_nonzero(piece.keep) for piece in which.fitted) for which in (ahead, data))
    if not before or left < LEAST_LEFT * before:
        return data, fitted  # by a model that is far off the motor rests nearly all the time
    begun = fitted
    for _ in range(ROUNDS if needs_observer(fitted.model) else 0):
        begun = fit(ahead, begun.model, AT_A_TIME, fixed=fixed)
        calmer = with_process_noise(ahead, begun.model)  # what a better model does not tell is less
        if calmer.fitted[0].process_noise == ahead.fitted[0].process_noise:
            found = resume_fit(ahead, begun, iterations)
            break
        ahead = calmer
    else:
        found = fit(ahead, begun.model, iterations, offsets=begun.offsets, fixed=fixed)
    for piece in (*data.fitted, *data.held_out):
        piece.motion.forget()  # these records are looked at as they were once more at most
    # Behind an observer a light body may fly off; a motion rebuilt by a model far off makes it worse.
    first = fitted.problem.pieces[0]
    louder = first.noise_nm / (first.noise_factor * data.noise_nm)  # the same error over a noise that is known better now
    now, then = ratio_in_groups_of(found, fitted), ratio_in_groups_of(fitted, found)
    sound = math.isfinite(found.objective) and now < WORSE * then * max(louder, 1.0)
    return (ahead, found) if sound else (data, fitted)


def in_groups_of(data: Data, fitted: Fitted, like: Data) -> tuple[Data, Fitted]:
    """Records and fit with as many neighbours in each value as other records have: else the two see other frequencies.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    like : Data
        The same stretches, as a model sees them that is held against this one.
    """
    ahead = grouped_like(data, like)
    return (data, fitted) if ahead is data else (ahead, fit(ahead, fitted.model, 0, offsets=fitted.offsets))


def ratio_in_groups_of(one: Fitted, other: Fitted) -> float:
    """Error over the noise of one fit where as many neighbours make a value as in another: else they see other frequencies.

    Parameters
    ----------
    one : Fitted
        Whose error is asked.
    other : Fitted
        Whose groups count, of the same records.

    Returns
    -------
    float
        rms of the whitened residual, 1 at the noise.
    """
    parts = np.split(one.residual, one.problem.ends[1:-1])
    squares = [
        (replace(piece, group=beside.group).group_sums(white) if piece.group == 1 else white) ** 2
        for white, piece, beside in zip(parts, one.problem.pieces, other.problem.pieces, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares))))
