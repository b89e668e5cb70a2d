"""Stepwise selection of effects: forward by score test and refit; backward, where a newer one made an earlier superfluous.

    evidence = O_before - O_after - (n ln N + 2 ln starts),   n : parameters that the effect adds

(Bayes' information criterion with the number of ways that were tried.)  ``explained`` is the share of what lies above the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.compiled import in_one_thread
from beltcomm.configfiles import did_you_mean
from beltcomm.effects import EFFECTS, AxisSummary, Effect, effect_named
from beltcomm.errors import UsageError
from beltcomm.fit.estimate import Fitted, fit, fit_of, problem_of
from beltcomm.fit.least_squares import least_in_band
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.laboratory.acceptance import (
    EVIDENCE,
    STIFFNESS,
    drop_by,
    drop_in_means,
    enough,
    exceeds_bounds,
    explained_share,
    impossible,
    is_left_by_path,
    is_negligible,
    is_refuted,
    lowers,
    most_within,
    only_cancels,
    share_left,
)
from beltcomm.laboratory.law_shape import additions, without
from beltcomm.laboratory.refine import ENOUGH, refine_best
from beltcomm.laboratory.score import Scored, Scorer
from beltcomm.model import Model

#: O per sample above which something is missing: measured as the floor in ``acceptance``.
MISSING = 1.04
#: Effects whose own parameters are searched, and ways of each; effects that are refitted with everything free, and the same where an
#: observer makes that dear.
SEARCHED, WAYS, REFITTED, FOLLOWED_REFITTED = 8, 2, 4, 3
#: An effect that promises less than this share of the best, or less than this many nats, is not searched, or not refitted.  Where an
#: observer makes a search dear the best is the best after those before it were searched.
SEARCH_SHARE, FOLLOWED_SEARCH_SHARE, SEARCH_PROMISE = 0.03, 0.1, 20.0
REFIT_SHARE, REFIT_PROMISE = 0.3, 30.0
#: Evidence by which an effect must be ahead of one with fewer parameters, nats.
SIMPLER = 25.0
#: Share of what lies above the noise from which on an effect explains most of it.
MOSTLY = 0.5
#: Iterations of a refit, also beside an observer and from far away, and the gain that is not worth another one, nats.
ITERATIONS, FOLLOWED_ITERATIONS, SWALLOWED_ITERATIONS = 10, 6, 25
#: Hz below which a weight, a spring or an offset of a rigid axis shows, however coarse its encoder is.
WEIGHED_HZ = 8.0
#: Factor by which masses and stiffness may leave their start values before the search begins there as well.
STRAYED = 1.5


@dataclass(frozen=True)
class Candidate:
    """An effect on trial.

    Attributes
    ----------
    evidence, explained : float
        See the module.
    promised : float
        Drop by the score test.
    fitted : Fitted or None
        With the effect, None where it was not refitted.
    held_out_gain : float
        Drop of O on the held-out records.
    hollow : bool
        It explains much, but only at physically impossible values.
    accepted : bool
        By the rule of this module.
    grows : bool
        It makes the error as a whole larger, from one bad model to the next.
    unneeded : bool
        A carriage that strays as freely without it explains as much, see ``gaps``.
    idle : bool
        The plain error does not fall, of the fitted records or of those held out.
    of_path : bool
        A delay that explains no more than what a fitted torque path leaves, see ``acceptance``.
    beside : str
        Effect that hides it and with which it was judged, see ``gap_behind_delay``; "" where it explains that alone.
    """

    effect: Effect
    promised: float
    evidence: float
    explained: float
    held_out_gain: float
    fitted: Fitted | None
    accepted: bool
    hollow: bool = False
    grows: bool = False
    unneeded: bool = False
    idle: bool = False
    of_path: bool = False
    beside: str = ""

    @property
    def stands(self) -> bool:
        """True if nothing speaks against it: records held out, error as a whole or in plain units, own values, a carriage that strays."""
        return not (self.hollow or self.grows or self.unneeded or self.idle or self._refuted)

    @property
    def _refuted(self) -> bool:
        return self.fitted is not None and is_refuted(self.evidence, self.held_out_gain, self.fitted.held_out_share)

    @property
    def against(self) -> str:
        """Reason in words why it may not be named; "" where it may, or was not fitted."""
        if self.accepted or self.fitted is None:
            return ""
        if self.hollow:
            return "only at physically impossible values"
        if self.grows:
            return "with all fitted again the error as a whole grows"
        if self.unneeded:
            return "a carriage that strays as far without it explains as much"
        if self.idle:
            return "the error in plain units does not fall"
        if self.of_path:
            return "so small a delay may be left by what is known of the torque path"
        if self.evidence <= EVIDENCE:
            return f"evidence below {EVIDENCE:.0f}"
        return "records held out speak against it" if self._refuted else "explains too little"


def search(
    data: Data,
    scorer: Scorer,
    ground: AxisSummary,
    effects: Sequence[Effect] | None = None,
    progress: Callable[[float], None] = lambda _f: None,
    swallowed_above: float = MISSING,
    against: Fitted | None = None,
) -> list[Candidate]:
    """All effects that the model of a score test does not have yet, best first.

    Parameters
    ----------
    data : Data
    scorer : Scorer
        Of the base model.
    ground : AxisSummary
        Of the axis, for the trials.
    effects : sequence of Effect or None
        That are tried; None for the whole catalogue.
    progress : callable
        Hears the share that is done, 0 to 1.
    swallowed_above : float
        O per sample from which on, where nothing explains it, it is asked what the base may have swallowed.
    against : Fitted or None
        Model that the refits must be better than where it is not the base, from which the search begins.
    """
    base = scorer.fitted
    wanted = [e for e in (effects or EFFECTS) if e.trials is not None and not e.bound and ground.may_have(e) and may_add(base, e)]
    ways: dict[str, list[Scored]] = {}
    for number, effect in enumerate(wanted):
        ways[effect.name] = scorer.score(effect, ground)
        progress(0.4 * (number + 1) / len(wanted))
    best = {name: found[0] for name, found in ways.items() if found}
    order = sorted(best, key=lambda name: -_expected_gain(best[name], base, len(ways[name])))
    most = _expected_gain(best[order[0]], base, len(ways[order[0]])) if order else 0.0
    for number, name in enumerate(order[:SEARCHED]):
        if needs_observer(base.model):
            most = max(_expected_gain(best[n], base, len(ways[n])) for n in order)
        share = FOLLOWED_SEARCH_SHARE if needs_observer(base.model) else SEARCH_SHARE
        if _expected_gain(best[name], base, len(ways[name])) > max(SEARCH_PROMISE, share * most):
            best[name] = refine_best(scorer, ways[name], 1 if needs_observer(base.model) else WAYS)
        progress(0.4 + 0.3 * (number + 1) / SEARCHED)
    order = sorted(best, key=lambda name: -_expected_gain(best[name], base, len(ways[name])))
    candidates: list[Candidate] = []
    for number, name in enumerate(order):
        promised = _expected_gain(best[name], base, len(ways[name]))
        found_most = max((c.evidence for c in candidates if c.stands), default=promised)
        if number < (FOLLOWED_REFITTED if needs_observer(base.model) else REFITTED) and promised > max(
            REFIT_PROMISE, REFIT_SHARE * found_most
        ):
            candidates.append(_best_standing(data, base, (best[name], *ways[name][1:]), against or base))
        else:
            candidates.append(Candidate(best[name].effect, best[name].drop, promised, 0.0, 0.0, None, False))
        progress(0.7 + 0.3 * min(1.0, (number + 1) / REFITTED))
    unexplained = base.objective > swallowed_above * base.problem.samples
    if unexplained and needs_observer(base.model) and not any(c.accepted and c.explained > MOSTLY for c in candidates):
        left = {c.effect.name for c in candidates if c.fitted is None}
        for way in (best[e.name] for e in wanted if e.name in left and e.name in best and _rubs_behind(e)):
            more = _refit_with_effect(data, base, way, len(ways[way.effect.name]), against or base)
            candidates = [c for c in candidates if c.effect is not way.effect] + [more]
    elif unexplained and not any(c.accepted for c in candidates):
        for effect in wanted:
            candidates = _candidates_absorbed_by_base(data, scorer, effect, ground, candidates, len(ways[effect.name]))
    return _rank_candidates(candidates)


def _rank_candidates(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Best first; of two that the records hardly tell apart the one with fewer parameters."""
    order = sorted(candidates, key=lambda c: (c.fitted is None, -c.evidence))
    best = next((c for c in order if c.accepted), None)
    if best is None:
        return order
    near = [c for c in order if c.accepted and c.evidence > best.evidence - SIMPLER]
    simplest = min(near, key=lambda c: sum(p.fitted for p in c.effect.parameters))
    if sum(p.fitted for p in simplest.effect.parameters) < sum(p.fitted for p in best.effect.parameters):
        order.remove(simplest)
        order.insert(order.index(best), simplest)
    return order


