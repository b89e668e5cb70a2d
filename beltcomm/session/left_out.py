"""Which failures of a further record a commissioning survives, and how the carriage is brought back after one."""

from __future__ import annotations

from beltcomm.errors import BeltcommError, DataError, Refused, SafetyStop
from beltcomm.model import Model
from beltcomm.session import phases
from beltcomm.session.machine import Machine
from beltcomm.session.steps import Step

#: Safety stops that one session goes on after: a second one is no accident.
MOST_STOPS = 1
#: s of looking whether the carriage stands, m it may move then, and m/s of bringing it back.
LOOK_S, STANDS_M, BACK_M_S = 0.2, 5e-5, 0.05


class LeftOut:
    """What may be left out of a session.   machine, model : of the session, with a loop in the drive."""

    def __init__(self, machine: Machine, model: Model) -> None:
        self._machine, self._model = machine, model
        self._stops = 0

    def admits(self, step: Step, problem: BeltcommError) -> bool:
        """Whether the session goes on without a step that failed like this; after a stop the carriage is at its place again.

        Records that could not be used, or were refused before they moved; of safety stops only the first one of an open-loop record whose
        carriage drifted too far, when it stands inside its travel.  Torque and speed beyond their limits would come again, and a key that
        was let go is a will.  Raises what bringing the carriage back raises.
        """
        if isinstance(problem, (DataError, Refused)):
            return True
        drifted = isinstance(problem, SafetyStop) and problem.reason == "position" and step.kind == "response"
        if not drifted or self._stops >= MOST_STOPS:
            return False
        self._stops += 1
        machine = self._machine
        low, high = machine.full_room().window_m
        before = machine.position_m
        machine.drive.clock.sleep_until(machine.drive.clock.now() + LOOK_S)
        at = machine.position_m
        if abs(at - before) > STANDS_M or not low < at < high:
            return False
        machine.folder.journal(f"safety stop (position): {problem}; the carriage stands at {at:.4f} m and is brought back")
        target = min(max(low + step.place * (high - low), phases.stroke_ends(machine)[0]), phases.stroke_ends(machine)[1])
        phases.move_to(machine, target, self._model, BACK_M_S)
        return True
