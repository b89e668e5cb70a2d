"""The whole sequence: connect, check, excite, close a cautious loop, measure, fit, design, verify, keep or restore.

Where nobody can write the drive's gains, the loop that a person has set in it carries the records and the last move.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from beltcomm.axis import Axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.specification import Infeasible
from beltcomm.errors import DamagedRecord, DataError, NoMotion, Refused, SafetyStop
from beltcomm.experiments import (
    execute_step,
    gain_steps,
    holding,
    own_loop,
    payload_mode_in_first_fit,
    phases,
    raising,
    sameness,
    sampling_limits,
    stop_unit,
    verification,
)
from beltcomm.experiments.proving import learn_gains, verify_move
from beltcomm.experiments.recentre import QUIETER, may_not_excite, stands_after
from beltcomm.experiments.recording_steps import quick_sweep, record_steps
from beltcomm.fit.torque.acting_torque import acting_recording, stated_remarks
from beltcomm.identify.amplitude import AmplitudeStep, family_around, half_friction, unknown_masses_kg
from beltcomm.identify.final import FinalModel, begun_best, few_values, final_model, from_records_alone, with_late_torque
from beltcomm.identify.standstill import largest
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.language import tr
from beltcomm.machine import scale, stops
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.quantities import mm, read_in, three_digits
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import assume_delay, delay, measure_delay_and_damping
from beltcomm.rundata.findings import Apply as Apply
from beltcomm.rundata.findings import Findings as Findings
from beltcomm.rundata.findings import Settings as Settings
from beltcomm.rundata.interval_margins import KEPT, final_plants, first_loop_over_intervals, over_intervals, plants_that_lack
from beltcomm.rundata.proof import SURE_MARGIN_DEG, move_name, proof, thin_margins
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.record_schedule import TITLES as TITLES
from beltcomm.schedule.steps import SHORT_S
from beltcomm.sending import Sending
from beltcomm.simulate.stopping import total_friction
from beltcomm.talk import choose

#: Times the torque of breaking away, below which an excitation tells nothing.
MOVES_AT = 1.2


def identify_here(machine: Machine, findings: Findings, *, brief: bool = False) -> Model:
    """Phases 1 to 3: sign, rising excitation, one open-loop frequency response at the present place; returns a first model.

    Parameters
    ----------
    machine : Machine
    findings : Findings
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
    machine.found("breakaway", _friction_words(machine.axis, findings.breakaway.coulomb_nm))
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
    _first_response(machine, findings, "frf_1", short_s)
    try:
        model = _first_model(machine, findings)
    except DataError as few:
        if isinstance(few, DamagedRecord) or may_not_excite(machine):
            raise
        findings.remarks.append(f"frf_1 alone does not do, another response is made beside it: {few}")
        _first_response(machine, findings, "frf_1_more", execute_step.RESPONSE_S)
        model = _first_model(machine, findings)
    scale.check_fitted(machine, model, findings.excited.model, acting_recording(machine.folder.recording("frf_1"), findings.path))
    return model


