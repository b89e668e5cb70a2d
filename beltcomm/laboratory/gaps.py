"""Gaps: their evidence against a carriage that may stray, a gap behind a torque that acts late, the valley of gap and stiffness.

The observer of a model with a gap follows the carriage by the torque and lets it stray (``process_noise``), so it follows whatever pushes
the carriage: friction that jumped between 8 and 20 N was explained by a gap, 21.6 to 3.5 times the noise, on held-out records as well.
Such a push needs no gap.  So the model is judged against the same one with the gap closed and a carriage that may stray as far: only
what the gap adds to that speaks for it.

    lead = O_closed - O_gap + 2 Σ ln (deviation_closed / deviation_gap)

Both are likelihoods of the same torque, and the closed one has no number less: how far its carriage strays stands for the gap's width.

A torque that acts late and a gap hide each other, so that neither alone leads out of a base that made up for both.
Where the fit left the start values of masses and belt, and nothing explains most of what is missing, both are fitted together from those
values.  If that explains nearly all of it, the gap goes on trial for what both explain, as that fit sees it without the delay: beside the
right masses the next stage finds the delay by itself, and tells lag from dead time.

A wider gap behind a stiffer belt looks nearly alike, so that both lie in a narrow valley.
An observer holds near the model that it was made for, and a fit behind observers ends where no small step is better behind the one it has.
In that valley this may be far from its end: on a screw with a gap of 20 µm fits ended at 17.8 µm and 31 of 36 N/µm, at twice the noise and
2.6 intervals off.  So both are tried at some distance, each behind an observer of its own, and the fit goes on from the best.

Excitations that hardly cross a gap let the motor swing alone, and the fit makes masses, a soft spring and a damping of it: from there a gap
is found too wide behind a spring too stiff, or not at all.  The start values know better: the motor's inertia and the stiffness are on data
sheets, and slow motion tells the whole load.  An observer holds near the model it was made for, and behind it no small step is better: so
the likelihood is searched without derivatives, every look with an observer of its own, first on a raster of gap and contact.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from beltcomm.arrays import Array
from beltcomm.effects import EFFECTS, Effect
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import AGITATIONS, Data, negative_log_likelihood, with_process_noise
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.start.model import MOTOR_SHARE
from beltcomm.laboratory.acceptance import EVIDENCE, STIFFNESS, drop_by, enough, explained_share, impossible, log_deviations
from beltcomm.laboratory.selection import Candidate, bic_penalty, candidate, may_add
from beltcomm.model import Model

#: Iterations of the fit with the gap closed, and factor by which its carriage may stray further where the largest process noise suits best.
ITERATIONS, WIDER = 6, 3.0
#: Lead, as a multiple of what is asked, that a carriage which strays further does not make up for.
CLEARLY = 4.0


def is_replaceable_gap(data: Data, grown: Fitted, effect: Effect) -> bool:
    """True if an effect is a gap that a carriage which strays can do without.

    Parameters
    ----------
    data : Data
    grown : Fitted
        Model with the effect, fitted.
    effect : Effect

    Returns
    -------
    bool
        False for an effect that is no gap.
    """
    return effect.rattles and needs_observer(grown.model) and not _gap_is_supported(data, grown, effect)


def _gap_is_supported(data: Data, grown: Fitted, gap: Effect) -> bool:
    """True if a gap may be named beside a carriage that strays without one, by the rule for any effect.

    On friction that jumped, a gap that explained 56 000 nats led by 1000 of them, where both models left 3.4 times the noise.
    Asked of the closed model before its fit, behind it, and as far as its carriage strays then: what comes later is likelier, or nearly so.
    A model that the gap does not lead from ends the question, and so does one behind whose fit it leads by a multiple.
    """
    names = gap.full_names()
    shut = grown.model.with_values({names[0]: 0.0}, "closed")
    loose = _with_likeliest_stray(_with_stray(data, grown.model[names[0]]), shut)
    begun = fit(loose, shut, 0, fixed=names)
    if not _exceeds_threshold(grown, begun):
        return False
    first = fit(loose, shut, ITERATIONS, fixed=names)
    if not _exceeds_threshold(grown, first) or _exceeds_threshold(grown, first, CLEARLY):
        return _exceeds_threshold(grown, first)
    return _exceeds_threshold(grown, fit(_with_likeliest_stray(loose, first.model), first.model, 0, fixed=names))


def _exceeds_threshold(grown: Fitted, closed: Fitted, times: float = 1.0) -> bool:
    """True if a gap explains enough, so many times over, beside a model of the same records without one."""
    lead = _lead_of(grown, closed) / times
    return enough(lead, explained_share(lead, closed), lead, 0.0, closed)


def _lead_of(grown: Fitted, closed: Fitted) -> float:
    """By how much a gap is likelier than a carriage that strays without one, nats; below 0 it is less likely."""
    lead = drop_by(closed, grown) + log_deviations(closed.problem.pieces) - log_deviations(grown.problem.pieces)
    closed.problem.forget()
    grown.problem.forget()
    return lead


def _with_stray(data: Data, width_m: float) -> Data:
    """The records with a carriage that has the freedom of a gap of this width, whatever the model's."""
    fitted, held_out = (tuple(replace(piece, freedom_m=width_m) for piece in pieces) for pieces in (data.fitted, data.held_out))
    return replace(data, fitted=fitted, held_out=held_out)


