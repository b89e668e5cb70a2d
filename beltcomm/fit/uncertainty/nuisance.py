"""Values of the torque path and parameters held at the data sheet: not quite known, from elsewhere, and every interval counts with them.

A parameter that the records do not tell is no result of theirs: it is held at the data sheet, its tolerance is its interval, and the
intervals of the others bear that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from beltcomm.effects import Parameter, effect_named
from beltcomm.fit.estimate import INERTIA, Fitted
from beltcomm.fit.likelihood.problem import OFFSET_M, Nuisance
from beltcomm.fit.noise.level import is_held
from beltcomm.fit.path_fit.values import path_nuisance
from beltcomm.fit.records import Data
from beltcomm.fit.residual.whitened import evaluate_each
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.model import BASE_BODIES, Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording.checks import rigid_inertia

#: Error over the noise up to which a base model explains records.
EXPLAINED = 1.5
#: What may be held, the first one first, with the tolerance of a data sheet: half an interval at 95 % over the value.
TOLERANCES: Mapping[str, float] = {"motor.inertia": 0.1, "belt_stiffness.stiffness": 0.3}
#: What they can be.
RANGES: Mapping[str, Parameter] = {
    "motor.inertia": BASE_BODIES["motor"].inertia,
    "belt_stiffness.stiffness": effect_named("belt_stiffness").parameters[0],
}
#: Half an interval over the value above which records do not tell it.   Source: method sheet, section 8.
UNTOLD = 0.3
#: Origin of a held value.
HELD = "data sheet, held"
#: Origin of an inertia that the fit lost and slow motion shows, and share of it by which its deviation may be for that.
SLOW, SURE = "slow motion, held", 0.1
#: Distance from a bound, relative to it, that is none; share of that inertia below which one is lost.
CLOSE, LOST = 1e-6, 0.5
#: Relative step of a difference.
STEP = 1e-3


def with_nuisance(data: Data, fitted: Fitted) -> Fitted:
    """The fit, whose intervals count with what path and held parameters leave open.

    Parameters
    ----------
    data : Data
        With their torque path.
    fitted : Fitted

    Returns
    -------
    Fitted
        The one given, changed in place.
    """
    known = [one for one in (path_nuisance(data, fitted), _held_nuisance(fitted)) if one is not None]
    if known:
        information = block_diag(*(one.information for one in known))
        told = np.concatenate([one.told for one in known])
        fitted.problem.nuisance = Nuisance(np.hstack([one.columns for one in known]), information, told)
    return fitted


def next_to_hold(fitted: Fitted, sheet: Model) -> str | None:
    """The parameter to be held next, because the records do not tell it; None where they do, or the data sheets do not know it.

    Parameters
    ----------
    fitted : Fitted
    sheet : Model
        The data sheets.
    """
    coarse = any(piece.motion.creep is not None for piece in fitted.problem.pieces)
    if fitted.ratio > EXPLAINED and not coarse:  # what an effect hides may be told beside it
        return None
    spread = parameter_spread(fitted)  # by the records alone, not by what the frictions' bounds leave of it
    for name in TOLERANCES:
        if name in fitted.problem.free and sheet.parameters[name].origin == "data sheet":
            half = spread.half_width({name: 1.0})
            return None if half is not None and half <= UNTOLD * fitted.model[name] else name
    return None


def hold(model: Model, name: str, value: float, interval: float, origin: str) -> Model:
    """The model with a parameter held.

    Parameters
    ----------
    model : Model
        As fitted.
    name : str
        Full name.
    value, interval : float
        In its unit; half an interval at 95 %.
    origin : str
        From where they are.
    """
    item = replace(model.parameters[name], value=value, low=value, high=value, interval=interval, origin=origin)
    return replace(model, parameters={**model.parameters, name: item})


def hold_lost_inertia(start: Model, data: Data, fitted: Fitted) -> Model | None:
    """The start with the inertia held that slow motion shows, where a rigid model has lost it; None where it has not.

    An acceleration that is mostly the noise of the angle, or made by a torque that nobody recorded, draws the inertia down, and of a
    smaller one the noise seems less: by turns both go to nothing.  A fraction of a second's mean of the motion bears neither.  Lost is an
    inertia at its bound; where all that is known of the torque is a command in steps, which excites nothing fast, one of less than half.

    Parameters
    ----------
    start : Model
        Model that the fit began from.
    data : Data
    fitted : Fitted
    """
    item = (fitted.likeliest or fitted).model.parameters[INERTIA]
    loaded = any(piece.motion.mounted for piece in fitted.problem.pieces)
    own = [r for r in data.recordings if not r.sidecar.held_out]
    at_bound = item.value <= item.low * (1.0 + CLOSE)
    if fitted.problem.movable or loaded or item.low == item.high or not (at_bound or is_held(own)):
        return None
    every = [rigid_inertia(r.t_s, r.torque, r.position) for r in own]
    sure = [one for one in every if one is not None and 0.0 < one.error < SURE * one.inertia]
    if not sure or len(sure) < len(every):
        return None
    best = min(sure, key=lambda one: one.error / one.inertia)
    if not at_bound and item.value > LOST * best.inertia:
        return None
    apart = max(abs(one.inertia - best.inertia) for one in sure)
    return hold(start, INERTIA, best.inertia, max(NORMAL_95 * best.error, apart), SLOW)


def released(model: Model) -> Model:
    """The model with what was held at the data sheet free again, within the range of its kind.

    Parameters
    ----------
    model : Model
        With or without such parameters.

    Returns
    -------
    Model
        Without intervals of these.
    """
    held = {name: RANGES[name] for name, item in model.parameters.items() if item.origin == HELD}
    free = {n: replace(model.parameters[n], low=r.low, high=r.high, interval=None, origin="data sheet") for n, r in held.items()}
    return replace(model, parameters={**model.parameters, **free})


def held_remarks(model: Model) -> list[str]:
    """Sentences on the parameters that are held.

    Parameters
    ----------
    model : Model
        With or without such parameters.
    """
    held = [(name, item) for name, item in model.parameters.items() if item.origin in (HELD, SLOW) and item.interval is not None]
    return [
        f"these records do not tell {name}: the data sheet's {item.value:.4g} ± {item.interval:.2g} {item.unit} was taken; an excitation "
        "that moves the motor by more steps of the encoder would tell it"
        if item.origin == HELD
        else f"{name} is held at the {item.value:.4g} ± {item.interval:.2g} {item.unit} that slow motion shows: faster, the motion follows "
        "a torque that was not recorded, or is noise of the angle; record the torque that acts, or an excitation that moves the motor more"
        for name, item in held
    ]


def _held_nuisance(fitted: Fitted) -> Nuisance | None:
    """Of the parameters that are held; None without any."""
    problem, held = fitted.problem, {n: p.interval for n, p in fitted.model.parameters.items() if p.origin in (HELD, SLOW) and p.interval}
    if not held or any(piece.whitener is None for piece in problem.pieces):
        return None
    vector, columns = problem.full(fitted.x), []
    steps = {name: STEP * fitted.model[name] for name in held}
    moved = [vector + step * np.eye(len(vector))[fitted.model.index(name)] for name, step in steps.items()]
    for piece, offset in zip(problem.pieces, OFFSET_M * fitted.offsets, strict=True):
        here, *ahead = evaluate_each(piece, fitted.model, [vector, *moved], [float(offset)] * (1 + len(moved)))
        changes = np.stack([(one - here) / step for one, step in zip(ahead, steps.values(), strict=True)], axis=1)
        columns.append(piece.white(changes))
    information = np.diag([(NORMAL_95 / interval) ** 2 for interval in held.values()])
    return Nuisance(np.concatenate(columns), information, np.zeros(len(held), dtype=np.bool_))
