"""The wire between host and nodes when it is not a good one: :class:`beltcomm.virtual.faults.BusFaults`, carried out."""

from __future__ import annotations

from typing import Generic, Literal, TypeVar

import can
import numpy as np

from beltcomm.virtual.faults import BusFaults, FrameFault, HostDied, kind_of

Direction = Literal["to node", "to host"]
Cargo = TypeVar("Cargo")


class TimedLine(Generic[Cargo]):
    """Takes frames in and gives them out, when it does.   Cargo : what the bus calls a frame; the line does not look inside.

    Parameters
    ----------
    ticks_per_second : int
        Of virtual time.
    """

    def __init__(self, faults: BusFaults, ticks_per_second: int) -> None:
        self.faults = faults
        self._per_second = ticks_per_second
        self._generator = np.random.default_rng(faults.seed)
        self._seen: dict[int, int] = {}
        self._late: list[tuple[int, Direction, Cargo]] = []
        self._waiting: dict[Direction, list[Cargo]] = {"to node": [], "to host": []}

    def alive(self, tick: int) -> None:
        """The host does something.   Raises HostDied once it is dead."""
        dies_at_s = self.faults.host_dies_at_s
        if dies_at_s is not None and tick / self._per_second >= dies_at_s:
            raise HostDied

    def interface(self, tick: int) -> None:
        """It uses its interface.   Raises can.CanOperationError while that is off too."""
        self.alive(tick)
        faults, now_s = self.faults, tick / self._per_second
        if _during(now_s, faults.off_from_s, faults.off_until_s):
            raise can.CanOperationError("the controller is in the state bus-off")

    def ahead_s(self, tick: int, stamps: bool = False) -> float:
        """Lead of the host's clock, or of the one of the ``stamps``, over virtual time, s."""
        faults = self.faults
        if faults.clock_jump_at_s is None or tick / self._per_second < faults.clock_jump_at_s:
            return 0.0
        return faults.clock_jump_s if stamps or not faults.stamps_only else 0.0

    def carry(self, direction: Direction, identifier: int, cargo: Cargo, tick: int) -> list[Cargo]:
        """Put a frame in; returns the frames that arrive now."""
        faults, now_s = self.faults, tick / self._per_second
        if _during(now_s, faults.off_from_s, faults.off_until_s) or _during(now_s, faults.silent_from_s, faults.silent_until_s):
            return []
        fault = next((f for n, f in enumerate(faults.frames) if self._takes(n, f, direction, identifier, now_s)), None)
        what = fault.what if fault is not None else None
        if fault is not None and what == "late":
            self._late.append((tick + max(1, round(fault.delay_s * self._per_second)), direction, cargo))
        if what in ("lost", "late"):
            return []
        if what == "swapped":
            self._waiting[direction].append(cargo)
            return []
        passed, self._waiting[direction] = self._waiting[direction], []
        return [cargo, *([cargo] if what == "doubled" else []), *passed]

    def due(self, tick: int) -> list[tuple[Direction, Cargo]]:
        """The frames that were held back until now."""
        if not self._late:
            return []
        now = [(direction, cargo) for when, direction, cargo in self._late if when <= tick]
        self._late = [item for item in self._late if item[0] > tick]
        return now

    def _takes(self, number: int, fault: FrameFault, direction: Direction, identifier: int, now_s: float) -> bool:
        if fault.direction not in ("both", direction) or not fault.from_s <= now_s < fault.until_s:
            return False
        if kind_of(identifier) not in fault.kinds:
            return False
        self._seen[number] = seen = self._seen.get(number, 0) + 1
        return seen in fault.numbers or (fault.rate > 0.0 and self._generator.random() < fault.rate)


def _during(now_s: float, from_s: float | None, until_s: float) -> bool:
    return from_s is not None and from_s <= now_s < until_s
