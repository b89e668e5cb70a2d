"""Score test: how far would the error fall if one more effect were there, with everything else fitted again to first order?

An effect switched on at a typical size changes the whitened residual by a column; ``likelihood.local_quadratic`` says how far the
objective falls with the best amount of it.  Finite changes and not derivatives: right for gap and slack, too.

Effects that repeat with the motor angle have their columns for all orders in one pass.  A torque A sin(N θ) adds its triangular mean to
the load; e^{jNθ} follows from e^{j(N-1)θ} by one multiplication per fine step.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.compiled import compiled
from beltcomm.effects import AxisSummary, Effect, Trial
from beltcomm.fit.estimate import BLOCK_S, Fitted
from beltcomm.fit.likelihood.problem import OFFSET_M, Parts, Problem
from beltcomm.fit.noise.decimation import is_counted, smallest_step
from beltcomm.fit.records import SUBSTEPS
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import in_noise, observed_residuals, whitened_residual, with_observers
from beltcomm.laboratory.acceptance import log_deviations
from beltcomm.laboratory.single_record import explained_elongation, stiffness_at_places
from beltcomm.model import Model, on_side
from beltcomm.simulate.inverse import (
    ENOUGH_LANES,
    FineMotion,
    acting_torque,
    as_read,
    belt_loads,
    motor_load,
    reading_lags,
    true_motion,
)
from beltcomm.simulate.kernels.switchboard import BEFORE_THE_LOAD
from beltcomm.simulate.kernels.writer import acts_on_motor


def _powers_of(number: int) -> Array:
    """sin(0 θ) and cos(0 θ) of so many angles, which :func:`_load_means` and :func:`_gain_means` raise order by order; (2, number)."""
    return np.stack([np.zeros(number), np.ones(number)])


def _load_means(piece: Segment, powers: Array, orders: int) -> Iterator[tuple[Array, Array]]:
    """Triangular means of sin(N θ) and cos(N θ) for the next so many orders N, (n,) each, ends 0; ``powers``, (2, fine), are those of the
    last one.
    """
    theta, m = piece.motion.theta, piece.motion.substeps
    sine, cosine = np.sin(theta), np.cos(theta)
    for _ in range(orders):
        means = np.zeros((2, piece.motion.samples))
        load_kernel(sine, cosine, powers[0], powers[1], m, means)
        yield means[0], means[1]


def _gain_means(piece: Segment, powers: Array, orders: int) -> Iterator[tuple[Array, Array]]:
    """Triangular means of torque sin(N θ) and torque cos(N θ), the torque held from sample n to n+1."""
    theta, m = piece.motion.theta, piece.motion.substeps
    middle = 0.5 * (theta[:-1] + theta[1:])
    sine, cosine = np.sin(middle), np.cos(middle)
    for _ in range(orders):
        means = np.zeros((2, piece.motion.samples))
        gain_kernel(sine, cosine, powers[0], powers[1], piece.torque, m, means)
        yield means[0], means[1]


def _line_columns(piece: Segment, inertia: float, lines: float) -> Array:
    """Inertia torque by errors of the angle shown, 1 rad once and twice per line, N m; (n, 4), ends 0.

        J (θ[n+1] - 2 θ[n] + θ[n-1])/T²  of  -sin Nθ, -cos Nθ, -sin 2Nθ, -cos 2Nθ

    A line passes in so short a time that nothing behind the motor follows; at the samples, above half their rate as well.
    """
    once = lines * piece.motion.theta[:: piece.motion.substeps]
    error = np.stack([np.sin(once), np.cos(once), np.sin(2.0 * once), np.cos(2.0 * once)], axis=1)
    columns = np.zeros_like(error)
    columns[1:-1] = -inertia / piece.motion.sample_s**2 * np.diff(error, 2, axis=0)
    return columns


@compiled
def load_kernel(sine: Array, cosine: Array, power_sine: Array, power_cosine: Array, m: int, means: Array) -> None:
    """Raise the powers by one order; their triangular means by Simpson's rule (see ``triangular_mean``).

    Parameters
    ----------
    sine, cosine : ndarray (n,)
        Of the angle, on a grid m times as fine as the samples.
    power_sine, power_cosine : ndarray (n,)
        Of its multiples; changed in place.
    m : int
        Steps of the grid in a sample.
    means : ndarray (2, samples)
        Sine and cosine; filled but for both ends.
    """
    for k in range(sine.shape[0]):
        s, c = power_sine[k], power_cosine[k]
        power_sine[k] = s * cosine[k] + c * sine[k]
        power_cosine[k] = c * cosine[k] - s * sine[k]
    for n in range(1, means.shape[1] - 1):
        middle = n * m
        total_s, total_c = 2.0 * m * power_sine[middle], 2.0 * m * power_cosine[middle]
        for j in range(1, m):
            weight = (4.0 if j % 2 else 2.0) * (m - j)
            total_s += weight * (power_sine[middle - j] + power_sine[middle + j])
            total_c += weight * (power_cosine[middle - j] + power_cosine[middle + j])
        means[0, n] = total_s / (3.0 * m * m)
        means[1, n] = total_c / (3.0 * m * m)


@compiled
def gain_kernel(sine: Array, cosine: Array, power_sine: Array, power_cosine: Array, torque: Array, m: int, means: Array) -> None:
    """Raise the powers by one order, and add their means for held torque, cell by cell; the middle of a cell weighs it.

    Parameters
    ----------
    sine, cosine : ndarray (n,)
        Of the angle, on a grid m times as fine as the samples.
    power_sine, power_cosine : ndarray (n,)
        Of its multiples; changed in place.
    torque : ndarray (samples,), N m
        Held from each sample to the next, motor shaft.
    m : int
        Steps of the grid in a sample.
    means : ndarray (2, samples)
        Sine and cosine, N m; added to, but for both ends.
    """
    for k in range(sine.shape[0]):
        s, c = power_sine[k], power_cosine[k]
        power_sine[k] = s * cosine[k] + c * sine[k]
        power_cosine[k] = c * cosine[k] - s * sine[k]
    for n in range(1, means.shape[1] - 1):
        for j in range(m):
            rising, falling = (n - 1) * m + j, n * m + j
            up, down = torque[n - 1] * (j + 0.5), torque[n] * (m - j - 0.5)
            means[0, n] += (up * power_sine[rising] + down * power_sine[falling]) / (m * m)
            means[1, n] += (up * power_cosine[rising] + down * power_cosine[falling]) / (m * m)


#: Trials whose columns are held at a time, and trials of an effect that are looked at again with bounds and weights of their own.
BATCH, LOOKED_AT = 10, 3
#: Fine steps per sample at most.
ROUGH_SUBSTEPS = 2
#: O per sample from which on an observer is made anew for an effect in one of these slots.
FAR_OFF, BELT_SLOTS = 1.3, ("element", "body", "belt_law")
#: m, values, cells, at most, and factor over the median: cells of the way of which some are told as rough.
ROUGH_CELL_M, ROUGH_VISITS, ROUGH_CELLS, MOST_ROUGH, ROUGH_BY = 0.01, 6, 10, 2, 6.0


@dataclass(frozen=True)
class Scored:
    """One way to switch an effect on, and what it promises.

    Attributes
    ----------
    drop : float
        Of the objective.
    values : dict of str to float
        Own parameters with the amplitudes that the score test wants, to start a refit from. trial.base : parameters of the base model that
        change with it.
    step : ndarray
        How everything fitted gives way, in the units of the problem's unknowns.
    """

    effect: Effect
    trial: Trial
    drop: float
    values: Mapping[str, float]
    step: Array


class Scorer:
    """The score test at one fitted model."""

    def __init__(self, fitted: Fitted) -> None:
        self._powers: dict[str, list[tuple[float, Trial]]] = {}
        self.fitted = fitted
        self.problem: Problem = fitted.problem
        self.model: Model = fitted.model
        self.vector = fitted.problem.full(fitted.x)
        self.offsets = OFFSET_M * fitted.offsets if fitted.problem.movable else np.zeros(len(fitted.problem.pieces))
        self.nearby = fitted.local_quadratic
        # The change by an effect is a difference of two runs: what coarse steps do wrong is in both.
        most = SUBSTEPS if needs_observer(self.model) else ROUGH_SUBSTEPS
        rough_pieces = [replace(p, motion=p.motion.coarser(min(most, p.motion.substeps))) for p in self.problem.pieces]
        self.rough = with_observers(rough_pieces, [self.model] * len(rough_pieces))
        if needs_observer(self.model):
            self.problem.forget()  # the observers of the fine steps: nothing here asks for them any more, and they are large
        rough = Problem(self.rough, self.model, self.problem.free, BLOCK_S)
        self.parts: list[Parts] = [rough.balance(i, fitted.x, float(o)) for i, o in enumerate(self.offsets)]

    def score(self, effect: Effect, ground: AxisSummary) -> list[Scored]:
        """The best trials of an effect that the model can take, best first."""
        if effect.needs_observer:
            return sorted((self._score_observed(effect, trial) for trial in self.trials_of(effect, ground)), key=lambda s: -s.drop)
        scored = [self.score_columns(effect, trial, columns) for _, trial, columns in self.screen(effect, ground)]
        return sorted((s for s in scored if s.drop > 0.0), key=lambda s: -s.drop)

    def screen(self, effect: Effect, ground: AxisSummary) -> list[tuple[float, Trial, Array]]:
        """Rough drop, trial and its columns of the trials to look at again, best first; what all of them show is kept for
        :meth:`powers_of`.
        """
        best: list[tuple[float, Trial, Array]] = []
        seen = self._powers[effect.name] = []
        for some, columns in self.trials(effect, ground):
            width = columns.shape[1] // len(some)
            drops, powers = self.nearby.rough_gains(columns, width, some[0].signed)
            seen += zip(powers.tolist(), some, strict=True)
            best += [(drops[i], trial, columns[:, i * width : (i + 1) * width].copy()) for i, trial in enumerate(some)]
            best = sorted(best, key=lambda entry: -entry[0])
            # Behind an observer of a model that is far off columns say little: what the records told of the base is looked at anyway.
            best = [entry for at, entry in enumerate(best) if at < LOOKED_AT or (entry[1].base and needs_observer(self.model))]
        return best

    def powers_of(self, effect: Effect, ground: AxisSummary) -> Sequence[tuple[float, Trial]]:
        """By how much O would fall if the effect were there as a trial says, and the trial; worked out once."""
        if effect.name not in self._powers:
            self.screen(effect, ground)
        return self._powers[effect.name]

    def trials(self, effect: Effect, ground: AxisSummary) -> Iterator[tuple[list[Trial], Array]]:
        """All trials of an effect and their columns, (n, k), some at a time: those of one trial beside those of the next."""
        trials = [trial for trial in self.trials_of(effect, ground) if not trial.swallowed]
        if effect.harmonic == "angle":
            return self.lines(effect, trials)
        return self._harmonics(effect, trials) if effect.harmonic and len(trials) > 3 else self._batches(effect, trials)

    def trials_of(self, effect: Effect, ground: AxisSummary) -> list[Trial]:
        """Every way to switch an effect on, inside the bounds; of torque that repeats with the angle none finer than its counts show."""
        trials = effect.trials(ground) if effect.trials is not None else []
        if effect.harmonic in ("load", "gain"):
            trials = [trial for trial in trials if trial.values[effect.parameters[0].name] < self._highest_order]
        return [self._clip_to_bounds(effect, trial) for trial in trials]

    @cached_property
    def _highest_order(self) -> float:
        """Periods per turn that are of two counts; inf for an angle that is not counted."""
        steps = [smallest_step(piece.position) for piece in self.problem.pieces if is_counted(piece.position)]
        return math.pi / min(steps) if steps else math.inf  # 0 for an angle that never changes, whose step is infinite

    def _clip_to_bounds(self, effect: Effect, trial: Trial) -> Trial:
        """The trial with its values inside the bounds of this model's side."""
        limits = self.model.parameters_of(effect)
        values = {}
        for name, value in trial.values.items():
            limit = limits.get(f"{effect.name}.{name}") or limits[name]
            values[name] = float(np.clip(value, limit.low, limit.high))
        base = {name: value for name, value in trial.base.items() if name in self.problem.free}
        return replace(trial, values=values, base=base)

    def _batches(self, effect: Effect, trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], Array]]:
        """Trials and their columns, some at a time."""
        for first in range(0, len(trials), BATCH):
            some = list(trials[first : first + BATCH])
            yield some, self.columns(effect, [self.model_with(effect, v, t) for t in some for v in amplitude_columns(t)])

    def _harmonics(self, effect: Effect, trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], Array]]:
        """Score columns for all orders of an effect that repeats with the motor angle."""
        key = effect.parameters[0].name
        wanted = {round(trial.values[key]): trial for trial in trials}
        highest = max(wanted)
        load = effect.harmonic == "load"
        pieces = self.rough if needs_observer(self.model) else self.problem.pieces  # an observer's steps are finer than a ripple asks for
        powers = [_powers_of(len(p.motion.theta) - (not load)) for p in pieces]
        for first in range(1, highest + 1, BATCH):
            orders = range(first, min(first + BATCH, highest + 1))
            some = [wanted[order] for order in orders if order in wanted]
            parts = []
            for i, piece in enumerate(pieces):
                means = np.empty((piece.motion.samples, len(some), 2))
                place, scan = 0, (_load_means if load else _gain_means)(piece, powers[i], len(orders))
                for order, (sine, cosine) in zip(orders, scan, strict=True):
                    if order in wanted:
                        for k, mean in enumerate((sine, cosine)):
                            means[:, place, k] = self._as_read(i, mean) if load else mean
                        place += 1
                parts.append(in_noise(piece, self.model, self.vector, means.reshape(len(means), -1)))
            if some:
                sizes = [(1.0 if load else -1.0) * trial.values[name] for trial in some for name in trial.amplitudes]
                yield some, np.concatenate(parts) * sizes

    def lines(self, effect: Effect, trials: Sequence[Trial]) -> Iterator[tuple[list[Trial], Array]]:
        """Scores of trials for the lines of an encoder, by the torque at the motor, N m, that they ask of its inertia.

        Returns
        -------
        iterator of tuple[list of Trial, ndarray]
            One trial and its columns (n, amplitudes).
        """
        key, inertia = effect.parameters[0].name, self.model["motor.inertia"]
        for trial in trials:
            sizes = [trial.values[name] for name in trial.amplitudes]
            parts = []
            for i, piece in enumerate(self.rough):
                asked = _line_columns(piece, inertia, trial.values[key]).T
                parts.append(in_noise(piece, self.model, self.vector, np.stack([self._as_read(i, one) for one in asked], axis=1)))
            yield [trial], np.concatenate(parts) * sizes

    def score_columns(self, effect: Effect, trial: Trial, columns: Array) -> Scored:
        """One trial by its columns; by what the whole axis does to an error of the angle, where the columns only said which to look at."""
        if effect.harmonic == "angle":
            columns = self.columns(effect, [self.model_with(effect, values, trial) for values in amplitude_columns(trial)])
        if trial.base:
            return self.score_at(effect, trial, trial.values)
        near = self.nearby.best(columns=columns)
        drop = self.nearby.objective - near.objective
        if not trial.signed and not trial.amplitudes and near.amounts[0] <= 0.0:
            drop = 0.0
        return Scored(effect, trial, drop, self._start_values(effect, trial, near.amounts), near.step)

    def _score_observed(self, effect: Effect, trial: Trial) -> Scored:
        """A trial of an effect that needs an observer: what one of its own leaves instead of the residual."""
        grown = self.model_with(effect, trial.values, trial)
        pieces = with_observers(self.problem.pieces, [grown] * len(self.problem.pieces))
        near = self.nearby.best(
            np.concatenate([whitened_residual(piece, grown, grown.vector()) for piece in pieces]) - self.fitted.residual
        )
        drop = self.nearby.objective - near.objective + log_deviations(self.problem.pieces) - log_deviations(pieces)
        return Scored(effect, trial, drop, dict(trial.values), near.step)

    def score_at(self, effect: Effect, trial: Trial, own: Mapping[str, float]) -> Scored:
        """A trial with these own values as they are; amplitudes as the score test wants them."""
        if trial.amplitudes:
            unit = replace(trial, values={**own, **{name: trial.values[name] for name in trial.amplitudes}})
            near = self.nearby.best(columns=self.columns(effect, [self.model_with(effect, v, unit) for v in amplitude_columns(unit)]))
            own = self._start_values(effect, unit, near.amounts)
        else:
            near = self.nearby.best(self.columns(effect, [self.model_with(effect, own, trial)])[:, 0])
        step = near.step.copy()
        for name, value in trial.base.items():
            number = self.problem.free.index(name)
            step[number] += value / self.problem.scale[number] - self.fitted.x[number]
        return Scored(effect, replace(trial, values=own), self.nearby.objective - near.objective, own, step)

    def model_with(self, effect: Effect, own: Mapping[str, float], trial: Trial) -> Model:
        """The model with the effect, and with what the trial changes of the base."""
        bounds = self.model.parameters  # on data that do not fit their axis file a trial may lead beyond what can be
        base = {name: min(max(value, bounds[name].low), bounds[name].high) for name, value in trial.base.items()} if trial.base else {}
        model = self.model.with_values(base, "trial") if base else self.model
        return model.with_effect(effect.name, own)

    def _start_values(self, effect: Effect, trial: Trial, amounts: Array) -> dict[str, float]:
        """Values of the effect with its amplitudes as the score test wants them, inside the bounds."""
        values = dict(trial.values)
        limits = {p.name: on_side(p, self.model.side) for p in effect.parameters}
        if trial.amplitudes:
            for name, amount in zip(trial.amplitudes, amounts, strict=True):
                values[name] = float(np.clip(values[name] * amount, limits[name].low, limits[name].high))
        elif trial.signed:
            first = effect.parameters[0]
            values[first.name] = float(np.clip(values[first.name] * np.clip(amounts[0], -3.0, 3.0), first.low, first.high))
        return values

    def columns(self, effect: Effect, extended: Sequence[Model]) -> Array:
        """Changes of the whitened residual of all pieces, (n, models), when the effect is switched on.

        The ``extended`` models have the effect, and may have another belt.
        """
        vectors = [model.vector() for model in extended]
        if self.rough[0].observer is not None and not (acts_on_motor(effect) and effect.slot != "friction_onset"):
            return self._observed_innovations(effect, extended) - self.innovations_here[:, None]
        parts = [in_noise(piece, self.model, self.vector, self.torques(effect, extended, vectors, i)) for i, piece in enumerate(self.rough)]
        return np.concatenate(parts)

    def torques(self, effect: Effect, extended: Sequence[Model], vectors: Sequence[Array], i: int) -> Array:
        """Changes of the residual of piece i, N m, (n, models), by the values of models that have the effect."""
        motion = true_motion(self.model, self.rough[i].motion, self.vector)
        if acts_on_motor(effect) or effect.slot in BEFORE_THE_LOAD:
            return np.stack([self.change(effect, m, v, i, motion) for m, v in zip(extended, vectors, strict=True)], axis=1)
        loads = belt_loads(extended[0], motion, list(vectors), [float(self.offsets[i])] * len(vectors))
        return np.stack([self._as_read(i, load - self.parts[i].belt) for load in loads.T], axis=1)

    def _observed_innovations(self, effect: Effect, extended: Sequence[Model]) -> Array:
        """Innovations of models that have the effect, over their deviations, (n, models)."""
        # An observer of a model that is far off has lost the carriage; what finds it again needs one of its own.
        anew = effect.slot in BELT_SLOTS and self.fitted.objective > FAR_OFF * self.problem.samples
        # Many models on one piece run in lock step, or few of them on all.
        many = len(extended) >= ENOUGH_LANES
        parts = []
        for pieces in [[piece] for piece in self.rough] if many else [self.rough]:
            every, models = [p for p in pieces for _ in extended], [*extended] * len(pieces)
            found = observed_residuals(with_observers(every, models) if anew else every, extended[0], [model.vector() for model in models])
            parts += [np.stack(found[i : i + len(extended)], axis=1) for i in range(0, len(found), len(extended))]
        return np.concatenate(parts)

    @cached_property
    def innovations_here(self) -> Array:
        """Innovations of the model as it is."""
        return np.concatenate(observed_residuals(self.rough, self.model, [self.vector] * len(self.rough)))

    def change(self, effect: Effect, extended: Model, vector: Array, i: int, motion: FineMotion) -> Array:
        """Change of a piece's residual, N m, (n,), by an effect of the motor, its torque or its angle."""
        piece, old, offset = self.rough[i], self.parts[i], float(self.offsets[i])
        if effect.slot == "sensor":
            return Problem([piece], extended, (), 1.0).balance(0, np.zeros(1), offset).residual - old.residual
        if acts_on_motor(effect) and effect.slot != "friction_onset":
            return self._as_read(i, motor_load(extended, motion, vector, effect.name))
        if acts_on_motor(effect):
            return self._as_read(i, motor_load(extended, motion, vector) - old.motor)
        if effect.slot in ("torque_path", "torque_delay"):
            return old.acting - acting_torque(extended, motion, piece.torque, vector)
        return replace(old, lags=reading_lags(extended, vector)).residual - old.residual

    def _as_read(self, i: int, torque: Array) -> Array:
        """A change of the torque that piece i needs as its reading shows it, N m, (n,)."""
        return as_read(torque, 0.0, self.parts[i].motion.sample_s, self.parts[i].lags)