def _rubs_behind(effect: Effect) -> bool:
    """True if it is friction of the carriage, which holds it in its gap: far from the truth the score test hardly sees that."""
    return effect.slot == "friction_level" and effect.body == "cart"


def _candidates_absorbed_by_base(
    data: Data, scorer: Scorer, effect: Effect, ground: AxisSummary, candidates: list[Candidate], starts: int
) -> list[Candidate]:
    """The candidates with this effect fitted from where the base model may have swallowed it, if that is better."""
    before = max((c.evidence for c in candidates if c.effect is effect and c.fitted is not None), default=0.0)
    for trial in scorer.trials_of(effect, ground):
        if trial.swallowed:
            model = scorer.model_with(effect, trial.values, trial)
            goal = scorer.fitted.objective - before - bic_penalty(effect, scorer.fitted, starts + 1)
            best = fit(data, model, SWALLOWED_ITERATIONS, offsets=scorer.fitted.offsets, enough=ENOUGH, goal=goal)
            found = candidate(data, scorer.fitted, effect, 0.0, best, starts + 1)
            if found.evidence > before:
                candidates, before = [c for c in candidates if c.effect is not effect] + [found], found.evidence
    return candidates


def may_add(base: Fitted, effect: Effect) -> bool:
    """True if the model can take the effect, one of a numbered family at a time.

    Parameters
    ----------
    base : Fitted
        Fitted without it.
    effect : Effect

    Returns
    -------
    bool
        False for one that is there already.
    """
    present = base.model.effects
    if effect.name in present or (effect.behind_gap and not needs_observer(base.model)):
        return False
    if base.model.side == "load" and (effect.harmonic or effect.slot in ("kinematics", "sensor")):
        return False  # at the load side no angle is known
    family, _, number = effect.name.rpartition("_")
    if number.isdigit():
        before = family if number == "2" else f"{family}_{int(number) - 1}"
        if before not in present:
            return False
    try:
        base.model.with_effect(effect.name)
    except UsageError:
        return False
    return True


