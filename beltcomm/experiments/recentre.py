"""A carriage that wandered out of the window of an open-loop record and was stopped: whether the session goes on, and its way back.

All such stops of a session count together, wherever they come.
"""

from __future__ import annotations

from beltcomm.errors import BeltcommError, SafetyStop
from beltcomm.experiments import phases
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.schedule.steps import Step

#: Stops after which a session excites no more: a third one, with less torque each time, is no accident.
MOST_STOPS = 3
#: Share of the torque with which a record is made again after the carriage went too far.
QUIETER = 0.7
#: s of looking whether the carriage stands, m it may move then, and how often that is looked at: a weak loop settles slowly.
LOOK_S, STANDS_M, LOOKS = 0.2, 5e-5, 5
#: m/s of bringing the carriage back.
BACK_M_S = 0.05


def may_not_excite(machine: Machine) -> bool:
    """True if stops have used up what the session goes on after: then no further open-loop record is begun.

    Parameters
    ----------
    machine : Machine
    """
    return machine.wanderings >= MOST_STOPS


def stands_after(machine: Machine, problem: BeltcommError) -> bool:
    """True if a record was stopped because the carriage went too far, and it stands inside the travel now; such a stop is counted.

    Torque and speed beyond their limits would come again, and a key that was let go is a will: for those the answer is no.

    Parameters
    ----------
    machine : Machine
    problem : BeltcommError
        That ended the record.
    """
    if not isinstance(problem, SafetyStop) or problem.reason != "position":
        return False
    if not stands(machine):
        return False
    machine.wanderings += 1
    machine.folder.journal(f"safety stop (position): {problem}; the carriage stands at {machine.position_m:.4f} m")
    machine.talk.say(f"The carriage went too far: stop {machine.wanderings} of {MOST_STOPS}, after which it is excited no more.")
    return True


def stands(machine: Machine) -> bool:
    """True if the carriage stands still inside the travel.

    Parameters
    ----------
    machine : Machine
    """
    low, high = machine.envelope().window_m
    at = machine.position_m
    for _ in range(LOOKS):
        before = at
        machine.drive.clock.sleep_until(machine.drive.clock.now() + LOOK_S)
        at = machine.position_m
        if abs(at - before) <= STANDS_M:
            return low < at < high
    return False


def lags_behind(machine: Machine, kind: str, problem: SafetyStop) -> bool:
    """True if a path left behind or overshot a first loop, too weak for what its feedforward does not know yet; the axis stands then.

    Parameters
    ----------
    machine : Machine
    kind : str
        Of the step.
    problem : SafetyStop
        That ended it.
    """
    return kind != "response" and problem.reason in ("lag", "position") and stands(machine)


def bring_back(machine: Machine, model: Model, step: Step, problem: SafetyStop) -> bool:
    """True if the session goes on after the stop of an open-loop step; then the carriage is at its place again.

    Raises what bringing the carriage back raises.

    Parameters
    ----------
    machine : Machine
    model : Model
        Of the loop in the drive.
    step : Step
        That was stopped.
    problem : SafetyStop
        That stopped it.
    """
    if step.kind != "response" or not stands_after(machine, problem):
        return False
    first, last = phases.stroke_ends(machine)
    phases.move_to(machine, min(max(step.at_m(machine.envelope().window_m), first), last), model, BACK_M_S)
    return True
