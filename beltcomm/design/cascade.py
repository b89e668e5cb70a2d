"""The product's controller design: the loop that will run, proven on every plant stated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import SampledPlants, loop_shape, open_loops, open_velocity_loop, position_path, sample_plants
from beltcomm.design.margins import PROOF_POINTS, Margins, margins_on
from beltcomm.design.prefilters import butterworth_cutoff_rad_s, notch_width
from beltcomm.design.search import best_gains, highest_position_gain
from beltcomm.design.specification import GROUPS, Infeasible, Specification, describe, relax
from beltcomm.errors import UsageError
from beltcomm.quantities import unit_of

#: Grid points per plant of the search, and what it keeps in reserve for the finer grid of the proof.
_SEARCH_POINTS = 220
_RESERVE_DEG, _RESERVE_DB = 0.1, 0.05
#: ω_r T_R beyond which a longer T_R is not tried: the resonance is already attenuated tenfold, and the crossover only loses phase.
LONGEST_LAG_RAD = 10.0
#: Cutoffs of the additional low-pass to try, over the notch's centre: nearer it costs phase below, further it leaves the next resonance.
ROLL_OFFS = (1.0, 2.0)
#: Gains in words, by the names that a drive's bounds have.
GAINS = {
    "kp_nm_s_rad": "velocity gain Kp",
    "ki_nm_rad": "integral gain Ki",
    "kpp_1_s": "position gain Kv",
    "integral_time_s": "integral time Kp/Ki",
}
_LACKABLE: tuple[PrefilterKind, ...] = ("notch", "butterworth")


@dataclass(frozen=True)
class DesignResult:
    """A cascade with its proof.

    Attributes
    ----------
    margins : tuple of Margins
        One per plant, in the order of ``plants``.
    binding : tuple of str
        The conditions that stopped the gains from growing.
    remarks : tuple of str
        What a drive with more of the thesis's cascade would have reached, in words.
    relaxed : bool
        It has less than the margins that were asked for at first.
    """

    cascade: Cascade
    structure: CascadeStructure
    specification: Specification
    plants: tuple[DesignPlant, ...]
    margins: tuple[Margins, ...]
    binding: tuple[str, ...]
    remarks: tuple[str, ...]
    relaxed: bool = False

    @property
    def stiffness(self) -> float:
        """K_I K_PP, N m/(rad s), what the design maximises: a lasting error breaks friction free after τ_c/(K_I K_PP e)."""
        return self.cascade.ki_nm_rad * self.cascade.kpp_1_s

    def open_loops(self, plant: int, omega_rad_s: Array) -> tuple[ComplexArray, ComplexArray]:
        """Open velocity loop and open position loop of one plant, for plots; see ``loops.open_loops``.

        Parameters
        ----------
        plant : int
            Which of ``plants``.
        omega_rad_s : ndarray, (m,)
            Above 0, below π/T.
        """
        return open_loops(self.plants[plant], self.cascade, self.structure.period_s, omega_rad_s)


def design_cascade(plants: Sequence[DesignPlant], structure: CascadeStructure, specification: Specification | None = None) -> DesignResult:
    """The cascade with the largest K_I K_PP that meets the specification on every plant, in the drive's own form.

    Prefilters are laid out on the plant with the lowest resonance (4.2.1); gains are quantised, then proven.

    Raises Infeasible (a Refused) with what binds and the nearest feasible request; UsageError without plants.

    Parameters
    ----------
    plants : sequence of DesignPlant
        Positions, payloads and damping values the loop must hold for (``with_friction_fractions`` for the last).
    structure : CascadeStructure
        What the drive offers; its period, prefilters, bounds and steps are those of the result.
    specification : Specification or None
        Margins to be kept; None for the usual ones.
    """
    specification = specification or Specification()
    search, proof = _sample_plants(plants, structure)
    found = _best_design(search, proof, structure, specification)
    if found is None:
        raise _infeasible(search, proof, structure, specification)
    return found


def feasible_cascade(plants: Sequence[DesignPlant], structure: CascadeStructure, specification: Specification) -> DesignResult | None:
    """As :func:`design_cascade`, without looking for the reason when nothing meets the specification.

    Parameters
    ----------
    plants : sequence of DesignPlant
        For all of which the gains must hold.
    structure : CascadeStructure
        What the drive's loop has.
    specification : Specification

    Returns
    -------
    DesignResult or None
        None when nothing meets it.
    """
    return _best_design(*_sample_plants(plants, structure), structure, specification)


def _sample_plants(plants: Sequence[DesignPlant], structure: CascadeStructure) -> tuple[SampledPlants, SampledPlants]:
    """The plants for the search, and for the proof."""
    if not plants:
        raise UsageError("the design has no plant; state at least one position and payload")
    return sample_plants(plants, structure.period_s, _SEARCH_POINTS), sample_plants(plants, structure.period_s, PROOF_POINTS)


def _best_design(
    search: SampledPlants, proof: SampledPlants, structure: CascadeStructure, specification: Specification
) -> DesignResult | None:
    found = best_cascade(search, proof, structure, specification)
    if found is None:
        return None
    cascade, achieved = found
    return DesignResult(
        cascade,
        structure,
        specification,
        proof.plants,
        achieved,
        binding_conditions(cascade, achieved, structure, specification),
        _remarks(cascade, search, proof, structure, specification),
    )


def meets(achieved: Sequence[Margins], specification: Specification) -> bool:
    """True if the margins of every plant meet the specification and both loops are stable.

    Parameters
    ----------
    achieved : sequence of Margins
        One for each plant.
    specification : Specification

    Returns
    -------
    bool
        Gain margin and sensitivity count in both loops.
    """
    return all(
        one.stable
        and one.velocity_stable
        and one.phase_margin_deg >= specification.phase_margin_deg
        and one.suppression_db <= specification.suppression_db
        and one.least_gain_margin_db >= specification.gain_margin_db
        and one.most_sensitivity_db <= specification.sensitivity_db
        and one.position_phase_margin_deg >= specification.position_phase_margin_deg
        for one in achieved
    )


def candidate_prefilters(plants: Sequence[DesignPlant], structure: CascadeStructure, specification: Specification) -> list[Prefilter]:
    """The prefilters that drive and specification allow, laid out on the plant with the lowest resonance; below π/T only.

    On plants with further resonances a notch comes also with the additional low-pass of 4.2.1, as far as the drive has it.

    Parameters
    ----------
    plants : sequence of DesignPlant
        All that the gains must hold for.
    structure : CascadeStructure
        What the drive's loop has.
    specification : Specification
        Which prefilters may be, and the depth they need, dB.

    Returns
    -------
    list of Prefilter
        None, Butterworth, notch, in that order.
    """
    softest = min(plants, key=lambda plant: plant.resonance_rad_s)
    lowest_antiresonance = min(plant.antiresonance_rad_s for plant in plants)
    result = []
    kinds: tuple[PrefilterKind, ...] = ("none", "butterworth", "notch")
    for kind in kinds:
        if kind not in structure.prefilters or (specification.prefilters is not None and kind not in specification.prefilters):
            continue
        if kind == "none":
            prefilter = Prefilter()
        elif kind == "butterworth":
            prefilter = Prefilter(kind, butterworth_cutoff_rad_s(lowest_antiresonance, specification.butterworth_db))
        else:
            width = notch_width(softest.resonance_rad_s, softest.antiresonance_rad_s, specification.notch_db)
            prefilter = Prefilter(kind, softest.resonance_rad_s, width)
        if prefilter.omega_rad_s < math.pi / structure.period_s:
            result.append(prefilter)
            if kind == "notch" and structure.roll_off and any(plant.bodies is not None for plant in plants):
                cutoffs = (factor * softest.resonance_rad_s for factor in ROLL_OFFS)
                result += [replace(prefilter, roll_off_rad_s=cutoff) for cutoff in cutoffs if cutoff < math.pi / structure.period_s]
    return result


def best_cascade(
    search: SampledPlants, proof: SampledPlants, structure: CascadeStructure, specification: Specification
) -> tuple[Cascade, tuple[Margins, ...]] | None:
    """The proven cascade with the largest K_I K_PP.

    Parameters
    ----------
    search, proof : SampledPlants
        A coarse and a fine grid over the same plants.
    structure : CascadeStructure
        What the drive's loop has.
    specification : Specification

    Returns
    -------
    tuple of Cascade and tuple of Margins, or None
        The margins are those on ``proof``; None where there is none.
    """
    best: tuple[Cascade, tuple[Margins, ...]] | None = None
    for prefilter in candidate_prefilters(search.plants, structure, specification):
        for lag in _velocity_filters(search.plants, structure, specification):
            # Coarse steps may cost more than the reserve of the search: then it looks for gains further inside.
            for reserve in (1.0, 3.0, 10.0, 40.0):
                found = _proven(search, proof, structure, specification, prefilter, lag, reserve)
                if found is not None:
                    break
            if found is not None and (best is None or _stiffness(found[0]) > _stiffness(best[0])):
                best = found
    return best


def _proven(
    search: SampledPlants,
    proof: SampledPlants,
    structure: CascadeStructure,
    specification: Specification,
    prefilter: Prefilter,
    lag: float,
    reserve: float,
) -> tuple[Cascade, tuple[Margins, ...]] | None:
    inside = with_reserve(specification, reserve)
    shape = loop_shape(search, prefilter, lag)
    gains = best_gains(shape, structure.period_s, structure, inside)
    if gains is None:
        return None
    forward = Feedforward(velocity=1.0 if structure.velocity_feedforward else 0.0)
    quantised = []
    for kp, ki in quantised_pi(gains.kp, gains.tn, structure):
        velocity = open_velocity_loop(shape, kp, ki)
        highest = structure.highest.get("kpp_1_s", math.inf)
        kpp = highest_position_gain(position_path(velocity, shape.estimator), shape, inside, highest)
        kpp = on_step(kpp, structure.steps.get("kpp_1_s", 0.0), math.floor)
        if kpp > 0.0 and kpp >= structure.lowest.get("kpp_1_s", 0.0):
            quantised.append(Cascade(kp, ki, kpp, lag, prefilter, forward, structure.reference_filter))
    for cascade in sorted(quantised, key=_stiffness, reverse=True):
        achieved = margins_on(cascade, proof)
        if meets(achieved, specification):
            return cascade, achieved
    return None


def with_reserve(specification: Specification, factor: float) -> Specification:
    """A specification a little above the one asked for, so that a finer grid and rounded gains still have that.

    Parameters
    ----------
    specification : Specification
    factor : float
        How often the reserve is added.

    Returns
    -------
    Specification
        Phase margins stay below 90 deg.
    """
    degrees, decibels = factor * _RESERVE_DEG, factor * _RESERVE_DB
    return replace(
        specification,
        phase_margin_deg=min(specification.phase_margin_deg + degrees, 89.9),
        suppression_db=specification.suppression_db - decibels,
        gain_margin_db=specification.gain_margin_db + decibels,
        sensitivity_db=max(specification.sensitivity_db - decibels, 0.5 * specification.sensitivity_db),
        position_phase_margin_deg=min(specification.position_phase_margin_deg + degrees, 89.9),
    )


def quantised_pi(kp: float, tn: float, structure: CascadeStructure) -> list[tuple[float, float]]:
    """K_P and K_I on the drive's steps, rounded each way, within its bounds.

    Parameters
    ----------
    kp : float, N m s/rad, motor shaft
        K_P.
    tn : float
        K_P/K_I, s.
    structure : CascadeStructure
        Steps and bounds of the drive.
    """
    kps = {on_step(kp, structure.steps.get("kp_nm_s_rad", 0.0), way) for way in (math.floor, math.ceil)}
    pairs = []
    for kp, way in itertools.product(sorted(kps), (math.floor, math.ceil)):
        if "integral_time_s" in structure.highest:
            time = on_step(tn, structure.steps.get("integral_time_s", 0.0), way)
            ki = kp / time if structure.lowest.get("integral_time_s", 0.0) <= time <= structure.highest["integral_time_s"] else 0.0
        else:
            ki = on_step(kp / tn, structure.steps.get("ki_nm_rad", 0.0), way)
        if ki > 0.0 and _is_within(kp, "kp_nm_s_rad", structure) and _is_within(ki, "ki_nm_rad", structure):
            pairs.append((kp, ki))
    return sorted(set(pairs))


def on_step(value: float, step: float, way: object) -> float:
    """A value on a multiple of a step.

    Parameters
    ----------
    value, step : float
        In one unit; a step of 0 leaves the value as it is.
    way : callable
        ``math.floor`` or ``math.ceil``.

    Returns
    -------
    float
        Not one step off for a value that lies on one already.
    """
    if step <= 0.0:
        return value
    # A value that already lies on a step must not lose one to rounding.
    return step * (math.floor(value / step + 1e-9) if way is math.floor else math.ceil(value / step - 1e-9))


def _is_within(value: float, name: str, structure: CascadeStructure) -> bool:
    return structure.lowest.get(name, 0.0) <= value * (1.0 + 1e-12) and value <= structure.highest.get(name, math.inf)


def _velocity_filters(plants: Sequence[DesignPlant], structure: CascadeStructure, specification: Specification) -> list[float]:
    """T_R to try, on the drive's steps; the long ones only for plants slow enough to gain by them."""
    longest = LONGEST_LAG_RAD / min(plant.resonance_rad_s for plant in plants)
    lags = [lag for lag in specification.velocity_filters_s if lag <= longest] or [min(specification.velocity_filters_s)]
    low = structure.lowest.get("velocity_filter_s", 0.0)
    high = structure.highest.get("velocity_filter_s", math.inf)
    step = structure.steps.get("velocity_filter_s", 0.0)
    return sorted({on_step(min(max(lag, low), high), step, math.floor) for lag in lags})


