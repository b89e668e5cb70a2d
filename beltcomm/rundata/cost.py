"""Cost of a missing effect: predicted tracking error of the verification move with a controller that does not know it, and with one
that does, both on a machine that has it.

No machine is needed: the cascade is that of the run's drive, else the thesis's; gains are designed for either model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.design.feedforward import compensated_effects, compensation
from beltcomm.design.margins import margins
from beltcomm.errors import BeltcommError, Refused
from beltcomm.model import Model
from beltcomm.quantities import in_mm, mm
from beltcomm.result import plain
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import assume_delay, delay, measure_delay_and_damping
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.kept import kept_path
from beltcomm.rundata.offline import structure_of
from beltcomm.rundata.revisions import Revision, keep_cost, model_named
from beltcomm.runfolder import RunFolder
from beltcomm.trajectory import Trajectory, plan_trajectory, with_dwell
from beltcomm.verify import REST_S, Loop, TrackingError, demand, predict_move, predict_range, tracking_error

if TYPE_CHECKING:  # the report, which searches for nothing, uses this module too
    from beltcomm.laboratory.diagnosis import Diagnosis

#: Limits of the move where axis.yaml names none: those of an ordinary handling axis.
USUAL = TrajectoryLimits(jerk_m_s3=200.0, acceleration_m_s2=10.0, speed_m_s=1.5)
#: Share of the travel kept free at both ends, and encoder counts where none are stated.
ROOM_SHARE, COUNTS = 0.06, 65536
#: One kind of prefilter is enough to tell what an effect costs; designing with all takes three times as long.
PREFILTERS = ("butterworth", "notch", "none")
#: Differences below these are nothing: a few encoder steps, and what gains differ by for other reasons.
MATTERS_M, MATTERS_SHARE = 5e-6, 0.10
#: Degrees by which a phase margin may be smaller before it is said.
THIN_DEG = 5.0


@dataclass(frozen=True)
class Cost:
    """Errors of the move on a machine with the effect.

    *_range : smallest and largest at the motor over the intervals of the model, ``verify.predict_range``; None where it has none.

    Attributes
    ----------
    unaware, aware : TrackingError, at the motor
        By controller; *_cart : at the carriage.
    unaware_margins : str
        What the controller that does not know the effect lacks on a machine with it, in words; "" for nothing.
    """

    move: str
    unaware: TrackingError
    aware: TrackingError
    unaware_cart: TrackingError
    aware_cart: TrackingError
    unaware_range: tuple[TrackingError, TrackingError] | None = None
    aware_range: tuple[TrackingError, TrackingError] | None = None
    unaware_margins: str = ""

    @property
    def is_negligible(self) -> bool:
        """True if knowing the effect changes no error by more than ``MATTERS_M`` and ``MATTERS_SHARE``."""
        pairs = [(self.unaware, self.aware), (self.unaware_cart, self.aware_cart)]
        values = [(getattr(a, n), getattr(b, n)) for a, b in pairs for n in ("dynamic_m", "static_m")]
        return all(abs(a - b) < max(MATTERS_M, MATTERS_SHARE * a) for a, b in values)


def _cost_of(folder: RunFolder, before: Model, after: Model) -> Cost:
    """Cost of what ``after`` has and ``before`` has not; raises BeltcommError where no loop or no move can be had."""
    axis, findings = folder.axis, Findings(kept_path=kept_path(folder))
    if not axis.has_transmission or before.side != "motor":
        raise Refused("an axis without a belt has no verification move yet")
    excited = [r for r in folder.recordings() if r.sidecar.experiment == "frf"]
    measure_delay_and_damping(findings, excited, before)
    structure = structure_of(folder, findings)
    assume_delay(findings, structure)
    kinds = ["none"] if before.rigid else [kind for kind in PREFILTERS if kind in structure.prefilters]
    structure = replace(structure, prefilters=(kinds[0],))
    move = offline_move(axis, after, structure.period_s)
    rested = with_dwell(move, REST_S)
    unaware = _errors(axis, before, after, structure, findings, rested)
    aware = _errors(axis, after, after, structure, findings, rested)
    top = float(abs(move.velocity_m_s).max())
    words = f"{move.position_m[0]:.2f} to {move.position_m[-1]:.2f} m at up to {top:.2g} m/s"
    return Cost(words, unaware[0], aware[0], unaware[1], aware[1], unaware[2], aware[2], _missing_words(axis, unaware[3], after, findings))


def _missing_words(axis: Axis, designed: DesignResult, machine: Model, findings: Findings) -> str:
    """Missing parts, in words, of a controller on another machine than it was made for; "" for none."""
    damping = analyse.apparent_damping(findings.thesis)
    plants = analyse.design_plants(machine, axis.travel.ends_m, [machine["cart.mass"]], delay(findings), damping)
    found = margins(designed.cascade, plants, designed.structure.period_s)
    if not all(one.stable and one.velocity_stable for one in found):
        return "it is not stable there"
    thin = min(found, key=lambda one: one.phase_margin_deg)
    asked = designed.specification.phase_margin_deg
    return (
        f"its phase margin is {thin.phase_margin_deg:.0f}° there, {asked:.0f}° are asked for"
        if thin.phase_margin_deg < asked - THIN_DEG
        else ""
    )


def _cost_or_reason(folder: RunFolder, before: Model, after: Model) -> tuple[Cost | None, str]:
    """The cost, or in words why it cannot be said."""
    try:
        return _cost_of(folder, before, after), ""
    except BeltcommError as problem:
        return None, str(problem)


def _cost_lines(cost: Cost | None, reason: str, name: str) -> list[str]:
    """Lines on the cost for a command."""
    if cost is None:
        return [f"What {name} costs in tracking cannot be said: {reason}"]
    if cost.is_negligible:
        either = mm(cost.aware.dynamic_m)
        return [f"{name} costs nothing that matters in the move from {cost.move}: {either} at the motor with it and without."]
    lines = [
        f"What {name} costs, predicted for the move from {cost.move}, controller without it → with it:",
        f"  at the motor    following error {mm(cost.unaware.dynamic_m)} → {mm(cost.aware.dynamic_m)}, "
        f"settled {mm(cost.unaware.static_m)} → {mm(cost.aware.static_m)}",
        f"  at the carriage following error {mm(cost.unaware_cart.dynamic_m)} → {mm(cost.aware_cart.dynamic_m)}, "
        f"settled {mm(cost.unaware_cart.static_m)} → {mm(cost.aware_cart.static_m)}",
    ]
    if cost.unaware_margins:
        lines.append(f"  but the controller without it does not hold on such a machine: {cost.unaware_margins}; knowing it costs gain")
    return lines


def offline_move(axis: Axis, model: Model, period_s: float) -> Trajectory:
    """The move of the targets, or what of it travel and limits allow.

    Parameters
    ----------
    axis : Axis
    model : Model
    period_s : float, s
        Of the samples.

    Raises
    ------
    Refused
        When nothing is left of it.
    """
    way = axis.targets.way_m
    low, high = float(axis.travel.min_m or 0.0), float(axis.travel.max_m or way)
    margin = ROOM_SHARE * (high - low)
    start = 0.0 if low <= 0.0 and high >= way else low + margin
    end = min(start + way, high - margin)
    limits = axis.trajectories.get(axis.targets.limits) or USUAL
    share = 1.0
    while share > 0.02:
        move = plan_trajectory(start, end, limits.slower(share), period_s)
        asked = demand(move, model)
        most = (axis.limits.speed_m_s or asked.speed_m_s, axis.belt_force_limit_n, axis.torque_limit_nm)
        if all(value <= limit for value, limit in zip((asked.speed_m_s, asked.feed_force_n, asked.torque_nm), most, strict=True)):
            return move
        share *= 0.95
    raise Refused(f"no move from {start:g} m to {end:g} m keeps the limits of axis.yaml")


def cost_rows(cost: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """A cost as a revision keeps it: what, error without the effect, its range, error with it, its range, mm; no range: "".

    Parameters
    ----------
    cost : mapping of str to Any, m
        As :func:`cost_and_words` made it.

    Returns
    -------
    list of tuple of str
        Following and settled error at motor and carriage.
    """
    rows: list[tuple[str, ...]] = []
    for place, end in (("motor", ""), ("carriage", "_cart")):
        for kind in ("dynamic_m", "static_m"):
            shown = []
            for controller in ("unaware", "aware"):
                spread = cost.get(f"{controller}{end}_range") or ()
                shown += [in_mm(cost[controller + end][kind]), " to ".join(in_mm(one[kind]) for one in spread)]
            rows.append((f"{place}, {kind.removesuffix('_m')}", *shown))
    return rows


def _errors(
    axis: Axis, known: Model, machine: Model, structure: CascadeStructure, findings: Findings, rested: Trajectory
) -> tuple[TrackingError, TrackingError, tuple[TrackingError, TrackingError] | None, DesignResult]:
    """Errors at motor and carriage with a controller made for one model on a machine that is another; over its intervals; it."""
    designed, cascade = analyse.design(
        known,
        structure,
        positions_m=axis.travel.ends_m,
        masses_kg=[known["cart.mass"]],
        dead_time_s=delay(findings),
        apparent_damping_nm_s_rad=analyse.apparent_damping(findings.thesis),
    )
    send = structure.torque_feedforward and compensated_effects(known)
    extra = compensation(known, cascade.feedforward, rested, structure.period_s) if send else None
    drive = Loop(structure, delay(findings), axis.torque_limit_nm, int(axis.motor.encoder_counts_per_rev or COUNTS))

    def errors(on: Model, stretch_m: float) -> tuple[TrackingError, TrackingError]:
        path = predict_move(on, cascade, rested, drive, belt_stretch_m=stretch_m, extra_torque_nm=extra)
        motor, cart = path.error_for(axis.targets), tracking_error(path.t_s, rested.position_m, path.cart_m, axis.targets)
        return motor, cart

    told = any(value.interval is not None for value in machine.parameters.values())
    spread = predict_range(machine, lambda on, stretch_m: errors(on, stretch_m)[0]) if told else None
    return *errors(machine, 0.0), spread, designed


def cost_and_words(folder: RunFolder, before: Model, after: Model, name: str) -> tuple[dict[str, Any] | None, list[str]]:
    """Cost of not knowing an effect, for programs and for people.

    Parameters
    ----------
    folder : RunFolder
    before : Model
        Model without the effect.
    after : Model
        Model with it.
    name : str
        Of the effect.

    Returns
    -------
    tuple of dict of str to Any or None and list of str
        None, and the reason as a line, where it is not computed.
    """
    price, reason = _cost_or_reason(folder, before, after)
    return (None if price is None else dict(plain(price))), _cost_lines(price, reason, name)


def with_costs(folder: RunFolder, found: Diagnosis, made: list[Revision], whole: dict[str, Any] | None) -> list[Revision]:
    """The revisions of a climb with what their effects together cost, kept with the last.

    Parameters
    ----------
    folder : RunFolder
    found : Diagnosis
    made : list of Revision
        Revisions of the climb.
    whole : dict of str to Any or None
        Of all that was named.
    """
    last = made[-1]
    new = [name for name in last.effects if name not in found.base.model.effects]
    if not new:
        return made
    if set(found.added_effects) - set(last.effects):
        whole, _ = cost_and_words(folder, found.base.model, model_named(folder, last.name), "")
    kept = None if whole is None else {"of": " and ".join(new), **whole}
    keep_cost(folder, last.name, kept)
    return [*made[:-1], replace(last, cost=kept)]