def try_stop_here(machine: Machine, model: Model) -> None:
    """After an identification, where no louder record follows: show by a slow stop what its deceleration counts in, if it was not shown.

    Parameters
    ----------
    machine : Machine
    model : Model

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


def _first_response(machine: Machine, findings: Findings, name: str, seconds: float) -> None:
    """A frequency response at the present place; where the carriage wanders too far again where it then stands, shorter and quieter.

    Then no response after it is louder, either.   One that does not move the axis is made louder.   Raises SafetyStop when stops have used
    up what the session goes on after, NoMotion when no torque allowed moves the axis.
    """
    excited = findings.excited
    assert excited is not None
    above_nm, model = 0.0, excited.model
    while True:
        # A carriage that went too far is not held by friction: no sequence is tried that is louder for leaving out the resonance.
        chosen = partial(phases.response_to_come, machine, model, excited.at_most_nm, loud=not machine.wanderings)
        choice, step = execute_step.short_if_possible(chosen, seconds)
        phases.louder(machine, step, above_nm)
        try:
            phases.planned_response(machine, name, model, choice, step)
            return
        except SafetyStop as problem:
            if not stands_after(machine, problem) or may_not_excite(machine):
                raise
            moves_nm = MOVES_AT * findings.breakaway.coulomb_nm if findings.breakaway else 0.0
            most_nm = max(QUIETER * step.amplitude_nm, min(step.amplitude_nm, moves_nm))
            seconds = min(seconds, SHORT_S)  # how far it wanders grows with the time
            model = half_friction(model)  # which a first record told too high
            excited = findings.excited = replace(excited, step=replace(step, amplitude_nm=most_nm), at_most_nm=most_nm)
            findings.remarks.append(f"{name} is made with at most ±{most_nm:.3f} N m, after this: {problem}")
        except NoMotion:
            above_nm = step.amplitude_nm
            if not machine.wanderings:
                excited = replace(excited, at_most_nm=raising.GROWTH * above_nm)


def _first_model(machine: Machine, findings: Findings) -> Model:
    """Model, dead time and apparent damping from the frequency response at one place."""
    recordings = [r for r in machine.folder.recordings() if r.sidecar.experiment == "frf"]
    counts = machine.drive.capabilities.counts_per_rev
    start = findings.excited.model if findings.excited else None
    with machine.withdrawing():
        try:
            found = final_model(recordings, machine.axis, counts, start=start)
        except DataError:
            found = _begun_anew(machine, recordings)  # behind a coarse encoder an estimate may leave no sample that counts
        if found.fit.suspect:
            found = with_late_torque(found, recordings, machine.axis, counts)
        if start is not None:
            found = from_records_alone(found, recordings, machine.axis, counts)
        findings.final = found
        findings.swing = payload_mode_in_first_fit.with_swing(found, recordings, machine.axis, counts) if found.fit.suspect else None
    model = found.fit.model
    if findings.swing is not None:
        model = payload_mode_in_first_fit.as_one(findings.swing)
        findings.remarks.append(payload_mode_in_first_fit.swing_words(findings.swing))
    sampling_limits.note_after(findings.remarks, model, machine.axis, machine.drive.capabilities, machine.position_m)
    _tell_model(machine, model, machine.position_m)
    measure_delay_and_damping(findings, recordings, model)
    return model


def _begun_anew(machine: Machine, recordings: Sequence[Recording]) -> FinalModel:
    try:
        return final_model(recordings, machine.axis, machine.drive.capabilities.counts_per_rev)
    except DataError as few:
        coarse = sampling_limits.coarse_words(machine.axis, machine.drive.capabilities, recordings[-1])
        if isinstance(few, DamagedRecord) or not coarse:
            raise
        raise DataError(f"{few}. {coarse}") from None


def _friction_words(axis: Axis, torque_nm: float) -> str:
    """Friction at the motor as its tables have it, and as the force that the verdict has, where both are not one number."""
    factor, unit = read_in("N m")
    ratio = axis.known_transmission_m_rad if axis.kind not in ("rotary", "linear") and axis.has_transmission else None
    return f"{three_digits(factor * torque_nm)} {unit}" + (f" ({three_digits(torque_nm / ratio)} N)" if ratio else "")


def _tell_model(machine: Machine, model: Model, at_m: float) -> None:
    """Tell the axis as the model knows it so far, with its resonance at ``at_m``."""
    machine.found("mass", f"{model['cart.mass']:.3g} kg")
    resonance = analyse.characteristic_hz(model, at_m)[1]
    if np.isfinite(resonance):
        machine.found("resonance", f"{resonance:.3g} Hz")


def close_first_loop(machine: Machine, findings: Findings, model: Model, *, ask: bool = False) -> Cascade:
    """Phase 4: a cautious loop for the uncertain first model, written into the drive.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
    ask : bool
        Before a loop with thin margins is closed.

    Raises
    ------
    Refused
        For a no.
    """
    machine.begin(TITLES[4])
    return close_loop(machine, findings, model, *first_cascade(machine, findings, model, machine.position_m), ask=ask)


def closed_for(machine: Machine, findings: Findings, model: Model, *, ask: bool) -> None:
    """A loop for strokes: a first one, or where nobody can write the gains the one that stands in the drive.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
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
    findings : Findings
    model : Model
    at_m : float, m
        Of the carriage.
    """
    if findings.final is not None and few_values(findings.final.fit):
        response, fit = machine.folder.recording("frf_1"), findings.final.fit
        if coarse := sampling_limits.coarse_words(machine.axis, machine.drive.capabilities, response):
            raise DataError(
                f"{response.name} has {fit.samples} values that count for {len(fit.free)} parameters: no loop is closed. {coarse}"
            )
    structure = machine.drive.capabilities.structure
    assume_delay(findings, structure)
    seen = at_m, delay(findings), analyse.apparent_damping(findings.thesis)
    result = first_loop_over_intervals(model, structure, *seen, machine.folder)
    margin = min(m.phase_margin_deg for m in result.margins)
    if findings.swing is not None:
        margin = min(margin, payload_mode_in_first_fit.proven_margin_deg(findings.swing, result.cascade, structure, *seen))
    cascade = analyse.with_feedforward(result.cascade, model, structure, delay(findings))
    # A short record tells friction badly, and more than there is drives a weak loop over its ends.
    sent, most_nm = cascade.feedforward, math.inf
    if findings.breakaway is not None:
        stiffness, inertia, ratio = result.plants[0].stiffness_n_m, result.plants[0].inertia_kg_m2, model["transmission.ratio"]
        most_nm = findings.breakaway.most_friction_nm(stiffness, inertia, ratio)
    viscous = min(sent.viscous_nm_s_rad, analyse.sure_viscous(model))
    return replace(cascade, feedforward=replace(sent, coulomb_nm=min(sent.coulomb_nm, most_nm), viscous_nm_s_rad=viscous)), margin


def close_loop(machine: Machine, findings: Findings, model: Model, cascade: Cascade, margin: float, *, ask: bool = False) -> Cascade:
    """Write a first loop into the drive and count with its stops.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
    cascade : Cascade
        To be written.
    margin : float, deg
        Smallest phase margin on the family.
    ask : bool
        Before a loop with thin margins is closed.

    Raises
    ------
    Refused
        For a no; else as :func:`close_first_loop`.
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


