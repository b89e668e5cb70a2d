"""Search for missing effects: stage after stage until nothing is left above the noise, or nothing known explains it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from beltcomm.axis import Axis
from beltcomm.compiled import in_one_thread
from beltcomm.effects import EFFECTS, effect_named
from beltcomm.fit.base import (
    FIRST_ITERATIONS,
    NEXT_ITERATIONS,
    ROUGH,
    fit_base,
    in_groups_of,
    refit_with_rebuilt_motion,
    with_noise_that_is_left,
)
from beltcomm.fit.estimate import Fitted, escape_local_minimum, fit
from beltcomm.fit.least_squares import least_plain_error
from beltcomm.fit.records import PUBLISHED_SUBSTEPS, Data, prepare
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.start.model import data_sheet
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.acceptance import (
    EVIDENCE,
    drop_by,
    implausible_effects,
    impossible,
    is_refuted,
    lowers,
    parameters_at_bounds,
    share_left,
    undetermined_effects,
)
from beltcomm.laboratory.compare import GIVEN_UP, QUIET, STRUCTURED_BESIDE, compare, sign_of_missing
from beltcomm.laboratory.coupled_bodies import COUPLING, coupling_candidate, coupling_instead, refit_from_several_stiffnesses
from beltcomm.laboratory.gaps import converged_gap, gap_from_start, gap_with_delay, is_replaceable_gap
from beltcomm.laboratory.law_shape import assign_body, fit_law_shapes
from beltcomm.laboratory.path_again import path_again
from beltcomm.laboratory.samples import structure
from beltcomm.laboratory.score import FAR_OFF, Scorer, ground_of
from beltcomm.laboratory.selection import (
    MISSING,
    MOSTLY,
    Candidate,
    candidate,
    drop_superfluous,
    fit_with_sheet_values,
    left_start_values,
    merge_candidates,
    search,
)
from beltcomm.model import Model
from beltcomm.recording import Recording

NONE_EXPLAINS: Final = "none of the known effects explains this"
Verdict = Literal["nothing missing", "explained", "partly explained", "none of the known effects explains this", "cannot tell"]

#: Iterations for the model that the search ends with.
SETTLED_ITERATIONS = 4
#: O per sample from which on, beside added effects, it is asked what the base may have swallowed: laws may be others than the machine's.
BESIDE_ADDED = 1.08
#: Deviations by which the mean square of a few values is above 1 by chance.
BY_CHANCE = 2.0
#: Share of what lies above the noise that must not be left for a verdict that something was explained.
MOSTLY_LEFT = 0.9
#: Factor from which on the error as a whole has grown by an effect; less is the noise, which is calibrated anew.
GROWN = 1.02
#: Effects that a diagnosis adds at most.
MOST_EFFECTS = 4
#: Two effects whose evidence differs by less than this, or by less than this share, are not told apart when they are twins.
TWIN_GAP, TWIN_SHARE = 50.0, 0.002


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes
    ----------
    before : Fitted
        The model it began with.
    candidates : tuple of Candidate
        Ranked.
    added : str
        The effect taken on trial, "" for none.
    removed : tuple of str
        Effects that became superfluous.
    after : Fitted
        The model it ended with.
    forms : tuple of str
        See ``law_shape``; beside an effect that was added what of it acts on the carriage.
    detour : tuple of str
        Effects that were taken on trial first and became superfluous beside that one.
    data : Data or None
        Records as the model that it ended with sees them; None while the search goes on.
    """

    before: Fitted
    candidates: tuple[Candidate, ...]
    added: str
    removed: tuple[str, ...]
    after: Fitted
    forms: tuple[str, ...] = ()
    detour: tuple[str, ...] = ()
    data: Data | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Result of a search.

    Attributes
    ----------
    data : Data
        As the last model sees it.
    twins : tuple of str
        Names between which the data cannot tell.
    scorer : Scorer
        At the base.
    first : Data
        Data as that sees them.
    published : tuple[Data, Fitted] or None
        Records and fit that the search began from, as they were shown.
    """

    base: Fitted
    data: Data
    steps: tuple[Stage, ...]
    verdict: Verdict
    twins: tuple[str, ...]
    scorer: Scorer
    first: Data
    published: tuple[Data, Fitted] | None = None

    @property
    def published_base(self) -> tuple[Data, Fitted]:
        """Records and fit of the base whose numbers are told: those that were published, where the search began from them."""
        return self.published or (self.first, self.base)

    @property
    def published_model(self) -> Fitted:
        """The model whose numbers are told: the base as it was published, where nothing was added."""
        return self.published_base[1] if self.final_fit is self.base else self.final_fit

    @property
    def final_fit(self) -> Fitted:
        """The model with all effects on trial."""
        return self.steps[-1].after if self.steps else self.base

    @property
    def added_effects(self) -> list[str]:
        """Effects that were added and stayed, in that order, each followed by what completes it."""
        every = [name for step in self.steps for name in (step.added, *step.forms)]
        return [name for name in dict.fromkeys(every) if name in self.final_fit.model.effects]


def fit_base_of(recordings: Sequence[Recording], axis: Axis, start: Model) -> tuple[Data, Fitted]:
    """The start model fitted to the records, and the records as it sees them.

    Parameters
    ----------
    recordings : sequence of Recording
        That are fitted, and held out.
    axis : Axis
    start : Model
        Model that the fit begins from.

    Returns
    -------
    tuple of Data and Fitted
        Held-out ones are prepared, too.
    """
    return fit_base(prepare(recordings, axis, start), start, sheet=data_sheet(axis, recordings))


def _as_searched(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """The fit of a base with the steps of time, and at the likelihood's minimum, of a search."""
    fitted = fitted.likeliest or fitted
    return (data, fitted) if needs_observer(fitted.model) else refit_with_rebuilt_motion(data, fitted, SETTLED_ITERATIONS)


