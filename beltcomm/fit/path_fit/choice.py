"""Choice between setpoint and reading as the torque that acts: by the motion, before any effect is looked for.

Setpoint and reading tell the chain of drive and reading together (``torque.reading_fit``); each filter, and what of the delay is no whole
sample, may lie before the acting torque or behind it.  Each such split is fitted to the liveliest records, and the one that explains the
motion best is taken.  A faithful reading that leaves nothing but noise needs no comparison.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array
from beltcomm.fit.estimate import Fitted, fit, fit_of, problem_of
from beltcomm.fit.noise.level import is_held, repeats_itself
from beltcomm.fit.path_fit.late_motion import RUBS, effect_between, rubs_instead
from beltcomm.fit.path_fit.trial_paths import (
    LATE_SHARES,
    LOOP_SHARES,
    SWITCHING,
    families_without_setpoint,
    instantaneous_paths,
    kind_of,
    lookalikes,
    times_tried,
    ways_of,
)
from beltcomm.fit.path_fit.values import columns_of, refine_path
from beltcomm.fit.records import Data, grouped_like, prepare_records, rounding_torque
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.torque.reading_fit import COMMAND, WHOLE, ReadingFit, clear_gain, hidden_chains, unlikely_readings
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Times its lower bound up to which an inertia is nothing.
NOTHING = 10.0
#: Error over the noise up to which a faithful reading is not doubted.
GOOD = 1.05
#: Error over the noise from which on a filter is looked for that the noise of the reading hides.
HIDDEN = 1.1
#: Error over the noise from which on more than a path is missing.
FAR_OFF = 2.0
#: Largest value over the rms up to which what a reading leaves is rounding of setpoint and reading (2.45), and share of the torque of that.
BOUNDED, HARDLY = 2.6, 0.01
#: s of records that the splits are held against, and iterations of each fit.
ENOUGH_S, ITERATIONS = 8.0, 15
#: Share of a record's samples that must count for it to be one of these.
LEAST_COUNTING = 0.02
#: O per sample above the best that no values of a path make good.
BEHIND = 0.2
#: Kinds of split, the best by values of the reading alone, whose values the motion is asked for before one is taken.
REFINED = 3
#: Things not ideal that a path may have where no setpoint was recorded.
MOST_WITHOUT_SETPOINT = 3
#: Share that is new in each sample of a reading whose filter hardly shows.
NEARLY_NEW = 0.9
#: Rounding of a torque of acceleration over the torque from which on the motion does not tell a path.
ILLEGIBLE = 10.0
#: Step of ln(time constant) for the curvature of O.
APART = 0.03
#: Samples that must count for a path to be told.
FEWEST = 200
#: Share of the values by the plain path that must count by another one.
LEAST_LEFT = 0.5
#: Share of what lies above the noise that a split other than the faithful one must explain.
EXPLAINED = 0.3


@dataclass(frozen=True)
class PathChoice:
    """The chosen torque path, and how it was chosen.

    Attributes
    ----------
    path : TorquePath
        The one taken.
    reading : ReadingFit or None
        The chain of setpoint and reading, None without setpoint.
    fitted : Fitted or None
        What the path was tried with.
    rivals : tuple of tuple[TorquePath, float]
        The others, with -2 ln L above that of the one taken.
    between : str
        Effect with which the path is to be told: one between reading and motion, with which another path is likelier than this one without,
        or friction at the carriage; empty for none.
    """

    path: TorquePath
    reading: ReadingFit | None
    fitted: Fitted | None = None
    rivals: tuple[tuple[TorquePath, float], ...] = ()
    between: str = ""


def reads_command(chain: ReadingFit | None, recordings: Sequence[Recording]) -> bool:
    """True if the readings are the setpoint that comes back, without noise.

    Parameters
    ----------
    chain : ReadingFit or None
        Fitted from setpoint to reading; None where none was.
    recordings : sequence of Recording
        Of the run.
    """
    if chain is None:
        return repeats_itself(recordings) or is_held(recordings)
    scale = max(float(np.sqrt(np.mean(r.torque**2))) for r in recordings)
    return chain.rest_nm <= COMMAND * scale or (chain.crest_factor < BOUNDED and chain.rest_nm <= HARDLY * scale)


def _without_inertia(model: Model) -> bool:
    """True where a rigid model lacks so much that its inertia went to nothing: then motion and torque share nothing that could be late."""
    inertia = model.parameters["motor.inertia"]
    return "cart" not in model.base_bodies and inertia.low < inertia.high and inertia.value < NOTHING * inertia.low


def choose_path(data: Data, fitted: Fitted, start: Model, chain: ReadingFit | None) -> PathChoice:
    """The path of the records.

    Parameters
    ----------
    data : Data
        The records.
    fitted : Fitted
        By the reading, or the command, taken for the torque that acts.
    start : Model
        Model that the fits begin from.
    chain : ReadingFit or None
        :func:`fit_reading`.
    """
    to_fit = [r for r in data.recordings if not r.sidecar.held_out]
    if chain is not None and reads_command(chain, to_fit):
        return _by_motion(data, fitted.model, to_fit, chain)
    faithful = TorquePath(chain.law if chain is not None else None)
    shaped = chain is not None and (bool(chain.law.lags) or abs(chain.law.delay - round(chain.law.delay)) > WHOLE)
    if chain is None:
        if _without_inertia(fitted.model) or (fitted.ratio <= GOOD and not _motion_asks_for_path(data, fitted)):
            return PathChoice(faithful, chain)
        return _by_motion(data, fitted.model, to_fit, chain) if data.path.commanded else _undone(data, start, to_fit)
    if (fitted.ratio <= GOOD and not shaped) or _illegible(data, start):
        return PathChoice(faithful, chain)
    lively = _liveliest(data, to_fit)
    other = next((rival for rival in sorted(chain.rivals, key=lambda rival: rival.cost) if rival.at_end != chain.at_end), None)
    sample_s = lively[0].sample_period_s
    ways = ways_of([(one.law, one.at_end) for one in (chain, other) if one is not None], sample_s)
    if not any(path.reading.faithful for path in ways):
        ways.append(faithful)
    trials = _possible(_fit_ways(data, lively, start, [*ways, *instantaneous_paths()]), sample_s)
    by = partial(_fit_by, data, lively)
    if trials[0][1].ratio > FAR_OFF and rubs_instead(by, start, trials[0][1], [path for path, _ in trials]):
        return replace(_best(trials, chain), between=RUBS)
    trials, hidden = _refine_kinds(data, lively, trials), list[TorquePath]()
    if trials[0][1].ratio > HIDDEN:
        hidden = ways_of([(one.law, one.at_end) for one in hidden_chains(to_fit, chain)], sample_s, beside=ways)
        beyond = _refine_kinds(data, lively, _fit_ways(data, lively, start, hidden))
        beyond = [trial for trial in beyond if trial[1].ratio <= FAR_OFF]  # seen by the motion alone: not with a model that lacks more
        hidden, trials = [path for path, _ in beyond], sorted([*trials, *beyond], key=lambda trial: _level(trial[1]))
    less_likely = {other.at_end: other.cost - chain.cost} if other is not None else {}
    choice = _best_shape(data, lively, _best(trials, chain, less_likely=less_likely))
    if choice.fitted is None or choice.fitted.ratio <= (GOOD if hidden else FAR_OFF):  # with such an effect no filter may be hidden
        return choice
    others = [path for path in ways if path != choice.path]
    clear = clear_gain(choice.fitted.problem.samples)
    return replace(choice, between=effect_between(by, start, choice.path, choice.fitted, others, clear))


def _refine(data: Data, recordings: Sequence[Recording], path: TorquePath, fitted: Fitted) -> tuple[TorquePath, Fitted]:
    """A path with its values as motion and reading together have them, and the fit by it."""
    ahead, found = refine_path(_by_path(data, recordings, fitted.model, path), fitted)
    return ahead.path, found


def _refine_kinds(
    data: Data, recordings: Sequence[Recording], trials: Sequence[tuple[TorquePath, Fitted]]
) -> list[tuple[TorquePath, Fitted]]:
    """Trials, the best first, with the best of each kind refined: those of one kind share the same values."""
    kinds, found = set[tuple[object, ...]](), list[tuple[TorquePath, Fitted]]()
    for path, fitted in trials:
        kind = kind_of(path, recordings[0].sample_period_s)
        found.append((path, fitted) if kind in kinds or len(kinds) >= REFINED else _refine(data, recordings, path, fitted))
        if not path.instantaneous:  # one of its own, beside which those of a held torque have their chance
            kinds.add(kind)
    return found


def _illegible(data: Data, start: Model) -> bool:
    """True where the rounding of the acceleration hides all that a torque does within a few samples."""
    feigned = [rounding_torque(start.driven_inertia(), data.step_rad, piece.motion.sample_s) for piece in data.fitted]
    return all(nm > ILLEGIBLE * float(np.std(piece.torque)) for nm, piece in zip(feigned, data.fitted, strict=True))


def _best_shape(data: Data, recordings: Sequence[Recording], choice: PathChoice) -> PathChoice:
    """The choice with the law of its drive as the motion asks for it, among those that the reading cannot tell apart."""
    drive = choice.path.drive
    if drive is None or choice.fitted is None:
        return choice
    behind, commanded = choice.path.reading, choice.path.commanded
    plain = behind == ReadingLaw(at_end=behind.at_end) and not commanded  # else what explains the reading is not all the drive's
    rivals = [rival.law for rival in choice.reading.rivals if rival.at_end == behind.at_end] if choice.reading and plain else []
    laws = [law for law in rivals if len(law.lags) <= max(len(drive.lags), 1)] + lookalikes(drive, recordings[0].sample_period_s)
    trials = [replace(choice.path, drive=law) for law in laws if law != drive]
    if not trials:
        return choice
    fits = [(path, fit(_by_path(data, recordings, choice.fitted.model, path), choice.fitted.model, ITERATIONS)) for path in trials]
    path, best = _refine(data, recordings, *min(fits, key=lambda trial: _level(trial[1])))
    samples, more = best.problem.samples, _values(path.drive or drive) - _values(drive)
    price = max(more, 0) * clear_gain(samples)
    if not commanded:  # the readings have a say, too
        before, after = unlikely_readings([choice.path, path], recordings)
        price += after - before
    gain = samples * (_level(choice.fitted) - _level(best)) / max(choice.fitted.ratio, 1.0) ** 2
    return replace(choice, path=path, fitted=best) if gain > price else choice


def _values(law: DriveLaw) -> int:
    """Number of parameters of a law."""
    return sum(len(lag.values) for lag in law.lags) + (abs(law.delay - round(law.delay)) > WHOLE)


def _liveliest(data: Data, recordings: Sequence[Recording]) -> list[Recording]:
    """Records whose torque changes most, :data:`ENOUGH_S` of them; not those of which hardly a sample counts.

    A controller behind a coarse encoder shakes the torque of the slowest stroke most, and the motor rests between the counts.
    """
    order = sorted(recordings, key=lambda r: -float(np.mean(np.diff(r.torque) ** 2)) / r.sample_period_s)
    counting = [r for r in order if _counting_share(data, r) >= LEAST_COUNTING]
    chosen, seconds = list[Recording](), 0.0
    for recording in counting or order:
        if seconds < ENOUGH_S:
            chosen.append(recording)
            seconds += float(recording.t_s[-1] - recording.t_s[0])
    return chosen


def _counting_share(data: Data, recording: Recording) -> float:
    """Share of a record's samples of which the values of a fit are made."""
    return sum(piece.group * len(piece.value_samples) for piece in data.fitted if piece.record == recording.name) / len(recording.t_s)


