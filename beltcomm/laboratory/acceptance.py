"""Acceptance of an effect: whether what it explains is enough to name it.

    share = 1 - exp(-drop/N)   of the squares, or   drop/(O - floor)   of the objective; the larger one counts

O is a logarithm far above the noise: there every share of it is small, and what counts is by how much the squares fall.

An effect of the torque path bends the reported torque itself.  Bent to nothing, it would fit everything: a density that is seen
through acting = g(reported) has the factor |g'|, so O has -2 Σ ln g' more.  A lag of the reading smooths the encoder's rounding:
its noise is less, and what is left over must be less, too.

Whatever it explains in units of the noise, an effect must lower the plain error (``plain_error``) as well, of the fitted records and of
those held out.  Where the error over the noise falls it may rise by 2 %, which nobody reads off.

Values of added effects speak against them, too: a bound that was met, numbers that nothing is known of, values that no machine has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from beltcomm.effects import Effect
from beltcomm.fit.band_error import changes
from beltcomm.fit.estimate import BLOCK_S, Fitted
from beltcomm.fit.likelihood.problem import Problem
from beltcomm.fit.noise.level import TOO_LITTLE
from beltcomm.fit.records import PUBLISHED_SUBSTEPS, Data, group_of, with_whitener
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.segment import Segment
from beltcomm.model import Model, effect_parameters
from beltcomm.simulate.inverse import acting_torque, true_motion

#: O per sample that no healthy machine falls below: measured on simulated healthy machines (tests/benchmarks), 0.985 to 1.012, where
#: it holds for any noise because the residual is in units of it.
FLOOR = 0.97
#: Evidence that the best of all effects must have; of 114 healthy machines that thresholds were set on one reached 109, the next 24.
EVIDENCE = 120.0
#: Damping ratio of a load on its shaft from which on it shows no resonance; couplings have 0.01 to 0.1.
OVERDAMPED = 0.5
#: Share of the misfit above the floor that a named effect must explain, and loss on held-out records beyond which it is refused,
#: as a share of the evidence.
EXPLAINED, HELD_OUT_LOSS = 0.10, 0.1
#: Rise of -2 ln L of records held out that is no chance.
BY_CHANCE = 10.0
#: Share that is enough where the held-out records confirm it: there each sample gains at least this share of what a fitted one does.
CONFIRMED_EXPLAINED, CONFIRMED_GAIN = 0.05, 0.5
#: Share of what lies above the noise on held-out records below which they speak for an effect, whatever a bad place of the others does.
HELD_FALLS = 0.5
#: Distance from a bound, relative to it, that is none.
CLOSE = 1e-6
STIFFNESS = "belt_stiffness.stiffness"
#: Delays in a row: what they do to a phase adds up, at low frequency only as their sum; and share of the smaller one of two opposite ones
#: below which their sum is nothing.
DELAYS, CANCELLED = ("dead_time", "current_lag", "measurement_lag"), 0.5
#: Share of the squares below which such a delay is what a torque path with filters leaves, whose shapes are few: of delays that were
#: there 0.60 at least in 200 draws, of those that were not mostly 0.37 at most.
PATH_LEFT = 0.45
#: Step by which the torque is raised to see how far the path passes it on, as a share of its largest value.
STEP = 1e-4


def explained_share(drop: float, base: Fitted) -> float:
    """Share of the objective above the noise that a fall explains.

    Parameters
    ----------
    drop : float
        Fall of the objective.
    base : Fitted
        Fitted without the effect.
    """
    above = base.objective - FLOOR * base.problem.samples
    squares = 1.0 - math.exp(-max(drop, 0.0) / base.problem.samples)
    return max(drop / above if above > 0.0 else 0.0, squares)


def enough(evidence: float, explained: float, drop: float, held_out_gain: float, base: Fitted) -> bool:
    """True if an effect may be named.

    Parameters
    ----------
    evidence : float
        Fall of the objective less its penalty.
    explained : float
        As of :func:`explained_share`.
    drop : float
        Fall of the objective.
    held_out_gain : float
        That of the records held out.
    base : Fitted
        Fitted without the effect.
    """
    if evidence <= EVIDENCE or is_refuted(evidence, held_out_gain, base.held_out_share):
        return False
    held = sum(len(r) for r in base.held_out_residuals)
    confirmed = held > 0 and held_out_gain / held > CONFIRMED_GAIN * drop / base.problem.samples
    return explained > (CONFIRMED_EXPLAINED if confirmed else EXPLAINED)


def share_left(before: Fitted, after: Fitted) -> float:
    """Share of the squares above the noise that is left, of the fitted records; of those held out where less than half is left there.

    O forgives bad places, which may fall while the error as a whole stays or grows.

    Parameters
    ----------
    before : Fitted
        Without the effect.
    after : Fitted
        With it.
    """
    held = (
        _mean_left(before.held_out_ratio, after.held_out_ratio)
        if before.held_out_ratio is not None and after.held_out_ratio is not None
        else 1.0
    )
    return held if held < HELD_FALLS else _mean_left(before.ratio, after.ratio)


def _mean_left(before: float, after: float) -> float:
    return (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 and after > 1.0 else float(after >= before)


def lowers(data: Data, before: Fitted, after: Fitted, ahead: Data | None = None) -> bool:
    """True if the plain error falls from one model to the next, on the fitted records and on those held out; see :func:`_falls`.

    Parameters
    ----------
    data : Data
    before : Fitted
        Without the change.
    after : Fitted
        With it.
    ahead : Data or None
        Records as the model after sees them, where the one before sees ``data``.
    """
    fitted, held = changes(data, before, after, ahead)
    ratios = (before.held_out_ratio, after.held_out_ratio)
    silent = None in ratios or held[0] == 0.0  # below its own noise it says nothing; the likelihood of the records held out does
    return _falls(fitted, before.ratio, after.ratio) and (silent or _falls(held, *ratios))  # type: ignore[arg-type]


def _falls(change: tuple[float, float], before: float, after: float) -> bool:
    """True if a plain error falls; where it rises by no more than anybody reads off, whether the error over the noise does.

    Such an effect smooths the noise instead where the error ends below what that can leave.
    """
    rise, unread = change
    return rise <= unread and (rise < 0.0 or (after < before and not after < TOO_LITTLE <= before))


def is_confirmed(data: Data, before: Fitted, after: Fitted, ahead: Data | None = None) -> bool | None:
    """True if the held-out records confirm a change of the model; None without any.

    The error over the noise must fall, in the mean square and without its outliers, and the plain error must not rise but by what nobody
    reads off.

    Parameters
    ----------
    data : Data
    before : Fitted
        Without the change.
    after : Fitted
        With it.
    ahead : Data or None
        Records as the changed model sees them; None for those of ``data``.

    Returns
    -------
    bool or None
        By the records that were not fitted.
    """
    if after.held_out_ratio is None or before.held_out_ratio is None or after.held_out_level is None or before.held_out_level is None:
        return None
    if not (after.held_out_level < before.held_out_level and after.held_out_ratio < before.held_out_ratio):
        return False
    return _falls(changes(data, before, after, ahead)[1], before.held_out_ratio, after.held_out_ratio)


def impossible(model: Model) -> list[str]:
    """Inertias of the base and stiffness of the belt that shrank or grew to a bound: no axis is like that, whatever it explains.

    One that is held has no room.

    Parameters
    ----------
    model : Model
        That was fitted.
    """
    solid = [inertia for inertia, body in model.bodies() if body.name in model.base_bodies]
    limits = {name: model.parameters[name] for name in (*solid, STIFFNESS) if name in model.parameters}
    return [name for name, v in limits.items() if v.low < v.high and not v.low * (1.0 + CLOSE) < v.value < v.high * (1.0 - CLOSE)]


def exceeds_bounds(model: Model, effect: Effect) -> bool:
    """True if what scales an effect, its first fitted parameter, grew until it met its bound: no size of the effect is right.

    Parameters
    ----------
    model : Model
        Fitted with the effect.
    effect : Effect
    """
    scale = next((f"{effect.name}.{p.name}" for p in effect.parameters if p.fitted), "")
    if scale not in model.parameters:
        return False
    item = model.parameters[scale]
    if item.low == item.high:
        return False  # held: what there is of it acts elsewhere
    near = CLOSE * (item.high - item.low)
    return item.value >= item.high - near or (item.low < 0.0 and item.value <= item.low + near)


def only_cancels(model: Model, effect: Effect) -> bool:
    """True if an effect is a delay that another one takes back: what both leave of the torque's phase stands for something else.

    Parameters
    ----------
    model : Model
        Fitted with the effect.
    effect : Effect
    """
    own = model.get(f"{effect.name}.time") if effect.name in DELAYS else 0.0
    others = sum(model.get(f"{name}.time") for name in DELAYS if name != effect.name)
    return own * others < 0.0 and abs(own + others) < CANCELLED * min(abs(own), abs(others))


def is_left_by_path(data: Data, before: Fitted, after: Fitted, effect: Effect) -> bool:
    """True if an effect is a delay no larger than what a fitted torque path leaves, where the reading is not the torque that acts.

    Parameters
    ----------
    data : Data
    before : Fitted
        Without the effect.
    after : Fitted
        With it.
    effect : Effect
    """
    told = (effect.name in DELAYS or _is_overdamped(after.model, effect)) and not data.path.read_as_acts
    return told and before.ratio**2 - after.ratio**2 < PATH_LEFT * before.ratio**2


def _is_overdamped(model: Model, effect: Effect) -> bool:
    """True for a load that does not swing on its shaft: what it does to the phase over the whole band a delay does as well."""
    if effect.name != "elastic_shaft":
        return False
    inertia, stiffness, damping = (model[name] for name in ("load.inertia", "elastic_shaft.stiffness", "elastic_shaft.damping"))
    return damping > 2.0 * OVERDAMPED * math.sqrt(stiffness * inertia)


def is_negligible(model: Model, effect: Effect) -> bool:
    """True if an effect was fitted to less than is one.

    A gap of no width: then what explains is the observer that follows the carriage, which forgives other effects.

    Parameters
    ----------
    model : Model
        Fitted with the effect.
    effect : Effect
    """
    return effect.least > 0.0 and model[effect.full_names()[0]] <= effect.least


def is_refuted(evidence: float, held_out_gain: float, share: float) -> bool:
    """True if the held-out records speak against an effect that the fitted ones speak for.

    Few of them cannot lose much: for each value no more than the fitted ones gain for each, but for what chance does.

    Parameters
    ----------
    evidence : float
        By the fitted records.
    held_out_gain : float
        Fall of the objective of the records held out.
    share : float
        Values of the records held out over those fitted.
    """
    won = max(evidence, 0.0)
    return held_out_gain < -min(HELD_OUT_LOSS * won, max(share * won, BY_CHANCE))


def drop_by(base: Fitted, grown: Fitted) -> float:
    """Fall of the objective O from one model to another, with what the likelihood has besides the squares.

    Parameters
    ----------
    base : Fitted
        Without the effect.
    grown : Fitted
        With it, of the same records.

    Returns
    -------
    float
        Above 0 where the second is likelier.
    """
    drop = base.objective - grown.objective
    old, new = _price_of_bending(base.problem, base.x), _price_of_bending(grown.problem, grown.x)
    if _lags(base) != _lags(grown):
        drop += min(0.0, _base_noise(grown))
    elif needs_observer(base.model) != needs_observer(grown.model):
        drop += log_deviations(base.problem.pieces) - log_deviations(grown.problem.pieces)
        grown.problem.forget()
    return drop - (new - old)


def drop_in_means(data: Data, base: Fitted, grown: Fitted) -> float:
    """By how much O falls where neighbours are put together.

    At a steady speed rounding is no white noise, and what smooths it looks like an effect; over some samples together there is less of it.

    Parameters
    ----------
    data : Data
    base : Fitted
        Without the effect.
    grown : Fitted
        With it.

    Returns
    -------
    float, nats
        inf where they are together already.
    """
    groups = {r.name: group_of(r) for r in data.recordings}
    if data.substeps == PUBLISHED_SUBSTEPS or all(piece.group >= groups[piece.record] for piece in base.problem.pieces):
        return math.inf
    levels = []
    for one in (base, grown):
        pieces = [replace(piece, group=max(piece.group, groups[piece.record])) for piece in one.problem.pieces]
        problem = Problem(pieces, one.problem.model, one.problem.free, BLOCK_S)
        levels.append(problem.objective(problem.residual(one.x), one.x))
    return levels[0] - levels[1]


def most_within(smaller: Problem, grown: Fitted, loss: float) -> float:
    """Objective O above which a model loses more than so many nats against one with more effects, by :func:`drop_by`.

    inf where that depends on what is fitted, as it does for effects of the torque path.

    Parameters
    ----------
    smaller : Problem
        Segments and free parameters of the model with fewer.
    grown : Fitted
        Fitted with more.
    loss : float, nats
        That is allowed.
    """
    bends = [e for e in grown.model.effect_list() if e.slot in ("torque_path", "torque_reading") and e.name not in smaller.model.effects]
    if bends:
        return math.inf
    most = grown.objective + loss
    if needs_observer(smaller.model) != needs_observer(grown.model):
        most += log_deviations(grown.problem.pieces) - log_deviations(smaller.pieces)
        grown.problem.forget()
    return most


def log_deviations(pieces: Sequence[Segment]) -> float:
    """2 Σ ln deviation of the innovations, nats: an observer's noise goes with what its model says is closed.

    Parameters
    ----------
    pieces : sequence of Segment
        Segments with observer or whitener.
    """
    total = 0.0
    for piece in pieces:
        noise = piece.observer.watch if piece.observer is not None else piece.whitener
        if noise is not None:
            total += 2.0 * float(np.sum(piece.group_sums(np.log(noise.deviations[piece.keep])))) / math.sqrt(piece.group)
    return total


def _lags(fitted: Fitted) -> bool:
    """True if the model's torque reading lags."""
    return any(effect.slot == "torque_reading" for effect in fitted.model.effect_list())


