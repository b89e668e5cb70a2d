"""A host of bare CAN frames and a rigid machine, for the tests of the virtual drive; no protocol library."""

from __future__ import annotations

import math
import struct
from typing import Any

import can

from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.device import VirtualDrive

COUNTS = 65536
UNIT_NM = 1.43e-3  # 0.1 % of the rated torque 1.43 N m
INERTIA = 2e-3
SYNC = 0x80
STATUS, POSITION, TORQUE, TARGET_TORQUE = 0x60410010, 0x60640020, 0x60770010, 0x60710010


class RigidPlant:
    """J dω/dt = τ - d ω, solved exactly for a held torque."""

    def __init__(self, inertia_kg_m2: float = INERTIA, viscous_nm_s_rad: float = 0.0) -> None:
        self.inertia, self.viscous = inertia_kg_m2, viscous_nm_s_rad
        self.position_rad = self.velocity_rad_s = self.cart_position_m = self.belt_force_n = 0.0
        self.steps: list[tuple[float, float]] = []
        self.time_s = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        self.steps.append((torque_nm, duration_s))
        self.time_s += duration_s
        v, t = self.velocity_rad_s, duration_s
        if self.viscous == 0.0:
            a = torque_nm / self.inertia
            self.position_rad += v * t + 0.5 * a * t * t
            self.velocity_rad_s = v + a * t
        else:
            end, tau = torque_nm / self.viscous, self.inertia / self.viscous
            decay = math.exp(-t / tau)
            self.position_rad += end * t + (v - end) * tau * (1.0 - decay)
            self.velocity_rad_s = end + (v - end) * decay


class Abort(Exception):
    """An SDO abort frame came back; the code is its only argument."""


class Host:
    """The other end of the bus."""

    def __init__(self, plant: RigidPlant | None = None, profile: str = "reference", **options: Any) -> None:
        self.plant = plant if plant is not None else RigidPlant()
        self.bus = options.pop("bus", None) or LockstepBus()
        options.setdefault("torque_noise_nm", 0.0)
        self.node = options.get("node_id", 1)
        self._kept: list[tuple[int, bytes]] = []
        self.drive = VirtualDrive(self.bus, self.plant, profile, **options)

    def send(self, identifier: int, data: bytes = b"", rtr: bool = False) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, is_remote_frame=rtr, data=data))

    def frames(self) -> list[tuple[int, bytes]]:
        """All frames that are waiting, but for the answers that :meth:`ask` has taken."""
        found, self._kept = self._kept, []
        while (message := self.bus.recv(0.0)) is not None:
            found.append((message.arbitration_id, bytes(message.data)))
        return found

    def of(self, identifier: int) -> list[bytes]:
        """Data of the waiting frames with this identifier; the others are dropped."""
        return [data for found, data in self.frames() if found == identifier]

    def ask(self, request: bytes) -> bytes:
        """One SDO request of 8 bytes and the answer to it."""
        kept = self.frames()
        self.send(0x600 + self.node, request)
        new = self.frames()
        self._kept = kept + [frame for frame in new if frame[0] != 0x580 + self.node]
        (answer,) = (data for identifier, data in new if identifier == 0x580 + self.node)
        return answer

    def read_raw(self, index: int, subindex: int = 0) -> bytes:
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, subindex))
        if answer[0] == 0x80:
            raise Abort(struct.unpack_from("<I", answer, 4)[0])
        assert answer[0] & 0xE3 == 0x43
        return answer[4 : 8 - (answer[0] >> 2 & 3)]

    def read(self, index: int, subindex: int = 0, code: str = "") -> Any:
        """Value of an object; unsigned unless ``code`` says otherwise."""
        raw = self.read_raw(index, subindex)
        return struct.unpack("<" + (code or {1: "B", 2: "H", 4: "I"}[len(raw)]), raw)[0]

    def write(self, index: int, subindex: int, value: float, code: str) -> None:
        data = struct.pack("<" + code, value)
        answer = self.ask(struct.pack("<BHB4s", 0x23 | (4 - len(data)) << 2, index, subindex, data))
        if answer[0] == 0x80:
            raise Abort(struct.unpack_from("<I", answer, 4)[0])
        assert answer == struct.pack("<BHB4x", 0x60, index, subindex)

    def control(self, word: int) -> int:
        """Write the controlword, return the statusword."""
        self.write(0x6040, 0, word, "H")
        return self.status

    @property
    def status(self) -> int:
        return int(self.read(0x6041))

    def state(self) -> DriveState:
        """The state inside the drive; what the host may know stands in ``status``."""
        return self.drive.state

    def run(self, seconds: float) -> None:
        self.bus.clock.sleep_until(self.bus.clock.now() + seconds)

    def place(self, position_rad: float) -> None:
        """Put the resting axis somewhere else and wait until the velocity filter has forgotten how it came there."""
        self.plant.position_rad = position_rad
        self.run(0.1)

    def enable(self, mode: int) -> None:
        """Shutdown, switch on, enable operation in a mode."""
        self.write(0x6060, 0, mode, "b")
        for word in (0x06, 0x07, 0x0F):
            self.control(word)
        assert self.status & 0x6F == 0x27

    def gains(self, kp: float = 0.2, ki: float = 2.0, kpp: float = 20.0, forward: float = 1.0) -> None:
        """Loops that follow well on the rigid machine, with feedforward of its inertia."""
        for subindex, value in ((1, kp), (2, ki), (3, kpp), (9, INERTIA * forward), (13, forward)):
            self.write(0x2100, subindex, value, "f")

    def map(self, number: int, receive: bool, objects: list[int], sync_type: int = 1, identifier: int = 0) -> int:
        """Map PDO ``number`` (1 to 4) as CiA 301 tells, return its identifier."""
        communication, mapping = (0x1400, 0x1600) if receive else (0x1800, 0x1A00)
        identifier = identifier or (0x100 if receive else 0x80) + 0x100 * number + self.node
        communication, mapping = communication + number - 1, mapping + number - 1
        self.write(communication, 1, 0x80000000 | identifier, "I")
        self.write(communication, 2, sync_type, "B")
        self.write(mapping, 0, 0, "B")
        for i, entry in enumerate(objects):
            self.write(mapping, i + 1, entry, "I")
        self.write(mapping, 0, len(objects), "B")
        self.write(communication, 1, identifier, "I")
        return identifier

    def operational(self) -> None:
        self.send(0x000, bytes((0x01, self.node)))
        self.frames()

    def close(self) -> None:
        self.bus.shutdown()


class CyclicTorque(Host):
    """Exchange at 1 kHz: torque setpoint out, position and torque in."""

    def prepare(self) -> None:
        """PDOs mapped, operational, enabled in cyclic torque."""
        self.sent = self.map(1, True, [TARGET_TORQUE])
        self.got = self.map(1, False, [POSITION, TORQUE, STATUS])
        self.operational()
        self.enable(10)
        self.frames()

    def cycle(self, setpoint: int) -> tuple[int, int]:
        """SYNC, sample, new setpoint for the next SYNC, one tick."""
        self.send(SYNC)
        ((position, torque, _status),) = (struct.unpack("<ihH", data) for data in self.of(self.got))
        self.send(self.sent, struct.pack("<h", setpoint))
        self.run(0.001)
        return position, torque


def prepared(**options: Any) -> CyclicTorque:
    """A host in cyclic torque, enabled and operational."""
    one = CyclicTorque(**options)
    one.prepare()
    return one
