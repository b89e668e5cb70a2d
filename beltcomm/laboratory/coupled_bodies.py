"""A compliant coupling, alone or beside an end pulley: each hides the other, and neither alone leads out of a base that made up for both.

The pulley of a coupling swings against the motor at some hundred hertz.  From a base that has it in its inertia, its stiffness and its
damping no single effect leads there, so both are fitted from a raster of what motor, pulley and belt may be:

    motor and driving pulley share the inertia,   r²/K = s/k_apparent,   1/k = (1 - s)/k_apparent

If that explains most of what lies above the noise, the coupling goes on trial for it, with the end pulley beside it where that is needed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from beltcomm.axis import Axis
from beltcomm.effects import effect_named
from beltcomm.effects.belt_spans import stiffness as stiffness_of_spans
from beltcomm.fit.base import NEXT_ITERATIONS, refit_with_rebuilt_motion
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data, for_coupling
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.acceptance import EVIDENCE, STIFFNESS, drop_by
from beltcomm.laboratory.selection import Candidate, bic_penalty, candidate, may_add
from beltcomm.model import Model

COUPLING, END_PULLEY = effect_named("coupling"), effect_named("end_pulley")
SPANS_BY_PLACE, SECTIONS = "belt_spans", "belt_sections"
#: Shares s of what gives way and of the driven inertia, that are the coupling's and behind it, that are tried.
FLEXIBLE, BEHIND = (0.7, 0.5, 0.35, 0.22, 0.13, 0.07), (0.2, 0.35, 0.5)
#: Masses of the end pulley over the carriage's, and the belt's shares over it with how they are split, that are tried beside it.
PULLEYS, SPANS = (0.005, 0.016, 0.05), ((0.15, 0.35), (0.15, 0.6), (0.3, 0.35), (0.3, 0.6))
#: Iterations of the fits that are begun, how many of them go on, and the iterations of those.
FIRST, GO_ON, ITERATIONS = 8, 4, 40
#: Factors of the stiffness from which a coupling is asked for again once the motion is rebuilt, iterations from there, rounds of rebuilding
#: it, and iterations in each.
ASIDE, APART, ROUNDS, IN_A_ROUND = (1.0, 1.6, 2.5), 15, 6, 3
#: Iterations of the model without it where the steps of time are others.
AGAIN = 4
#: Slots of effects that imitate a part of it.
IMITATED_BY = frozenset(("body", "belt_law", "element", "torque_delay"))
#: Share of what lies above the noise that it must explain, and O per sample of a base up to which it is not asked.
MOST, FAR_OFF = 0.5, 1.15


def coupling_candidate(data: Data, current: Fitted, axis: Axis) -> Candidate | None:
    """The coupling as a candidate for what it explains, alone or with an end pulley; None where it does not explain most.

    Parameters
    ----------
    data : Data
    current : Fitted
        Model that it must be better than.
    axis : Axis
        Whose start values of inertias, belt and friction the raster begins from, beside the model's own.
    """
    if current.objective <= FAR_OFF * current.problem.samples or not _may_be_coupled(current):
        return None
    if data.path.without_setpoint:  # fast torque is a guess without the setpoint, and a coupling shows itself nowhere else
        return None
    found = _grown_by_coupling(data, current, axis)
    if found is None:
        return None
    seen, against, grown, ways = found
    named = candidate(seen, against, COUPLING, 0.0, grown, ways)
    if not named.accepted or named.explained <= MOST:
        return None
    new = next((name for name in grown.model.effects if name not in (*current.model.effects, COUPLING.name)), "")
    return replace(named, beside=new)


def coupling_instead(data: Data, base: Fitted, current: Fitted, axis: Axis) -> Candidate | None:
    """The coupling as a candidate beside a base, where that is likelier than all that was added to it since; None otherwise.

    A payload that creeps or a delay imitates a part of a coupling, is taken first, and stands in its way from then on.

    Parameters
    ----------
    data : Data
        As the base sees it.
    base : Fitted
        Before anything was added.
    current : Fitted
        The base with what was added.
    axis : Axis
        As its file states it.
    """
    added = {effect_named(name).slot for name in current.model.effects if name not in base.model.effects}
    if current.objective <= FAR_OFF * current.problem.samples or not IMITATED_BY & added:
        return None
    named = coupling_candidate(data, base, axis)
    if named is None or named.fitted is None:
        return None
    seen = for_coupling(data, base.model)
    return named if drop_by(fit(seen, current.model, AGAIN), named.fitted) > EVIDENCE else None


def _has_end_pulley(model: Model) -> bool:
    """True if an end pulley is among its bodies."""
    return any(body.name == "end_pulley" for _, body in model.bodies())


def _may_be_coupled(current: Fitted) -> bool:
    """True for a belt that nothing rattles on, and no coupling yet."""
    has_spring = STIFFNESS in current.model.parameters or {SPANS_BY_PLACE, SECTIONS} & set(current.model.effects)
    return bool(has_spring) and not needs_observer(current.model) and may_add(current, COUPLING)


def add_coupling(data: Data, current: Fitted, axis: Axis) -> tuple[Data, Fitted] | None:
    """Records and model with a coupling that was asked for, whatever speaks for it; None where nothing can be begun.

    Parameters
    ----------
    data : Data
    current : Fitted
        Model without the coupling.
    axis : Axis
        For what the data sheets say of it.
    """
    found = _grown_by_coupling(data, current, axis, alone=True) if _may_be_coupled(current) else None
    return None if found is None else refit_from_several_stiffnesses(*refit_with_rebuilt_motion(found[0], found[2], NEXT_ITERATIONS))


def with_sections(data: Data, current: Fitted) -> Fitted | None:
    """Model whose spans have become sections with an end pulley that was asked for; None where it has no spans, or nothing can be begun.

    Parameters
    ----------
    data : Data
    current : Fitted
        Model with spans.

    Returns
    -------
    Fitted or None
        The likeliest of several starts.
    """
    if SPANS_BY_PLACE not in current.model.effects or _has_end_pulley(current.model):
        return None
    places = list(_with_pulleys(current.model, current.model["cart.mass"], _stiffness_at(current.model, _middle_m(data, current.model))))
    return next(iter(_by_objective(fit(data, place, ITERATIONS, offsets=current.offsets) for place in places)), None)


def _grown_by_coupling(data: Data, current: Fitted, axis: Axis, *, alone: bool = False) -> tuple[Data, Fitted, Fitted, int] | None:
    """Records with steps of time that suit a coupling, the model as it is and with one, and places it was begun from; None for none.

    An end pulley comes with it where that leaves less than its parameters cost; none where ``alone``.
    """
    here = current.model
    own = _has_end_pulley(here)
    grounds, place_m = (here, start_model(axis, data.recordings)), _middle_m(data, here)
    single = [] if own else [model for ground in grounds for model in _raster(here, ground, place_m, False)]
    both = own or (not alone and may_add(current, END_PULLEY))
    double = [model for ground in grounds for model in _raster(here, ground, place_m, True)] if both else []
    if not single + double:
        return None
    finer = for_coupling(data, here)
    against = current if finer is data else fit(finer, here, AGAIN, offsets=current.offsets)
    if not against.problem.samples:  # by finer steps of time none counts
        return None
    simple, more = (next((one for one in _best_from(finer, places) if one.problem.samples), None) for places in (single, double))
    if simple is not None and (more is None or drop_by(simple, more) <= bic_penalty(END_PULLEY, simple, len(double)) + EVIDENCE):
        return finer, against, simple, len(single)
    return None if more is None else (finer, against, more, len(double))


def _raster(here: Model, start: Model, place_m: float, with_pulley: bool) -> Iterator[Model]:
    """Models with a coupling, and with an end pulley or without, whose low frequencies are those of the start values.

    The effects of ``here`` stay; with a delay of the torque and without, for it may be one or stand for the coupling's inertia.
    """
    known = {name: start[name] for name in start.parameters if name in here.parameters}
    late = here.with_values(known, "start")
    late = late.without_effect(END_PULLEY.name) if END_PULLEY.name in late.effects else late
    delays = [effect.name for effect in late.effect_list() if effect.slot == "torque_delay"]
    prompt = reduce(Model.without_effect, delays, late)
    grounds = [prompt, late] if any(late[f"{name}.time"] > 0.0 for name in delays) else [prompt]
    inertia, belt, mass = late["motor.inertia"], _stiffness_at(late, place_m), late["cart.mass"]
    lever = late["transmission.ratio"]
    for ground, flexible, behind in itertools.product(grounds, FLEXIBLE, BEHIND):
        values = {
            "coupling.stiffness": belt * lever**2 / flexible,
            "driving_pulley.inertia": behind * inertia,
            "motor.inertia": (1.0 - behind) * inertia,
        }
        model = _begun_at(_with_stiffness(ground.with_effect(COUPLING.name), 1.0 / (1.0 - flexible)), values)
        if model is not None:
            yield from _with_pulleys(model, mass, belt) if with_pulley else (model,)


def _begun_at(model: Model | None, values: Mapping[str, float]) -> Model | None:
    """The model with these start values; None where one of them is outside its bounds, and for no model."""
    if model is None or any(not model.parameters[name].low <= value <= model.parameters[name].high for name, value in values.items()):
        return None
    return model.with_values(values, "start")


def _with_pulleys(model: Model, mass: float, belt: float) -> Iterator[Model]:
    """The model with end pulleys: in a span of unknown geometry, or between the sections of one that is known, where it may be already.

    ``mass`` is the carriage's, kg; the damping of the belt belongs to the stiffness ``belt``, N/m.
    """
    if SPANS_BY_PLACE in model.effects:
        tried = (_begun_at(_by_sections(model, belt), {"end_pulley.mass": share * mass}) for share in PULLEYS)
    elif SECTIONS in model.effects:
        tried = (_begun_at(model, {"end_pulley.mass": share * mass}) for share in PULLEYS)
    else:
        tried = (
            _begun_at(
                model.with_effect(END_PULLEY.name),
                {"end_pulley.mass": pulley * mass, "end_pulley.share": share, "end_pulley.split": split},
            )
            for pulley, (share, split) in itertools.product(PULLEYS, SPANS)
        )
    yield from (grown for grown in tried if grown is not None)


def _by_sections(model: Model, belt: float) -> Model | None:
    """The model whose spans are sections with an end pulley between them, of the geometry that they have; None beyond the bounds."""
    own = {name: model[f"{SPANS_BY_PLACE}.{name}"] for name in ("specific_stiffness", "pulley_distance", "offset")}
    own["specific_damping"] = model.get("belt_damping.damping") / belt * own["specific_stiffness"]
    bare = model.without_effect(SPANS_BY_PLACE)
    bare = bare.without_effect("belt_damping") if "belt_damping" in bare.effects else bare
    grown = _begun_at(bare.with_effect(SECTIONS), {f"{SECTIONS}.{name}": value for name, value in own.items()})
    return None if grown is None else grown.with_fixed(f"{SECTIONS}.pulley_distance")


def _stiffness_at(model: Model, place_m: float) -> float:
    """Stiffness of the belt at a place, N/m, of one without mass in it."""
    if STIFFNESS in model.parameters:
        return model[STIFFNESS]
    law = SPANS_BY_PLACE if SPANS_BY_PLACE in model.effects else SECTIONS
    return float(stiffness_of_spans(place_m, *(model[f"{law}.{name}"] for name in ("specific_stiffness", "pulley_distance", "offset"))))


def _with_stiffness(model: Model, factor: float) -> Model | None:
    """The model with a belt so many times as stiff; None where that is stiffer than a belt can be."""
    names = (STIFFNESS, *(f"{law}.specific_stiffness" for law in (SPANS_BY_PLACE, SECTIONS)))
    return _begun_at(model, {name: factor * model[name] for name in names if name in model.parameters})


def _middle_m(data: Data, model: Model) -> float:
    """Place of the carriage in the middle of the records, m."""
    return float(np.mean([np.mean(piece.motion.theta) for piece in data.fitted])) * model["transmission.ratio"]


def _best_from(data: Data, places: Sequence[Model]) -> list[Fitted]:
    """Fits begun from the places that suit the excited records best as they are; those that come far soon go on, on all records."""
    excited = _excited_only(data)
    best: dict[tuple[float, float], Fitted] = {}  # of each coupling: else all that go on have the same
    for seen in _by_objective(fit(excited, model, 0) for model in places):
        own = seen.model["driving_pulley.inertia"]
        best.setdefault((seen.model["coupling.stiffness"], round(own / (own + seen.model["motor.inertia"]), 6)), seen)
    begun = _by_objective(fit(excited, fitted.model, FIRST) for fitted in best.values())
    return _by_objective(fit(data, fitted.model, ITERATIONS) for fitted in begun[:GO_ON])


def _excited_only(data: Data) -> Data:
    """Records whose excitation reaches the modes; all where none of them is such."""
    names = {recording.name for recording in data.recordings if recording.sidecar.experiment == "frf"}
    pieces = tuple(piece for piece in data.fitted if piece.record in names)
    return replace(data, fitted=pieces, held_out=()) if pieces else data


def _by_objective(fits: Iterable[Fitted]) -> list[Fitted]:
    """Fits in the order of what they leave, the least first; those that fly off are not among them."""
    return sorted((fitted for fitted in fits if math.isfinite(fitted.objective)), key=lambda fitted: fitted.objective)


def refit_from_several_stiffnesses(data: Data, grown: Fitted) -> tuple[Data, Fitted]:
    """Records and model with a coupling, the motion between the samples rebuilt by it until both agree, from several stiffnesses; the best.

    The pulley swings faster than the samples show, so what it did there follows from the model, and more than one model agrees with that.

    Parameters
    ----------
    data : Data
    grown : Fitted
        Fitted with the coupling.
    """
    tried = [(data, grown)]
    for factor in ASIDE:
        begun = _as_flexible(grown.model, factor * grown.model["coupling.stiffness"], _middle_m(data, grown.model))
        if begun is None:
            continue
        ahead, found = data, fit(data, begun, APART, offsets=grown.offsets)
        for _ in range(ROUNDS):
            ahead, found = refit_with_rebuilt_motion(ahead, found, IN_A_ROUND)
        tried.append((ahead, found))
    return min(tried, key=lambda one: one[1].ratio if math.isfinite(one[1].objective) else math.inf)


def _as_flexible(model: Model, stiffness: float, place_m: float) -> Model | None:
    """The model with another stiffness of its coupling, N m/rad, and the belt's with which both give way as before; None for none."""
    lever, belt = model["transmission.ratio"] ** 2, _stiffness_at(model, place_m)
    rest = 1.0 / belt + lever / model["coupling.stiffness"] - lever / stiffness
    other = _begun_at(model, {"coupling.stiffness": stiffness}) if rest > 0.0 else None
    return None if other is None else _with_stiffness(other, 1.0 / (rest * belt))