def amplitude_columns(trial: Trial) -> Iterator[dict[str, float]]:
    """Values of each column: the whole trial, or each of its amplitudes alone.

    Parameters
    ----------
    trial : Trial
        One way to switch an effect on.

    Yields
    ------
    dict of str to float
        By bare name of the parameter.
    """
    if not trial.amplitudes:
        yield dict(trial.values)
        return
    for name in trial.amplitudes:
        yield {key: (0.0 if key in trial.amplitudes and key != name else value) for key, value in trial.values.items()}


def ground_of(fitted: Fitted, pieces: Sequence[Segment], axis: Axis) -> AxisSummary:
    """Summary of the axis for the trials.

    Parameters
    ----------
    fitted : Fitted
        Model that a trial is added to.
    pieces : sequence of Segment
        Segments for speeds, places and torques.
    axis : Axis

    Returns
    -------
    AxisSummary
        SI; torque at the motor shaft, forces along the belt.
    """
    model = fitted.model
    ratio = model["transmission.ratio"]
    places = np.concatenate([piece.motion.theta * ratio for piece in pieces])
    stiffness, mass = model.get("belt_stiffness.stiffness", 1e6), model.get("cart.mass", 1.0)
    pieces = [piece for piece in pieces if piece.motion.samples > 2]
    acceleration = max(float(np.percentile(np.abs(np.diff(p.position, 2)), 99.5)) / p.motion.sample_s**2 for p in pieces)
    return AxisSummary(
        inertia=model["motor.inertia"],
        mass=mass,
        stiffness=stiffness,
        damping=model.get("belt_damping.damping"),
        coulomb=max(model.get("coulomb.level"), 1e-3),
        ratio=ratio,
        low_m=float(places.min()),
        high_m=float(places.max()),
        antiresonance_hz=float(np.sqrt(stiffness / mass) / (2.0 * np.pi)),
        teeth=float(axis.get("pulley.teeth") or 0) / axis.gearbox.ratio,
        peak_nm=max(float(np.abs(piece.torque).max()) for piece in pieces),
        peak_force_n=min(stiffness * 2e-3, max(1.0, mass * ratio * acceleration)),
        offset_m=axis.travel.driven_side_offset_m,
        pulley_distance_m=float(axis.get("belt.pulley_distance_m") or 0.0),
        stiffness_at=stiffness_at_places(fitted),
        fastest=max(float(np.percentile(np.abs(piece.motion.omega), 99.0)) for piece in pieces),
        side=model.side,
        belt="cart" in model.base_bodies,
        toothed=axis.transmission is None,
        gear=axis.gearbox.ratio,
        explained_m=explained_elongation(fitted),
        counts=float(axis.get("motor.encoder_counts_per_rev") or 0),
        step_rad=pieces[0].step_rad,
        rough_m=_rough_places(fitted),
    )


def _rough_places(fitted: Fitted) -> tuple[float, ...]:
    """Places of the load, m, around which a model leaves far more than at most places it has been to, the worst first."""
    problem, ratio = fitted.problem, fitted.model["transmission.ratio"]
    if not problem.samples:
        return ()
    places = np.concatenate([ratio * piece.motion.theta[:: piece.motion.substeps][piece.value_samples] for piece in problem.pieces])
    cell = np.floor((places - places.min()) / ROUGH_CELL_M).astype(np.intp)
    visits = np.bincount(cell)
    known = np.flatnonzero(visits >= ROUGH_VISITS)
    if len(known) < ROUGH_CELLS:
        return ()
    square = np.bincount(cell, fitted.residual**2)[known] / visits[known]
    worst = np.argsort(square)[::-1][:MOST_ROUGH]
    rough = [k for k in worst if square[k] > ROUGH_BY * max(1.0, float(np.median(square)))]
    return tuple(float(places.min() + (known[k] + 0.5) * ROUGH_CELL_M) for k in rough)
