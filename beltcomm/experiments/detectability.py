"""Before the machine moves: from which strength on could the planned records name an effect on this axis?

The records are simulated with the model from the data sheets, and what they would show is worked out as for measured ones
(:mod:`beltcomm.laboratory.visible`).  Nothing of a machine enters, so what a sheet does not say is assumed and told.
"""

from __future__ import annotations

import hashlib
import json
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from platformdirs import user_cache_path

from beltcomm import caches
from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.caches import source_hash
from beltcomm.drive import Capabilities
from beltcomm.errors import BeltcommError
from beltcomm.excitation import choose_prbs, prbs, visible_band
from beltcomm.experiments import phases
from beltcomm.experiments.bounds import course_before, seconds_of
from beltcomm.experiments.execute_step import EXPERIMENT, RESPONSE_S, quieter
from beltcomm.experiments.options import Options
from beltcomm.experiments.paths import Course, path_of, start_of
from beltcomm.experiments.plan import Plan
from beltcomm.fit.start.first_estimate import data_sheet_model
from beltcomm.identify.amplitude import MotionLimits, largest_amplitude
from beltcomm.laboratory.diagnosis import fit_base_of
from beltcomm.laboratory.score import Scorer, ground_of
from beltcomm.laboratory.visible import DetectionLimit, detection_limits
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.result import plain, with_unit
from beltcomm.rundata import analyse
from beltcomm.schedule import record_schedule
from beltcomm.schedule.record_schedule import Extent
from beltcomm.schedule.sequences import excitation_travel_m, held_choice
from beltcomm.schedule.steps import LOUD, Step
from beltcomm.simulate.exact import is_exact
from beltcomm.simulate.forward import integrate_torque, simulate_torque
from beltcomm.simulate.stopping import total_friction
from beltcomm.verify import Loop, predict_move

#: Assumed where no sheet says it: friction as a share of the torque that the axis may be driven with, belt damping, viscous friction
#: as a share of Coulomb friction at 1 m/s, noise of the torque signal as a share of the motor's rated torque.
FRICTION_SHARE, BELT_DAMPING_NS_M, VISCOUS_SHARE, NOISE_SHARE = 0.1, 20.0, 0.5, 0.004
#: Damping ratio of what swings on anything but a belt.
DAMPING_RATIO = 0.02
#: Units that are shown in thousandths or millionths where they are small.
PREFIXED = ("m", "s", "N m", "rad", "N")
#: What a quick plan says instead.
UNSAID = "How weak an effect these records could name is not said with --quick; --visible says it."
#: Seed of the noise.
SEED = 1
#: s of simulated positioning between two records.
BETWEEN_S = 1.0
#: s of machine time for what is not simulated: breakaway, rising excitation, first response, the move that verifies.
FIRST_AND_LAST_S = 19.0
#: Sub-steps of a sampling period.
SUBSTEPS = 20
#: Answers that are kept on a computer: axes and drives that it meets in turn.
MOST_KEPT = 20


