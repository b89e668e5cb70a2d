"""The thesis's three tuning knobs (4.4), read off given gains, and held on all plants at once for one prefilter and one T_R.

Where :mod:`beltcomm.design.cascade` looks for the largest K_I K_PP inside bounds of all three, here the suppression sets K_P as in the
thesis.   The velocity phase margin is what T_N = K_P/K_I must leave at least, the position phase margin sets K_PP, and T_N is the one with
the largest K_I K_PP: the shortest that leaves the velocity loop its margin would leave the position loop next to nothing where that asks
for much.   Each on the plant where it is hardest, on the loops as they run; gain margin and sensitivity bound both loops beside them.

On a plant, behind a prefilter and with T_R the three numbers fix the three gains:  A_sup is |G_PI G_ω| at the undamped resonance ω_r
(4.7),  φ_ωr the distance to −180° at the first crossover of the open velocity loop (4.8), (4.9),  φ_φr the same of the open position
loop (4.13), all on the continuous plant (2.42) with its dead time.   :func:`knobs_of` reads them off given gains,
:func:`_gains_for` goes the other way, :func:`designs_along_knob` moves one of them alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter, PrefilterKind
from beltcomm.design.cascade import DesignResult, binding_conditions, meets, on_step, quantised_pi, with_reserve
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import LoopShape, SampledPlants, loop_shape, open_velocity_loop, position_path
from beltcomm.design.margins import margins_on, resonance_or_peak
from beltcomm.design.search import AllowedGains, allowed_gains, highest_position_gain, integral_time_bounds, unit_loop
from beltcomm.design.specification import Specification
from beltcomm.design.thesis import ThesisDesign, thesis_design, thesis_margins
from beltcomm.errors import Refused

Knob = Literal["phase_margin_deg", "position_phase_margin_deg", "suppression_db"]
#: Gains count as the same from this relative difference down: margins are solved to 1e-12, their inverse loses a few digits.
SAME = 1e-6


@dataclass(frozen=True)
class Knobs:
    """φ_ωr and φ_φr, deg, and A_sup, dB.   Defaults: the thesis's, tables A.6 and A.7."""

    phase_margin_deg: float = 60.0
    position_phase_margin_deg: float = 80.0
    suppression_db: float = -10.0


@dataclass(frozen=True)
class KnobSetting:
    """Positions of the knobs for given gains.

    Attributes
    ----------
    again : ThesisDesign or None
        The design from these knobs, None when the equations refuse them (``refusal`` says why).
    same : bool
        It has the given gains; otherwise they are another solution of the same equations.
    """

    knobs: Knobs
    again: ThesisDesign | None
    same: bool
    refusal: str = ""


@dataclass(frozen=True)
class Turn:
    """One position of one knob: the design, None where the equations have no solution, with the reason."""

    value: float
    design: ThesisDesign | None
    refusal: str = ""


def knobs_of(plant: DesignPlant, cascade: Cascade) -> KnobSetting:
    """The knobs that give these gains on this plant, exactly, and whether turning them there gives the gains back.

    The prefilter and T_R of ``cascade`` count as given.

    Parameters
    ----------
    plant : DesignPlant
        On which the margins are asked.
    cascade : Cascade
        Gains, prefilter and T_R.

    Returns
    -------
    KnobSetting
        Margins and suppression, and the design that they give.

    Raises
    ------
    Refused
        When a loop of these gains has no crossover.
    """
    achieved = thesis_margins(plant, cascade)
    knobs = Knobs(achieved.phase_margin_deg, achieved.position_phase_margin_deg, achieved.suppression_db)
    try:
        again = _gains_for(plant, cascade.prefilter, knobs, cascade.velocity_filter_s)
    except Refused as refusal:
        return KnobSetting(knobs, None, False, str(refusal))
    pairs = (
        (again.cascade.kp_nm_s_rad, cascade.kp_nm_s_rad),
        (again.cascade.ki_nm_rad, cascade.ki_nm_rad),
        (again.cascade.kpp_1_s, cascade.kpp_1_s),
    )
    return KnobSetting(knobs, again, all(abs(one - other) <= SAME * other for one, other in pairs))