def _base_noise(grown: Fitted) -> float:
    """Gain of O when a model whose reading lags is judged by its own noise, its smaller deviations counted; nats."""
    before = [replace(piece, group=1) for piece in grown.problem.pieces]
    after = [replace(with_whitener(piece, grown.model), group=1) for piece in before]
    old, new = (Problem(pieces, grown.model, grown.problem.free, BLOCK_S) for pieces in (before, after))
    fall = 0.0
    for one, other in zip(before, after, strict=True):
        if one.whitener is not None and other.whitener is not None:
            fall += 2.0 * float(np.sum(np.log(one.whitener.deviations[one.keep] / other.whitener.deviations[other.keep])))
    return fall - (new.objective(new.residual(grown.x), grown.x) - old.objective(old.residual(grown.x), grown.x))


def _price_of_bending(problem: Problem, x: np.ndarray) -> float:
    """-2 Σ ln g' over the samples that count, nats; 0 for a model that takes the torque as it is reported."""
    if not any(effect.slot == "torque_path" for effect in problem.model.effect_list()):
        return 0.0
    vector, total = problem.full(x), 0.0
    for piece in problem.pieces:
        motion = true_motion(problem.model, piece.motion, vector)
        step = STEP * float(np.abs(piece.torque).max())
        raised, plain = (acting_torque(problem.model, motion, piece.torque + shift, vector) for shift in (step, 0.0))
        passed = (raised - plain)[piece.value_samples] / step
        total -= 2.0 * float(np.sum(np.log(np.maximum(passed, 1e-3))))
    return total