def _expected_gain(way: Scored, base: Fitted, starts: int) -> float:
    """Expected gain of one start of an effect, its BIC penalty taken off."""
    return way.drop - bic_penalty(way.effect, base, starts)


def bic_penalty(effect: Effect, base: Fitted, starts: int) -> float:
    """Penalty of an effect in the evidence: n ln N + 2 ln starts.

    Parameters
    ----------
    effect : Effect
    base : Fitted
        Fitted without it.
    starts : int
        Ways that were tried.
    """
    added = sum(p.fitted for p in effect.parameters) + len(effect.bodies)
    return added * math.log(base.problem.samples) + 2.0 * math.log(max(starts, 1))


def _refit_with_effect(data: Data, base: Fitted, way: Scored, starts: int, against: Fitted) -> Candidate:
    """Everything fitted again with the effect, from its best way."""
    return candidate(data, against, way.effect, way.drop, _refit_with(data, base, way, against.objective), starts)


def _best_standing(data: Data, base: Fitted, ways: Sequence[Scored], against: Fitted) -> Candidate:
    """The first way refitted; where something speaks against it, and the next is another order of a ripple, that one."""
    first = _refit_with_effect(data, base, ways[0], len(ways), against)
    if first.stands or not first.effect.harmonic:
        return first
    others = (
        _refit_with_effect(data, base, way, len(ways), against) for way in ways[1:] if _expected_gain(way, base, len(ways)) > REFIT_PROMISE
    )
    return next((other for other in others if other.accepted), first)


def left_start_values(base: Fitted, start: Model, above: float = MISSING) -> bool:
    """True if a fit that explains little left what the start values say of the masses and of the belt, to make up for what is missing.

    Parameters
    ----------
    base : Fitted
        That was fitted.
    start : Model
        Model with the start values.
    above : float
        O per sample from which on it explains little.
    """
    missing = base.objective > above * base.problem.samples and not needs_observer(base.model)
    return missing and any(abs(math.log(base.model[name] / start[name])) > math.log(STRAYED) for name in _sheet_values(base, start))