def _gains_for(plant: DesignPlant, prefilter: PrefilterKind | Prefilter, knobs: Knobs, velocity_filter_s: float = 0.002) -> ThesisDesign:
    """The gains that the knobs stand for; raises Refused as ``thesis.thesis_design``."""
    return thesis_design(plant, prefilter, velocity_filter_s, knobs.phase_margin_deg, knobs.suppression_db, knobs.position_phase_margin_deg)


def designs_along_knob(plant: DesignPlant, prefilter: PrefilterKind | Prefilter, knob: Knob, values: Sequence[float]) -> tuple[Turn, ...]:
    """Designs with one knob at several values and the others at their defaults, T_R 2 ms.

    Parameters
    ----------
    plant : DesignPlant
        On which the margins are asked.
    prefilter : PrefilterKind or Prefilter
        Laid out on the plant, or as it is.
    knob : Knob
        Which is turned.
    values : sequence of float
        In the unit of the knob.

    Returns
    -------
    tuple of Turn
        One for each value, with the refusal where there is no design.
    """
    turns = []
    for value in values:
        try:
            turns.append(Turn(value, _gains_for(plant, prefilter, replace(Knobs(), **{knob: value}))))
        except Refused as refusal:
            turns.append(Turn(value, None, str(refusal)))
    return tuple(turns)


#: T_N tried at first, 2 ms to 5 s in steps of 1.7; how often, and with how many, around the best again: to 1 %.
_TIMES, _ZOOMS, _ZOOM_TIMES = 16, 3, 5
Limit = Literal["velocity", "position", "drive"]


class OutOfReach(Refused):
    """No gains stand for these knobs.

    Parameters
    ----------
    limit : Limit
        The loop whose margins stand in the way, or the drive's own bounds.
    """

    def __init__(self, message: str, limit: Limit) -> None:
        super().__init__(message)
        self.limit = limit


@dataclass(frozen=True)
class KnobPlants:
    """The plants that knobs are held on, sampled for the search and for the proof.   Twins among ``proof`` are left out of ``search``."""

    search: SampledPlants
    proof: SampledPlants
    structure: CascadeStructure


def specification_of(knobs: Knobs, prefilter: Prefilter, velocity_filter_s: float) -> Specification:
    """The knobs as bounds; gain margin and sensitivity as in every design of the product.

    Parameters
    ----------
    knobs : Knobs
        Margins and suppression.
    prefilter : Prefilter
        The only kind allowed.
    velocity_filter_s : float, s
        T_R.

    Returns
    -------
    Specification
        For a search over gains.
    """
    return Specification(
        phase_margin_deg=knobs.phase_margin_deg,
        suppression_db=knobs.suppression_db,
        position_phase_margin_deg=knobs.position_phase_margin_deg,
        velocity_filters_s=(velocity_filter_s,),
        prefilters=(prefilter.kind,),
    )


def gains_of_knobs(plants: KnobPlants, prefilter: Prefilter, velocity_filter_s: float, knobs: Knobs) -> DesignResult:
    """The gains that the knobs stand for on all plants, on the drive's steps, with their proof.

    Raises OutOfReach where there are none, with the limit in words.

    Parameters
    ----------
    plants : KnobPlants
        On which gains are searched and proven.
    prefilter : Prefilter
        In front of the velocity controller.
    velocity_filter_s : float
        T_R, s.
    knobs : Knobs
        Phase margins and suppression.
    """
    asked = specification_of(knobs, prefilter, velocity_filter_s)
    shape = loop_shape(plants.search, prefilter, velocity_filter_s)
    refusal: OutOfReach | None = None
    for reserve in (1.0, 3.0, 10.0, 40.0):
        try:
            cascades = _quantised_cascades(plants, shape, prefilter, velocity_filter_s, with_reserve(asked, reserve))
        except OutOfReach as problem:
            refusal = refusal or problem
            break  # more in reserve only asks for more
        for cascade in cascades:
            achieved = margins_on(cascade, plants.proof)
            if meets(achieved, asked):
                binding = binding_conditions(cascade, achieved, plants.structure, asked)
                return DesignResult(cascade, plants.structure, asked, plants.proof.plants, achieved, binding, ())
    raise refusal or OutOfReach(f"the drive's steps of its gains are too coarse for {_words(knobs)}", "drive")


