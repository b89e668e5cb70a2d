"""A CANopen node scripted by hand for the adapter's tests: frames from CiA 301 and CiA 402, a frictionless inertia behind it.

It shares nothing with ``beltcomm.virtual``: what the adapter believes of a drive is written down here a third time.
"""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass, field

import can

INERTIA_KG_M2 = 1e-3
COUNTS_PER_RAD = 65536 / 6.283185307179586
RATED_NM = 1.0

_ENABLED, _QUICK, _FAULT = 0x27, 0x07, 0x08
#: (state now, control word & 8Fh) -> next state; states by the statusword of CiA 402.
_TRANSITIONS = {
    (0x40, 0x06): 0x21,
    (0x21, 0x07): 0x23,
    (0x23, 0x0F): 0x27,
    (0x27, 0x02): 0x07,
    (0x07, 0x02): 0x07,
}


def standard_objects() -> dict[tuple[int, int], tuple[str, float]]:
    """A generic CiA 402 drive: type and value by index and subindex."""
    objects: dict[tuple[int, int], tuple[str, float]] = {
        (0x1000, 0): ("<I", 0x00020192),
        (0x1016, 1): ("<I", 0),
        (0x1017, 0): ("<H", 0),
        (0x1018, 1): ("<I", 0x99),
        (0x6040, 0): ("<H", 0),
        (0x6041, 0): ("<H", 0x40),
        (0x605A, 0): ("<h", 2),
        (0x6060, 0): ("<b", 0),
        (0x6061, 0): ("<b", 0),
        (0x6064, 0): ("<i", 0),
        (0x606C, 0): ("<i", 0),
        (0x6071, 0): ("<h", 0),
        (0x6072, 0): ("<H", 3000),
        (0x6073, 0): ("<H", 3000),
        (0x6074, 0): ("<h", 0),
        (0x6075, 0): ("<I", 2000),
        (0x6076, 0): ("<I", round(RATED_NM * 1000)),
        (0x6077, 0): ("<h", 0),
        (0x607A, 0): ("<i", 0),
        (0x607D, 1): ("<i", 0),
        (0x607D, 2): ("<i", 0),
        (0x6080, 0): ("<I", 6000),
        (0x608F, 1): ("<I", 65536),
        (0x608F, 2): ("<I", 1),
        (0x60B1, 0): ("<i", 0),
        (0x60B2, 0): ("<h", 0),
        (0x60C2, 1): ("<B", 1),
        (0x60C2, 2): ("<b", -3),
        (0x60FF, 0): ("<i", 0),
        (0x6502, 0): ("<I", 0x3A0),
    }
    for n in (0, 1):
        objects |= {(0x1400 + n, 1): ("<I", 0xC0000201 + 0x100 * n), (0x1400 + n, 2): ("<B", 255)}
        objects |= {(0x1800 + n, 1): ("<I", 0xC0000181 + 0x100 * n), (0x1800 + n, 2): ("<B", 255)}
        for mapping in (0x1600 + n, 0x1A00 + n):
            objects |= {(mapping, sub): ("<I" if sub else "<B", 0) for sub in range(5)}
    return objects