def _with_likeliest_stray(data: Data, model: Model) -> Data:
    """The records with a carriage that strays as far as is likeliest."""
    best = with_process_noise(data, model)
    while best.fitted[0].process_noise == AGITATIONS[-1]:
        wider = with_process_noise(_with_stray(best, WIDER * best.fitted[0].freedom_m), model)
        if negative_log_likelihood(wider.fitted, model) >= negative_log_likelihood(best.fitted, model):
            break
        best = wider
    return best


#: m and s; gaps and delays that are tried with each other: smaller ones hide nothing.
GAPS_M, DELAYS_S = (3e-5, 6e-5, 1.2e-4), (5e-4, 1e-3, 2e-3)
#: Share of what lies above the noise that both together must explain.
NEARLY_ALL = 0.8
#: Iterations of the fit of both.
BOTH_ITERATIONS = 9


def gap_with_delay(data: Data, current: Fitted, held: Fitted) -> Candidate | None:
    """The gap as a candidate for what it explains beside a delay; None where both together do not explain nearly all.

    evidence = O_current - O_both - (n ln N + 2 ln ways),   n : parameters of both   (see ``selection``)

    Parameters
    ----------
    data : Data
    current : Fitted
        Model that they must be better than.
    held : Fitted
        The same with masses and belt as the start values have them.
    """
    if STIFFNESS not in held.model.parameters or needs_observer(held.model):
        return None
    fits: list[tuple[Effect, Effect, Fitted]] = []
    for gap in EFFECTS:
        for delay in EFFECTS:
            if gap.rattles and delay.slot == "torque_delay" and may_add(held, gap) and may_add(held, delay):
                goal = min((fitted.objective for _, _, fitted in fits), default=math.inf)
                fits.append((gap, delay, _both_fitted(data, held.model, gap, delay, goal)))
    if not fits:
        return None
    gap, delay, best = min(fits, key=lambda fitted: fitted[2].objective)
    drop = drop_by(current, best)
    ways = len(fits) * len(GAPS_M) * len(DELAYS_S)
    evidence, explained = drop - bic_penalty(gap, current, ways) - bic_penalty(delay, current, 1), explained_share(drop, current)
    if evidence <= EVIDENCE or explained <= NEARLY_ALL or best.ratio >= current.ratio or impossible(best.model):
        return None
    alone = candidate(data, current, gap, 0.0, fit(data, best.model.without_effect(delay.name), 0), 1)
    if alone.fitted is None or alone.fitted.ratio >= current.ratio:
        return None
    held_out_gain = current.held_out_objective - best.held_out_objective
    return Candidate(gap, drop, evidence, explained, held_out_gain, alone.fitted, True, beside=delay.name)