def _stiffness(cascade: Cascade) -> float:
    return cascade.ki_nm_rad * cascade.kpp_1_s


def binding_conditions(
    cascade: Cascade, achieved: Sequence[Margins], structure: CascadeStructure, specification: Specification
) -> tuple[str, ...]:
    """The conditions met with less than a degree or 0.3 dB to spare, with the plant, and the bounds of the drive reached.

    Parameters
    ----------
    cascade : Cascade
        The design.
    achieved : sequence of Margins
        On all plants.
    structure : CascadeStructure
        With the bounds of the drive.
    specification : Specification
        What was asked for.
    """
    lines = []
    for words, name, limit, unit, sign, near in (
        ("velocity phase margin", "phase_margin_deg", specification.phase_margin_deg, "deg", 1.0, 1.0),
        ("resonance suppression", "suppression_db", specification.suppression_db, "dB", -1.0, 0.3),
        ("velocity gain margin", "gain_margin_db", specification.gain_margin_db, "dB", 1.0, 0.3),
        ("velocity sensitivity", "sensitivity_db", specification.sensitivity_db, "dB", -1.0, 0.3),
        ("position phase margin", "position_phase_margin_deg", specification.position_phase_margin_deg, "deg", 1.0, 1.0),
        ("position gain margin", "position_gain_margin_db", specification.gain_margin_db, "dB", 1.0, 0.3),
        ("position sensitivity", "position_sensitivity_db", specification.sensitivity_db, "dB", -1.0, 0.3),
    ):
        worst = min(achieved, key=attrgetter(name)) if sign > 0.0 else max(achieved, key=attrgetter(name))
        value = float(getattr(worst, name))
        if sign * (value - limit) < near:
            where = f" at {worst.plant}" if worst.plant else ""
            side = "min" if sign > 0.0 else "max"
            lines.append(f"{words} {value:.1f} {unit} ({side} {limit:.4g}){where}")
    values = {
        "kp_nm_s_rad": cascade.kp_nm_s_rad,
        "ki_nm_rad": cascade.ki_nm_rad,
        "kpp_1_s": cascade.kpp_1_s,
        "integral_time_s": cascade.kp_nm_s_rad / cascade.ki_nm_rad,
    }
    for name, value in values.items():
        for bound, words in ((structure.lowest.get(name), "lowest"), (structure.highest.get(name), "highest")):
            if bound is not None and math.isclose(value, bound, rel_tol=0.02):
                lines.append(f"the drive's {words} {GAINS[name]} {bound:g} {unit_of(name)}")
    return tuple(lines)