def _fit_and_design(machine: Machine, findings: Findings, settings: Settings) -> Cascade:
    """Phase 6: final fit over all records, final design; returns what goes into the drive."""
    machine.begin(TITLES[6])
    recordings = machine.folder.recordings()
    counts = machine.drive.capabilities.counts_per_rev
    first = findings.final.fit.model if findings.final else None
    with machine.withdrawing():
        findings.final = begun_best(recordings, machine.axis, counts, first, lambda f: machine.talk.progress(f, None))
    model = findings.final.fit.model
    stated = machine.drive.capabilities.torque_reading
    findings.remarks += stated_remarks(findings.final.fit.path, stated, machine.drive.capabilities.sample_period_s)
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    middle = sum(machine.envelope().window_m) / 2
    findings.characteristics = analyse.characteristics(findings.final.fit, middle)
    findings.sheets = sheet_doubts(model, findings.final.fit.misfit**0.5, machine.axis, recordings)
    _tell_model(machine, model, middle)
    sampling_limits.note_after(findings.remarks, model, machine.axis, machine.drive.capabilities, middle)
    try:
        findings.friction = analyse.friction_of(recordings, inertia_kg_m2=analyse.moved_inertia(model))
    except DataError as problem:
        findings.remarks.append(f"friction sweep: {problem}")
        findings.reservations.append("the friction sweep could not be used")
    else:
        machine.found("friction", f"{three_digits(total_friction(model) / model['transmission.ratio'])} N")  # as the verdict has it
    findings.standstill = largest(recordings, findings.thesis, model, findings.friction)
    designed, cascade = design_for(machine.axis, model, machine.drive.capabilities.structure, findings, settings, machine.folder)

    plants = final_plants(machine.axis.travel.ends_m, settings.payloads_kg, delay(findings), analyse.apparent_damping(findings.thesis))
    if short := over_intervals("the final design", designed, model, plants, machine.folder):
        if not findings.own_loop:  # gains that only a person types in are told with what speaks against them
            raise Refused(f"{short}. {KEPT}")
        findings.remarks.append(short)
        findings.reservations.append("these gains do not hold over what is known of the axis")
    findings.design, findings.cascade = designed, cascade
    findings.reservations += thin_margins(designed.margins)
    return cascade


