"""Which failures of a further record a commissioning survives, and how the carriage is brought back after one."""

from __future__ import annotations

from beltcomm.errors import BeltcommError, DataError, Refused
from beltcomm.model import Model
from beltcomm.session import phases
from beltcomm.session.machine import Machine
from beltcomm.session.steps import Step
from beltcomm.session.wandering import stands_after

#: Safety stops that one session goes on after: a second one is no accident.
MOST_STOPS = 1
#: m/s of bringing the carriage back.
BACK_M_S = 0.05


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
        machine = self._machine
        if step.kind != "response" or self._stops >= MOST_STOPS or not stands_after(machine, problem):
            return False
        self._stops += 1
        low, high = machine.full_room().window_m
        target = min(max(low + step.place * (high - low), phases.stroke_ends(machine)[0]), phases.stroke_ends(machine)[1])
        phases.move_to(machine, target, self._model, BACK_M_S)
        return True