def suppression_range(shape: LoopShape, structure: CascadeStructure, specification: Specification, values_db: Array) -> BoolArray:
    """Suppressions that the velocity loop can have with the phase margin of a specification, at any T_N.

    Parameters
    ----------
    shape : LoopShape
        Of the plants.
    structure : CascadeStructure
        With the bounds of the drive.
    specification : Specification
        Phase margin, gain margin and sensitivity.
    values_db : ndarray
        Suppressions asked about.

    Returns
    -------
    ndarray of bool
        In the shape of ``values_db``.
    """
    possible = np.zeros(len(values_db), dtype=bool)
    for time in _times(structure):
        unit = unit_loop(shape, time)
        allowed = allowed_gains(unit, shape, specification.phase_margin_deg, specification)
        if allowed is not None:
            gains = 10.0 ** (values_db / 20.0) / _peak(unit, shape)
            possible |= np.isin(gains, allowed.of(gains)) & _in_drive(gains, time, structure)
    return possible


def highest_position_margin(shape: LoopShape, structure: CascadeStructure, specification: Specification) -> float:
    """The largest position phase margin that some K_PP of the drive leaves, to a quarter of a degree; 0 where none leaves any.

    With suppression and velocity phase margin of ``specification``, at any T_N.

    Parameters
    ----------
    shape : LoopShape
        Of the plants.
    structure : CascadeStructure
        With the bounds of the drive.
    specification : Specification
        Suppression and velocity phase margin.

    Returns
    -------
    float, deg
        0 where no gain leaves any.
    """
    gains = [(time, kp) for time in _times(structure) if (kp := _at(shape, structure, specification, time)) is not None]
    paths = [position_path(kp * unit_loop(shape, time), shape.estimator) for time, kp in gains]
    low, high = 0.0, 90.0
    while paths and high - low > 0.25:
        middle = 0.5 * (low + high)
        asked = replace(specification, position_phase_margin_deg=middle)
        able = [path for path in paths if _position_gain(path, shape, structure, asked) > 0.0]
        if able:
            low, paths = middle, able
        else:
            high = middle
    return low


def _quantised_cascades(
    plants: KnobPlants, shape: LoopShape, prefilter: Prefilter, velocity_filter_s: float, inside: Specification
) -> list[Cascade]:
    """The cascade of these bounds on the drive's steps, rounded each way, the stiffest first.   Raises OutOfReach."""
    structure = plants.structure
    kp, time = _stiffest(shape, structure, inside)
    forward = Feedforward(velocity=1.0 if structure.velocity_feedforward else 0.0)
    found = []
    for rounded, ki in quantised_pi(kp, time, structure):
        path = position_path(open_velocity_loop(shape, rounded, ki), shape.estimator)
        kpp = _position_gain(path, shape, structure, inside)
        if kpp > 0.0:
            found.append(Cascade(rounded, ki, kpp, velocity_filter_s, prefilter, forward, structure.reference_filter))
    if not found:
        raise OutOfReach(f"no Kv leaves the position loop {inside.position_phase_margin_deg:.1f} degrees of phase margin", "position")
    return sorted(found, key=lambda cascade: cascade.ki_nm_rad * cascade.kpp_1_s, reverse=True)


