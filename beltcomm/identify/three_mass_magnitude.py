"""The thesis's log-magnitude fit (3.32) to (3.34) with three masses: over all frequency responses at once, friction as damping.

For comparison with the fit that explains torque from motion (:mod:`beltcomm.identify.three_mass`), which holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from beltcomm.arrays import Array, decibels, rms
from beltcomm.axis import Axis
from beltcomm.identify.magnitude_fit import HIGHEST_SAMPLED, chosen_lines
from beltcomm.model import Model, build_model
from beltcomm.model.linear import operating_point, sampled_response
from beltcomm.model.value import Value
from beltcomm.response import FrequencyResponse

#: Fitted in logarithms, which keeps them positive.
FREE = (
    "cart.mass",
    "end_pulley.mass",
    "belt_sections.specific_stiffness",
    "belt_sections.specific_damping",
    "viscous.damping",
    "viscous_cart.damping",
)
#: What stands for Coulomb friction around standstill at first, N m s/rad and N s/m.
START_DAMPING = {"viscous.damping": 0.02, "viscous_cart.damping": 10.0}
#: Lowest value of a logarithm's argument, over its start; lines of one response; N m s/rad, losses of a coupling.
FLOOR, LINES, COUPLING_DAMPING = 1e-4, 60, 1e-3
#: Relative change of the cost, or of the logarithms, that is not worth another step; decibels are known to some hundredths.
ENOUGH = 1e-5


@dataclass(frozen=True)
class ThreeMassMagnitude:
    """Log-magnitude fit of three masses.

    Attributes
    ----------
    parameters : dict of str to Value
        By name, with 95 % intervals of the linearised problem, as wide as the misfit asks.
    rms_db : float
        Of what is left, dB.
    coupled : bool
        The coupling counts as a spring, from the data sheet.
    """

    parameters: Mapping[str, Value]
    rms_db: float
    coupled: bool


def fit_magnitudes(
    responses: Mapping[str, FrequencyResponse], places_m: Mapping[str, float], start: Model, axis: Axis
) -> ThreeMassMagnitude | None:
    """The better of the three-mass model with a rigid coupling and, where the data sheet knows its stiffness, with that one; None
    without a response.

    J = Σ (20 lg |Ĝ(f_i)| - 20 lg |G(f_i)|)²   with G sampled exactly at each place, Θ_e and the belt's geometry given

    Parameters
    ----------
    responses : mapping of str to FrequencyResponse, rad/(N m), motor shaft
        By record.
    places_m : dict of str to float
        Of the responses, m.
    start : Model
        Three-mass model; its Coulomb friction is left out.
    axis : Axis
    """
    chosen = {name: chosen_lines(r, LINES, HIGHEST_SAMPLED) for name, r in responses.items()}
    if not chosen:
        return None
    models = [_linear_model(start, axis)]
    if axis.coupling.stiffness_nm_rad is not None:
        models.append(_with_coupling(models[0], axis))
    return min((_fitted(chosen, places_m, model) for model in models), key=lambda fit: fit.rms_db)


def _linear_model(model: Model, axis: Axis) -> Model:
    """The model with viscous friction alone, at values that Coulomb friction poses as around standstill.

    Returns
    -------
    Model
        Start values of a fit of magnitudes.
    """
    values = {name: model[name] for name in model.parameters if name.partition(".")[0] not in ("coulomb", "cart_friction")}
    values |= {"belt_sections.offset": axis.travel.driven_side_offset_m, **START_DAMPING}
    effects = [e for e in model.effects if e not in ("coulomb", "cart_friction")]
    return build_model(model.name, effects, values, origin="log-magnitude fit")


def _with_coupling(model: Model, axis: Axis) -> Model:
    """The model with the data sheet's coupling as a spring at the motor shaft: half of it turns with the motor, half with the pulley.

    Parameters
    ----------
    model : Model
        Without a coupling.
    axis : Axis
        With inertias of coupling, pulley and gearbox, kg m².

    Returns
    -------
    Model
        The inertia of motor and pulley together as it was.
    """
    behind = ((axis.get("pulley.inertia_kg_m2") or 0.0) + axis.gearbox.inertia_kg_m2) / axis.gearbox.ratio**2
    behind += 0.5 * axis.coupling.inertia_kg_m2
    values = {"stiffness": float(axis.coupling.stiffness_nm_rad or 0.0), "damping": COUPLING_DAMPING, "driving_pulley.inertia": behind}
    coupled = model.with_effect("coupling", {**values, "inertia": behind}, "data sheet")
    return coupled.with_values({"motor.inertia": axis.motor_side_inertia_kg_m2 - behind}, "data sheet")


def _fitted(chosen: Mapping[str, FrequencyResponse], places_m: Mapping[str, float], start: Model) -> ThreeMassMagnitude:
    points = {name: operating_point(start, places_m[name], 1.0) for name in chosen}
    measured = {name: decibels(r.h) for name, r in chosen.items()}
    begin = np.array([start[name] for name in FREE])
    limits = [start.parameters[name] for name in FREE]
    low = np.log([max(v.low, FLOOR * b) for v, b in zip(limits, begin, strict=True)])
    high = np.log([v.high for v in limits])

    def residual(logarithms: Array) -> Array:
        model = start.with_values(dict(zip(FREE, np.exp(logarithms).tolist(), strict=True)))
        parts = []
        for name, response in chosen.items():
            h = sampled_response(model, points[name], response.freq_hz, response.sample_period_s)
            parts.append(measured[name] - decibels(h))
        return np.concatenate(parts)

    edge = 1e-9 * (high - low)
    found = least_squares(
        residual, np.clip(np.log(begin), low + edge, high - edge), bounds=(low + edge, high - edge), x_scale="jac", ftol=ENOUGH, xtol=ENOUGH
    )
    freedom = len(found.fun) - len(FREE)
    variance = float(np.sum(found.fun**2)) / freedom
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    values = np.exp(found.x)
    half = float(stdtrit(freedom, 0.975)) * np.sqrt(np.diag(covariance)) * values
    parameters = {
        name: Value(float(value), item.unit, item.side, item.low, item.high, float(width), "log-magnitude fit")
        for name, value, width, item in zip(FREE, values, half, limits, strict=True)
    }
    return ThreeMassMagnitude(parameters, rms(found.fun), "coupling" in start.effects)