def _both_fitted(data: Data, model: Model, gap: Effect, delay: Effect, goal: float) -> Fitted:
    """A model fitted with a gap and a delay, from the width and time that suit it best as they are; ``goal`` as of ``fitting.fit``."""
    sizes = itertools.product(GAPS_M, DELAYS_S)
    ways = [
        model.with_effect(gap.name, {gap.parameters[0].name: width}).with_effect(delay.name, {delay.parameters[0].name: time})
        for width, time in sizes
    ]
    begun = min((fit(data, way, 0) for way in ways), key=lambda fitted: fitted.objective)
    return fit(data, begun.model, BOTH_ITERATIONS, goal=goal)


#: Relative changes of gap and stiffness that are tried, at first and where none of them is better, and rounds of trials at most.
GAPS, STIFFNESSES, SMALLER, ROUNDS = (-0.1, -0.05, 0.0, 0.06, 0.12), (-0.1, 0.0, 0.1, 0.2), (1.0, 0.4), 8
#: Error over the noise up to which there is nothing to look for, and gain of O that is worth another round, nats.
AT_NOISE, WORTH = 1.1, 20.0
#: How often the carriage is asked anew how far it strays: the better the model, the less, and the more its motion tells.
CALMER, VALLEY_ITERATIONS = 4, 6