#: An effect counts as found when at least one of its numbers is known to this share of itself: a belt that creeps was imitated by an end
#: pulley and a payload on a spring whose stiffness was 26 ± 40 kN/m.
KNOWN: Final = 0.5


def parameters_at_bounds(model: Model, base: Model) -> list[str]:
    """Parameters of added effects that grew until they met a bound: no size of the effect is right.

    Parameters
    ----------
    model : Model
        With the effects.
    base : Model
        Without them.
    """
    sizes = {name for e in model.effect_list() for name, p in effect_parameters(e).items() if not p.form} - set(base.parameters)
    added = {name: v for name, v in model.parameters.items() if name in sizes and v.low < v.high}
    near = {name: 1e-6 * (v.high - v.low) for name, v in added.items()}
    return [n for n, v in added.items() if v.value >= v.high - near[n] or (v.low < 0.0 and v.value <= v.low + near[n])]


def undetermined_effects(model: Model, base: Model) -> list[str]:
    """Added effects of which no number is known better than to ``KNOWN``: they stand for something else.

    Parameters
    ----------
    model : Model
        With intervals.
    base : Model
        Model without them.
    """
    found = []
    for effect in (e for e in model.effect_list() if e.name not in base.effects):
        own = [model.parameters[name] for name, p in effect_parameters(effect).items() if name not in base.parameters and not p.form]
        free = [p for p in own if p.low < p.high]
        if free and not any(p.interval is not None and p.interval <= KNOWN * abs(p.value) for p in free):
            found.append(effect.name)
    return found


def implausible_effects(model: Model, base: Model) -> list[str]:
    """Added effects whose values no machine has, with the reason.

    Parameters
    ----------
    model : Model
        With the effects.
    base : Model
        Without them.

    Returns
    -------
    list of str
        "EFFECT as REASON".
    """
    found = []
    for effect in (e for e in model.effect_list() if e.name not in base.effects and e.unlikely is not None):
        assert effect.unlikely is not None
        values = {name.removeprefix(f"{effect.name}."): model[name] for name in effect_parameters(effect)}
        if why := effect.unlikely(values):
            found.append(f"{effect.name} as {why}")
    return found