def _fit_by(
    data: Data, recordings: Sequence[Recording], start: Model, path: TorquePath, worth: float = math.inf, near: Fitted | None = None
) -> Fitted:
    """The base model fitted to some records by one path, and once more with the motion rebuilt; once where it begins near.

    worth : O per sample, above which the path does not matter; its search ends where it does not get there.   near : by another path; where
    it leaves little, the search begins there, and its motion is that of this one.
    """

    def fitted(model: Model, offsets: Array | None = None) -> Fitted:
        ahead = _by_path(data, recordings, model, path)
        problem = problem_of(ahead, model)
        return fit_of(problem, ahead, ITERATIONS, offsets=offsets, goal=worth * max(problem.samples, 1))

    if near is not None and near.ratio <= FAR_OFF:
        return fitted(near.model, near.offsets)
    found = fitted(start)
    if _level(found) > worth:
        return found
    better = fitted(found.model, found.offsets)
    return better if better.objective / max(better.problem.samples, 1) < found.objective / max(found.problem.samples, 1) else found


def _fit_ways(
    data: Data, recordings: Sequence[Recording], start: Model, ways: Sequence[TorquePath], near: Fitted | None = None
) -> list[tuple[TorquePath, Fitted]]:
    """Fits by some paths, the best first; one far behind the best before it is not fitted to its end.   near : as of ``_fit_by``."""
    trials, least = list[tuple[TorquePath, Fitted]](), math.inf
    for path in ways:
        trials.append((path, _fit_by(data, recordings, start, path, least + BEHIND, near)))
        least = min(least, _level(trials[-1][1]))
    return sorted(trials, key=lambda trial: _level(trial[1]))