def converged_gap(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Records and model of a gap at the end of its valley, with a carriage that strays no further than this model leaves to chance.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        As :func:`_along_gap_valley`.

    Returns
    -------
    tuple of Data and Fitted
        Those given where the model is at the noise or nothing is better.
    """
    for _ in range(CALMER):
        further = _along_gap_valley(data, fitted, VALLEY_ITERATIONS)
        calmer = with_process_noise(data, further.model)
        quieter = [piece.process_noise for piece in calmer.fitted] != [piece.process_noise for piece in data.fitted]
        if not quieter and (further is fitted or further.ratio <= AT_NOISE):
            return data, further
        data, fitted = (calmer, fit(calmer, further.model, VALLEY_ITERATIONS)) if quieter else (data, further)
    return data, fitted


def _along_gap_valley(data: Data, fitted: Fitted, iterations: int) -> Fitted:
    """The fit of a model with a gap, from farther along the valley of gap and stiffness where that is likelier.

    One without an observer, and one that is at the noise already, comes back as it is.
    """
    gaps = [effect.full_names()[0] for effect in fitted.model.effect_list() if effect.rattles]  # the gap comes first
    if len(gaps) != 1 or STIFFNESS not in fitted.model.parameters:
        return fitted
    best, sizes = fitted, list(SMALLER)
    for _ in range(ROUNDS):
        if best.ratio <= AT_NOISE or not sizes:
            break
        near = min((fit(data, model, 0) for model in _around(best.model, gaps[0], sizes[0])), key=_objective, default=best)
        if near.objective < best.objective - WORTH:
            best = min(near, fit(data, near.model, iterations), key=_objective)
        else:
            sizes.pop(0)
    return best


def _around(model: Model, gap: str, size: float) -> list[Model]:
    """Models with other gaps and stiffnesses, inside their bounds.   size : of the changes, over the largest."""
    found = []
    for one, other in product(GAPS, STIFFNESSES):
        values = {gap: (1.0 + size * one) * model[gap], STIFFNESS: (1.0 + size * other) * model[STIFFNESS]}
        inside = all(model.parameters[name].low <= value <= model.parameters[name].high for name, value in values.items())
        if inside and (one or other):
            found.append(model.with_values(values, "laboratory"))
    return found


def _objective(fitted: Fitted) -> float:
    """O, infinite where a body flew off."""
    return fitted.objective if math.isfinite(fitted.objective) else math.inf


#: m and shares of the gap; gaps, each half as much again, and the roundness of their contact that are tried.
START_GAPS_M, ROUNDINGS = tuple(5e-6 * 1.5**step for step in range(10)), (0.01, 0.03, 0.1)
#: Error over the noise from which on it is asked, and damping of the spring over the critical one.
FAR_OFF, DAMPING = 3.0, 0.02
#: What is searched, and first steps of its logarithm; rounds, each with steps so much smaller, and looks in each.
STEPS = {
    "backlash.gap": 0.15,
    "backlash.rounding": 0.5,
    STIFFNESS: 0.08,
    "cart.mass": 0.03,
    "motor.inertia": 0.03,
    "belt_damping.damping": 0.4,
    "coulomb.level": 0.03,
    "cart_friction.level": 0.1,
}
START_ROUNDS, CLOSER, LOOKS = 3, 0.3, 150


def gap_from_start(data: Data, current: Fitted, start: Model) -> Candidate | None:
    """The likeliest gap as a candidate; None where the fit is near the noise, or has a gap or no spring to put one beside.

    Parameters
    ----------
    data : Data
    current : Fitted
        Model that it must be better than.
    start : Model
        Whose masses and stiffness count.
    """
    model, gap = current.model, next(effect for effect in EFFECTS if effect.rattles)
    solid = {"motor.inertia", "cart.mass", STIFFNESS}
    if (
        current.ratio < FAR_OFF
        or needs_observer(model)
        or not solid <= {*model.parameters} & {*start.parameters}
        or not may_add(current, gap)
    ):
        return None
    ground = _as_started(model, start)
    ways = [_with_gap(ground, gap, width, rounding) for width, rounding in itertools.product(START_GAPS_M, ROUNDINGS)]
    begun = min(ways, key=lambda way: negative_log_likelihood(data.fitted, way))
    for number in range(START_ROUNDS):
        data = with_process_noise(data, begun)
        begun = _likelier(data, begun, CLOSER**number)
    best = fit(data, begun, 0)
    return candidate(data, current, gap, drop_by(current, best), best, len(ways))


def _likelier(data: Data, model: Model, size: float) -> Model:
    """The model after :data:`LOOKS` looks for a likelier one (Nelder, Mead).   size : of the first steps over :data:`STEPS`."""
    bounds = {name: model.parameters[name] for name in STEPS if name in model.parameters and model[name] > 0.0}

    def model_at(place: Array) -> Model:
        found = zip(bounds.items(), np.exp(place), strict=True)
        return model.with_values({name: float(min(max(value, b.low), b.high)) for (name, b), value in found}, "laboratory")

    def unlikely(place: Array) -> float:
        return negative_log_likelihood(data.fitted, model_at(place))

    begin = np.log([model[name] for name in bounds])
    corners = np.vstack([begin, begin + size * np.diag([STEPS[name] for name in bounds])])
    found = minimize(
        unlikely, corners[0], method="Nelder-Mead", options={"initial_simplex": corners, "maxfev": LOOKS, "fatol": 1.0, "xatol": 1e-4}
    )
    return model_at(found.x)


def _with_gap(model: Model, gap: Effect, width: float, rounding: float) -> Model:
    """The model with a gap of that width in metres, its contact round over that share of it."""
    width_name, rounding_name = (parameter.name for parameter in gap.parameters)
    return model.with_effect(gap.name, {width_name: width, rounding_name: rounding})


def _as_started(model: Model, start: Model) -> Model:
    """The model with masses and stiffness of the start values, all of its friction shared as usual, and a torque that acts at once."""
    inertia, mass, stiffness, ratio = (start[name] for name in ("motor.inertia", "cart.mass", STIFFNESS, "transmission.ratio"))
    coulomb = model.get("coulomb.level") + ratio * model.get("cart_friction.level")
    values = {
        "motor.inertia": inertia,
        "cart.mass": mass,
        STIFFNESS: stiffness,
        "belt_damping.damping": 2.0 * DAMPING * math.sqrt(stiffness / (ratio**2 / inertia + 1.0 / mass)),
        "coulomb.level": MOTOR_SHARE * coulomb if "cart_friction.level" in model.parameters else coulomb,
        "cart_friction.level": (1.0 - MOTOR_SHARE) * coulomb / ratio,
        "viscous.damping": model.get("viscous.damping") + ratio**2 * model.get("viscous_cart.damping"),
        "viscous_cart.damping": 0.0,
        "dead_time.time": 0.0,
    }
    known = {name: value for name, value in values.items() if name in model.parameters}
    return model.with_values({n: min(max(v, model.parameters[n].low), model.parameters[n].high) for n, v in known.items()}, "start")
