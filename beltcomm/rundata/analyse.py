"""From recordings to results, without a machine: the same functions serve the sequence and the single commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import rms
from beltcomm.control import Cascade, CascadeStructure, PrefilterKind
from beltcomm.design.cascade import DesignResult, design_cascade, feasible_cascade
from beltcomm.design.cautious import (
    LEAST_RESONANCE_DAMPING,
    cautious_cascade,
    cautious_specification,
    uncertain_plants,
    with_resonance_damping,
)
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.feedforward import FeedforwardKind, SentFeedforward, feedforward_from
from beltcomm.design.specification import PRODUCT_SPECIFICATION, Infeasible, Specification
from beltcomm.design.structure import late_s, loop_model
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.errors import DataError, Refused
from beltcomm.fit.model_fit import ModelFit
from beltcomm.identify.dead_time import DeadTime, dead_time_between
from beltcomm.identify.friction import FrictionFit, Plateau, fit_friction
from beltcomm.identify.landmarks import Shape, shape_of
from beltcomm.identify.loop_response import response_to_signal
from beltcomm.identify.magnitude_fit import MagnitudeFit, Solver, fit_magnitude
from beltcomm.identify.sweeps import plateaus_of
from beltcomm.model import Model
from beltcomm.model.linear import operating_point
from beltcomm.model.transfer import two_mass
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.response.distortion import distortion
from beltcomm.simulate.stopping import total_friction, total_viscous

#: Below this a loop is refused, whatever the drive's structure.
LEAST_PHASE_MARGIN_DEG = 10.0
#: Hz: what nothing swings is excited from here on, as far as its records can show.
RIGID_LOWEST_HZ = 20.0
#: Uncertainty of mass and stiffness that the first loop must bear: as much as the drive's structure allows.
UNCERTAINTIES = (0.3, 0.15, 0.05)


@dataclass(frozen=True)
class Characteristic:
    """A number derived from the fit, with its 95 % interval (half width)."""

    value: float
    interval: float
    unit: str


def responses(recordings: Sequence[Recording], *, setpoint: bool = False) -> dict[str, FrequencyResponse]:
    """Frequency response of every periodic excited record, by name; from the torque setpoint when asked for.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one period are left out.
    setpoint : bool
        True for the torque setpoint in place of the torque.

    Returns
    -------
    dict of str to FrequencyResponse, rad/(N m)
        Motor shaft.
    """
    found = {}
    for recording in recordings:
        note = recording.sidecar.excitation
        torque = recording.torque_setpoint if setpoint else recording.torque
        if recording.sidecar.experiment != "frf" or note is None or not note.period_samples or torque is None:
            continue
        try:
            found[recording.name] = response_to_signal(recording, torque)
        except DataError:
            continue  # a record with a single period: it serves the final fit, not the picture
    return found


@dataclass(frozen=True)
class Nonlinearity:
    """Answers of a multisine on its silent lines in a band, Hz: rms of odd and even answers and noise, over the linear one."""

    odd: float
    even: float
    noise: float
    low_hz: float
    high_hz: float


def nonlinearities(recordings: Sequence[Recording]) -> dict[str, Nonlinearity]:
    """Distortion and noise of every open-loop record of a multisine with at least two whole periods, by its name.

    Parameters
    ----------
    recordings : sequence of Recording
        Those in closed loop are left out: a loop answers on the silent lines itself.

    Returns
    -------
    dict of str to Nonlinearity
        rms of odd and even distortion and of noise, over that of the linear answer.
    """
    found = {}
    for recording in recordings:
        note = recording.sidecar.excitation
        if note is None or note.kind != "multisine" or not note.period_samples or recording.sidecar.closed_loop:
            continue
        try:
            split = distortion(
                recording.torque,
                recording.position,
                recording.sample_period_s,
                note.period_samples,
                note.first_sample,
                t_s=recording.t_s,
            )
        except DataError:
            continue  # too short: it serves the fit
        low, high = float(split.freq_hz[0]), float(split.freq_hz[-1])
        linear = rms(split.speed)
        noise = rms(np.concatenate((split.odd.noise, split.even.noise)))
        found[recording.name] = Nonlinearity(
            split.odd.rms(low, high) / linear, split.even.rms(low, high) / linear, noise / linear, low, high
        )
    return found


def thesis_fit(response: FrequencyResponse, model: Model, solver: Solver = "lm") -> MagnitudeFit:
    """The thesis's log-magnitude fit of (2.42), inertia and transmission from the data sheets; biased by friction.

    Parameters
    ----------
    response : FrequencyResponse, rad/(N m), motor shaft
        Torque to motor angle.
    model : Model
        For inertia and transmission.
    solver : Solver
        Of the least squares.
    """
    return fit_magnitude(response, model["transmission.ratio"], model["motor.inertia"], solver=solver)


def dead_time_of(recordings: Sequence[Recording], highest_hz: float) -> DeadTime:
    """Delay from torque setpoint to acting torque, from the record with the most periods.

    Parameters
    ----------
    recordings : sequence of Recording
    highest_hz : float, Hz
        Up to which lines count.

    Raises
    ------
    DataError
    """
    by_torque = responses(recordings)
    by_setpoint = responses(recordings, setpoint=True)
    common = [name for name in by_torque if name in by_setpoint]
    if not common:
        raise DataError("no excited record has both torque_nm and torque_setpoint_nm; the drive's delay cannot be told")
    standing = {r.name for r in recordings if not r.sidecar.moving}  # louder: nothing turns round that should not
    best = max(common, key=lambda name: (name in standing, by_torque[name].n_periods))
    return dead_time_between(by_setpoint[best], by_torque[best], lowest_hz=2.0, highest_hz=highest_hz)


def friction_of(recordings: Sequence[Recording], slowest_rad_s: float = 0.0, inertia_kg_m2: float = 0.0) -> FrictionFit:
    """Friction (3.36) from all constant-speed sweeps.

    Parameters
    ----------
    recordings : sequence of Recording
    slowest_rad_s : float
        Slower passes are shown and not fitted.
    inertia_kg_m2 : float
        Of all that moves, at the motor; 0 when not known, see :func:`find_plateaus`.

    Raises
    ------
    DataError
        When there is none or no plateau is usable.
    """
    plateaus: list[Plateau] = []
    for recording in recordings:
        if recording.sidecar.experiment != "friction_sweep" or recording.reference_velocity is None:
            continue
        plateaus += plateaus_of(recording, inertia_kg_m2)
    if not plateaus:
        dumb = [r.name for r in recordings if r.sidecar.experiment == "friction_sweep"]
        if dumb:
            raise DataError(
                f"{', '.join(dumb)}: sweeps without the speed that was asked for (reference_velocity_rad_s), which says where it is "
                "constant; friction comes from the fit over all records"
            )
        raise DataError("no recording of a constant-speed sweep (experiment: friction_sweep); record one with `beltcomm friction`")
    return fit_friction(plateaus, slowest_rad_s=slowest_rad_s)


def characteristics(fit: ModelFit, position_m: float) -> dict[str, Characteristic]:
    """Resonance, antiresonance and total Coulomb friction with intervals from the fit's covariance (linear propagation).

    Parameters
    ----------
    fit : ModelFit
        With its covariance.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    dict of str to Characteristic
        By name, with 95 % half width and unit; a rigid model has no resonances.
    """

    def numbers(model: Model) -> np.ndarray:
        two = None if model.rigid else two_mass(model, operating_point(model, position_m, 1.0))
        resonances = () if two is None else (two.resonance_hz, two.antiresonance_hz)
        return np.array([*resonances, total_friction(model), total_viscous(model)])

    here = numbers(fit.model)
    slopes, covariance = [], fit.covariance
    for i, name in enumerate(covariance.names):
        deviation = math.sqrt(covariance.matrix[i, i])
        item = fit.model.parameters[name]
        step = min(0.1 * deviation, 0.5 * (item.high - item.value)) if deviation else 0.0
        slopes.append((numbers(fit.model.with_values({name: item.value + step})) - here) / step if step else np.zeros(len(here)))
    jacobian = np.array(slopes)
    half = fit.quantile * np.sqrt(np.einsum("ij,ik,kj->j", jacobian, covariance.matrix, jacobian))
    shown = slice(2 if fit.model.rigid else 0, None)
    names = ("resonance", "antiresonance", "coulomb_total", "viscous_total")[shown]
    units = ("Hz", "Hz", "N m", "N m s/rad")[shown]
    return {n: Characteristic(float(v), float(h), u) for n, v, h, u in zip(names, here, half, units, strict=True)}


def design_plants(
    model: Model,
    positions_m: Sequence[float],
    masses_kg: Sequence[float],
    dead_time_s: float,
    apparent_damping_nm_s_rad: float,
) -> list[DesignPlant]:
    """The plants a loop must hold for: places, payloads, and every damping between none and the apparent one.

    Parameters
    ----------
    model : Model
    positions_m : sequence of float, m
        Carriage on the axis.
    masses_kg : sequence of float, kg
        Carriage with payload.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float
        What a frequency response around standstill shows, at the motor; the axis in motion has less.
    """
    plants = []
    late = late_s(model)
    for position in positions_m:
        two = loop_model(model, position)
        moving = model.get("viscous.damping") + two.transmission_m_rad**2 * model.get("viscous_cart.damping")
        apparent = max(apparent_damping_nm_s_rad, moving)
        fractions = sorted({0.0, moving / apparent if apparent else 0.0, 0.5, 1.0})
        for mass in masses_kg:
            plant = DesignPlant(
                inertia_kg_m2=two.inertia_kg_m2,
                transmission_m_rad=two.transmission_m_rad,
                mass_kg=mass,
                stiffness_n_m=two.stiffness_n_m,
                motor_damping_nm_s_rad=apparent,
                belt_damping_ns_m=two.belt_damping_ns_m,
                dead_time_s=dead_time_s + late,
                name=f"{position:.2f} m, {mass:.2f} kg",
                bodies=None if two.bodies is None else two.bodies.with_carriage(mass),
            )
            plants += with_friction_fractions(plant, fractions)
    return plants


def _tells_no_damping(model: Model) -> bool:
    return model.get("belt_damping.damping", 1.0) == 0.0


def plants_with_damping(
    model: Model,
    positions_m: Sequence[float],
    masses_kg: Sequence[float],
    dead_time_s: float,
    apparent_damping_nm_s_rad: float,
) -> list[DesignPlant]:
    """The plants of a final design: those of :func:`design_plants`, none without any damping of its belt.

    A fit at its bound tells none, and no loop suppresses such a resonance; counted as by the first loop, which ran the axis.

    Parameters
    ----------
    model : Model
    positions_m : sequence of float, m
        Carriage on the axis.
    masses_kg : sequence of float, kg
        Carriage with payload.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`design_plants`.
    """
    plants = design_plants(model, positions_m, masses_kg, dead_time_s, apparent_damping_nm_s_rad)
    if not _tells_no_damping(model):
        return plants
    return [p if p.bodies else with_resonance_damping(p, LEAST_RESONANCE_DAMPING) for p in plants]


def design(
    model: Model,
    structure: CascadeStructure,
    *,
    positions_m: Sequence[float],
    masses_kg: Sequence[float],
    dead_time_s: float,
    apparent_damping_nm_s_rad: float,
    prefilter: PrefilterKind | None = None,
    feedforward: FeedforwardKind = "nonlinear",
    specification: Specification | None = None,
    besides: Sequence[DesignPlant] = (),
) -> tuple[DesignResult, Cascade]:
    """The proven cascade and, with the feedforward of the model as far as the drive has it, what goes into the drive.

    Parameters
    ----------
    model : Model
    structure : CascadeStructure
    positions_m : sequence of float, m
        Carriage on the axis.
    masses_kg : sequence of float, kg
        Carriage with payload.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`design_plants`.
    prefilter : PrefilterKind or None
        The only kind to try; None: all that the drive has.
    feedforward : FeedforwardKind
        Kind that is asked for.
    specification : Specification or None
        Margins and targets; None for the usual ones.
    besides : sequence of DesignPlant
        For which it must hold, too; they are not among the plants of the result.

    Raises
    ------
    Refused
        (Infeasible) with what binds.
    """
    require_offered(structure, prefilter)
    wanted = specification or PRODUCT_SPECIFICATION
    if prefilter is not None:
        wanted = replace(wanted, prefilters=(prefilter,))
    plants = plants_with_damping(model, positions_m, masses_kg, dead_time_s, apparent_damping_nm_s_rad)
    try:
        result = design_cascade([*plants, *besides], structure, wanted)
    except Infeasible as refusal:
        nearest = refusal.nearest
        if specification is not None or nearest is None or nearest.phase_margin_deg < LEAST_PHASE_MARGIN_DEG:
            raise
        result = design_cascade([*plants, *besides], structure, nearest)
        result = replace(result, remarks=(f"the usual margins cannot be had: {refusal}", *result.remarks), relaxed=True)
    result = replace(result, plants=result.plants[: len(plants)], margins=result.margins[: len(plants)])
    if _tells_no_damping(model):
        words = f"the fit tells no damping of the belt: a resonance damped by {100.0 * LEAST_RESONANCE_DAMPING:g} % is counted with"
        result = replace(result, remarks=(words, *result.remarks))
    return result, with_feedforward(result.cascade, model, structure, dead_time_s, feedforward, apparent_damping_nm_s_rad)


def first_loop(
    model: Model,
    structure: CascadeStructure,
    position_m: float,
    dead_time_s: float,
    apparent_damping_nm_s_rad: float,
    besides: Sequence[DesignPlant] = (),
) -> DesignResult:
    """The cautious loop for a first model at one place, with the largest uncertainty and the best margins that the drive allows.

    Parameters
    ----------
    model : Model
    structure : CascadeStructure
    position_m : float, m
        Carriage on the axis.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        As of :func:`design_plants`.
    besides : sequence of DesignPlant
        For which it must hold, too.

    Raises
    ------
    Refused
        (Infeasible) when even a model known to 5 % leaves less than ``LEAST_PHASE_MARGIN_DEG``.
    """
    plant = design_plants(model, [position_m], [model["cart.mass"]], dead_time_s, apparent_damping_nm_s_rad)[-1]
    for uncertainty in UNCERTAINTIES[:-1]:
        found = feasible_cascade([*uncertain_plants(plant, uncertainty), *besides], structure, cautious_specification())
        if found is not None:
            return found
    try:
        return cautious_cascade(plant, structure, UNCERTAINTIES[-1], besides=besides)
    except Infeasible as refusal:
        nearest = refusal.nearest
        if nearest is None or nearest.phase_margin_deg < LEAST_PHASE_MARGIN_DEG:
            raise
    return cautious_cascade(plant, structure, UNCERTAINTIES[-1], nearest, besides)


def require_offered(structure: CascadeStructure, prefilter: PrefilterKind | None, feedforward: SentFeedforward | None = None) -> None:
    """Refuse a prefilter or a feedforward that was asked for and that the drive does not have.

    Parameters
    ----------
    structure : CascadeStructure
    prefilter : PrefilterKind or None
        None for any.
    feedforward : SentFeedforward or None
        None for any.

    Raises
    ------
    Refused
        With what there is.
    """
    if prefilter is not None and prefilter not in structure.prefilters:
        raise Refused(f"{structure.name} has no {prefilter} prefilter; choose {' or '.join(structure.prefilters)}")
    if feedforward not in (None, "none") and not (structure.torque_feedforward or structure.velocity_feedforward):
        raise Refused(f"{structure.name} has no feedforward, so {feedforward} cannot be had; leave it out or choose none")


def with_feedforward(
    cascade: Cascade,
    model: Model,
    structure: CascadeStructure,
    dead_time_s: float,
    kind: FeedforwardKind = "nonlinear",
    apparent_nm_s_rad: float | None = None,
) -> Cascade:
    """The cascade with the feedforward (4.16) of a model; the reference passes the velocity filter where the drive can.

    Parameters
    ----------
    cascade : Cascade
        Whose feedforward is replaced.
    model : Model
        For inertia, friction and holding torque.
    structure : CascadeStructure
    dead_time_s : float, s
        Of the torque path, beside the model's own.
    kind : FeedforwardKind
        Of feedforward.
    apparent_nm_s_rad : float or None, N m s/rad, motor shaft
        Viscous friction in place of the model's; None or 0 for none.
    """
    feedforward = feedforward_from(
        structure,
        kind,
        inertia_kg_m2=moved_inertia(model),
        viscous_nm_s_rad=total_viscous(model),
        coulomb_nm=total_friction(model),
        apparent_viscous_nm_s_rad=apparent_nm_s_rad or None,
        offset_nm=holding_nm(model),
        dead_time_s=dead_time_s + late_s(model),
    )
    return replace(cascade, feedforward=feedforward, filter_reference=structure.reference_filter)


def holding_nm(model: Model) -> float:
    """Torque that holds the axis at standstill beside friction:  i_t m_c g sin(α) + constant torque, N m at the motor shaft.

    Parameters
    ----------
    model : Model
        With a carriage.
    """
    gravity = model["transmission.ratio"] * model["cart.mass"] * GRAVITY_M_S2 * math.sin(model.get("tilt.angle"))
    return model.get("constant_offset.torque") + gravity


def sure_viscous(model: Model) -> float:
    """Viscous friction of motor and carriage at the motor that a fit is sure of, N m s/rad: the lower end of its 95 % interval.

    Parameters
    ----------
    model : Model
        All of it where nothing was estimated.
    """
    if model.covariance is None:
        return total_viscous(model)
    weights = np.array([1.0, model["transmission.ratio"] ** 2])
    variance = weights @ model.covariance.of(("viscous.damping", "viscous_cart.damping")) @ weights
    return max(total_viscous(model) - NORMAL_95 * math.sqrt(variance), 0.0)


def moved_inertia(model: Model) -> float:
    """m_e of (4.15) with every body that the motor moves, kg m² at the motor shaft.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    """
    ratio = model["transmission.ratio"]
    behind = sum(model[name] * (1.0 if body.rotary else ratio**2) for name, body in model.bodies()[1:])
    return model.driven_inertia() + behind


def apparent_damping(fits: Mapping[str, MagnitudeFit]) -> float:
    """Largest rigid damping that the thesis's fits show, i_t² (d_m + d_c), N m s/rad at the motor; 0 without a fit.

    Parameters
    ----------
    fits : mapping of str to MagnitudeFit
        By record.
    """
    values = [0.0]
    for fit in fits.values():
        two = fit.two_mass
        values.append(two.transmission_m_rad**2 * (two.motor_damping_n_s_m + two.cart_damping_n_s_m))
    return max(values)


def resonance_shape(model: Model, position_m: float) -> Shape:
    """:func:`beltcomm.identify.landmarks.shape_of`.

    Parameters
    ----------
    model : Model
    position_m : float, m
        Carriage on the axis.

    Raises
    ------
    DataError
        For a model whose belt is so soft that nothing swings on it.
    """
    shape = shape_of(model, position_m)
    if shape is None:
        raise DataError(
            "the model has no resonance: its carriage does not swing on the belt, as a gap (backlash) makes it seem, in which the motor "
            "moves alone, and a belt that is loose; hold the motor and push the carriage both ways against a dial gauge, and look at "
            "the model (beltcomm compare RUN)"
        )
    return shape


def characteristic_hz(model: Model, position_m: float) -> tuple[float, float]:
    """Antiresonance and resonance of the belt with the carriage at a place, Hz; of a rigid axis the whole band from ``RIGID_LOWEST_HZ`` on.

    Parameters
    ----------
    model : Model
    position_m : float, m
        Carriage on the axis.

    Raises
    ------
    DataError
        As :func:`resonance_shape`.
    """
    if model.rigid:
        return RIGID_LOWEST_HZ, math.inf
    belt = resonance_shape(model, position_m).belt
    return belt.antiresonance_hz, belt.resonance_hz