def _possible(trials: Sequence[tuple[TorquePath, Fitted]], sample_s: float) -> list[tuple[TorquePath, Fitted]]:
    """Trials in their order; of those by a torque that changes all the time the best, for its instant is fitted, where it can be."""
    best = min((trial for trial in trials if trial[0].instantaneous), key=lambda trial: _level(trial[1]), default=None)
    return [trial for trial in trials if not trial[0].instantaneous or (trial is best and trial[0].can_be_undone(sample_s))]


def _by_path(data: Data, recordings: Sequence[Recording], model: Model, path: TorquePath) -> Data:
    """Some of the records by a path, in groups that are the same for all paths: O of others is of other frequencies."""
    return grouped_like(prepare_records(recordings, model, data.noise_nm, data.step_rad, {}, path=path, colour=data.colour), data)


def _level(fitted: Fitted, first: Fitted | None = None) -> float:
    """O per sample; inf where nothing counts, or much less than by another path: by a wrong one the motor may rest nearly all the time."""
    fewest = LEAST_LEFT * _counting(first) if first is not None else FEWEST
    return fitted.objective / fitted.problem.samples if _counting(fitted) > fewest and fitted.problem.samples else math.inf


def _counting(fitted: Fitted) -> int:
    """Samples that count, whatever they are grouped by."""
    return sum(int(np.count_nonzero(piece.keep)) for piece in fitted.problem.pieces)