@dataclass
class StubNode:
    """Node 1.   refuse : abort code by object, on write.    drop : SYNCs (from 1) whose first answer is lost.

    ignores_target : bit 12 stays 0.     jammed : target positions are taken, and nothing moves.
    fault_at, emergency_at : SYNC at which bit 3 is set, or an EMCY 8611h is sent.
    silent_from : SYNC from which nothing is heard any more.     stuck_objects : writes are confirmed and forgotten.
    unguarded : it does not mind that its host falls silent.     leaves : it leaves Operational then, as CiA 301's default 1029h = 0 has it;
    keeps_torque : and nothing more happens while 6007h is 0.     stops : it goes to Stopped instead and answers no SDO (1029h = 2).
    What it noted of its host, and its count of SYNCs, begin anew when the first fault, that of the proof of its guarding, is acknowledged.
    """

    objects: dict[tuple[int, int], tuple[str, float]] = field(default_factory=standard_objects)
    refuse: dict[tuple[int, int], int] = field(default_factory=dict)
    drop: set[int] = field(default_factory=set)
    ignores_target: bool = False
    jammed: bool = False
    fault_at: int | None = None
    fault_pattern: int = _FAULT
    emergency_at: int | None = None
    silent_from: int | None = None
    stuck_objects: set[tuple[int, int]] = field(default_factory=set)
    unguarded: bool = False
    leaves: bool = False
    stops: bool = False
    keeps_torque: bool = False

    def __post_init__(self) -> None:
        self.out: deque[tuple[int, bytes]] = deque()
        self.written: list[tuple[int, int, float]] = []
        self.states: list[int] = []
        self.life_s: list[float] = []
        self.operational = self.proven = self.dumb = False
        self.state = 0x40
        self.syncs = 0
        self.position_rad = self.speed_rad_s = self.acting_nm = 0.0
        self._pending: list[bytes | None] = [None, None]
        self._last_s: float | None = None

    def get(self, index: int, sub: int = 0) -> float:
        return self.objects[index, sub][1]

    def put(self, index: int, sub: int, value: float) -> None:
        self.objects[index, sub] = (self.objects[index, sub][0], value)

    def receive(self, frame: can.Message, now_s: float) -> None:
        if self.silent_from is not None and self.syncs >= self.silent_from and (self.proven or not self.silent_from):
            return
        cob, data = frame.arbitration_id, bytes(frame.data)
        if cob == 0x601:
            if not self.dumb:
                self._sdo(data)
        elif cob == 0 and data[1] in (0, 1):
            self.operational, self.dumb = data[0] == 1, False
            self._pending = [None, None]
        elif cob in (0x77F, 0x701):
            self.life_s.append(now_s)
        elif cob in (0x201, 0x301) and self.operational:
            self._pending[(cob - 0x201) >> 8] = data
        elif cob == 0x80 and self.operational:
            self._sync(now_s)

    def _sdo(self, data: bytes) -> None:
        command, index, sub = struct.unpack_from("<BHB", data)
        key = (index, sub)
        if command == 0x80:
            return
        head = data[1:4]
        if key not in self.objects:
            self._abort(head, 0x06020000)
        elif command == 0x40:
            layout, value = self.objects[key]
            raw = struct.pack(layout, value)
            self.out.append((0x581, bytes([0x43 | (4 - len(raw)) << 2]) + head + raw.ljust(4, b"\0")))
        elif key in self.refuse:
            self._abort(head, self.refuse[key])
        else:
            (value,) = struct.unpack_from(self.objects[key][0], data, 4)
            self.written.append((*key, value))
            if key not in self.stuck_objects:
                self.put(*key, value)
            if key == (0x6060, 0) and (0x6061, 0) not in self.stuck_objects:
                self.put(0x6061, 0, value)
            if key == (0x6040, 0):
                self._control(int(value))
            self.out.append((0x581, b"\x60" + head + b"\0\0\0\0"))

    def _abort(self, head: bytes, code: int) -> None:
        self.out.append((0x581, b"\x80" + head + struct.pack("<I", code)))

    def _control(self, word: int) -> None:
        if self.state == self.fault_pattern:
            if word & 0x80:
                self.state = 0x40
                if (self.life_s or self.leaves or self.stops) and not self.proven:
                    self.proven, self.syncs = True, 0
                    for noted in (self.written, self.states, self.life_s):
                        noted.clear()
        elif word & 0x02 == 0:
            self.state = 0x40
        else:
            self.state = _TRANSITIONS.get((self.state, word & 0x0F), self.state)
        if self.state == _QUICK:
            self.speed_rad_s = 0.0  # an ideal brake
        if not self.states or self.states[-1] != self.state:
            self.states.append(self.state)
        self.put(0x6041, 0, self._status())

    def _status(self) -> int:
        follows = self.state == _ENABLED and not self.ignores_target
        return self.state | (1 << 12 if follows else 0)

    def _sync(self, now_s: float) -> None:
        self.syncs += 1
        step_s = 0.0 if self._last_s is None else now_s - self._last_s
        self._last_s = now_s
        before = self.speed_rad_s
        self.speed_rad_s += self.acting_nm / INERTIA_KG_M2 * step_s
        self.position_rad += 0.5 * (before + self.speed_rad_s) * step_s
        mode, mean_nm = self.get(0x6060), self.acting_nm
        self._guard(now_s)
        if self.proven and self.fault_at == self.syncs:
            self.state = self.fault_pattern
        for number, data in enumerate(self._pending):
            if data is not None:
                self._activate(number, data, int(mode))
                self._pending[number] = None
        self.acting_nm = self.get(0x6071) * 1e-3 * RATED_NM if self.state == _ENABLED and mode == 10 else 0.0
        if self.state == _ENABLED and mode == 8 and not self.jammed:
            target = self.get(0x607A) / COUNTS_PER_RAD
            self.speed_rad_s, self.position_rad = 0.0, target
        position = round(self.position_rad * COUNTS_PER_RAD)
        self.put(0x6064, 0, position)
        first = struct.pack("<ihH", position, round(mean_nm / RATED_NM * 1000), self._status())
        second = struct.pack("<ih", round(self.speed_rad_s * COUNTS_PER_RAD), round(mean_nm / RATED_NM * 1000))
        if self.proven and self.emergency_at == self.syncs:
            self.out.append((0x81, struct.pack("<HB5x", 0x8611, 0x20)))
        if not self.proven or self.syncs not in self.drop:
            self.out.append((0x181, first))
        self.out.append((0x281, second))

    def _guard(self, now_s: float) -> None:
        """Heartbeat consumer, CiA 301, 7.5.2.13: an enabled axis whose host is silent for longer goes into fault."""
        consumer = int(self.objects.get((0x1016, 1), ("", 0))[1])
        if self.unguarded or self.state != _ENABLED or not consumer & 0xFFFF or not self.life_s:
            return
        if now_s - self.life_s[-1] > 1e-3 * (consumer & 0xFFFF):
            if not (self.keeps_torque and self.get(0x6007) == 0):
                self.state, self.speed_rad_s = self.fault_pattern, 0.0
            self.put(0x6041, 0, self._status())
            self.out.append((0x81, struct.pack("<HB5x", 0x8130, 0x10)))
            if self.leaves or self.stops:
                self.operational, self.dumb = False, self.stops and self.get(0x1029, 1) == 2
                self.life_s.clear()  # the consumer waits for the next heartbeat

    def _activate(self, number: int, data: bytes, mode: int) -> None:
        if number == 1:
            if mode == 9:
                self.put(0x60B2, 0, *struct.unpack("<h", data))
                return
            velocity, torque = struct.unpack("<ih", data)
            self.put(0x60B1, 0, velocity)
            self.put(0x60B2, 0, torque)
            return
        if mode == 10:
            word, torque = struct.unpack("<Hh", data)
            self.put(0x6071, 0, torque)
        else:
            word, target = struct.unpack("<Hi", data)
            self.put(0x607A if mode == 8 else 0x60FF, 0, target)
        self._control(word)


class StubClock:
    """Time that only waiting moves."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def now(self) -> float:
        return self.now_s

    def sleep_until(self, t_s: float) -> None:
        self.now_s = max(self.now_s, t_s)


class StubBus(can.BusABC):
    """Delivers to the node at once; ``recv`` on an empty queue lets time pass.   dead : sending fails."""

    def __init__(self, *nodes: StubNode) -> None:
        super().__init__(channel="stub")
        self.channel_info = "stub bus"
        self.nodes = nodes
        self.clock = StubClock()
        self.sent: list[tuple[float, int, bytes, bool]] = []
        self.dead = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.dead:
            raise can.CanOperationError("no buffer space")
        self.sent.append((self.clock.now_s, msg.arbitration_id, bytes(msg.data), msg.is_remote_frame))
        for node in self.nodes:
            node.receive(msg, self.clock.now_s)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        for node in self.nodes:
            if node.out:
                cob, data = node.out.popleft()
                return can.Message(timestamp=self.clock.now_s, arbitration_id=cob, data=data, is_extended_id=False)
        self.clock.now_s += timeout or 0.0
        return None
