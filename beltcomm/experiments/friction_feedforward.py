"""Friction that strokes have shown, sent ahead instead of that of a first fit.

A first loop may be weak: without a filter against the resonance its speed settles in a second, and a few per cent of friction that are
sent ahead and are not there take it over the ends of the travel.  Then short strokes where the carriage stands come before the sweep, a
slow one first.  And where the first fit does not explain its records, the sweep's friction is sent ahead behind it: around standstill
friction that needs a way, or a gap, poses as viscous: three times what there is, counted up to the speed of fast moves, drives the axis
ahead of its reference until it is stopped.  The sweep measured it at speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import nnls

from beltcomm.axis import Axis
from beltcomm.control import Cascade, Feedforward
from beltcomm.drive import Capabilities
from beltcomm.errors import DataError, SafetyStop
from beltcomm.experiments import execute_step, phases
from beltcomm.experiments.bounds import Experiment, gentle_force_n, peak_torque_nm, stroking_nm, top_speed_m_s
from beltcomm.experiments.recentre import lags_behind
from beltcomm.identify.amplitude import family_around
from beltcomm.identify.friction import Plateau
from beltcomm.identify.sweeps import plateaus_of
from beltcomm.machine import stops
from beltcomm.machine.machine import Machine, stroking
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.rundata.findings import Findings
from beltcomm.schedule.orders import fastest_stroke_m_s, sweep_strokes
from beltcomm.simulate.stopping import total_friction, total_viscous
from beltcomm.trajectory import Strokes

#: Records of short strokes, each at a share of the fastest speed that has a plateau on the way, m; that plateau, s.
SHORT_STROKES = {f"short_strokes_{number}": share for number, share in enumerate((0.3, 0.5, 0.75, 1.0), start=1)}
WAY_M, PLATEAU_S = 0.2, 0.3
#: m/s: fastest of them; s that each takes at most.
FASTEST_M_S, SECONDS = 0.5, 3.5
#: m off its reference, beyond which they are stopped.
ASTRAY_M = 0.03
#: Share of the fastest that speeds differ by, at least, from which viscous and Coulomb friction are told apart.
DIFFERENT = 0.2
#: Share of the friction that is not known behind them.
UNSURE = 0.05
#: Share of the travel that a sweep leaves free at either end where the loop is not sure behind them, either.
FREE_SHARE = 0.2


def _may_be_weak(capabilities: Capabilities) -> bool:
    """True for a drive with known gains whose loop no filter keeps off the resonance, and that takes torque beside it."""
    known, structure = capabilities.gains != "unknown" and stroking(capabilities) != "profile", capabilities.structure
    return known and structure.torque_feedforward and set(structure.prefilters) <= {"none"}


def line(axis: Axis, capabilities: Capabilities) -> tuple[Experiment, ...]:
    """The plan's line on short strokes; empty where a loop is not weak for want of a filter.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    if not _may_be_weak(capabilities):
        return ()
    way, speed = WAY_M + ASTRAY_M, min(FASTEST_M_S, top_speed_m_s(axis, capabilities))
    torque, seconds = peak_torque_nm(axis, capabilities), len(SHORT_STROKES) * SECONDS
    heating = stroking_nm(axis, capabilities)
    return (Experiment("short strokes, for friction", WAY_M, way, speed, torque, gentle_force_n(axis), seconds, heating),)


def _short_strokes(machine: Machine, model: Model, share: float) -> Strokes:
    """A stroke forth and back from where the carriage stands towards the farther end, at a share of the fastest speed for that way."""
    at, limits, period = machine.position_m, phases.gentle_limits(machine, model, np.inf), machine.drive.capabilities.sample_period_s
    far = phases.farther_end_m(machine)
    end = at + math.copysign(min(WAY_M, abs(far - at)), far - at)

    def plan(slower: float) -> Strokes:
        fastest = min(FASTEST_M_S, fastest_stroke_m_s(limits.slower(slower), abs(end - at), PLATEAU_S))
        return sweep_strokes(at, end, limits.slower(slower), period, "once", [share * fastest], longest_s=PLATEAU_S)

    return phases.stoppable(machine, plan, partial(phases.strokes_leave_by_m, machine))


def with_friction_of_strokes(machine: Machine, loop: execute_step.Closed) -> execute_step.Closed:
    """The loop, in the drive too, with the friction of short strokes sent ahead, where it is not sure to keep a sweep inside the travel.

    Raises what the machine raises.

    Parameters
    ----------
    machine : Machine
    loop : Closed
        In the drive, with its model.
    """
    if loop.cascade is None or not _may_be_weak(machine.drive.capabilities) or machine.folder.finished(execute_step.SWEEP) is not None:
        return loop
    passes: list[Plateau] = []
    for name, share in SHORT_STROKES.items():
        if machine.folder.finished(name) is None:
            if phases.sweep_is_sure(machine, loop.model):
                break
            path = _short_strokes(machine, loop.model, share).trajectory
            envelope, sidecar = replace(phases.stroke_envelope(machine), lag_m=ASTRAY_M), phases.sidecar(machine, "friction_sweep")
            try:
                machine.record(name, machine.follow(path, machine.stroking()), envelope, sidecar)
            except SafetyStop as problem:
                if not lags_behind(machine, "strokes", problem):
                    raise
                machine.folder.journal(f"{name}: left out: {problem}")
                break
        passes += plateaus_of(machine.folder.recording(name), analyse.moved_inertia(loop.model))
        loop = _with_passes(machine, loop, passes)
    if not phases.sweep_is_sure(machine, loop.model):
        machine.free_share = FREE_SHARE
        machine.detail(f"strokes leave {FREE_SHARE:.0%} of the travel free at either end: this loop is weak beside the friction sent ahead")
    return loop