def _sheet_values(base: Fitted, start: Model) -> list[str]:
    """Masses and belt that are free in the one and stand in the other."""
    solid = [inertia for inertia, body in base.model.bodies() if body.name in base.model.base_bodies]
    return [name for name in (*solid, STIFFNESS) if name in base.problem.free and name in start.parameters]


def fit_with_sheet_values(data: Data, base: Fitted, start: Model) -> Fitted:
    """The model fitted with masses and belt as the start values have them.

    Parameters
    ----------
    data : Data
    base : Fitted
        Fitted to these records.
    start : Model
        With the values of the data sheets.
    """
    held = {name: start[name] for name in _sheet_values(base, start)}
    return fit(data, base.model.with_values(held, "start"), ITERATIONS, fixed=tuple(held), enough=ENOUGH)


def merge_candidates(candidates: Sequence[Candidate], more: Sequence[Candidate]) -> list[Candidate]:
    """Both searches: of every effect the candidate that stands and has more evidence.

    Parameters
    ----------
    candidates, more : sequence of Candidate
        Of two searches.
    """
    best: dict[str, Candidate] = {}
    for item in (*candidates, *more):
        old = best.get(item.effect.name)
        if old is None or _rank(item) > _rank(old):
            best[item.effect.name] = item
    return _rank_candidates(list(best.values()))


def _rank(item: Candidate) -> tuple[bool, bool, float]:
    """Sort key: one candidate for an effect is better than another."""
    return item.accepted, item.fitted is not None and item.stands, -item.fitted.objective if item.fitted is not None else item.evidence


def candidate(data: Data, base: Fitted, effect: Effect, promised: float, best: Fitted, starts: int) -> Candidate:
    """Candidate from a model fitted with the effect; as one that was not refitted where a body flies off in it.

    Parameters
    ----------
    data : Data
    base : Fitted
        Without the effect.
    effect : Effect
    promised : float
        Fall of the objective to first order.
    best : Fitted
        Fitted with the effect.
    starts : int
        Ways that were tried.
    """
    if not math.isfinite(best.objective + best.held_out_objective):
        return Candidate(effect, promised, promised, 0.0, 0.0, None, False)
    drop = drop_by(base, best)
    evidence, explained = drop - bic_penalty(effect, base, starts), explained_share(drop, base)
    held_out_gain = base.held_out_objective - best.held_out_objective
    hollow = bool(impossible(best.model)) or any(bad(best.model, effect) for bad in (exceeds_bounds, is_negligible, only_cancels))
    grows = share_left(base, best) >= 1.0
    of_path = is_left_by_path(data, base, best, effect)
    accepted = enough(evidence, explained, drop, held_out_gain, base) and not (hollow or grows or of_path)
    if accepted and (means := drop_in_means(data, base, best)) < drop:
        evidence = means - bic_penalty(effect, base, starts)
        accepted = evidence > EVIDENCE
    idle = accepted and not lowers(data, base, best)
    return Candidate(
        effect, promised, evidence, explained, held_out_gain, best, accepted and not idle, hollow, grows, idle=idle, of_path=of_path
    )


def _refit_with(data: Data, base: Fitted, way: Scored, goal: float = math.inf) -> Fitted:
    """The model with the effect, begun where the score test says, or with no more of the base moved than the trial moves; the better.

    Above ``goal`` O does not matter where an observer makes the fit dear.
    """
    here = base.problem
    moved = np.clip(base.x + way.step, here.low, here.high)
    beside = base.x.copy()
    for name, value in way.trial.base.items():
        number = here.free.index(name)
        beside[number] = value / here.scale[number]
    starts = []
    for x in (moved, beside):
        model = here.model_at(x, "trial").with_effect(way.effect.name, way.values)
        problem = problem_of(data, model)
        begin = problem.start(here.offsets(x))
        starts.append((problem.objective(problem.residual(begin), begin), problem, here.offsets(x)))
    if not here.movable and impossible(base.model):  # a rigid axis whose base made up for what it lacks by an inertia of nothing
        problem = problem_of(data, base.model.with_effect(way.effect.name, way.values))
        banded = problem_of(data, problem.model_at(least_in_band(problem, problem.start(None), WEIGHED_HZ), "trial"))
        begin = banded.start(None)
        starts.append((banded.objective(banded.residual(begin), begin), banded, base.offsets))
    _, problem, offsets = min(starts, key=lambda start: start[0])
    starts.clear()  # the other one's observers are large
    if needs_observer(problem.model):
        return fit_of(problem, data, FOLLOWED_ITERATIONS if needs_observer(base.model) else ITERATIONS, enough=ENOUGH, goal=goal)
    return fit_of(problem, data, ITERATIONS, offsets=offsets, enough=ENOUGH)


