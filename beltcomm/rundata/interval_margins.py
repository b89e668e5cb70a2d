"""A controller at both ends of what is known of the axis: refused before it is written where it does not hold there.

An inertia or a stiffness goes to an end of its 95 % interval, and with it what the fit cannot tell apart from it:

    δ_k = Σ_kn/Σ_nn δ_n

Σ : covariance of the fit.   The way ends where the parameter meets its bound, and the others stay at theirs: no mass is negative, however
wide its interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from beltcomm.control import Cascade
from beltcomm.design.cascade import DesignResult
from beltcomm.design.cautious import FRICTIONS, with_least_damping
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.margins import WorstMargins, margins, worst_of
from beltcomm.design.specification import Specification, relaxed_to
from beltcomm.errors import Refused
from beltcomm.given import pasted
from beltcomm.model import BELT_STIFFNESSES, Model
from beltcomm.rundata.analyse import LEAST_PHASE_MARGIN_DEG, design_plants
from beltcomm.rundata.calibration import at_interval_ends, unsure
from beltcomm.runfolder import RunFolder

#: Of a controller that is refused.
KEPT = "It was not written, the records are kept"


def first_loop_plants(model: Model, position_m: float, dead_time_s: float, apparent_damping_nm_s_rad: float) -> list[DesignPlant]:
    """The plants of a first loop at one place, as certain as the model has them.

    Parameters
    ----------
    model : Model
        A first one, or at an end of an interval.
    position_m : float, m
        Carriage on the axis.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`beltcomm.rundata.analyse.design_plants`.
    """
    plant = design_plants(model, [position_m], [model["cart.mass"]], dead_time_s, apparent_damping_nm_s_rad)[-1]
    return with_friction_fractions(with_least_damping(plant), FRICTIONS)


def require_over_intervals(
    name: str, result: DesignResult, model: Model, plants: Callable[[Model], Sequence[DesignPlant]], folder: RunFolder
) -> None:
    """Refuse a controller that loses its margins at an end of the 95 % interval of an inertia, a mass, a spring or its own gains' units.

    The margins are those that the design itself is refused below: as it asked for, relaxed until ``LEAST_PHASE_MARGIN_DEG`` is left.

    Parameters
    ----------
    name : str
        Of the controller, for the refusal.
    result : DesignResult
        With the margins that it was designed for.
    model : Model
        That it was designed on, with intervals.
    plants : callable
        Of a model, to the plants of it that the controller must hold for.
    folder : RunFolder
        With the records, and what was measured of the drive's gains.

    Raises
    ------
    Refused
        With what is known too badly, the end of its interval, and what is missing there.
    """
    least = relaxed_to(result.specification, LEAST_PHASE_MARGIN_DEG)

    def missing(cascade: Cascade, at: Model) -> str:
        return _missing(worst_of(margins(cascade, plants(at), result.structure.period_s)), least)

    for end in _interval_ends(model):
        if short := missing(result.cascade, end.model):
            known, at = model.parameters[end.name], replace(end.model.parameters[end.name], interval=None)
            raise Refused(
                f"{name} does not hold over what is known of this axis: {end.name} is {known}, and at {at} {short}. {KEPT}; make a "
                "response that tells it better (`beltcomm identify` at another place, or with --excitation chirp), or look what the model "
                f"lacks: `beltcomm diagnose {pasted(folder.path)}`"
            )
    for cascade in at_interval_ends(folder, result.cascade):
        if short := missing(cascade, model):
            raise Refused(
                f"{name} does not hold over what is known of this drive's gains, ± {100.0 * unsure(folder):.2g} %: should its Kp "
                f"{result.cascade.kp_nm_s_rad:.3g} N m s/rad be {cascade.kp_nm_s_rad:.3g} and its Kv {result.cascade.kpp_1_s:.3g} 1/s be "
                f"{cascade.kpp_1_s:.3g}, {short}. {KEPT}; measure them again (`beltcomm calibrate`), with a shorter --sample-period where "
                "the bus allows one"
            )


def _missing(found: WorstMargins, least: Specification) -> str:
    """Sentence on the margin that is below the least; "" where none is."""
    if not found.stable:
        return "it is unstable"
    margins_deg = {
        "velocity": (found.phase_margin_deg, least.phase_margin_deg),
        "position": (found.position_phase_margin_deg, least.position_phase_margin_deg),
    }
    for loop, (left, needed) in margins_deg.items():
        if left < needed:
            return f"its {loop} loop is left with {left:.1f} deg of phase margin, {needed:.1f} are the least"
    if found.gain_margin_db < least.gain_margin_db:
        return f"it is left with {found.gain_margin_db:.1f} dB of gain margin, {least.gain_margin_db:.1f} are the least"
    if found.sensitivity_db > least.sensitivity_db:
        return f"its sensitivity is {found.sensitivity_db:.1f} dB, {least.sensitivity_db:.1f} are the most"
    return ""


@dataclass(frozen=True)
class IntervalEnd:
    """A model at one end of the 95 % interval of one of its parameters.

    Attributes
    ----------
    name : str
        Full name of the parameter.
    model : Model
        With the parameter there.
    """

    name: str
    model: Model


def _interval_ends(model: Model) -> list[IntervalEnd]:
    """Both ends, the lower first, of every inertia and spring of a model that is an estimate; none where nothing was estimated."""
    names = [name for name in (*(name for name, _ in model.bodies()), *BELT_STIFFNESSES) if name in model.parameters]
    estimated = [name for name in names if model.parameters[name].interval_95 is not None]
    return [IntervalEnd(name, _moved(model, name, sign, estimated)) for name in estimated for sign in (-1.0, 1.0)]


def _moved(model: Model, name: str, sign: float, along: list[str]) -> Model:
    """The model with a parameter at an end of its interval, and those along with it that the fit ties to it."""
    half, ties = model.parameters[name].interval or 0.0, {name: 1.0}
    if model.covariance is not None and name in model.covariance.names:
        matrix, at = model.covariance.of(along), along.index(name)
        if matrix[at, at] > 0.0:
            ties |= {other: float(matrix[k, at] / matrix[at, at]) for k, other in enumerate(along)}
    way = _inside(model, name, sign * half) - model[name]
    return model.with_values({other: _inside(model, other, tie * way) for other, tie in ties.items()})


def _inside(model: Model, name: str, way: float) -> float:
    """Value so far away from that of the model, or its bound on that way."""
    item = model.parameters[name]
    return min(max(item.value + way, item.low), item.high)