def _best(
    trials: Sequence[tuple[TorquePath, Fitted]],
    chain: ReadingFit | None,
    *,
    plain_first: bool = False,
    less_likely: Mapping[bool, float] = MappingProxyType({}),
) -> PathChoice:
    """The split with the least O; a faithful one unless another is clearly better.

    plain_first : the first trial is the one that stays, whatever else is faithful.   less_likely : -2 ln L of setpoint and reading above
    the least, by whether the reading is the torque at the end of the period.
    """
    usual = trials[:1] if plain_first else [trial for trial in trials if trial[0].reading.faithful and not trial[0].instantaneous]
    faithful, first = min(usual, key=lambda trial: _level(trial[1]))
    samples = first.problem.samples
    path, best = min(trials, key=lambda trial: _level(trial[1], first) + less_likely.get(trial[0].reading.at_end, 0.0) / max(samples, 1))
    gain = samples * (_level(first) - _level(best))
    above = samples * (_level(first) - 1.0)
    if gain <= clear_gain(samples) or gain < EXPLAINED * above:
        path, best = faithful, first
    rivals = tuple((other, samples * (_level(found, first) - _level(best))) for other, found in trials if other is not path)
    sample_s = best.problem.pieces[0].motion.sample_s
    near = [other for other, above in rivals if above <= clear_gain(samples) and _differ(other, path, sample_s)]
    return PathChoice(replace(path, rivals=tuple(near)), chain, best, rivals)


def _differ(one: TorquePath, other: TorquePath, sample_s: float) -> bool:
    """True if by two paths the torque acts at different times."""

    def ahead_s(path: TorquePath) -> float:
        if path.without_setpoint or path.drive is None:
            return path.reading.delay_s(sample_s)
        return -path.drive.delay_s(sample_s)

    return abs(ahead_s(one) - ahead_s(other)) > WHOLE * sample_s


def _best_time_constant(
    data: Data,
    recordings: Sequence[Recording],
    start: Model,
    first: Fitted,
    path_of: Callable[[float, float], TorquePath],
) -> tuple[TorquePath, Fitted]:
    """The best time constant of a family of paths, with its interval from the curvature of O.   first : by the plain one.

    path_of : of a time constant and half its interval at 95 %, s.
    """

    def level(logarithm: float) -> float:
        return _level(_fit_by(data, recordings, start, path_of(math.exp(logarithm), 0.0), near=first), first)

    grid = np.log(times_tried(recordings[0].sample_period_s))
    levels = [level(float(x)) for x in grid]
    at = int(np.argmin(levels))
    low, high = grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)]
    found = minimize_scalar(level, bounds=(low, high), method="bounded", options={"xatol": 0.02, "maxiter": 6})
    best, here = (float(found.x), float(found.fun)) if found.fun < levels[at] else (float(grid[at]), levels[at])
    below, above = level(best - APART), level(best + APART)
    curved, half = above - 2.0 * here + below, 0.0
    if 0.0 < curved < math.inf:  # the vertex of the parabola through three of them
        best += min(max(0.5 * APART * (below - above) / curved, -APART), APART)
        half = NORMAL_95 * APART * math.sqrt(2.0 / (first.problem.samples * curved))
    path = path_of(math.exp(best), half * math.exp(best))
    return path, _fit_by(data, recordings, start, path, near=first)