@in_one_thread
def with_effect(data: Data, base: Fitted, ground: AxisSummary, effect: Effect, start: Mapping[str, float] | None = None) -> Fitted:
    """The model with an effect that was asked for, whatever speaks for it.

    Parameters
    ----------
    data : Data
    base : Fitted
        Fitted without it.
    ground : AxisSummary
        Of the axis, for the trials.
    effect : Effect
    start : Mapping[str, float] or None
        Values from which the fit begins, instead of a search.

    Raises
    ------
    UsageError
        For a name that is no parameter of the effect, or a value outside its bounds.
    """
    if start:
        grown = base.model.with_effect(effect.name)
        full = {name.removeprefix(f"{effect.name}."): name for name in grown.parameters if name not in base.model.parameters}
        for name, value in start.items():
            if name not in full:
                raise UsageError(f"{effect.name} has no parameter {name!r}{did_you_mean(name, full)}; it has {', '.join(full)}")
            own = grown.parameters[full[name]]
            if not own.low <= value <= own.high:
                raise UsageError(f"{name} of {effect.name} is {value:g}; it lies between {own.low:g} and {own.high:g} {own.unit}".rstrip())
        values = {full[name]: value for name, value in start.items()}
        return fit(data, grown.with_values(values, "start"), ITERATIONS, offsets=base.offsets)
    scorer = Scorer(base)
    ways = scorer.score(effect, ground)
    if not ways:
        return fit(data, base.model.with_effect(effect.name), ITERATIONS, offsets=base.offsets)
    return _refit_with(data, base, refine_best(scorer, ways, WAYS))


#: Iterations of a refit, and where another kind of observer is needed.
REFIT_ITERATIONS, MORE_ITERATIONS = 12, 25
#: A loss of so many times the least evidence needs no exact figure.
SURE = 4.0
#: Factor by which the error may be larger without an effect that is superfluous.
WORSE = 1.5


def drop_superfluous(data: Data, fitted: Fitted, base: Model, newest: str) -> tuple[Fitted, tuple[str, ...]]:
    """Throw out earlier additions without which the model is as good, or of which nothing is left: what stays, and their names.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    base : Model
        Model that the search began with.
    newest : str
        Name of the effect that was added last, which is not asked.
    """
    removed = []
    worth = _rise_without(fitted)
    for name in [e.name for e in additions(fitted.model, base) if e.name != newest]:
        if worth.get(name, 0.0) > SURE * EVIDENCE:
            continue
        smaller = without(fitted.model, name)
        if smaller is None:
            continue
        # Where an observer is no longer needed, where each carriage stood at first has to be found anew.
        iterations = REFIT_ITERATIONS if needs_observer(smaller) == needs_observer(fitted.model) else MORE_ITERATIONS
        nothing = is_negligible(fitted.model, effect_named(name))
        problem = problem_of(data, smaller)
        goal = math.inf if nothing else most_within(problem, fitted, SURE * EVIDENCE)
        trial = fit_of(problem, data, iterations, offsets=fitted.offsets, goal=goal)
        missed = trial.ratio > WORSE * fitted.ratio  # what an observer does to the noise may outweigh the whole error
        if nothing or (not missed and drop_by(trial, fitted) < EVIDENCE):
            removed.append(name)
            fitted = trial
    return fitted, tuple(removed)


def _rise_without(fitted: Fitted) -> dict[str, float]:
    """By how much O rises to first order when an effect that is a sum of amplitudes is taken out and the rest gives way, nats."""
    problem = fitted.problem
    linear = {}
    for effect in fitted.model.effect_list():
        if effect.harmonic != "load":
            continue
        linear[effect.name] = [problem.free.index(name) for name in effect.full_names() if name in problem.free]
    if not linear:
        return {}
    jacobian = problem.jacobian(fitted.x).weighted_rows(problem.weights(fitted.residual))
    inverse = np.linalg.pinv(jacobian.information())
    return {name: float(fitted.x[at] @ np.linalg.pinv(inverse[np.ix_(at, at)]) @ fitted.x[at]) for name, at in linear.items()}