def final_refit(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Final refit of the selected model, with the integration step halved: the coarse one costs stiffness 0.05 % and belt damping 0.5 %.

    Parameters
    ----------
    data : Data
    fitted : Fitted

    Returns
    -------
    tuple of Data and Fitted
        As they came with an observer, whose step is not halved.
    """
    return (
        (data, fitted) if needs_observer(fitted.model) else refit_with_rebuilt_motion(data, fitted, SETTLED_ITERATIONS, PUBLISHED_SUBSTEPS)
    )


@in_one_thread
def diagnose(
    recordings: Sequence[Recording],
    axis: Axis,
    start: Model,
    *,
    begun: tuple[Data, Fitted] | None = None,
    most: int = MOST_EFFECTS,
    progress: Callable[[int, float], None] = lambda _stage, _fraction: None,
    trying: Callable[[Candidate], None] = lambda _candidate: None,
) -> Diagnosis:
    """The whole search from a start model.

    Parameters
    ----------
    recordings : sequence of Recording
    axis : Axis
    start : Model
        Model that the search begins from.
    begun : tuple[Data, Fitted] or None
        Its :func:`fit_base_of`, where known.
    most : int
        Causes that are named.
    progress : callable
        Hears the number of the stage, from 1, and how much of it is done; nobody knows how many there will be.
    trying : callable
        Hears of each effect on trial, and again, with what speaks against it, where it is refused.

    Raises
    ------
    DataError
        When the records cannot be used.
    """
    if begun is None:
        data, base = fit_base(prepare(recordings, axis, start), start, sheet=data_sheet(axis, recordings), publish=False)
    else:
        data, base = _as_searched(*begun)
    steps: list[Stage] = []
    seen: list[Data] = []  # what each step began with
    current = base
    at_base, at_first = Scorer(base), data
    limit = most + len(EFFECTS)
    doubted: int | None = None  # step in which a gap was taken that a straying carriage can do without; looked behind once
    patient = True
    ranked: list[Candidate] | None = None
    coupled: Fitted | None = None  # what was asked last whether a coupling is behind it
    quieter = False  # noise that stood for what was missing was found anew: the base is held against it, too
    instead = False  # begun anew with a coupling in the place of all that was named
    for number in range(limit):
        above = BESIDE_ADDED if any(step.added for step in steps) else MISSING
        if ranked is None:
            ranked = _find_candidates(
                data, current, at_base if current is base else Scorer(current), start, axis, above, _in_stage(progress, number)
            )
        # Further orders of a ripple that is there already are no new cause.
        causes = sum(bool(step.added) and not _is_later_member(step.added) for step in steps)
        taken = _accept_best(data, current, ranked, trying, causes < most)
        ranked = None
        current.problem.forget()  # observers of a stage that is over: every step keeps its model
        if taken.best is None or taken.grown is None:
            if doubted is not None:
                data, current, ranked = _revert_step(seen, steps, doubted, trying)
                doubted, patient = None, False
                continue
            coupling = None if coupled is current or causes >= most else coupling_candidate(data, current, axis)
            coupled = current
            if coupling is not None:
                ranked = merge_candidates(taken.candidates, [coupling])
                continue
            if steps and not instead and (coupling := coupling_instead(seen[0], base, current, axis)) is not None:
                data, current, ranked = seen[0], base, [coupling, *steps[0].candidates]
                steps, seen, instead = [], [], True
                continue
            better = _escape_if_far_off(data, current) if causes else None
            if better is not None:
                data, current = refit_with_rebuilt_motion(data, better, NEXT_ITERATIONS)
                steps[-1] = replace(steps[-1], after=current)
                continue
            shaped = fit_law_shapes(data, current, base.model)
            seen.append(data)
            steps.append(Stage(current, tuple(taken.candidates), "", shaped.removed, shaped.fitted, shaped.new))
            current = shaped.fitted
            if not shaped.new or current.objective < MISSING * current.problem.samples:
                break
            continue
        seen.append(data)
        data, name = taken.data, taken.best.effect.name
        kept, removed = drop_superfluous(data, taken.grown, base.model, name)
        removed += tuple(each for each in current.model.effects if each not in (*taken.grown.model.effects, *removed))
        on_body = assign_body(data, kept, taken.best.effect)
        if on_body.new:
            data, kept = refit_with_rebuilt_motion(data, on_body.fitted, NEXT_ITERATIONS)
        beside = (taken.best.beside,) if taken.best.beside in kept.model.effects else ()
        steps.append(Stage(current, tuple(taken.candidates), name, removed, kept, (*on_body.new, *beside)))
        current = kept
        # What was missing had told the path.
        if ((len(steps) == 1 and data.path.rivals) or steps[-1].before.ratio > ROUGH) and not needs_observer(current.model):
            data, current, gone = path_again(data, current, base.model, name)
            removed += gone
            steps[-1] = replace(steps[-1], after=current, removed=removed)
        if current.objective < QUIET * current.problem.samples:
            data, current = with_noise_that_is_left(data, current)
            quieter = True
            steps[-1] = replace(steps[-1], after=current)
        at = len(steps) - 1 if doubted is None else doubted
        strays = steps[at].added in kept.model.effects and is_replaceable_gap(data, kept, effect_named(steps[at].added))
        if strays and not (patient and doubted is None):
            data, current, ranked = _revert_step(seen, steps, at, trying)
            doubted, patient = None, False
            continue
        direct = _find_shortcut(seen, steps) if removed else None
        if direct is not None:
            first, step = direct
            steps[first:], seen[first + 1 :] = [step], []
        doubted = len(steps) - 1 if strays else None  # what a gap hides may show itself behind it, as a slack strand does
    twins = next((pair for step in steps if step.added and (pair := _twins_of(_without_contradicted(step.candidates)))), ())
    if twins and twins[0] not in current.model.effects:
        twins = ()
    against = base  # what the last model is held against: a base of the same steps of time and groups of samples
    if any(step.added for step in steps):
        data, last = final_refit(data, current)
        steps = [replace(step, after=last) if step.after is current else step for step in steps]
        current = last
        alike = data.substeps != at_first.substeps  # the last model with finer steps, and so the first one, too
        if quieter:
            known = replace(at_first, step_rad=data.step_rad, noise_nm=data.noise_nm, colour=data.colour)
            before, against = final_refit(known, base)
        else:
            before, against = (begun or final_refit(at_first, base)) if alike else (at_first, base)
        before, against = in_groups_of(before, against, data)
        if not lowers(before, against, current, data):
            data, current, twins, steps, against = at_first, base, (), [_withdrawn(steps, base)], base
    verdict = _verdict_of(against, steps, twins, _remaining_structure(data, current))
    if current is not base:
        told = least_plain_error(data, current, FIRST_ITERATIONS)
        steps = [replace(step, after=told) if step.after is current else step for step in steps]
    ended = tuple(replace(step, data=ahead) for step, ahead in zip(steps, (*seen[1 : len(steps)], data), strict=True))
    return Diagnosis(base, data, ended, verdict, twins, at_base, at_first, begun)


def _find_candidates(
    data: Data, current: Fitted, scorer: Scorer, start: Model, axis: Axis, above: float, progress: Callable[[float], None]
) -> list[Candidate]:
    """Candidates for what is missing, best first.

    Where the fit strayed from its start values, looked for from there as well, and where nothing explains most even so, for a gap between
    those values (``gap_from_start``) and for what hides each other (``gap_behind_delay``).  O per sample ``above`` explains little.
    """
    ground = ground_of(current, data.fitted, axis)
    candidates = search(data, scorer, ground, progress=progress, swallowed_above=above)
    if not left_start_values(current, start, above):
        return candidates
    held = fit_with_sheet_values(data, current, start)
    beside = ground_of(held, data.fitted, axis)
    both = merge_candidates(candidates, search(data, Scorer(held), beside, swallowed_above=math.inf, against=current))
    if any(c.accepted and c.explained > MOSTLY for c in both):
        return both
    apart = gap_from_start(data, current, start)
    both = both if apart is None else merge_candidates(both, [apart])
    masked = gap_with_delay(data, current, held)
    return both if masked is None else merge_candidates([c for c in both if c.effect is not masked.effect], [masked])


def _revert_step(
    seen: list[Data], steps: list[Stage], first: int, trying: Callable[[Candidate], None]
) -> tuple[Data, Fitted, list[Candidate]]:
    """Records, model and candidates as a step began with them, its effect refused: a carriage that strays can do without it.

    The step and all after it are gone.
    """
    step, data = steps[first], seen[first]
    del steps[first:], seen[first:]
    best = next(c for c in step.candidates if c.effect.name == step.added)
    refused = replace(best, accepted=False, unneeded=True)
    trying(refused)
    return data, step.before, [refused if c is best else c for c in step.candidates]


def _withdrawn(steps: Sequence[Stage], base: Fitted) -> Stage:
    """The first step with its effect refused: with all that was added the error in plain units is no less than without."""
    first = steps[0]
    refused = [replace(c, accepted=False, idle=True) if c.effect.name == first.added else c for c in first.candidates]
    return Stage(base, tuple(refused), "", (), base)


@dataclass(frozen=True)
class Acceptance:
    """Result of accepting the best candidates of a stage.

    Attributes
    ----------
    candidates : list of Candidate
        With what the fits said of them.
    best : Candidate or None
        The one taken, None for none.
    data, grown
        With it, all fitted again.
    """

    candidates: list[Candidate]
    best: Candidate | None
    data: Data
    grown: Fitted | None = None


def _accept_best(
    data: Data, current: Fitted, candidates: list[Candidate], trying: Callable[[Candidate], None], causes_left: bool
) -> Acceptance:
    """The best candidate with everything fitted again; the next one where the error as a whole grows, and none where that is not accepted.

    Such a one explains only what it does to the noise, as a lag of the reading beside a dead time does.  Without ``causes_left`` only
    further orders of one cause may be named.
    """
    while True:
        best = next(iter(_without_contradicted(candidates)), None)
        if best is None or not best.accepted or best.fitted is None or not (causes_left or _is_later_member(best.effect.name)):
            return Acceptance(candidates, None, data)
        trying(best)
        ahead, grown = refit_with_rebuilt_motion(data, best.fitted, NEXT_ITERATIONS)
        if best.effect is COUPLING:
            ahead, grown = refit_from_several_stiffnesses(ahead, grown)
        if best.effect.rattles and needs_observer(grown.model):
            ahead, grown = converged_gap(ahead, grown)
        less = grown.ratio <= GROWN * current.ratio or share_left(current, grown) < 1.0
        if less and lowers(data, current, grown, ahead):
            return Acceptance(candidates, best, ahead, grown)
        refused = replace(best, accepted=False, grows=not less, idle=less)
        trying(refused)
        candidates = [refused if c is best else c for c in candidates]


def _escape_if_far_off(data: Data, fitted: Fitted) -> Fitted | None:
    """The model in a better valley where the error is far above the noise; None where it is not, or where none is found.

    Asked when nothing more explains what is left beside an added effect, so that it costs no time where a search ends well.
    """
    if needs_observer(fitted.model) or fitted.objective <= FAR_OFF * fitted.problem.samples:
        return None
    found = escape_local_minimum(data, fitted, NEXT_ITERATIONS)
    drop, held_out_gain = drop_by(fitted, found), fitted.held_out_objective - found.held_out_objective
    return found if drop > EVIDENCE and not is_refuted(drop, held_out_gain, found.held_out_share) and not impossible(found.model) else None


def _without_contradicted(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates that neither the held-out records nor their own values contradict: the others stand in no one's way."""
    return [c for c in candidates if c.stands]


def _in_stage(progress: Callable[[int, float], None], number: int) -> Callable[[float], None]:
    """Progress of a search as that of its stage: the trial that follows takes about as long."""
    return lambda fraction: progress(number + 1, 0.5 * fraction)


def _is_later_member(name: str) -> bool:
    """True if an effect is the second, third, ... of a numbered family."""
    return name.rpartition("_")[2].isdigit()


def _find_shortcut(seen: Sequence[Data], steps: Sequence[Stage]) -> tuple[int, Stage] | None:
    """The step that goes straight to where the last ones came by a detour, and the number of the first that it stands for.

    Far from the truth the score test does not see every effect, and one that explains a part shows it the way.  Where that one is
    superfluous in the end, the stage is judged again as if both had been tried: the one with more evidence comes first.
    ``seen``: records as each step began with them.
    """
    last = steps[-1]
    for number, step in enumerate(steps[:-1]):
        if not step.added or set(last.after.model.effects) != {*step.before.model.effects, last.added, *last.forms}:
            continue
        straight = fit(seen[number], last.after.model, FIRST_ITERATIONS, offsets=last.after.offsets)
        found = candidate(seen[number], step.before, effect_named(last.added), 0.0, straight, len(steps) - number)
        candidates = merge_candidates(step.candidates, [found])
        if _without_contradicted(candidates)[0] is found and found.accepted:
            detour = tuple(name for name in last.removed if name not in step.before.model.effects)
            left = {*last.after.model.parameters, *last.after.model.effects}
            forms = tuple(name for other in steps[number:] for name in other.forms if name in left)
            return number, Stage(step.before, tuple(candidates), last.added, (), last.after, forms, detour)
    return None


def _twins_of(candidates: Sequence[Candidate]) -> tuple[str, ...]:
    """The best candidate and the next that the data cannot tell it from, whichever of the two knows the other for its twin."""
    if not candidates:
        return ()
    first = candidates[0]
    for other in candidates[1:]:
        if first.evidence - other.evidence >= max(TWIN_GAP, TWIN_SHARE * first.evidence):
            break
        if other.accepted and (other.effect.name in first.effect.twins or first.effect.name in other.effect.twins):
            return (first.effect.name, other.effect.name)
    return ()


def _remaining_structure(data: Data, fitted: Fitted) -> float:
    """Distance of the residual from noise: see ``beltcomm.laboratory.samples``."""
    return max(structures(data, fitted).values(), default=0.0)


def structures(data: Data, fitted: Fitted) -> dict[str, float]:
    """Distance of the residual from noise, by the quantity it goes with.

    Parameters
    ----------
    data : Data
    fitted : Fitted

    Returns
    -------
    dict of str to float
        By quantity; see :func:`structure`.
    """
    return structure(compare(data, fitted).judged)


def _verdict_of(base: Fitted, steps: Sequence[Stage], twins: tuple[str, ...], left: float) -> Verdict:
    """The verdict about the state after adding the best effects on trial; ``left`` is the structure of the rest."""
    after = steps[-1].after if steps else base
    level = after.objective / after.problem.samples
    added = {step.added for step in steps if step.added}
    if added and share_left(base, after) > MOSTLY_LEFT:
        return NONE_EXPLAINS
    if not added:
        return NONE_EXPLAINS if sign_of_missing(base, left) else "nothing missing"
    undetermined = set(undetermined_effects(with_intervals(after), base.model))
    if added <= undetermined:
        return "cannot tell"
    if (
        level >= max(MISSING, 1.0 + BY_CHANCE * math.sqrt(2.0 / after.problem.samples))
        or max(after.ratio, after.held_out_ratio or 0.0) >= GIVEN_UP
        or left >= STRUCTURED_BESIDE
        or parameters_at_bounds(after.model, base.model)
    ):
        return "partly explained"
    if undetermined or implausible_effects(after.model, base.model):
        return "partly explained"
    return "cannot tell" if twins else "explained"