def _remarks(
    cascade: Cascade,
    search: SampledPlants,
    proof: SampledPlants,
    structure: CascadeStructure,
    specification: Specification,
) -> tuple[str, ...]:
    """Remarks on what the parts of the thesis's cascade that this drive lacks would have brought."""
    remarks = []
    lacking = tuple(k for k in _LACKABLE if k not in structure.prefilters)
    for kind in lacking:
        found = best_cascade(search, proof, replace(structure, prefilters=(kind,)), replace(specification, prefilters=(kind,)))
        if found is not None and _stiffness(found[0]) > 1.05 * _stiffness(cascade):
            factor = _stiffness(found[0]) / _stiffness(cascade)
            remarks.append(f"with a {kind} prefilter the drive could have reached {factor:.1f} times the stiffness Ki Kv")
    if not structure.velocity_feedforward:
        remarks.append(
            f"without velocity feedforward the carriage trails by {1e3 / cascade.kpp_1_s:.3g} mm for every m/s of speed "
            f"(speed over Kv); with it this part of the error would vanish"
        )
    elif not structure.reference_filter:
        lag = cascade.velocity_filter_s + 0.5 * structure.period_s
        remarks.append(
            f"the reference velocity does not pass the velocity filter: on acceleration a the velocity error is "
            f"{1e3 * lag:.2f} ms times a, and the position error that over Kv"
        )
    if not structure.torque_feedforward:
        remarks.append("without torque feedforward the integrator alone must deliver the torque for inertia and friction")
    return tuple(remarks)


