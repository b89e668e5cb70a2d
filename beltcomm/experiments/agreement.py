"""Before anything moves: the plan is shown, a drive that never moved is confirmed by a person, and the question is asked."""

from __future__ import annotations

from dataclasses import dataclass, replace

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities, Drive
from beltcomm.errors import Declined, Refused
from beltcomm.experiments import referencing
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Plan, with_homing
from beltcomm.experiments.rehearsal import Job, rehearse
from beltcomm.experiments.supervised import Supervised
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Machine
from beltcomm.machine.ratings import fault_of
from beltcomm.result import Result, plain
from beltcomm.rundata.store import PLAN
from beltcomm.talk import Silence, Talk

#: Before the plan of a resumed run.
KEPT = "Finished records are kept; what stands below is the most that is driven again, after a check that this is still the machine. "


@dataclass(frozen=True)
class Agreement:
    """How a command asks before anything moves: call it with the plan and the machine.

    job : the command once more on another drive, for ``--simulate-first``.   goes_on : it needs what is in its run folder.
    """

    options: Options
    talk: Talk
    job: Job
    goes_on: bool = True

    def __call__(self, plan: Plan, machine: Machine) -> None:
        """See :func:`agree`."""
        agree(plan, self.options, self.talk, machine.drive, machine.axis, machine, self)


def agree(
    plan: Plan,
    options: Options,
    talk: Talk,
    drive: Drive,
    axis: Axis,
    machine: Machine | None = None,
    agreement: Agreement | None = None,
) -> None:
    """Say what will happen and ask, unless told not to; then let the drive home if it shall.   Raises Refused for a no.

    machine, agreement : of a command with records, which can be played on a twin first.
    The first motion of a drive that this computer has not moved yet is a question of its own, which ``yes`` does not answer.
    """
    if machine is not None and options.home:
        plan = with_homing(plan, axis, drive.capabilities)
    plan = _whole(plan, axis, drive.capabilities, options)
    talk.say(*plan.lines())
    if machine is not None:
        machine.planned_s = plan.seconds
    if fault := plan.heat_fault(axis):
        raise Refused(f"{fault}; nothing was moved")
    if options.simulate_first and machine is not None and agreement is not None:
        rehearse(machine, options, talk, agreement.job, agreement.goes_on)
    if isinstance(drive, Supervised):
        confirm_first_motion(drive.hardware, axis, options, talk)
    if not options.yes and not talk.confirm("May the axis move like this?"):
        raise Declined(
            "nothing was moved: the plan was to be agreed to, and nobody is there who could; give yes=True (--yes), or a talk that asks"
            if isinstance(talk, Silence)
            else "nothing was moved, as you said; --dry-run shows the plan without asking"
        )
    if isinstance(drive, Supervised):
        drive.allow_motion()
    if machine is not None:
        machine.folder.save_result(
            PLAN, {"text": plan.text, "points": plain(plan.points), "experiments": plain(plan.experiments), **plan.heat_dict()}
        )
        machine.folder.journal(f"agreed{' by --yes' if options.yes else ''}: {plan.summary()}")
        if options.home:
            referencing.home(machine)


def confirm_first_motion(hardware: Hardware, axis: Axis, options: Options, talk: Talk) -> None:
    """Ask a person, or take ``options.first_motion``, where this computer has never moved this drive on this axis.

    A virtual drive moves nothing.  A drive without a serial number is never known: another one of its kind may hang there today.
    Raises Refused for a no, for another drive than the one confirmed, and where there is nobody to ask.
    """
    if hardware.virtual:
        return
    if options.first_motion is not None and not hardware.named_by(options.first_motion):
        raise Refused(
            f"--first-motion-confirmed names {options.first_motion}, but this is {hardware.words}; nothing was moved. Look at the cabling, "
            f"or confirm this drive with --first-motion-confirmed {hardware.confirmation!r}"
        )
    known = hardware.remembered() if hardware.unique else {}
    if known.get("moved") and known.get("axis") == axis.name:
        return
    what = f"{hardware.words} (on {hardware.name}) was never moved by beltcomm on this computer"
    if known.get("moved"):
        what = f"{hardware.words} was moved on the axis {known.get('axis') or 'without a name'} before, not on {axis.name or 'this one'}"
    elif not hardware.unique:
        what = f"{hardware.words} (on {hardware.name}) tells no serial number, so nobody knows whether beltcomm has moved it before"
    if options.first_motion is not None:
        talk.say(f"{what}; its first motion was confirmed by --first-motion-confirmed.")
    elif not talk.attended():
        raise Refused(
            f"{what}, and --yes does not answer for its first motion: somebody must stand beside it. Call this in a terminal and answer, "
            f"or add --first-motion-confirmed {hardware.confirmation!r} when a person has made sure of it; nothing was moved"
        )
    else:
        travel = f" of {axis.travel.min_m:g} to {axis.travel.max_m:g} m" if axis.travel.min_m is not None else ""
        talk.say(
            f"{what}. Before it moves for the first time: the emergency stop is in your hand and was tried; nobody and nothing is in the "
            f"travel{travel}; the carriage stands where the plan says; "
            "end switches or stops are fitted. Which way is plus, and how far the carriage goes for one turn, no sensor tells: watch its "
            "first creep."
        )
        if not talk.confirm("Is all of this so, and may it move for the first time?"):
            raise Declined("nothing was moved, as you said")
    if hardware.unique:
        hardware.remember(axis=axis.name, moved=False)


def planned(plan: Plan, capabilities: Capabilities | None = None, options: Options | None = None, axis: Axis | None = None) -> Result:
    """A plan that is only shown."""
    if capabilities and axis and options:
        plan = _whole(plan, axis, capabilities, options)
        referencing.inside(axis, options.position_m)
        plan = with_homing(plan, axis, capabilities) if options.home else plan
    wrong = fault_of(axis, capabilities) if capabilities and axis else ""
    refused = [f"This plan will be refused: {fault}." for fault in (wrong, plan.heat_fault(axis)) if fault]
    return Result(
        {"plan": plain(plan), "seconds": plan.seconds, "visible": plan.visible, **plan.heat_dict()},
        [*plan.lines(), *refused, "Nothing was moved (--dry-run)."],
        1 if refused else 0,
    )


def _whole(plan: Plan, axis: Axis, capabilities: Capabilities, options: Options) -> Plan:
    """The plan with what motor and drive bear, and what is said of a resumed run."""
    plan = plan if plan.thermal else replace(plan, thermal=Thermal.of(axis, capabilities))
    return replace(plan, text=KEPT + plan.text) if options.resume else plan
