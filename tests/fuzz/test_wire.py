"""Nothing from the wire raises anything but the errors of this package: SDO, PDO, EMCY, signs of life, at both ends."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any

import can
import numpy as np
import pytest

from beltcomm.drive import Drive, Limits, Motion, open_drive
from beltcomm.errors import BeltcommError
from beltcomm.virtual.bus import LockstepBus
from beltcomm_adapters.canopen import connect
from fuzz.mutation import mutated_frame
from marks import quick
from virtual.host import Host

LIMITS = Limits(-40.0, 40.0, 20.0, 0.5, 200.0)


class Damaging(can.BusABC):
    """A bus on which a share of the frames that are received, of one range of identifiers, is damaged; strange ones come in between."""

    def __init__(self, bus: LockstepBus, draw: np.random.Generator, share: float, identifiers: range) -> None:
        super().__init__(channel="virtual")
        self.channel_info = "damaged bus"
        self.bus, self.draw, self.share, self.identifiers = bus, draw, share, identifiers
        self.damaged = 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        draw = self.draw
        if draw.random() < 0.2 * self.share:
            self.damaged += 1
            strange = int(draw.integers(0x800))
            return can.Message(self.bus.clock.now(), strange, False, bool(draw.random() < 0.2), data=draw.bytes(int(draw.integers(9))))
        message = self.bus.recv(timeout)
        if message is not None and message.arbitration_id in self.identifiers and draw.random() < self.share:
            self.damaged += 1
            message.data = bytearray(mutated_frame(draw, bytes(message.data)))
            message.dlc = len(message.data)
            if draw.random() < 0.05:
                message.is_error_frame = True
        return message


@contextlib.contextmanager
def virtual(profile: str) -> Any:
    first: Any = open_drive("virtual:g_a", {"profile": profile})
    bus: LockstepBus = first._link.bus
    first._open = False
    yield bus, bus._nodes[0]
    bus.shutdown()


def ends_well(action: Callable[[], object]) -> str:
    """The sentence of a refusal, "" when all went well; anything else comes through."""
    try:
        action()
    except BeltcommError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("profile", quick(["reference", "cmmp-as"], 1))
def test_damaged_answers_to_sdo(profile: str) -> None:
    """Connect, read everything, write, save: 48 times, with from one to 30 % of all answers damaged."""
    draw, sentences, damaged = np.random.default_rng(1), set[str](), 0
    for _ in range(48):
        with virtual(profile) as (bus, _node):
            line = Damaging(bus, draw, float(draw.choice([0.01, 0.03, 0.1, 0.3])), range(0x580, 0x600))

            def job(line: Damaging = line, bus: LockstepBus = bus) -> None:
                with connect(line, bus.clock, 1, None, None, lambda: None) as drive:
                    has = drive.capabilities
                    drive.calibrate({name: has.parameters[name].scale for name in has.uncalibrated})  # as the profile says
                    drive.write({name: 1.1 * value for name, value in drive.backup().items() if name == "kpp_1_s"})
                    drive.read(["position_rad", "velocity_rad_s", "torque_nm", "state", "referenced"])
                    drive.save()

            sentences.add(ends_well(job))
            damaged += line.damaged
            assert bus.clock.now() < 300.0
    assert damaged > 50
    assert len(sentences) > 2  # the damage was not all of one kind
    assert all(len(text) > 30 for text in sentences - {""})


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_damaged_process_data_emergencies_and_signs_of_life(profile: str) -> None:
    """A motion whose samples are damaged ends in a sentence, and in a drive without torque."""
    draw, sentences = np.random.default_rng(2), set[str]()
    torque = 0.05 * np.sin(2.0 * math.pi * 5.0 * np.arange(150) * 1e-3)
    motion = Motion("torque", 1e-3, np.zeros(150), np.zeros(150), torque)
    with virtual(profile) as (bus, node):
        line = Damaging(bus, draw, 0.0, range(0, 0x580))
        drive: Drive = connect(line, bus.clock, 1, None, None, lambda: None)
        for _ in range(25):
            line.share = float(draw.choice([0.002, 0.01, 0.1]))
            here = motion if draw.random() < 0.9 else Motion("velocity", 1e-3, np.zeros(150), np.zeros(150), np.zeros(150))
            rows: list[tuple[float, ...]] = []
            sentences.add(ends_well(lambda here=here, rows=rows: drive.record(here, LIMITS, rows.append)))
            line.share = 0.0
            ends_well(drive.stop)
            assert not node._servo.machine.powered
    assert line.damaged > 50
    assert len(sentences) > 4


def test_any_frame_at_all_is_borne_by_the_drive(host: Callable[..., Host]) -> None:
    """4000 random frames, most of them to what a drive listens to; afterwards it still answers."""
    draw = np.random.default_rng(3)
    for profile in ("reference", "cmmp-as"):
        one = host(profile=profile)
        for n in range(2000):
            identifier = int(draw.choice([0x000, 0x080, 0x201, 0x301, 0x601, 0x601, 0x601, 0x701, int(draw.integers(0x800))]))
            data = draw.bytes(int(draw.choice([0, 1, 2, 4, 6, 8, 8, 8])))
            if identifier == 0x601 and draw.random() < 0.7:  # plausible requests get deeper
                index = int(draw.choice([0x1000, 0x1003, 0x1008, 0x1010, 0x1400, 0x1600, 0x1800, 0x1A00, 0x6040, 0x6060, 0x607D, 0x2100]))
                first = int(draw.choice([0x40, 0x60, 0x70, 0x2F, 0x2B, 0x23, 0x21, 0x00, 0x01, 0x10, 0x80, 0xA0, 0xC0]))
                data = bytes((first, index & 0xFF, index >> 8, int(draw.integers(6)))) + draw.bytes(4)
            one.send(identifier, data, rtr=identifier == 0x701 or bool(draw.random() < 0.02))
            if n % 50 == 0:
                one.run(0.001)
        one.frames()
        one.send(0x000, b"\x81\x01")  # reset of the node
        one.run(0.1)
        assert one.ask(b"\x40\x00\x10\x00\x00\x00\x00\x00")[:4] == b"\x43\x00\x10\x00"


@pytest.fixture
def host() -> Any:
    made: list[Host] = []

    def make(**options: Any) -> Host:
        made.append(Host(**options))
        return made[-1]

    yield make
    for one in made:
        one.close()