def _infeasible(search: SampledPlants, proof: SampledPlants, structure: CascadeStructure, specification: Specification) -> Infeasible:
    """Refusal naming the group of conditions that alone stands in the way, and the nearest feasible request."""
    if not candidate_prefilters(search.plants, structure, specification):
        offered = ", ".join(structure.prefilters)
        return Infeasible(
            f"none of the prefilters asked for fits {structure.name}, which offers {offered}; ask for one of these",
            ("prefilter",),
            None,
        )
    alone = {}
    for group, words in GROUPS.items():
        relaxation = _nearest(search, proof, structure, specification, (group,))
        if relaxation is not None:
            alone[words] = relaxation
    candidates = list(alone.values())
    if not candidates or min(share for share, _ in candidates) > 0.5:
        # One condition alone would have to give up most of what it protects: let all give a little.
        together = _nearest(search, proof, structure, specification, tuple(GROUPS))
        candidates += [together] if together is not None else []
    binding = tuple(alone) or tuple(GROUPS.values())
    if not candidates:
        return Infeasible(
            f"no cascade of {structure.name} is stable with any margin worth the name on all {len(search.plants)} plants; "
            "its bounds on the gains or its loop period do not fit this axis, or the model is not that of this axis: look at it "
            "(beltcomm compare RUN) and identify again",
            binding,
            None,
        )
    _, nearest = min(candidates, key=lambda pair: pair[0])
    what = " or ".join(binding) + " must give way" if alone else ", ".join(binding) + " must give way together"
    return Infeasible(
        f"no cascade of {structure.name} meets {describe(specification)} on all {len(search.plants)} plants: "
        f"{what}; the nearest request that it meets is {describe(nearest)}",
        binding,
        nearest,
    )


