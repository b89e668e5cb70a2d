"""A CAN bus in lock-step: virtual time, no threads, the same frames in every run.

Order inside the tick that begins at t_k = k · T (1 ms, or the cycle of the drive that is played):

1. every node's ``begin_tick``: it latches its samples, supervises itself and sends what its own clock makes due;
2. the host's frames of this instant, each answered before ``send`` returns;
3. when time moves on, every node's ``finish_tick``: its loops decide, and its machine moves to t_k+1.

So the loops of tick k use what the SYNC at t_k has activated.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, Literal, Protocol, TypeVar

import can
import numpy as np

from beltcomm.virtual.faults import BusFaults, FrameFault, HostDied, kind_of

#: Ticks of virtual time per second where nothing else is asked for.
TICKS_PER_SECOND = 1000

# A time that was computed as 0.1 + 0.003 lies a few ulp beside the tick it means.
_ROUNDING_TICKS = 1e-6

#: Virtual time in s, arbitration ID, data, "host" or "node"; a remote frame is ``(t, id, b"", "host rtr")``.
Frame = tuple[float, int, bytes, str]
Direction = Literal["to node", "to host"]
Cargo = TypeVar("Cargo")


class WallClock(Protocol):
    """Real time, passed in; see :class:`beltcomm.drive.Clock`."""

    def now(self) -> float:
        """Seconds on a clock that never goes back."""
        ...

    def sleep_until(self, t_s: float) -> None:
        """Return when ``now() >= t_s``."""
        ...


class Node(Protocol):
    """Interface of a node attached to the bus."""

    def receive(self, identifier: int, data: bytes, remote: bool) -> None:
        """Take one frame with an 11-bit identifier; answers go out by :meth:`LockstepBus.transmit`.

        Parameters
        ----------
        identifier : int
        data : bytes
        remote : bool
            A remote frame, which has no data.
        """
        ...

    def begin_tick(self, tick: int) -> None:
        """Virtual time has become so many ticks of the bus."""
        ...

    def finish_tick(self) -> None:
        """Virtual time is about to leave the present tick."""
        ...


class VirtualClock:
    """The clock of a :class:`LockstepBus`: waiting on it lets the nodes run."""

    def __init__(self, bus: LockstepBus) -> None:
        self._bus = bus
        self._per_second = bus.ticks_per_second
        self._asked_for_s = self._plain_s = 0.0
        self._asked_tick = 0

    def now(self) -> float:
        """Virtual time in s, a whole number of ticks (up to the rounding of the time last slept to), as the host's clock shows it."""
        tick, line = self._bus.tick, self._bus.line
        if line is None:
            return self._plain_s if tick == self._asked_tick else tick / self._per_second
        now_s = tick / self._per_second + line.ahead_s(tick)
        return self._asked_for_s if tick == self._asked_tick and self._asked_for_s > now_s else now_s

    def sleep_until(self, t_s: float) -> None:
        """Run the nodes up to the first whole tick at or after ``t_s``."""
        bus, line = self._bus, self._bus.line
        if line is not None:  # whose clock may jump while somebody sleeps
            line.alive(bus.tick)
            while bus.tick < self._last_tick(t_s - line.ahead_s(bus.tick)):
                bus.advance()
                line.alive(bus.tick)
            last = self._last_tick(t_s - line.ahead_s(bus.tick))
        else:
            last = self._last_tick(t_s)
            while bus.tick < last:
                bus.advance()
        if bus.tick == last:  # so that ``now() >= t_s`` holds when t_s is an ulp above its tick
            self._asked_for_s, self._asked_tick = t_s, last
            self._plain_s = max(t_s, last / self._per_second)

    def _last_tick(self, t_s: float) -> int:
        return math.ceil(t_s * self._per_second - _ROUNDING_TICKS)


class DataFrame(can.Message):
    """A frame that a node has sent: what ``can.Message`` makes of it, in half the time, for nothing is left to be found out."""

    __slots__ = ()

    def __init__(self, timestamp: float, arbitration_id: int, data: bytes) -> None:
        self.timestamp, self.arbitration_id = timestamp, arbitration_id
        self.data, self.dlc = bytearray(data), len(data)
        self.is_extended_id = self.is_remote_frame = self.is_error_frame = self.is_fd = False
        self.bitrate_switch = self.error_state_indicator = False
        self.is_rx, self.channel = True, None