def _stiffest(shape: LoopShape, structure: CascadeStructure, inside: Specification) -> tuple[float, float]:
    """K_P, N m s/rad, and the T_N, s, with the largest K_I K_PP that the margins allow.   Raises OutOfReach."""
    times, found = _times(structure), {}
    tried: set[float] = set()
    for _ in range(1 + _ZOOMS):
        for time in times:
            if (rounded := float(f"{time:.9g}")) in tried:
                continue  # the middle and the ends of a zoom are known from before
            tried.add(rounded)
            if (kp := _at(shape, structure, inside, time)) is not None:
                path = position_path(kp * unit_loop(shape, time), shape.estimator)
                found[float(time)] = (kp / time * _position_gain(path, shape, structure, inside), kp)
        if not found:
            words = f"{inside.phase_margin_deg:.1f} degrees of phase margin at {inside.suppression_db:.1f} dB of suppression"
            raise OutOfReach(f"no integral time leaves the velocity loop {words}", "velocity")
        best, ratio = max(found, key=lambda time: found[time][0]), times[1] / times[0] if len(times) > 1 else 1.0
        low, high = integral_time_bounds(structure, structure.period_s)
        times = np.clip(np.geomspace(best / ratio, best * ratio, _ZOOM_TIMES), low, high)
    if not found[best][0]:
        raise OutOfReach(f"no Kv leaves the position loop {inside.position_phase_margin_deg:.1f} degrees of phase margin", "position")
    return found[best][1], best


def _at(shape: LoopShape, structure: CascadeStructure, inside: Specification, time: float) -> float | None:
    """K_P of the suppression at one T_N; None where the loop then lacks phase margin, gain margin or sensitivity, or the drive that K_P."""
    unit = unit_loop(shape, time)
    kp = np.array([10.0 ** (inside.suppression_db / 20.0) / _peak(unit, shape)])
    if not _in_drive(kp, time, structure)[0]:
        return None
    allowed: AllowedGains | None = allowed_gains(unit, shape, inside.phase_margin_deg, inside)
    return float(kp[0]) if allowed is not None and len(allowed.of(kp)) else None


def _position_gain(path: ComplexArray, shape: LoopShape, structure: CascadeStructure, inside: Specification) -> float:
    """The largest K_PP of the drive that meets the specification; 0 where none does."""
    highest = highest_position_gain(path, shape, inside, structure.highest.get("kpp_1_s", math.inf))
    kpp = on_step(highest, structure.steps.get("kpp_1_s", 0.0), math.floor)
    return kpp if kpp >= structure.lowest.get("kpp_1_s", 0.0) else 0.0


def _times(structure: CascadeStructure) -> Array:
    """T_N to try, s, ascending; none where the drive's range is empty."""
    low, high = integral_time_bounds(structure, structure.period_s)
    return np.geomspace(low, high, _TIMES) if low < high else np.array([low] if low == high else [])


def _peak(unit: ComplexArray, shape: LoopShape) -> float:
    """Largest gain at and above the resonance and at local peaks, for K_P = 1."""
    peaks = resonance_or_peak(unit, shape.omega_rad_s, shape.resonance_rad_s)
    return float(np.max(np.where(peaks, np.abs(unit), 1e-300)))


def _in_drive(kp: Array, time: float, structure: CascadeStructure) -> BoolArray:
    low, high = structure.lowest.get, structure.highest.get
    least = max(low("kp_nm_s_rad", 0.0), low("ki_nm_rad", 0.0) * time)
    most = min(high("kp_nm_s_rad", math.inf), high("ki_nm_rad", math.inf) * time)
    return np.asarray((kp >= least) & (kp <= most))


def _words(knobs: Knobs) -> str:
    return (
        f"{knobs.phase_margin_deg:.1f} deg of phase margin, {knobs.suppression_db:.1f} dB of suppression and "
        f"{knobs.position_phase_margin_deg:.1f} deg of position phase margin"
    )
