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
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.likelihood.problem import OFFSET_M, Nuisance
from beltcomm.fit.path_fit.values import path_nuisance
from beltcomm.fit.records import Data
from beltcomm.fit.residual.whitened import evaluate_each
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.model import BASE_BODIES, Model
from beltcomm.model.value import NORMAL_95

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
#: Relative step of a difference.
STEP = 1e-3


def with_nuisance(data: Data, fitted: Fitted) -> Fitted:
    """The fit, whose intervals count with what path and held parameters leave open.

    Parameters
    ----------
    data : Data
        With their torque path.
    fitted : Fitted
        Model, fitted to the records.

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
        Model, fitted to the records.
    sheet : Model
        The data sheets.
    """
    coarse = any(piece.motion.creep is not None for piece in fitted.problem.pieces)
    if fitted.ratio > EXPLAINED and not coarse:  # what an effect hides may be told beside it
        return None
    told = with_intervals(fitted).parameters
    for name in TOLERANCES:
        if name in fitted.problem.free and sheet.parameters[name].origin == "data sheet":
            item = told[name]
            return None if item.interval is not None and item.interval <= UNTOLD * item.value else name
    return None


def hold(model: Model, sheet: Model, name: str) -> Model:
    """The model with a parameter held at the data sheet.

    Parameters
    ----------
    model : Model
        As fitted.
    sheet : Model
        By the data sheets.
    name : str
        Full name, one of :data:`TOLERANCES`.

    Returns
    -------
    Model
        With the tolerance as its interval.
    """
    value = sheet[name]
    item = replace(model.parameters[name], value=value, low=value, high=value, interval=TOLERANCES[name] * value, origin=HELD)
    return replace(model, parameters={**model.parameters, name: item})


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

    Returns
    -------
    list of str
        One for each.
    """
    held = [(name, item) for name, item in model.parameters.items() if item.origin == HELD and item.interval is not None]
    return [
        f"these records do not tell {name}: the data sheet's {item.value:.4g} ± {item.interval:.2g} {item.unit} was taken; an excitation "
        "that moves the motor by more steps of the encoder would tell it"
        for name, item in held
    ]


def _held_nuisance(fitted: Fitted) -> Nuisance | None:
    """Of the parameters that are held; None without any."""
    problem, held = fitted.problem, [name for name, item in fitted.model.parameters.items() if item.origin == HELD]
    if not held or any(piece.whitener is None for piece in problem.pieces):
        return None
    vector, columns = problem.full(fitted.x), []
    steps = {name: STEP * fitted.model[name] for name in held}
    moved = [vector + step * np.eye(len(vector))[fitted.model.index(name)] for name, step in steps.items()]
    for piece, offset in zip(problem.pieces, OFFSET_M * fitted.offsets, strict=True):
        here, *ahead = evaluate_each(piece, fitted.model, [vector, *moved], [float(offset)] * (1 + len(moved)))
        changes = np.stack([(one - here) / step for one, step in zip(ahead, steps.values(), strict=True)], axis=1)
        columns.append(piece.white(changes))
    deviations = [TOLERANCES[name] * fitted.model[name] / NORMAL_95 for name in held]
    information = np.diag([1.0 / deviation**2 for deviation in deviations])
    return Nuisance(np.concatenate(columns), information, np.zeros(len(held), dtype=np.bool_))
