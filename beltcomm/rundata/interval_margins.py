"""A controller at both ends of what is known of the axis: where it does not hold there no machine gets it unasked.

An inertia or a stiffness goes to an end of its 95 % interval, and with it what the fit cannot tell apart from it:

    δ_k = Σ_kn/Σ_nn δ_n

Σ : covariance of the fit.   The way ends where the parameter meets its bound, and the others stay at theirs: no mass is negative, however
wide its interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.design.cautious import FRICTIONS, with_least_damping
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.margins import margins, worst_of
from beltcomm.design.specification import Infeasible, relaxed_to
from beltcomm.errors import Refused
from beltcomm.given import pasted
from beltcomm.model import BELT_STIFFNESSES, Model
from beltcomm.rundata.analyse import LEAST_PHASE_MARGIN_DEG, design_plants, first_loop, plants_with_damping
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


def first_loop_over_intervals(
    model: Model, structure: CascadeStructure, position_m: float, dead_time_s: float, apparent_damping_nm_s_rad: float, folder: RunFolder
) -> DesignResult:
    """The first loop; where it does not hold over what is known a gentler one, designed for the ends of the intervals, too.

    Parameters
    ----------
    model : Model
        A first one, with intervals.
    structure : CascadeStructure
        Of the loops in the drive.
    position_m : float, m
        Carriage on the axis.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`beltcomm.rundata.analyse.design_plants`.
    folder : RunFolder
        With the records, and what was measured of the drive's gains.

    Raises
    ------
    Refused
        Where none holds.
    """
    seen = position_m, dead_time_s, apparent_damping_nm_s_rad

    def short(result: DesignResult) -> str:
        return over_intervals("the first loop", result, model, lambda at_end: first_loop_plants(at_end, *seen), folder)

    result = first_loop(model, structure, *seen)
    if not (why := short(result)):
        return result
    with suppress(Infeasible):
        lacking = plants_that_lack(result, model, lambda at_end: first_loop_plants(at_end, *seen))
        gentler = first_loop(model, structure, *seen, lacking)
        if not short(gentler):
            return gentler
    raise Refused(f"{why}. {KEPT}")


def final_plants(
    positions_m: Sequence[float], payloads_kg: Sequence[float], dead_time_s: float, apparent_damping_nm_s_rad: float
) -> Callable[[Model], list[DesignPlant]]:
    """Of a model, the plants of a final design.

    Parameters
    ----------
    positions_m : sequence of float, m
        Carriage on the axis.
    payloads_kg : sequence of float, kg
        Further ones than what is mounted.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`beltcomm.rundata.analyse.design_plants`.
    """

    def plants(model: Model) -> list[DesignPlant]:
        masses = [model["cart.mass"] + extra for extra in (0.0, *payloads_kg)]
        return plants_with_damping(model, positions_m, masses, dead_time_s, apparent_damping_nm_s_rad)

    return plants


def plants_that_lack(result: DesignResult, model: Model, plants: Callable[[Model], Sequence[DesignPlant]]) -> list[DesignPlant]:
    """Plants of a model at both ends of the 95 % intervals of those inertias and springs at an end of which a controller does not hold.

    Parameters
    ----------
    result : DesignResult
        With the margins that it was designed for.
    model : Model
        That it was designed on, with intervals.
    plants : callable
        Of a model, to its plants.
    """
    ends = [(end.name, plants(end.model)) for end in _interval_ends(model)]
    lacking = {name for name, at_end in ends if _missing(result, result.cascade, at_end)}
    return [plant for name, at_end in ends if name in lacking for plant in at_end]


def over_intervals(
    name: str, result: DesignResult, model: Model, plants: Callable[[Model], Sequence[DesignPlant]], folder: RunFolder
) -> str:
    """Sentence on a controller that loses its margins at an end of the 95 % interval of an inertia, a mass, a spring or its gains' units.

    The margins are those that the design itself is refused below: as it asked for, relaxed until ``LEAST_PHASE_MARGIN_DEG`` is left.

    Parameters
    ----------
    name : str
        Of the controller.
    result : DesignResult
        With the margins that it was designed for.
    model : Model
        That it was designed on, with intervals.
    plants : callable
        Of a model, to the plants of it that the controller must hold for.
    folder : RunFolder
        With the records, and what was measured of the drive's gains.

    Returns
    -------
    str
        What is known too badly, the end of its interval, what is missing there and what to do; "" where the controller holds.
    """
    for end in _interval_ends(model):
        if short := _missing(result, result.cascade, plants(end.model)):
            known, at = model.parameters[end.name], replace(end.model.parameters[end.name], interval=None)
            return (
                f"{name} does not hold over what is known of this axis: {end.name} is {known}, and at {at} {short}; make a "
                "response that tells it better (`beltcomm identify` at another place, or with --excitation chirp), or look what the model "
                f"lacks: `beltcomm diagnose {pasted(folder.path)}`"
            )
    for cascade in at_interval_ends(folder, result.cascade):
        if short := _missing(result, cascade, plants(model)):
            return (
                f"{name} does not hold over what is known of this drive's gains, ± {100.0 * unsure(folder):.2g} %: should its Kp "
                f"{result.cascade.kp_nm_s_rad:.3g} N m s/rad be {cascade.kp_nm_s_rad:.3g} and its Kv {result.cascade.kpp_1_s:.3g} 1/s be "
                f"{cascade.kpp_1_s:.3g}, {short}; measure them again (`beltcomm calibrate`), with a shorter --sample-period where "
                "the bus allows one"
            )
    return ""


def _missing(result: DesignResult, cascade: Cascade, plants: Sequence[DesignPlant]) -> str:
    """Sentence on the margin of a cascade on some plants that is below the least of a design; "" where none is."""
    least, found = relaxed_to(result.specification, LEAST_PHASE_MARGIN_DEG), worst_of(margins(cascade, plants, result.structure.period_s))
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
