"""A gap from the masses and the stiffness of the start values, where the fit without one is far from everything.

Excitations that hardly cross a gap let the motor swing alone, and the fit makes masses, a soft spring and a damping of it: from there a gap
is found too wide behind a spring too stiff, or not at all.  The start values know better: the motor's inertia and the stiffness are on data
sheets, and slow motion tells the whole load.  An observer holds near the model it was made for, and behind it no small step is better: so
the likelihood is searched without derivatives, every look with an observer of its own, first on a raster of gap and contact.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.optimize import minimize

from beltcomm.arrays import Array
from beltcomm.effects import EFFECTS, Effect
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data, negative_log_likelihood, with_process_noise
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.start.model import MOTOR_SHARE
from beltcomm.laboratory.acceptance import STIFFNESS, drop_by
from beltcomm.laboratory.selection import Candidate, candidate, may_add
from beltcomm.model import Model

#: m and shares of the gap; gaps, each half as much again, and the roundness of their contact that are tried.
GAPS_M, ROUNDINGS = tuple(5e-6 * 1.5**step for step in range(10)), (0.01, 0.03, 0.1)
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
ROUNDS, SMALLER, LOOKS = 3, 0.3, 150


def gap_from_start(data: Data, current: Fitted, start: Model) -> Candidate | None:
    """The likeliest gap as a candidate; None where the fit is near the noise, or has a gap or no spring to put one beside.

    Parameters
    ----------
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
    ground = as_started(model, start)
    ways = [with_gap(ground, gap, width, rounding) for width, rounding in itertools.product(GAPS_M, ROUNDINGS)]
    begun = min(ways, key=lambda way: negative_log_likelihood(data.fitted, way))
    for number in range(ROUNDS):
        data = with_process_noise(data, begun)
        begun = likelier(data, begun, SMALLER**number)
    best = fit(data, begun, 0)
    return candidate(data, current, gap, drop_by(current, best), best, len(ways))


def likelier(data: Data, model: Model, size: float) -> Model:
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


def with_gap(model: Model, gap: Effect, width: float, rounding: float) -> Model:
    """The model with a gap of that width in metres, its contact round over that share of it."""
    width_name, rounding_name = (parameter.name for parameter in gap.parameters)
    return model.with_effect(gap.name, {width_name: width, rounding_name: rounding})


def as_started(model: Model, start: Model) -> Model:
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
