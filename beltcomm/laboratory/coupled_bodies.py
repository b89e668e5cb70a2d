"""A compliant coupling, alone or beside an end pulley: each hides the other, and neither alone leads out of a base that made up for both.

The pulley of a coupling swings against the motor at some hundred hertz.  From a base that has it in its inertia, its stiffness and its
damping no single effect leads there, so both are fitted from a raster of what motor, pulley and belt may be:

    motor and driving pulley share the inertia,   1/k = 1/k_apparent - r²/K

If that explains most of what lies above the noise, the coupling goes on trial for it, with the end pulley beside it where that is needed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from beltcomm.axis import Axis
from beltcomm.effects import effect_named
from beltcomm.fit.base import NEXT_ITERATIONS, refit_with_rebuilt_motion
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.observer import needs_observer
from beltcomm.fit.records import Data, for_coupling
from beltcomm.fit.start import start_model
from beltcomm.laboratory.acceptance import EVIDENCE, STIFFNESS, drop_by
from beltcomm.laboratory.forward_selection import Candidate, bic_penalty, candidate, may_add
from beltcomm.model import Model

COUPLING, END_PULLEY = effect_named("coupling"), effect_named("end_pulley")
#: N m/rad, and shares of the driven inertia behind the coupling, that are tried.
STIFFNESSES, SHARES_BEHIND = (100.0, 150.0, 225.0, 340.0, 500.0, 750.0), (0.2, 0.35, 0.5)
#: Masses of the end pulley over the carriage's, and the belt's shares over it with how they are split, that are tried beside it.
PULLEYS, SPANS = (0.005, 0.013, 0.03), ((0.15, 0.5), (0.2, 0.35), (0.27, 0.5), (0.4, 0.5))
#: Fits that are begun from the best places of the raster, those that go on, and the iterations of both.
BEGUN, GO_ON, FIRST, ITERATIONS = 12, 3, 6, 40
#: Factors of the stiffness from which a coupling is asked for again once the motion is rebuilt, iterations from there, rounds of rebuilding
#: it, and iterations in each.
ASIDE, APART, ROUNDS, IN_A_ROUND = (1.0, 1.6, 2.5), 15, 6, 3
#: Iterations of the model without it where the steps of time are others.
AGAIN = 4
#: Share of what lies above the noise that it must explain, and O per sample of a base up to which it is not asked.
MOST, FAR_OFF = 0.5, 1.5


def coupling_candidate(data: Data, current: Fitted, axis: Axis) -> Candidate | None:
    """The coupling as a candidate for what it explains, alone or with an end pulley; None where it does not explain most.

    Parameters
    ----------
    current : Fitted
        Model that it must be better than.
    axis : Axis
        Whose start values of inertias, belt and friction the raster begins from, beside the model's own.
    """
    if current.objective <= FAR_OFF * current.problem.samples or not may_be_coupled(current):
        return None
    found = grown_by_coupling(data, current, axis)
    if found is None:
        return None
    seen, against, grown, ways = found
    named = candidate(seen, against, COUPLING, 0.0, grown, ways)
    if not named.accepted or named.explained <= MOST:
        return None
    new = END_PULLEY.name not in current.model.effects and END_PULLEY.name in grown.model.effects
    return replace(named, beside=END_PULLEY.name) if new else named


def may_be_coupled(current: Fitted) -> bool:
    """True for a belt that nothing rattles on, and no coupling yet."""
    return STIFFNESS in current.model.parameters and not needs_observer(current.model) and may_add(current, COUPLING)


def with_coupling(data: Data, current: Fitted, axis: Axis) -> tuple[Data, Fitted] | None:
    """Records and model with a coupling that was asked for, whatever speaks for it; None where nothing can be begun."""
    found = grown_by_coupling(data, current, axis, alone=True) if may_be_coupled(current) else None
    return None if found is None else settled(*refit_with_rebuilt_motion(found[0], found[2], NEXT_ITERATIONS))


def grown_by_coupling(data: Data, current: Fitted, axis: Axis, *, alone: bool = False) -> tuple[Data, Fitted, Fitted, int] | None:
    """Records with steps of time that suit a coupling, the model as it is and with one, and places it was begun from; None for none.

    An end pulley comes with it where that leaves less than its parameters cost.

    Parameters
    ----------
    alone : bool
        No end pulley comes with it.
    """
    here, own = current.model, END_PULLEY.name in current.model.effects
    grounds = (here, start_model(axis, data.recordings))
    single = [] if own else [model for ground in grounds for model in raster(here, ground, False)]
    both = own or (not alone and may_add(current, END_PULLEY))
    double = [model for ground in grounds for model in raster(here, ground, True)] if both else []
    if not single + double:
        return None
    finer = for_coupling(data, (single + double)[0])
    against = current if finer is data else fit(finer, here, AGAIN, offsets=current.offsets)
    simple, more = (next(iter(best_from(finer, places)), None) for places in (single, double))
    if simple is not None and (more is None or drop_by(simple, more) <= bic_penalty(END_PULLEY, simple, len(double)) + EVIDENCE):
        return finer, against, simple, len(single)
    return None if more is None else (finer, against, more, len(double))


def raster(here: Model, start: Model, with_pulley: bool) -> Iterator[Model]:
    """Models with a coupling, and with an end pulley or without, whose low frequencies are those of the start values."""
    known = {name: start[name] for name in start.parameters if name in here.parameters}
    ground = here.with_values(known, "start")
    ground = ground.without_effect(END_PULLEY.name) if END_PULLEY.name in ground.effects else ground
    inertia, belt, mass = ground["motor.inertia"], ground[STIFFNESS], ground["cart.mass"]
    lever = ground["transmission.ratio"]
    pulleys = [(m, *span) for m in PULLEYS for span in SPANS] if with_pulley else [(0.0, 0.0, 0.0)]
    for stiffness, behind, (pulley, share, split) in itertools.product(STIFFNESSES, SHARES_BEHIND, pulleys):
        rest = 1.0 / belt - lever**2 / stiffness
        if rest <= 0.0:
            continue
        model = ground.with_effect(COUPLING.name).with_values(
            {
                "coupling.stiffness": stiffness,
                "driving_pulley.inertia": behind * inertia,
                "motor.inertia": (1.0 - behind) * inertia,
                STIFFNESS: 1.0 / rest,
            },
            "start",
        )
        if with_pulley:
            own = {"end_pulley.mass": pulley * mass, "end_pulley.share": share, "end_pulley.split": split}
            model = model.with_effect(END_PULLEY.name).with_values(own, "start")
        yield model


def best_from(data: Data, places: Sequence[Model]) -> list[Fitted]:
    """Fits begun from the places that suit the records best as they are; those that come far soon go on."""
    seen = by_objective(fit(data, model, 0) for model in places)
    begun = by_objective(fit(data, fitted.model, FIRST) for fitted in seen[:BEGUN])
    return by_objective(fit(data, fitted.model, ITERATIONS, offsets=fitted.offsets) for fitted in begun[:GO_ON])


def by_objective(fits: Iterable[Fitted]) -> list[Fitted]:
    """Fits in the order of what they leave, the least first; those that fly off are not among them."""
    return sorted((fitted for fitted in fits if math.isfinite(fitted.objective)), key=lambda fitted: fitted.objective)


def settled(data: Data, grown: Fitted) -> tuple[Data, Fitted]:
    """Records and model with a coupling, the motion between the samples rebuilt by it until both agree, from several stiffnesses; the best.

    The pulley swings faster than the samples show, so what it did there follows from the model, and more than one model agrees with that.
    """
    tried = [(data, grown)]
    for factor in ASIDE:
        begun = as_flexible(grown.model, factor * grown.model["coupling.stiffness"])
        if begun is None:
            continue
        ahead, found = data, fit(data, begun, APART, offsets=grown.offsets)
        for _ in range(ROUNDS):
            ahead, found = refit_with_rebuilt_motion(ahead, found, IN_A_ROUND)
        tried.append((ahead, found))
    return min(tried, key=lambda one: one[1].ratio if math.isfinite(one[1].objective) else math.inf)


def as_flexible(model: Model, stiffness: float) -> Model | None:
    """The model with another stiffness of its coupling, N m/rad, and the belt's with which both give way as before; None for none."""
    lever = model["transmission.ratio"] ** 2
    rest = 1.0 / model[STIFFNESS] + lever / model["coupling.stiffness"] - lever / stiffness
    return model.with_values({"coupling.stiffness": stiffness, STIFFNESS: 1.0 / rest}, "start") if rest > 0.0 else None