def design_for(
    axis: Axis, model: Model, structure: CascadeStructure, findings: Findings, settings: Settings, folder: RunFolder
) -> tuple[DesignResult, Cascade]:
    """The final design: both ends of the travel, the payload mounted now and the further ones stated.

    Where it does not hold over what is known of the axis, a gentler one that does, designed for the ends of the intervals, too.

    Parameters
    ----------
    axis : Axis
    model : Model
    structure : CascadeStructure
        Of the loops in the drive.
    findings : Findings
    settings : Settings
    folder : RunFolder
        With what was measured of the drive's gains.
    """
    assume_delay(findings, structure)
    apparent = analyse.apparent_damping(findings.thesis)

    def designed(besides: Sequence[DesignPlant] = ()) -> tuple[DesignResult, Cascade]:
        return analyse.design(
            model,
            structure,
            positions_m=axis.travel.ends_m,
            masses_kg=[model["cart.mass"], *(model["cart.mass"] + extra for extra in settings.payloads_kg)],
            dead_time_s=delay(findings),
            apparent_damping_nm_s_rad=apparent,
            prefilter=settings.prefilter,
            feedforward=settings.feedforward,
            specification=settings.specification,
            besides=besides,
        )

    usual, plants = designed(), final_plants(axis.travel.ends_m, settings.payloads_kg, delay(findings), apparent)
    if over_intervals("the design", usual[0], model, plants, folder):
        with suppress(Infeasible):
            gentler = designed(plants_that_lack(usual[0], model, plants))
            if not over_intervals("the design", gentler[0], model, plants, folder):
                words = "the usual gains do not hold over what is known of this axis: these hold there, too, and are gentler"
                return replace(gentler[0], remarks=(words, *gentler[0].remarks)), gentler[1]
    return usual


def _known_model(findings: Findings) -> Model:
    """The model so far; raises Refused when nothing was fitted yet."""
    if findings.final is None:
        raise Refused("there is no model yet; run `beltcomm fit` first")
    return findings.final.fit.model


def commission(machine: Machine, settings: Settings, findings: Findings) -> Findings:
    """The whole job on a connected, referenced axis.  ``findings`` is filled as it goes, so an interruption loses nothing.

    Parameters
    ----------
    machine : Machine
    settings : Settings
    findings : Findings
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
    cascade = _fit_and_design(machine, findings, settings)
    machine.begin(TITLES[7])
    model = _known_model(findings)
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
    settings : Settings
    findings : Findings
    """
    lasting = not Hardware.of("", machine.drive.capabilities).virtual
    return settings.apply is None and settings.ask and findings.meets_targets and lasting and not findings.own_loop


def dispose(machine: Machine, settings: Settings, findings: Findings) -> None:
    """Phase 8: keep, restore or save the gains that were proven; asked for where nothing was said and a drive keeps them.

    Parameters
    ----------
    machine : Machine
    settings : Settings
    findings : Findings
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
