"""Before anything moves: the plan is shown, a drive that never moved is confirmed by a person, and the question is asked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities, Drive
from beltcomm.errors import Declined, Refused, UsageError
from beltcomm.experiments import referencing
from beltcomm.experiments.first_motion import confirm_first_motion
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Plan, with_homing
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.experiments.rehearsal import Job, rehearse
from beltcomm.experiments.supervised import Supervised
from beltcomm.language import tr
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Machine
from beltcomm.machine.ratings import fault_of
from beltcomm.result import Result, plain
from beltcomm.rundata.store import PLAN
from beltcomm.talk import Silence, Talk, choose, detail

#: Before anything moves.
QUESTION = "May the axis move like this?"
#: Before the plan of a resumed run.
KEPT = "Finished records are kept; what stands below is the most that is driven again, after a check that this is still the machine. "


@dataclass(frozen=True)
class Agreement:
    """Question of a command before anything moves: call it with the plan and the machine.

    Attributes
    ----------
    job : Job
        The command once more on another drive, for ``--simulate-first``.
    goes_on : bool
        It needs what is in its run folder.
    """

    options: Options
    talk: Talk
    job: Job
    goes_on: bool = True

    def __call__(self, plan: Plan, machine: Machine) -> None:
        """Ask as :func:`agree` does."""
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
    """Say what will happen and ask, unless told not to; then let the drive home if it shall.

    The first motion of a drive that this computer has not moved so far yet is a question of its own, which ``yes`` does not answer, as
    it does not for a plan longer than ``longest_s``.

    Parameters
    ----------
    plan : Plan
        What is planned.
    options : Options
    talk : Talk
    drive : Drive
    axis : Axis
    machine, agreement
        Of a command with records, which can be played on a twin first.

    Raises
    ------
    Refused
        For a no.
    """
    if machine is not None and options.home:
        plan = with_homing(plan, axis, drive.capabilities)
    plan = _whole(plan, axis, drive.capabilities, options)
    talk.say(*plan_screen(plan, axis, drive.capabilities))
    detail(talk, "", *plan.lines())
    if machine is not None:
        machine.planned_s = plan.seconds
    if fault := plan.heat_fault(axis):
        raise Refused(f"{fault}; nothing was moved")
    if options.simulate_first and machine is not None and agreement is not None:
        rehearse(machine, options, talk, agreement.job, agreement.goes_on)
    if isinstance(drive, Supervised):
        confirm_first_motion(drive.hardware, axis, plan, options, talk, drive.capabilities.units)
    if options.yes and plan.seconds > options.longest_s:
        raise Refused(
            f"this plan moves the axis for up to {plan.seconds:.0f} s, and --yes answers for {options.longest_s:.0f} s at most; nothing "
            f"was moved. Leave --yes out and answer, ask for less, or allow it with --longest {math.ceil(plan.seconds)}s"
        )
    if not options.yes and not _asked(plan, options, talk, machine, agreement):
        raise Declined(
            "nothing was moved: the plan was to be agreed to, and nobody is there who could; give yes=True (--yes), or a talk that asks"
            if isinstance(talk, Silence)
            else "nothing was moved, as you said; --dry-run shows the plan without asking"
        )
    if isinstance(drive, Supervised):
        drive.allow_motion()
    if machine is not None:
        machine.folder.save(
            "results",
            PLAN,
            {
                "text": plan.text,
                "points": plain(plan.points),
                "experiments": plain(plan.experiments),
                "seconds": plan.seconds,
                **plan.heat_dict(),
            },
        )
        machine.folder.journal(f"agreed{' by --yes' if options.yes else ''}: {plan.summary()}")
        if options.home:
            referencing.home(machine)


def _asked(plan: Plan, options: Options, talk: Talk, machine: Machine | None, agreement: Agreement | None) -> bool:
    """True if it may begin; the details, and the plan on a twin, may be asked for before that."""
    choices = {"y": tr("start"), "d": tr("details"), "s": tr("simulate first"), "q": tr("quit")}
    if machine is None or agreement is None or options.simulate_first:
        del choices["s"]
    while True:
        chosen = choose(talk, QUESTION, choices)
        if chosen == "d":
            talk.say(*plan.lines())
            del choices["d"]
        elif chosen == "s" and machine is not None and agreement is not None:
            rehearse(machine, options, talk, agreement.job, agreement.goes_on)
            del choices["s"]
        else:
            return chosen == "y"


def plan_result(plan: Plan, capabilities: Capabilities | None = None, options: Options | None = None, axis: Axis | None = None) -> Result:
    """A plan that is only shown.

    Parameters
    ----------
    plan : Plan
        With or without what is known of the drive.
    capabilities : Capabilities or None
        Of the drive; None leaves out what depends on it.
    options : Options or None
        Window, homing and wishes of the session.
    axis : Axis or None
        As its file states it.

    Returns
    -------
    Result
        Exit code 1 for a plan that will be refused.

    Raises
    ------
    UsageError
        For a place outside the travel.
    """
    if capabilities and axis and options:
        plan = _whole(plan, axis, capabilities, options)
        _require_inside(axis, options.position_m)
        plan = with_homing(plan, axis, capabilities) if options.home else plan
    wrong = fault_of(axis, capabilities) if capabilities and axis else ""
    refused = [tr("This plan will be refused: {fault}.", fault=fault) for fault in (wrong, plan.heat_fault(axis)) if fault]
    shown = plan_screen(plan, axis, capabilities) if capabilities and axis else []
    return Result(
        {"plan": plain(plan), "seconds": plan.seconds, "visible": plan.visible, **plan.heat_dict()},
        [*(shown or plan.lines()), *refused, "", tr("Nothing was moved (--dry-run).")],
        1 if refused else 0,
        details=plan.lines() if shown else (),
    )


def _whole(plan: Plan, axis: Axis, capabilities: Capabilities, options: Options) -> Plan:
    """The plan with what motor and drive bear, and what is said of a resumed run."""
    plan = plan if plan.thermal else replace(plan, thermal=Thermal.of(axis, capabilities))
    return replace(plan, text=KEPT + plan.text, bare=False) if options.resume else plan


def _require_inside(axis: Axis, position_m: float | None) -> None:
    """Refuse a stated position outside the travel."""
    low, high = axis.travel.ends_m
    if position_m is not None and not low <= position_m <= high:
        raise UsageError(f"position {position_m:.4g} m is outside the travel {low:g}..{high:g} m of axis.yaml")