def _undone(data: Data, start: Model, to_fit: Sequence[Recording]) -> PathChoice:
    """Without setpoint: what the motion asks for of a drive and a reading that are not ideal, one thing after the other."""
    lively = _liveliest(data, to_fit)
    families = families_without_setpoint(lively[0].sample_period_s)
    path = TorquePath(without_setpoint=True)
    choice = PathChoice(path, None, _fit_by(data, lively, start, path))
    for number in range(MOST_WITHOUT_SETPOINT):
        assert choice.fitted is not None
        if number and choice.fitted.ratio <= GOOD:
            break
        tried = [_best_value(data, lively, start, choice, paths) for family in families if (paths := family(choice.path))]
        tried = _possible(tried, lively[0].sample_period_s)
        tried.sort(key=lambda trial: _level(trial[1], choice.fitted))
        trials = _refine_kinds(data, lively, tried)
        further = _best([(choice.path, choice.fitted), *trials], None, plain_first=True)
        if further.fitted is choice.fitted:
            return further if choice.path == path else choice
        choice = further
    return choice


def _best_value(
    data: Data, recordings: Sequence[Recording], start: Model, first: PathChoice, paths: Sequence[TorquePath]
) -> tuple[TorquePath, Fitted]:
    """The best of some paths, and the fit by it."""
    return min(_fit_ways(data, recordings, start, paths, first.fitted), key=lambda trial: _level(trial[1], first.fitted))


def _motion_asks_for_path(data: Data, fitted: Fitted) -> bool:
    """True where the motion asks for a loop inside the period, or for a reading that is late or filtered, to first order."""
    sample_s = data.recordings[0].sample_period_s
    late, filtered = ReadingLaw(LATE_SHARES[0]), ReadingLaw(0.0, (Lag("sampled", (NEARLY_NEW,)),))
    loop = DriveLaw(0.0, (Lag("first order", (LOOP_SHARES[0] * sample_s,)),))
    drives = (TorquePath(law, without_setpoint=True) for law in (loop, DriveLaw(SWITCHING[0])))
    for path in (*drives, TorquePath(None, late), TorquePath(None, filtered)):
        columns = columns_of(replace(data, path=path), fitted)
        if columns is not None and np.any(columns):
            near = fitted.local_quadratic.best(columns=columns)
            gain = fitted.local_quadratic.objective - near.objective
            if near.amounts[0] > 0.0 and gain > clear_gain(fitted.problem.samples):
                return True
    return False


def _by_motion(data: Data, start: Model, to_fit: Sequence[Recording], chain: ReadingFit | None) -> PathChoice:
    """The reading is the command: what lies between it and the torque is told by the motion alone."""
    lively, law = _liveliest(data, to_fit), DriveLaw(0.0) if chain is None else chain.law
    plain, sample_s = TorquePath(law, commanded=True, without_setpoint=chain is None), lively[0].sample_period_s

    def behind(time_s: float, half_s: float) -> TorquePath:
        return replace(plain, drive=replace(law, lags=(*law.lags, Lag("first order", (time_s,), (half_s,)))))

    def later(time_s: float, half_s: float) -> TorquePath:
        return replace(plain, drive=replace(law, delay=law.delay + time_s / sample_s, delay_interval=half_s / sample_s))

    commands_nm = [r.torque if r.torque_setpoint is None else r.torque_setpoint for r in lively]
    swing = max(float(np.abs(np.diff(command)).max()) for command in commands_nm)

    def limited(time_s: float, half_s: float) -> TorquePath:
        limit = Lag("slew rate", (swing / time_s,), (half_s * swing / time_s**2,))
        return replace(plain, drive=replace(law, lags=(*law.lags, limit)))

    first = _fit_by(data, lively, start, plain)
    families = (behind, later, limited) if swing > 0.0 else (behind, later)
    trials = [(plain, first), *(_best_time_constant(data, lively, start, first, family) for family in families)]
    return _best_shape(data, lively, _best(trials, chain, plain_first=True))