@dataclass(frozen=True)
class Detectability:
    """Detection limits that the records of a plan will have.

    Attributes
    ----------
    sights : tuple of DetectionLimit
        Of every effect.
    assumed : str
        In words.
    records : int
        How many were simulated.
    extent : Extent
        Of the session.
    """

    sights: tuple[DetectionLimit, ...]
    assumed: str
    records: int
    extent: Extent

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``; null for never."""
        return {"extent": self.extent, "records": self.records, "assumed": self.assumed, "effects": [_as_entry(s) for s in self.sights]}


def _lines_of(found: Mapping[str, Any], whole: bool) -> list[str]:
    """For people: the weakest strength of every effect that could be named, then those that could not; ``whole``: a line for each."""
    seen = sorted((e for e in found["effects"] if e["seen"]), key=lambda e: str(e["effect"]))
    blind = [e for e in found["effects"] if not e["seen"]]
    lines = [f"What these records could name, to first order, by a simulation from the data sheets ({found['assumed']}):"]
    width = max((len(_amount(e)) for e in seen), default=0)
    if whole:
        each = (f"{e['effect']:22} from {_amount(e):{width}} on  {e['parameter']}, {e['strength']:.1g} of a typical one" for e in seen)
        lines += [f"  {line}" for line in each]
    elif seen:
        lines[0] = lines[0].removesuffix(":") + ", each from this size on (--visible: what it is a size of):"
        lines += textwrap.wrap(
            ", ".join(f"{e['effect']} {_amount(e)}".replace(" ", "\xa0") for e in seen), 96, initial_indent="  ", subsequent_indent="  "
        )
        lines = [line.replace("\xa0", " ") for line in lines]
    if blind:
        told = "; ".join(f"{e['effect']} ({_remedy(e, found['extent'])})" for e in blind)
        lines.append(f"  cannot be named at a typical size: {told}")
    return lines


def _as_entry(sight: DetectionLimit) -> dict[str, Any]:
    """One effect for ``--json``."""
    weakest = None if math.isinf(sight.hardest) else sight.hardest * sight.size
    strength = None if math.isinf(sight.hardest) else sight.hardest
    return {
        "effect": sight.effect.name,
        "parameter": sight.parameter,
        "weakest": weakest,
        "unit": sight.unit,
        "strength": strength,
        "seen": sight.is_detectable,
    }


def _amount(entry: Mapping[str, Any]) -> str:
    """Weakest size with a unit that people read."""
    value, unit = entry["weakest"], entry["unit"]
    if unit in ("", "1"):
        return f"{100.0 * value:.2g} %"
    fits = ((p, f) for p, f in (("", 1.0), ("m", 1e3), ("µ", 1e6)) if unit not in PREFIXED or value * f >= 0.3 or p == "µ")
    prefix, factor = next(fits)
    return with_unit(f"{value * factor:.3g}", f"{prefix}{unit}")


def _remedy(entry: Mapping[str, Any], extent: Extent) -> str:
    """From where on, and which option would show it."""
    weaker = "at no size" if entry["strength"] is None else f"only from {entry['strength']:.2g} x a typical one on"
    return f"{weaker}; {'the limits in axis.yaml allow no more' if extent == 'thorough' else '--thorough records more'}"


def _foresee(axis: Axis, capabilities: Capabilities, extent: Extent) -> Detectability:
    """Detection limits of the records of an extent; raises BeltcommError where no record can be simulated."""
    model = sheet_model(axis)
    noise = NOISE_SHARE * (axis.motor.rated_torque_nm or capabilities.rated_torque_nm)
    recordings = list(_records(axis, capabilities, model, extent, noise))
    data, fitted = fit_base_of(recordings, axis, model)
    sights = detection_limits(Scorer(fitted), ground_of(fitted, data.fitted, axis))
    assumed = (
        f"assumed: carriage {model['cart.mass']:.3g} kg, friction {1e3 * total_friction(model):.3g} mN m, "
        f"{1e3 * noise:.2g} mN m of torque noise, {capabilities.counts_per_rev} encoder steps per turn"
    )
    return Detectability(tuple(sights), assumed, len(recordings), extent)


def with_detectability(plan: Plan, axis: Axis, capabilities: Capabilities, options: Options) -> Plan:
    """The plan with what its records could show.

    1.5 s of calculation, kept for the next time; a quick session leaves it out and says what shows it.   The first time on a machine
    its kernels are compiled, too, which a later ``diagnose`` needs as well.

    Parameters
    ----------
    plan : Plan
        Of a commissioning.
    axis : Axis
    capabilities : Capabilities
    options : Options
        Extent, and what is to be shown.

    Returns
    -------
    Plan
        With notes; a quick session's say how to ask.
    """
    if options.quick and not options.visible:
        return replace(plan, notes=(*plan.notes, UNSAID))
    try:
        seen = _kept_or_new(axis, capabilities, options.extent, lambda: plain(_foresee(axis, capabilities, options.extent).to_dict()))
    except BeltcommError as problem:
        return replace(plan, notes=(*plan.notes, f"What these records could name cannot be said beforehand: {problem}"))
    return replace(plan, notes=(*plan.notes, *_lines_of(seen, whole=options.visible)), visible=seen)


def sheet_model(axis: Axis) -> Model:
    """The base model with what the data sheets say, and with the assumptions of this module.

    Parameters
    ----------
    axis : Axis
    """
    friction = FRICTION_SHARE * axis.torque_limit_nm
    middle = axis.travel.middle_m
    sheet = data_sheet_model(axis, middle, friction)
    sheet = sheet.without_effect("cart_friction") if "cart_friction" in sheet.effects else sheet
    values = {
        "coulomb.level": friction,
        "viscous.damping": VISCOUS_SHARE * friction * axis.transmission_m_rad,
        "belt_damping.damping": BELT_DAMPING_NS_M,
    }
    if axis.transmission is not None and not sheet.rigid:
        light = 1.0 / (1.0 / sheet["cart.mass"] + axis.transmission_m_rad**2 / sheet["motor.inertia"])
        values["belt_damping.damping"] = 2.0 * DAMPING_RATIO * math.sqrt(sheet["belt_stiffness.stiffness"] * light)
    return sheet.with_values({name: value for name, value in values.items() if name in sheet.parameters}, "assumed")


def _records(axis: Axis, capabilities: Capabilities, model: Model, extent: Extent, noise_nm: float) -> Iterator[Recording]:
    """The records of an extent as a machine like the model would give them."""
    course, noise, clock_s = course_before(axis, capabilities, model["cart.mass"]), np.random.default_rng(SEED), 0.0
    left = record_schedule.BUDGET_S[extent] - FIRST_AND_LAST_S
    steps = [
        Step("response"),
        *record_schedule.fitting_records(record_schedule.BY_EXTENT[extent], lambda step: seconds_of(step, course), left)[0],
    ]
    simulated = _Simulated(axis, capabilities, model, course)
    for name, step in record_schedule.named_steps(steps):
        motion = simulated.response(step) if step.kind == "response" else simulated.stroke(step)
        sidecar = replace(motion.sidecar, session_time_s=clock_s, held_out=step.held_out)
        torque = motion.torque_nm + noise.normal(0.0, noise_nm, len(motion.torque_nm))
        setpoint = np.append(motion.torque_nm[1:], 0.0)
        yield Recording(name, motion.t_s, torque, motion.position_rad, setpoint, sidecar=sidecar)
        clock_s += float(motion.t_s[-1]) + BETWEEN_S


@dataclass(frozen=True)
class _Motion:
    """t_s, torque_nm (acting, without noise), position_rad (in whole encoder steps) : (n,)."""

    t_s: Array
    torque_nm: Array
    position_rad: Array
    sidecar: Sidecar


class _Simulated:
    """Excitations and strokes of the model, as the machine would be asked for them."""

    def __init__(self, axis: Axis, capabilities: Capabilities, model: Model, course: Course) -> None:
        self.axis, self.capabilities, self.model, self.course = axis, capabilities, model, course
        self.period_s = capabilities.sample_period_s
        self.step_rad = 2.0 * math.pi / capabilities.counts_per_rev
        self._loudest: dict[float, float] = {}
        middle = 0.5 * sum(course.window_m)
        design = analyse.first_loop(model, capabilities.structure, middle, self.period_s, 0.0)
        self.cascade = analyse.with_feedforward(design.cascade, model, capabilities.structure, self.period_s)

    def encoder_angle(self, position_rad: Array) -> Array:
        """Angle that the encoder shows."""
        return np.floor(position_rad / self.step_rad + 0.5) * self.step_rad

    def response(self, step: Step) -> _Motion:
        """An excitation as loud as the belt allows, or quieter."""
        at = self.course.place_m(step)
        band = visible_band(self.period_s, *analyse.characteristic_hz(self.model, at))
        choice = choose_prbs(self.period_s, *band, max(step.seconds, RESPONSE_S))
        if step.held_out:
            choice = held_choice(choice)
        shape = prbs(choice.order, choice.clock, 2.0, self.period_s, choice.repeats)
        unit = shape.torque / shape.amplitude_nm
        amplitude = self.loudest(unit, at)
        if step.share < LOUD:
            amplitude = quieter(amplitude, total_friction(self.model), step.share)
        torque = amplitude * unit
        # A plan waits for no kernel of Nyström's: that compiles longer.
        simulate = simulate_torque if is_exact(self.model) else integrate_torque
        moved = simulate(self.model, torque, self.period_s, at, substeps=SUBSTEPS)
        note = ExcitationNote("prbs", amplitude, shape.period_samples, shape.first_sample)
        return _Motion(moved.t_s, torque, self.encoder_angle(moved.position_rad), Sidecar("frf", at, excitation=note))

    def loudest(self, unit: Array, at_m: float) -> float:
        """Largest amplitude of a shape within travel, speed and belt force, N m; the way of a stop is left out."""
        limits = MotionLimits(
            excitation_travel_m(self.period_s),
            phases.EXCITATION_SPEED_M_S,
            self.capabilities.peak_torque_nm,
            phases.BELT_SHARE * self.axis.belt_force_limit_n,
        )
        key = round(float(np.sum(np.abs(unit))), 6)
        if key not in self._loudest:
            found = largest_amplitude([self.model], unit, self.period_s, at_m, limits, self.axis.torque_limit_nm)
            self._loudest[key] = found.amplitude_nm
        return self._loudest[key]

    def stroke(self, step: Step) -> _Motion:
        """A motion in closed loop, with the cautious loop that this model gives."""
        start = start_of(step, self.course)
        path = path_of(step, self.course, start)
        own = self.capabilities
        moved = predict_move(self.model, self.cascade, path, Loop(own.structure, self.period_s, own.peak_torque_nm, own.counts_per_rev))
        ratio = self.model["transmission.ratio"]
        acting = np.concatenate(([0.0], moved.torque_nm[:-1]))  # one period late, as assumed
        sidecar = Sidecar(EXPERIMENT[step.kind], start, closed_loop=True)
        return _Motion(moved.t_s, acting, start / ratio + self.encoder_angle((moved.motor_m - start) / ratio), sidecar)


def _kept_or_new(axis: Axis, capabilities: Capabilities, extent: Extent, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The answer kept for this axis, drive and extent where everything is as it was, else a new one.   Raises what ``make`` raises."""
    key = _key_of(axis, capabilities, extent)
    path = user_cache_path("beltcomm") / f"foresight_{key[:12]}.json"
    if found := caches.found(path, key):
        try:
            return dict(found["visible"])
        except (ValueError, KeyError, TypeError):
            caches.damaged(path)
    visible = make()
    caches.keep(path, key, {"visible": visible})
    caches.keep_newest(path.parent, "foresight_*.json", MOST_KEPT)
    return visible


def _key_of(axis: Axis, capabilities: Capabilities, extent: Extent) -> str:
    """Changes with everything that the answer rests on."""
    drive = {name: sorted(map(str, v)) if isinstance(v, set | frozenset) else str(v) for name, v in asdict(capabilities).items()}
    return hashlib.sha256(json.dumps([axis.to_dict(), drive, extent, source_hash()], default=str, sort_keys=True).encode()).hexdigest()