class LockstepBus(can.BusABC):
    """The host's end of a virtual CAN bus with any number of nodes.

    ``send`` reaches every node before it returns; what nodes send is queued for ``recv``, stamped with virtual time. Virtual time moves
    only inside ``clock.sleep_until`` and inside ``recv`` on an empty queue, in whole ticks.

    Parameters
    ----------
    wall_clock : WallClock or None
        Paces the ticks in real time; None runs as fast as it can. missed_cycles : ticks that the wall clock had already left when they
        were due; they are dropped from the schedule, not caught up in a burst. on_frame : called with every :data:`Frame` on the bus,
        e.g. ``list.append``.
    faults : BusFaults or None
        What is wrong with the wire or the host; None is a good one. line : the wire that carries them out.
    ticks_per_second : int
        One over the cycle of the drive's loops. tick_s : that cycle.
    """

    def __init__(
        self, wall_clock: WallClock | None = None, faults: BusFaults | None = None, ticks_per_second: int = TICKS_PER_SECOND
    ) -> None:
        super().__init__(channel="virtual")
        self.ticks_per_second, self.tick_s = ticks_per_second, 1.0 / ticks_per_second
        self.channel_info = "beltcomm virtual bus"
        self.clock = VirtualClock(self)
        self.tick = 0
        self.missed_cycles = 0
        self.on_frame: Callable[[Frame], object] | None = None
        self.line: TimedLine[tuple[int, bytes, bool]] | None = None if faults is None else TimedLine(faults, ticks_per_second)
        self._nodes: list[Node] = []
        self._queue: deque[tuple[float, int, bytes]] = deque()
        self._wall_clock = wall_clock
        self._wall_start_s = wall_clock.now() if wall_clock else 0.0

    def attach(self, node: Node) -> None:
        """Connect a node; it starts at the present tick."""
        self._nodes.append(node)
        node.begin_tick(self.tick)

    def advance(self) -> None:
        """Let virtual time move on by one tick."""
        for node in self._nodes:
            node.finish_tick()
        self.tick += 1
        if self._wall_clock is not None:
            self._pace(self._wall_clock)
        for node in self._nodes:
            node.begin_tick(self.tick)
        if self.line is not None:
            for direction, cargo in self.line.due(self.tick):
                self._to_nodes(*cargo) if direction == "to node" else self._to_host(*cargo)

    def transmit(self, sender: Node, identifier: int, data: bytes) -> None:
        """Put a node's frame on the bus: to the other nodes at once, to the host through its queue."""
        now_s = self.tick / self.ticks_per_second
        if self.on_frame is not None:
            self.on_frame((now_s, identifier, data, "node"))
        if self.line is None:
            self._queue.append((now_s, identifier, data))
        else:
            for cargo in self.line.carry("to host", identifier, (identifier, data, False), self.tick):
                self._to_host(*cargo)
        for node in self._nodes:
            if node is not sender:
                node.receive(identifier, data, False)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Deliver ``msg`` to every node; their answers are queued when this returns.

        Raises can.CanOperationError after ``shutdown`` and in bus-off.
        """
        if self.line is not None:
            self.line.interface(self.tick)
        if self._is_shutdown:
            raise can.CanOperationError("the virtual bus is shut down; open a new one")
        data = bytes(msg.data)
        remote = msg.is_remote_frame
        if self.on_frame is not None:
            source = "host rtr" if remote else "host"
            self.on_frame((self.tick / self.ticks_per_second, msg.arbitration_id, data, source))
        if msg.is_extended_id or msg.is_error_frame or msg.is_fd:
            return  # CANopen nodes listen to classic base frames only
        if self.line is None:
            for node in self._nodes:
                node.receive(msg.arbitration_id, data, remote)
        else:
            for cargo in self.line.carry("to node", msg.arbitration_id, (msg.arbitration_id, data, remote), self.tick):
                self._to_nodes(*cargo)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame a node has sent; None when virtual time has run ``timeout`` seconds without one.

        With ``timeout=None`` virtual time runs on until a frame comes, however long that is.   Raises can.CanOperationError in bus-off.
        """
        queue = self._queue
        last: float | None = None
        while True:
            if self.line is not None:
                self.line.interface(self.tick)
            while queue:
                message = DataFrame(*queue.popleft())
                if self._filters is None or self._matches_filters(message):
                    return message
            if timeout == 0.0:
                return None
            if last is None:
                last = math.inf if timeout is None else self.tick + math.ceil(timeout * self.ticks_per_second - _ROUNDING_TICKS)
            if self.tick >= last:
                return None
            self.advance()

    def _to_nodes(self, identifier: int, data: bytes, remote: bool) -> None:
        for node in self._nodes:
            node.receive(identifier, data, remote)

    def _to_host(self, identifier: int, data: bytes, _remote: bool) -> None:
        ahead_s = 0.0 if self.line is None else self.line.ahead_s(self.tick, stamps=True)
        self._queue.append((self.tick / self.ticks_per_second + ahead_s, identifier, data))

    def _pace(self, wall: WallClock) -> None:
        due_s = self._wall_start_s + self.tick / self.ticks_per_second
        late_ticks = int((wall.now() - due_s) * self.ticks_per_second)
        if late_ticks >= 1:
            self.missed_cycles += late_ticks
            self._wall_start_s += late_ticks / self.ticks_per_second
        else:
            wall.sleep_until(due_s)


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
        """The host does something.

        Raises
        ------
        HostDied
            Once it is dead.
        """
        dies_at_s = self.faults.host_dies_at_s
        if dies_at_s is not None and tick / self._per_second >= dies_at_s:
            raise HostDied

    def interface(self, tick: int) -> None:
        """It uses its interface.

        Raises
        ------
        can.CanOperationError
            While that is off.
        HostDied
            As :meth:`alive`.
        """
        self.alive(tick)
        faults, now_s = self.faults, tick / self._per_second
        if _during(now_s, faults.off_from_s, faults.off_until_s):
            raise can.CanOperationError("the controller is in the state bus-off")

    def ahead_s(self, tick: int, stamps: bool = False) -> float:
        """Lead of the host's clock, or with ``stamps`` of the one that stamps frames, over virtual time; 0 before the jump."""
        faults = self.faults
        if faults.clock_jump_at_s is None or tick / self._per_second < faults.clock_jump_at_s:
            return 0.0
        return faults.clock_jump_s if stamps or not faults.stamps_only else 0.0

    def carry(self, direction: Direction, identifier: int, cargo: Cargo, tick: int) -> list[Cargo]:
        """Put a frame in; the frames that arrive now, before all else this one."""
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
