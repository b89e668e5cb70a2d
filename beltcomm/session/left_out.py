"""Which stops of a further record a commissioning survives, and how the carriage is brought back after one."""

from __future__ import annotations

from beltcomm.errors import SafetyStop
from beltcomm.model import Model
from beltcomm.session import phases
from beltcomm.session.machine import Machine
from beltcomm.session.steps import Step
from beltcomm.session.wandering import stands_after

#: Safety stops after which the first response, and later all the others together, are made again: a third one is no accident, with less
#: torque each time.
MOST_STOPS = 2
#: m/s of bringing the carriage back.
BACK_M_S = 0.05


class LeftOut:
    """What may be left out of a session.   machine, model : of the session, with a loop in the drive."""

    def __init__(self, machine: Machine, model: Model) -> None:
        self._machine, self._model = machine, model
        self._stops = 0

    @property
    def exhausted(self) -> bool:
        """Whether stops have used up what the session goes on after: then no further open-loop record is begun."""
        return self._stops > MOST_STOPS

    def admits(self, step: Step, problem: SafetyStop) -> bool:
        """Whether the session goes on after a stop like this; then the carriage is at the place of the step again.

        Of an open-loop record whose carriage went too far, ``MOST_STOPS`` times, when it stands inside its travel; once more for one that
        is left out, and then the session is ``exhausted``.   Raises what bringing the carriage back raises.
        """
        machine = self._machine
        if step.kind != "response" or self.exhausted or not stands_after(machine, problem):
            return False
        self._stops += 1
        low, high = machine.full_room().window_m
        target = min(max(low + step.place * (high - low), phases.stroke_ends(machine)[0]), phases.stroke_ends(machine)[1])
        phases.move_to(machine, target, self._model, BACK_M_S)
        return True