def _nearest(
    search: SampledPlants,
    proof: SampledPlants,
    structure: CascadeStructure,
    specification: Specification,
    groups: tuple[str, ...],
) -> tuple[float, Specification] | None:
    """Smallest share of relaxation of the groups that makes the request feasible, to 2 %, and that request.

    Bisected on the search grid; what is returned has been proven.
    """
    low, high = 0.0, 1.0
    if not _within_reach(search, structure, relax(specification, groups, high)):
        return None
    while high - low > 0.02:
        middle = 0.5 * (low + high)
        if _within_reach(search, structure, relax(specification, groups, middle)):
            high = middle
        else:
            low = middle
    while high <= 1.0:
        request = relax(specification, groups, high)
        if best_cascade(search, proof, structure, request) is not None:
            return high, request
        high += 0.04
    return None


def _within_reach(search: SampledPlants, structure: CascadeStructure, specification: Specification) -> bool:
    """True if the search finds gains with any prefilter and T_R, steps and proof aside."""
    inside = with_reserve(specification, 1.0)
    return any(
        best_gains(loop_shape(search, prefilter, lag), structure.period_s, structure, inside, zooms=0) is not None
        for prefilter in candidate_prefilters(search.plants, structure, specification)
        for lag in _velocity_filters(search.plants, structure, specification)
    )
