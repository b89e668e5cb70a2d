"""The whole sequence: connect, check, excite, close a cautious loop, measure, fit, design, verify, keep or restore.

Where nobody can write the drive's gains, the loop that a person has set in it carries the records and the last move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from beltcomm.axis import Axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.errors import DataError, NoMotion, Refused, SafetyStop
from beltcomm.experiments import (
    bounds,
    execute_step,
    friction_feedforward,
    gain_steps,
    holding,
    own_loop,
    own_strokes,
    payload_mode_in_first_fit,
    phases,
    raising,
    sameness,
    sampling_limits,
    stop_unit,
    verification,
)
from beltcomm.experiments.proving import learn_gains, verify_move
from beltcomm.experiments.recentre import MOST_STOPS, QUIETER, bring_back, lags_behind, may_not_excite, stands_after
from beltcomm.fit.torque.acting_torque import acting_recording, stated_remarks
from beltcomm.identify.amplitude import AmplitudeStep, family_around, half_friction, unknown_masses_kg
from beltcomm.identify.final import FinalModel, evidence, final_model
from beltcomm.identify.standstill import largest
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.language import tr
from beltcomm.machine import scale, stops
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import assume_delay, delay, measure_delay_and_damping
from beltcomm.rundata.findings import Apply as Apply
from beltcomm.rundata.findings import Findings as Findings
from beltcomm.rundata.findings import Settings as Settings
from beltcomm.rundata.first_motions import Excited
from beltcomm.rundata.proof import SURE_MARGIN_DEG, move_name, proof, thin_margins
from beltcomm.schedule import record_schedule
from beltcomm.schedule.record_schedule import Extent
from beltcomm.schedule.steps import SHORT_S
from beltcomm.schedule.strokes import SWEEP_LONGEST_S
from beltcomm.sending import Sending
from beltcomm.talk import choose

#: s of machine time kept for the move that verifies, with the way to its start.
VERIFYING_S = 4.0
#: The same for a velocity loop, which follows slow moves only and takes several tries to arrive anywhere.
DRIFTING_S = 22.0
#: What follows a path that a first loop was left behind by is driven so many times slower, and no slower than that in all.
SLOWER, SLOWEST_PACE = 0.5, 0.13
#: Times the torque of breaking away, below which an excitation tells nothing.
MOVES_AT = 1.2
#: s of machine time that finding sign and breakaway takes as a rule.
CREPT_S = 2.0
#: s, from where a dead time is looked for; evidence that it must have.
LATE_S, CLEAR_EVIDENCE = 5e-4, 150.0
#: Names of the phases, as shown to the user.
TITLES = (
    "connect and check",
    "direction + breakaway",
    "excitation in place, rising",
    "frequency response here",
    "first safe loop",
    "strokes, responses, moves",
    "fit and design",
    "verification move",
    "verdict and report",
)


def identify_here(machine: Machine, findings: Findings, *, brief: bool = False) -> Model:
    """Phases 1 to 3: sign, rising excitation, one open-loop frequency response at the present place; returns a first model.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Of the session; filled.
    brief : bool
        Fewer steps and a shorter response.
    """
    machine.begin(TITLES[1])
    masses = unknown_masses_kg(machine.axis)
    if machine.axis.mounting.tilted:
        findings.breakaway, findings.holding = holding.sign_and_scale(machine)
        masses = holding.masses_kg(machine, machine.holding_nm)
    else:
        findings.breakaway = phases.sign_and_scale(machine)
        machine.holding_nm = findings.breakaway.holding_nm
    machine.found("direction", "ok")
    machine.found("breakaway", f"{findings.breakaway.coulomb_nm:.3g} N m")
    sameness.check_breakaway(machine, findings.breakaway.coulomb_nm)
    findings.calibrating_s = gain_steps.ensure(machine, findings.breakaway.coulomb_nm)
    sameness.repeat_first_excitation(machine, findings.breakaway, masses)
    machine.begin(TITLES[2])
    short_s = SHORT_S if brief else execute_step.RESPONSE_S

    def to_come(model: Model, at_most_nm: float) -> AmplitudeStep:
        return execute_step.short_if_possible(partial(phases.response_to_come, machine, model, at_most_nm), short_s)[1]

    findings.excited = raising.raise_amplitude(machine, findings.breakaway, masses, response=to_come if brief else None)
    if findings.holding is not None:
        findings.holding = holding.compare(machine, findings.holding)
    if machine.cascade is not None and machine.braking is not None:  # as from here on a loop ends what an excitation began
        stop_unit.ensure(machine, findings.excited.model, again=True)
    machine.begin(TITLES[3])
    first_response(machine, findings, findings.excited, short_s)
    model = first_model(machine, findings)
    scale.check_fitted(machine, model, findings.excited.model, acting_recording(machine.folder.recording("frf_1"), findings.path))
    return model


def try_stop_here(machine: Machine, model: Model) -> None:
    """After an identification, where no louder record follows: show by a slow stop what its deceleration counts in, if it was not shown.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    model : Model
        Of the axis.

    Raises
    ------
    DriveError
        When the stop contradicts that.
    """
    if machine.stop_tried or not stop_unit.is_tried(machine.drive.capabilities):
        return
    stops.lend_brake(machine, model, machine.position_m)
    if machine.cascade is not None and machine.braking is not None:
        stop_unit.ensure(machine, model)
    else:
        stop_unit.tell_untold(machine, "an identification closes no loop whose gains nobody knows")


def first_response(machine: Machine, findings: Findings, excited: Excited, seconds: float) -> None:
    """The frequency response at the present place; where the carriage wanders too far again where it then stands, shorter and quieter.

    Then no response after it is louder, either.   One that does not move the axis is made louder.

    Raises
    ------
    SafetyStop
        When stops have used up what the session goes on after, NoMotion when no torque allowed moves the axis.
    """
    above_nm, model = 0.0, excited.model
    while True:
        # A carriage that went too far is not held by friction: no sequence is tried that is louder for leaving out the resonance.
        chosen = partial(phases.response_to_come, machine, model, excited.at_most_nm, loud=not machine.wanderings)
        choice, step = execute_step.short_if_possible(chosen, seconds)
        phases.louder(machine, step, above_nm)
        try:
            phases.planned_response(machine, "frf_1", model, choice, step)
            return
        except SafetyStop as problem:
            if not stands_after(machine, problem) or may_not_excite(machine):
                raise
            moves_nm = MOVES_AT * findings.breakaway.coulomb_nm if findings.breakaway else 0.0
            most_nm = max(QUIETER * step.amplitude_nm, min(step.amplitude_nm, moves_nm))
            seconds = min(seconds, SHORT_S)  # how far it wanders grows with the time
            model = half_friction(model)  # which a first record told too high
            excited = findings.excited = replace(excited, step=replace(step, amplitude_nm=most_nm), at_most_nm=most_nm)
            findings.remarks.append(f"frf_1 is made with at most ±{most_nm:.3f} N m, after this: {problem}")
        except NoMotion:
            above_nm = step.amplitude_nm
            if not machine.wanderings:
                excited = replace(excited, at_most_nm=raising.GROWTH * above_nm)


def first_model(machine: Machine, findings: Findings) -> Model:
    """Model, dead time and apparent damping from the frequency response at one place."""
    recordings = [r for r in machine.folder.recordings() if r.sidecar.experiment == "frf"]
    counts = machine.drive.capabilities.counts_per_rev
    start = findings.excited.model if findings.excited else None
    with machine.withdrawing():
        try:
            found = final_model(recordings, machine.axis, counts, start=start)
        except DataError:
            if start is None:
                raise
            found = final_model(recordings, machine.axis, counts)  # behind a coarse encoder an estimate may leave no sample that counts
        if found.fit.suspect:
            found = with_late_torque(found, recordings, machine.axis, counts)
        if found.fit.suspect and start is not None:
            found = from_records_alone(found, recordings, machine.axis, counts)
        findings.final = found
        findings.swing = payload_mode_in_first_fit.with_swing(found, recordings, machine.axis, counts) if found.fit.suspect else None
    model = found.fit.model
    if findings.swing is not None:
        model = payload_mode_in_first_fit.as_one(findings.swing)
        findings.remarks.append(payload_mode_in_first_fit.swing_words(findings.swing))
    sampling_limits.note_after(findings.remarks, model, machine.axis, machine.drive.capabilities, machine.position_m)
    tell_model(machine, model, machine.position_m)
    measure_delay_and_damping(findings, recordings, model)
    return model


def tell_model(machine: Machine, model: Model, at_m: float) -> None:
    """Tell the axis as the model knows it so far.

    Parameters
    ----------
    at_m : float
        Where its resonance is told for.
    """
    machine.found("mass", f"{model['cart.mass']:.3g} kg")
    resonance = analyse.characteristic_hz(model, at_m)[1]
    if np.isfinite(resonance):
        machine.found("resonance", f"{resonance:.3g} Hz")


def with_late_torque(found: FinalModel, recordings: Sequence[Recording], axis: Axis, counts_per_rev: int) -> FinalModel:
    """The fit with torque that acts later than it is reported, where that explains clearly more; else the fit as it is.

    A loop designed without knowing a dead time of a millisecond, from inertia and mass that it has biased, cannot be closed.
    """
    late = found.fit.model.with_effect("dead_time", {"time": LATE_S})
    try:
        other = final_model(recordings, axis, counts_per_rev, start=late)
    except DataError:
        return found
    return other if evidence(other.fit, found.fit) > CLEAR_EVIDENCE else found


def from_records_alone(found: FinalModel, recordings: Sequence[Recording], axis: Axis, counts_per_rev: int) -> FinalModel:
    """The fit begun anew from its own records, where that explains them; else the fit as it is.

    The estimate it began from is kept near the data sheets, which may be far from the machine: the fit can end beside it.
    """
    try:
        other = final_model(recordings, axis, counts_per_rev)
    except DataError:
        return found
    return found if other.fit.suspect else other


def close_first_loop(machine: Machine, findings: Findings, model: Model, *, ask: bool = False) -> Cascade:
    """Phase 4: a cautious loop for the uncertain first model, written into the drive.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Of the session; filled.
    model : Model
        Of the axis.
    ask : bool
        Before a loop with thin margins is closed.

    Raises
    ------
    Refused
        For a no.
    """
    machine.begin(TITLES[4])
    return close_loop(machine, findings, model, *first_cascade(machine, findings, model, machine.position_m), ask=ask)


def closed_for(machine: Machine, findings: Findings, model: Model, *, ask: bool = False) -> None:
    """A loop for strokes: a first one, or where nobody can write the gains the one that stands in the drive.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Of the session; filled.
    model : Model
        Of the axis.
    ask : bool
        Before a loop with thin margins is closed.

    Raises
    ------
    Refused
    """
    if machine.drive.capabilities.gains != "unknown":
        close_first_loop(machine, findings, model, ask=ask)
        return
    machine.begin(TITLES[4])
    assume_delay(findings, machine.drive.capabilities.structure)
    if not own_loop.try_out(machine, findings, model):
        raise Refused(findings.remarks.pop())


def first_cascade(machine: Machine, findings: Findings, model: Model, at_m: float) -> tuple[Cascade, float]:
    """The cautious loop for a place, m, and its smallest phase margin, deg; nothing is written.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Of the session; filled.
    model : Model
        Of the axis.
    at_m : float, m
        Of the carriage.
    """
    structure = machine.drive.capabilities.structure
    assume_delay(findings, structure)
    seen = at_m, delay(findings), analyse.apparent_damping(findings.thesis)
    result = analyse.first_loop(model, structure, *seen)
    margin = min(m.phase_margin_deg for m in result.margins)
    if findings.swing is not None:
        margin = min(margin, payload_mode_in_first_fit.proven_margin_deg(findings.swing, result.cascade, structure, *seen))
    cascade = analyse.with_feedforward(result.cascade, model, structure, delay(findings))
    if findings.breakaway is None:
        return cascade, margin
    # A short record tells friction badly, and more than there is drives a weak loop over its ends.
    stiffness, inertia, ratio = result.plants[0].stiffness_n_m, analyse.moved_inertia(model), model["transmission.ratio"]
    sent, most_nm = cascade.feedforward, findings.breakaway.most_friction_nm(stiffness, inertia, ratio)
    return replace(cascade, feedforward=replace(sent, coulomb_nm=min(sent.coulomb_nm, most_nm))), margin


def close_loop(machine: Machine, findings: Findings, model: Model, cascade: Cascade, margin: float, *, ask: bool = False) -> Cascade:
    """Write a first loop into the drive and count with its stops; returns it; raises as :func:`close_first_loop`.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Of the session; filled.
    model : Model
        Of the axis.
    cascade : Cascade
        To be written.
    margin : float, deg
        Smallest phase margin on the family.
    ask : bool
        Before a loop with thin margins is closed.
    """
    machine.detail(f"first loop: Kp {cascade.kp_nm_s_rad:.4f} N m s/rad, smallest phase margin {margin:.0f} deg on an uncertain model")
    if margin < SURE_MARGIN_DEG:
        machine.talk.say(
            f"That is little, {SURE_MARGIN_DEG:.0f} deg are usual: this drive's structure gives no more. The axis may ring as it travels."
        )
        if ask and not machine.talk.confirm("Close this loop and travel with it?"):
            raise Refused("the loop was not closed, as you said; the recordings so far are kept, `beltcomm fit` makes a model of them")
    stops.count_on_loop(machine, family_around(model), machine.write_cascade(cascade), delay(findings))
    return cascade


def record_steps(machine: Machine, findings: Findings, model: Model, cascade: Cascade | None, extent: Extent) -> None:
    """Phase 5: the records of the programme, as many as the time allows.

    Parameters
    ----------
    cascade : Cascade or None
        That is in the drive, None where nobody knows it.
    """
    machine.begin(TITLES[5])
    loop = friction_feedforward.with_friction_of_strokes(machine, execute_step.Closed(model, cascade, delay(findings)))
    course = execute_step.course_of(machine, model)
    items = [
        i
        for i in record_schedule.BY_EXTENT[extent]
        if not execute_step.is_measured(machine, i.step) and (i.rank == 0 or bounds.has_room(i.step, course))
    ]
    for item in record_schedule.BY_EXTENT[extent]:
        if execute_step.is_measured(machine, item.step):
            machine.detail(f"{item.step.title(course.place_m(item.step))}: frf_1 was recorded near there, and stands for it")
    kept = VERIFYING_S
    if machine.stroking() == "velocity":  # which drifts, and does not turn within a millimetre; its last move is a slow one
        items = [item for item in items if item.step.kind != "reversals"]
        kept = DRIFTING_S
    first = [
        machine.folder.recording(n)
        for n in machine.folder.finished_names()
        if n.startswith(("amplitude_", "short_strokes_")) or n == "frf_1"
    ]
    spent = CREPT_S + findings.calibrating_s + sum(float(np.ptp(r.t_s)) for r in first)
    left = record_schedule.BUDGET_S[extent] - spent - kept
    steps, without = record_schedule.fitting_records(items, lambda step: bounds.seconds_of(step, course), left)
    if without:
        names = "; ".join(step.title(course.place_m(step)) for step in without)
        longer = "; --thorough has time for more" if extent == "standard" else ""
        findings.remarks.append(
            f"not recorded, for {record_schedule.BUDGET_S[extent]:.0f} s of machine time are not enough: {names}{longer}"
        )
    loudest = findings.excited.step.amplitude_nm if findings.excited else machine.axis.torque_limit_nm
    share = pace = 1.0
    needed = [item.step for item in items if item.rank == 0]
    for name, step in record_schedule.named_steps(steps, ("frf_1",)):
        left_out = f"{name} ({step.title(course.place_m(step))}) was left out"
        if step.kind == "response" and may_not_excite(machine):
            findings.remarks.append(f"{left_out}: the carriage went too far {MOST_STOPS} times before")
            continue
        while True:
            try:
                execute_step.make(machine, loop, step, name, loudest, share, pace)
            except SafetyStop as problem:
                if lags_behind(machine, step.kind, problem) and pace > SLOWEST_PACE:
                    pace *= SLOWER
                    findings.remarks.append(f"{name} and what follows are driven at {pace:.2g} times their speed, after this: {problem}")
                    continue  # the model does not quite know how far this machine goes: again, and all that follow, quieter
                if not bring_back(machine, model, step, problem):
                    raise
                if not may_not_excite(machine):
                    share *= QUIETER
                    findings.remarks.append(f"{name} is made with {share:.2g} times the torque, after this: {problem}")
                    continue
                findings.remarks.append(f"{left_out}: {problem}")
            except (DataError, Refused) as problem:  # the result does not rest on this record
                if step in needed and not (isinstance(problem, NoMotion) and step.kind == "response"):
                    raise
                findings.remarks.append(f"{left_out}: {problem}")
            break
        if name == execute_step.SWEEP:
            loop = friction_feedforward.with_measured_friction(machine, findings, loop)


def quick_sweep(machine: Machine, findings: Findings, model: Model) -> None:
    """The sweep of a quick commissioning, slower where the first loop lags behind it."""
    speeds = record_schedule.quick_speeds_m_s(phases.gentle_limits(machine, model, np.inf).acceleration_m_s2)
    pace = 1.0
    while True:
        try:
            asked = [pace * speed for speed in speeds]
            measure_friction(machine, model, speeds_m_s=asked, longest_s=record_schedule.QUICK_PLATEAU_S)
            return
        except SafetyStop as problem:
            if not lags_behind(machine, "sweep", problem) or pace <= SLOWEST_PACE:
                raise
            pace *= SLOWER
            findings.remarks.append(f"the sweep is driven at {pace:.2g} times its speeds, after this: {problem}")


def measure_friction(
    machine: Machine,
    model: Model,
    name: str = "sweep",
    speeds_m_s: Sequence[float] = (),
    longest_s: float = SWEEP_LONGEST_S,
    held_out: bool = False,
) -> Recording:
    """The constant-speed sweep alone, three of its speeds twice.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    model : Model
        Of the axis.
    name : str
        Of the record.
    speeds_m_s : sequence of float
        Instead of the usual seven, each once.
    longest_s : float, s
        That a plateau counts at most.
    held_out : bool
        It judges, nothing is fitted to it.
    """
    machine.begin(TITLES[5])
    if machine.folder.finished(name) is None:
        friction_feedforward.learn_friction(machine, model)
        first, last = phases.stroke_ends(machine)
        if not phases.room_to_sweep(machine, model, speeds_m_s):
            phases.move_to(machine, first, model)
        elif not first <= machine.position_m <= last:  # where a sweep before it was stopped: nothing is left there for an overshoot
            phases.move_to(machine, min(max(machine.position_m, first), last), model)
    strokes = phases.sweep(machine, model, speeds_m_s, longest_s)
    sidecar = phases.sidecar(machine, "friction_sweep", held_out=held_out, extra=own_strokes.note(machine))
    return machine.record(name, machine.follow(strokes.trajectory, machine.stroking()), phases.stroke_envelope(machine), sidecar)


def final_of(
    recordings: Sequence[Recording], axis: Axis, counts_per_rev: int, first: Model | None, progress: Callable[[float], None]
) -> FinalModel:
    """The fit that `beltcomm fit` makes of these records; begun from a first model where that is none or explains them better.

    Parameters
    ----------
    recordings : sequence of Recording
        Of the run.
    axis : Axis
        Data sheets.
    counts_per_rev : int
        Of the encoder.
    first : Model or None
        Of a part of the records.
    progress : callable
        Told the share that is done, 0 to 1.

    Returns
    -------
    FinalModel
        With its reason.

    Raises
    ------
    DataError
        When no record can be fitted.
    """
    try:
        found = final_model(recordings, axis, counts_per_rev, progress=progress)
    except DataError:
        if first is None:
            raise
        return final_model(recordings, axis, counts_per_rev, start=first)
    if first is None or not found.fit.suspect:
        return found
    try:
        other = final_model(recordings, axis, counts_per_rev, start=first)
    except DataError:
        return found
    return other if other.fit.misfit < found.fit.misfit else found


def fit_and_design(machine: Machine, findings: Findings, settings: Settings) -> Cascade:
    """Phase 6: final fit over all records, final design; returns what goes into the drive."""
    machine.begin(TITLES[6])
    recordings = machine.folder.recordings()
    counts = machine.drive.capabilities.counts_per_rev
    first = findings.final.fit.model if findings.final else None
    with machine.withdrawing():
        findings.final = final_of(recordings, machine.axis, counts, first, lambda f: machine.talk.progress(f, None))
    model = findings.final.fit.model
    stated = machine.drive.capabilities.torque_reading
    findings.remarks += stated_remarks(findings.final.fit.path, stated, machine.drive.capabilities.sample_period_s)
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    middle = sum(machine.envelope().window_m) / 2
    findings.characteristics = analyse.characteristics(findings.final.fit, middle)
    findings.sheets = sheet_doubts(model, findings.final.fit.misfit**0.5, machine.axis, recordings)
    tell_model(machine, model, middle)
    sampling_limits.note_after(findings.remarks, model, machine.axis, machine.drive.capabilities, middle)
    try:
        findings.friction = analyse.friction_of(recordings, inertia_kg_m2=analyse.moved_inertia(model))
    except DataError as problem:
        findings.remarks.append(f"friction sweep: {problem}")
        findings.reservations.append("the friction sweep could not be used")
    else:
        machine.found("friction", f"{findings.friction.coulomb.value:.3g} N m")
    findings.standstill = largest(recordings, findings.thesis, model, findings.friction)
    findings.design, findings.cascade = design_for(machine.axis, model, machine.drive.capabilities.structure, findings, settings)
    findings.reservations += thin_margins(findings.design.margins)
    return findings.cascade


def design_for(
    axis: Axis, model: Model, structure: CascadeStructure, findings: Findings, settings: Settings
) -> tuple[DesignResult, Cascade]:
    """The final design: both ends of the travel, the payload mounted now and the further ones stated.

    Parameters
    ----------
    axis : Axis
        As its file states it.
    model : Model
        Of the axis.
    structure : CascadeStructure
        Of the loops in the drive.
    findings : Findings
        Of the session; filled.
    settings : Settings
        Of the session.
    """
    assume_delay(findings, structure)
    masses = [model["cart.mass"], *(model["cart.mass"] + extra for extra in settings.payloads_kg)]
    return analyse.design(
        model,
        structure,
        positions_m=axis.travel.ends_m,
        masses_kg=masses,
        dead_time_s=delay(findings),
        apparent_damping_nm_s_rad=analyse.apparent_damping(findings.thesis),
        prefilter=settings.prefilter,
        feedforward=settings.feedforward,
        specification=settings.specification,
    )


def known_model(findings: Findings) -> Model:
    """The model so far.

    Raises
    ------
    Refused
        When nothing was fitted yet.
    """
    if findings.final is None:
        raise Refused("there is no model yet; run `beltcomm fit` first")
    return findings.final.fit.model


def commission(machine: Machine, settings: Settings, findings: Findings) -> Findings:
    """The whole job on a connected, referenced axis.  ``findings`` is filled as it goes, so an interruption loses nothing.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    settings : Settings
        Of the session.
    findings : Findings
        Of the session; filled.
    """
    machine.titles, brief = TITLES, settings.extent == "quick"
    machine.begin(TITLES[0])
    model = identify_here(machine, findings, brief=brief)
    own = findings.own_loop = machine.drive.capabilities.gains == "unknown"
    if own:
        machine.begin(TITLES[4])
        assume_delay(findings, machine.drive.capabilities.structure)
    cascade = None if own else close_first_loop(machine, findings, model, ask=settings.ask)
    travels = not own or own_loop.try_out(machine, findings, model)
    if travels:
        stop_unit.ensure(machine, model)
    else:
        stop_unit.tell_untold(machine, "the loop in the drive follows no slow strokes")
    if not travels:
        pass
    elif brief:
        quick_sweep(machine, findings, model)
    else:
        record_steps(machine, findings, model, cascade, settings.extent)
    cascade = fit_and_design(machine, findings, settings)
    machine.begin(TITLES[7])
    model = known_model(findings)
    if own:
        if travels and (driven := own_loop.verify_own(machine, findings, model, cascade, settings.move)):
            findings.verdict, findings.demand = driven
            findings.move_name = own_loop.MOVE
        return findings
    stops.count_on_loop(machine, [model], cascade, delay(findings))
    if settings.move is not None:
        trajectory = settings.move
    else:
        standard = verification.slowed_move(machine, model, cascade, delay(findings))
        if verification.uses_led_reference(machine.drive, machine.axis, cascade):
            learn_gains(machine, model, cascade, delay(findings), standard, settings.payloads_kg)
        trajectory, remark = verification.within_target(machine, model, cascade, delay(findings), standard)
        if remark:
            findings.remarks.append(remark)
        if trajectory.duration_s > standard.at(1.0, trajectory.sample_period_s).duration_s:
            findings.reservations.append("this drive cannot follow the standard move within the target, only slower ones")
    sending: Sending = "led" if verification.uses_led_reference(machine.drive, machine.axis, cascade) else "nothing"
    findings.proof = proof(cascade, trajectory, settings.payloads_kg, sending if sending == "led" else "")
    findings.move_name = name = move_name(machine.folder, findings.proof)
    findings.verdict, findings.demand = verify_move(
        machine, model, cascade, delay(findings), trajectory, name, settings.payloads_kg, sending
    )
    machine.found("following error", mm(findings.verdict.measured.dynamic_m))
    return findings


def asks(machine: Machine, settings: Settings, findings: Findings) -> bool:
    """True if a person decides about the gains: they are good, nothing was said of them, and this drive keeps what is written.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    settings : Settings
        Of the session.
    findings : Findings
        Of the session; filled.
    """
    lasting = not Hardware.of("", machine.drive.capabilities).virtual
    return settings.apply is None and settings.ask and findings.meets_targets and lasting and not findings.own_loop


def dispose(machine: Machine, settings: Settings, findings: Findings) -> None:
    """Phase 8: keep, restore or save the gains that were proven; asked for where nothing was said and a drive keeps them.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    settings : Settings
        Of the session.
    findings : Findings
        Of the session; filled.
    """
    wanted: Apply = settings.apply or "restore"
    if asks(machine, settings, findings):
        keys = {"k": tr("keep until power-off"), "s": tr("save for good"), "r": tr("restore old gains")}
        chosen = choose(machine.talk, "Keep the new gains in the drive until power-off?", keys)
        wanted = "keep" if chosen == "k" else "save" if chosen == "s" else "restore"
    if wanted in ("keep", "save") and not findings.meets_targets:
        missed = findings.verdict is None or not findings.verdict.passed
        why = "the verification missed its target" if missed else "; ".join(findings.reservations)
        findings.remarks.append(
            f"the new gains were not kept, because {why or 'the model does not explain the measurements'}; "
            "`beltcomm apply --force` writes them all the same"
        )
        wanted = "restore"
    findings.applied = wanted
    machine.keep_gains = wanted in ("keep", "save")
    if wanted == "save":
        assert findings.cascade is not None
        machine.write_cascade(findings.cascade)
        machine.drive.save()
