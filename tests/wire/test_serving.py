"""The pump between a CAN interface and the virtual drive, and the host's clock for a drive whose time is the count of SYNCs."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Iterator

import can
import numpy as np
import pytest

from beltcomm.drive import Limits, Motion
from beltcomm.errors import BusError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.serving import SILENCE_S, Pump
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.canopen import CanopenDrive, connect
from beltcomm_adapters.synctime import TIME_BY_SYNC, SyncTimeBus, keeps_time_by_sync
from virtual.host import RigidPlant
from wire.decoder import lockstep
from wire.rig import ServedDrive
from wire.rules import Judge

SYNC = (0x80, b"")


class Over(Exception):
    """No more frames."""


class Script:
    """A wire with what the host says, None for 0.1 s of silence; a clock that goes with the silence."""

    def __init__(self, *said: tuple[int, bytes] | None) -> None:
        self.said = deque(said)
        self.heard: list[tuple[int, bytes]] = []
        self.now_s = 0.0

    def recv(self, timeout: float) -> can.Message | None:
        if not self.said:
            raise Over
        frame = self.said.popleft()
        if frame is None:
            self.now_s += timeout
            return None
        return can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False)

    def send(self, message: can.Message) -> None:
        self.heard.append((message.arbitration_id, bytes(message.data)))

    def now(self) -> float:
        return self.now_s

    def sleep_until(self, t_s: float) -> None:
        raise AssertionError("nobody sleeps")


def written(index: int, part: int, value: int, size: int) -> tuple[int, bytes]:
    return 0x601, struct.pack("<BHBI", 0x23 | (4 - size) << 2, index, part, value)


START = (0, b"\x01\x01")
ENABLE = [written(0x6060, 0, 4, 1), *(written(0x6040, 0, word, 2) for word in (6, 7, 15))]


def served(script: Script, profile: str = "reference", ticks_per_second: int = 1000) -> tuple[LockstepBus, VirtualDrive, RigidPlant]:
    bus, plant = LockstepBus(ticks_per_second=ticks_per_second), RigidPlant()
    drive = VirtualDrive(bus, plant, profile, torque_noise_nm=0.0)
    with pytest.raises(Over):
        Pump(script, bus, drive, script).by_sync()
    bus.shutdown()
    return bus, drive, plant


def test_a_sync_is_a_tick_and_time_stands_between_two():
    script = Script(SYNC, (0x601, b"\x40\x41\x60\x00\0\0\0\0"), *[None] * 500, SYNC, SYNC)
    bus, _, plant = served(script)
    assert bus.tick == len(plant.steps) == 3
    assert script.heard[0] == (0x701, b"\x00")  # what the drive said before anybody listened
    assert [identifier for identifier, _ in script.heard] == [0x701, 0x581]


@pytest.mark.parametrize("profile", ["accelnet", "bare"])
def test_a_drive_that_answers_late_answers_while_time_stands(profile: str):
    bus, _, _ = served(script := Script(SYNC, (0x601, b"\x40\x41\x60\x00\0\0\0\0"), None), profile)
    assert [identifier for identifier, _ in script.heard] == [0x701, 0x581]
    assert bus.tick == 1


def test_a_sync_is_a_millisecond_also_of_a_drive_with_another_cycle():
    bus, _, _ = served(Script(*[SYNC] * 10), "cmms-as", 2500)
    assert bus.tick == 25


def test_while_operational_a_sync_is_the_interpolation_period():
    bus, _, _ = served(Script(SYNC, written(0x60C2, 1, 5, 1), SYNC, START, SYNC, SYNC))
    assert bus.tick == 1 + 1 + 5 + 5


def test_a_host_that_dies_while_the_motor_carries_torque_is_waited_for_only_so_long():
    life = (0x77F, b"\x05")
    silence = [None] * round(SILENCE_S / 0.1)
    alive = [written(0x1016, 1, 127 << 16 | 50, 4), life, *ENABLE, SYNC]
    bus, drive, _ = served(Script(*alive, *silence[:-2]))
    assert (drive.state, bus.tick) == (DriveState.OPERATION_ENABLED, 1)
    script = Script(*alive, *silence, None, None)
    bus, drive, _ = served(script)
    assert drive.state is DriveState.FAULT  # its own guarding: 50 ms
    assert (0x81, struct.pack("<HB5x", 0x8130, 0x11)) in script.heard
    bus, drive, _ = served(Script(written(0x1016, 1, 127 << 16 | 50, 4), life, SYNC, *silence, *silence))
    assert bus.tick == 1  # with the stage off it may compute for as long as it likes


def test_frames_that_are_no_canopen_do_nothing():
    script = Script(SYNC)
    odd = [
        can.Message(arbitration_id=0x80, is_extended_id=True),
        can.Message(arbitration_id=0x80, is_remote_frame=True, is_extended_id=False),
        can.Message(is_error_frame=True),
    ]
    script.recv = lambda _timeout: odd.pop() if odd else Script.recv(script, 0.1)  # type: ignore[method-assign]
    bus, _, _ = served(script)
    assert bus.tick == 1


# -- the host of such a drive ---------------------------------------------------------------------------------------------

LIMITS = Limits(-40.0, 40.0, 60.0, 0.5)


def torque_motion(n: int = 200) -> Motion:
    return Motion("torque", 1e-3, np.zeros(n), np.zeros(n), np.where(np.arange(n) // 20 % 2, 0.1, -0.1))


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[ServedDrive]:
    """Of the profile that the test is given, else the reference drive."""
    profile = getattr(request.node, "callspec", None) and request.node.callspec.params.get("profile")
    made = ServedDrive(request.node.name, True, profile or "reference", hardware=f"virtual, {TIME_BY_SYNC}")
    made.start()
    yield made
    made.close()


def host_of(request: pytest.FixtureRequest) -> CanopenDrive:
    bus = can.Bus(interface="virtual", channel=request.node.name)
    return connect(bus, MonotonicClock(), 1, None, 1_000_000, bus.shutdown)


def session(drive: CanopenDrive) -> list[tuple[float, ...]]:
    """Homing in 10 ms periods, three motions and a wait: rows that depend on every tick that has passed."""
    rows: list[tuple[float, ...]] = []
    drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})
    drive.home(LIMITS)
    drive.record(torque_motion(), LIMITS, rows.append)
    drive.clock.sleep_until(drive.clock.now() + 0.3)
    here, n = drive.read(["position_rad"])["position_rad"], 300
    way = here + 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n)))
    drive.record(Motion("position", 1e-3, way, np.gradient(way, 1e-3), np.zeros(n)), LIMITS, rows.append)
    drive.write({"kpp_1_s": 5.0})
    here = drive.read(["position_rad"])["position_rad"]
    drive.record(Motion("position", 1e-3, np.full(50, here), np.zeros(50), np.zeros(50)), LIMITS, rows.append)
    return rows


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_every_row_is_the_one_of_the_bus_in_one_process(rig, request, profile):
    """The same ticks under the same frames, heartbeats or guarding: nothing between the processes costs or adds a millisecond."""
    with host_of(request) as drive:
        over_there = session(drive)
    bus = LockstepBus()
    VirtualDrive(bus, RigidPlant(2e-3, 1e-3), profile, referenced=True, torque_noise_nm=0.0)
    with connect(bus, bus.clock, 1, None, None, bus.shutdown) as drive:
        here = session(drive)
    np.testing.assert_array_equal(over_there, here)
    report = Judge(by_sync=True, kept={(0x2100, 3), (0x60FB, 1)}).of(lockstep(rig.seen))
    assert report.findings == []
    assert report.longest_silence_s <= 0.025  # 15 ms, rounded up to the periods of 10 ms of homing
    assert report.states.count("enabled") == 5  # homing, the proof of guarding, three motions


def test_a_drive_of_the_wall_clock_is_not_taken_for_one(request):
    rig = ServedDrive(request.node.name, False)
    rig.start()
    with can.Bus(interface="virtual", channel=request.node.name) as bus:
        assert not keeps_time_by_sync(bus, MonotonicClock(), 1)
        assert not keeps_time_by_sync(bus, MonotonicClock(), 2)  # nobody there
    rig.close()


def test_a_lost_answer_is_a_lost_cycle(rig, request, monkeypatch):
    monkeypatch.setattr("beltcomm_adapters.synctime._PATIENCE_S", 0.2)
    rows: list[tuple[float, ...]] = []

    def sink(row: tuple[float, ...]) -> None:
        rows.append(row)
        if len(rows) == 50:
            rig.wire.swallow.append(0x181)

    with host_of(request) as drive:
        report = drive.record(torque_motion(), LIMITS, sink)
    assert report.lost_cycles == 1
    assert np.diff([row[0] for row in rows]).max() == pytest.approx(3e-3)  # its own row and the one before


def test_a_process_that_dies_is_told_soon(rig, request, monkeypatch):
    monkeypatch.setattr("beltcomm_adapters.synctime._PATIENCE_S", 0.2)
    monkeypatch.setattr("beltcomm_adapters.synctime._LITTLE_PATIENCE_S", 0.001)

    def sink(_row: tuple[float, ...]) -> None:
        rig.wire.mute = True

    begun_s = time.monotonic()
    with host_of(request) as drive, pytest.raises(BusError, match="did not answer"):
        drive.record(torque_motion(), LIMITS, sink)
    assert time.monotonic() - begun_s < 30.0


def test_waiting_for_a_frame_lets_the_drive_run(rig, request):
    """A reset's boot-up message comes 50 ms of the drive later, CiA 301's NMT: nobody but SYNCs brings them."""
    bus = can.Bus(interface="virtual", channel=request.node.name)
    timed = SyncTimeBus(bus, 1, bus.shutdown)
    while timed.recv(0.0) is not None:
        pass
    timed.send(can.Message(arbitration_id=0, data=b"\x81\x01", is_extended_id=False))
    before_s = timed.clock.now()
    assert timed.recv(0.02) is None
    assert timed.clock.now() == pytest.approx(before_s + 0.02)
    message = timed.recv(1.0)
    assert (message.arbitration_id, bytes(message.data)) == (0x701, b"\0")
    assert 0.02 < timed.clock.now() - before_s < 0.07
    timed.shutdown()
    timed.shutdown()
