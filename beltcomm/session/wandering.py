"""A carriage that wanders out of the window of an open-loop record: it was stopped, and whether the session may go on."""

from __future__ import annotations

from beltcomm.errors import BeltcommError, SafetyStop
from beltcomm.session.machine import Machine

#: s of looking whether the carriage stands, and m it may move then.
LOOK_S, STANDS_M = 0.2, 5e-5


def stands_after(machine: Machine, problem: BeltcommError) -> bool:
    """Whether a record was stopped because the carriage went too far, and it stands inside the travel now.

    Torque and speed beyond their limits would come again, and a key that was let go is a will: for those the answer is no.
    """
    if not isinstance(problem, SafetyStop) or problem.reason != "position":
        return False
    low, high = machine.full_room().window_m
    before = machine.position_m
    machine.drive.clock.sleep_until(machine.drive.clock.now() + LOOK_S)
    at = machine.position_m
    if abs(at - before) > STANDS_M or not low < at < high:
        return False
    machine.folder.journal(f"safety stop (position): {problem}; the carriage stands at {at:.4f} m")
    return True