def learn_friction(machine: Machine, model: Model) -> None:
    """:func:`with_friction_of_strokes`, with the loop that is in the drive; nothing where nobody knows it.

    Parameters
    ----------
    machine : Machine
    model : Model
    """
    if machine.closed is not None and machine.cascade is not None:
        cascade = replace(machine.cascade, feedforward=machine.feedforward or machine.cascade.feedforward)
        with_friction_of_strokes(machine, execute_step.Closed(model, cascade, machine.closed[1]))


def _shown_by_passes(sent: Feedforward, passes: Sequence[Plateau]) -> Feedforward:
    """The feedforward with the friction that passes show: of one speed all of it times a factor; as it is where they show none."""
    if not passes or not (sent.viscous_nm_s_rad or sent.coulomb_nm):
        return sent
    speed, shown = np.array([(one.speed_rad_s, one.torque_nm - sent.offset_nm) for one in passes]).T
    parts, before = np.column_stack([speed, np.sign(speed)]), np.array([sent.viscous_nm_s_rad, sent.coulomb_nm])
    if np.ptp(np.abs(speed)) < DIFFERENT * np.abs(speed).max():
        viscous, coulomb = before * nnls((parts @ before)[:, np.newaxis], shown)[0]
    else:
        viscous, coulomb = nnls(parts, shown)[0]
    return replace(sent, viscous_nm_s_rad=float(viscous), coulomb_nm=float(coulomb)) if coulomb else sent


def _with_passes(machine: Machine, loop: execute_step.Closed, passes: Sequence[Plateau]) -> execute_step.Closed:
    """The loop, in the drive too, with the friction that passes show sent ahead."""
    if loop.cascade is None or (shown := _shown_by_passes(loop.cascade.feedforward, passes)) == loop.cascade.feedforward:
        return loop
    viscous, coulomb = shown.viscous_nm_s_rad, shown.coulomb_nm
    top = machine.ratio * max(abs(one.speed_rad_s) for one in passes)
    machine.detail(f"short strokes up to {top:.2g} m/s: friction {coulomb:.4g} N m and {viscous:.3g} N m s/rad")
    known = _with_friction(loop.model, viscous, coulomb)
    less, more = ((share * viscous, share * coulomb) for share in (1.0 - UNSURE, 1.0 + UNSURE))
    family = [known, _with_friction(known, *less), _with_friction(known, *more)]
    family += [_with_friction(member, *less) for member in family_around(known)[1:]]
    cascade = replace(loop.cascade, feedforward=shown)
    stops.count_on_loop(machine, family, machine.write_cascade(cascade), loop.delay_s)
    return replace(loop, cascade=cascade)


def _with_friction(model: Model, viscous_nm_s_rad: float, coulomb_nm: float) -> Model:
    """The model with this friction in all at the motor, shared out as it was."""
    values: dict[str, float] = {}
    for names, total, wanted in (
        (("viscous.damping", "viscous_cart.damping"), total_viscous(model), viscous_nm_s_rad),
        (("coulomb.level", "cart_friction.level"), total_friction(model), coulomb_nm),
    ):
        if total > 0.0:
            values |= {name: model[name] * wanted / total for name in names if name in model.parameters}
    return model.with_values(values)


def with_measured_friction(machine: Machine, findings: Findings, loop: execute_step.Closed) -> execute_step.Closed:
    """The loop, in the drive too, with the friction of the sweep sent ahead, where the first fit leaves its records unexplained.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    loop : Closed
        In the drive, with its model.
    """
    if (
        loop.cascade is None
        or findings.final is None
        or not findings.final.fit.suspect
        or machine.folder.finished(execute_step.SWEEP) is None
    ):
        return loop
    cascade = _with_sliding_friction(loop.cascade, loop.model, machine.folder.recording(execute_step.SWEEP))
    if cascade == loop.cascade:
        return loop
    stops.count_on_loop(machine, family_around(loop.model), machine.write_cascade(cascade), loop.delay_s)
    return replace(loop, cascade=cascade)


def _with_sliding_friction(cascade: Cascade, model: Model, sweep: Recording) -> Cascade:
    """The cascade with the friction of ``sweep`` in its feedforward, where that tells it; else as it is.

    Gains and inertia stay: no pole moves.
    """
    sent = cascade.feedforward
    if not (sent.viscous_nm_s_rad or sent.coulomb_nm):
        return cascade  # the drive sends none
    try:
        friction = analyse.friction_of([sweep], inertia_kg_m2=analyse.moved_inertia(model))
    except DataError:
        return cascade
    viscous, coulomb = friction.viscous, friction.coulomb
    if not all(one.interval is not None and one.value > one.interval for one in (viscous, coulomb)):
        return cascade
    return replace(cascade, feedforward=replace(sent, viscous_nm_s_rad=viscous.value, coulomb_nm=coulomb.value))
