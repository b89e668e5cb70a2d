"""The knobs: each fault is seen by the host as it would be on a machine."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest

from beltcomm.errors import UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.faults import Faults
from frames import FrameHash
from virtual.host import Host, RigidPlant

MakeHost = Callable[..., Host]
SYNC = 0x80
STATUS, POSITION, TORQUE, TARGET_TORQUE = 0x60410010, 0x60640020, 0x60770010, 0x60710010


def answers(one: Host, identifier: int, count: int) -> list[int]:
    """How many PDOs come back to each of some SYNCs, 1 ms apart."""
    got = []
    for _ in range(count):
        one.send(SYNC)
        got.append(len(one.of(identifier)))
        one.run(0.001)
    return got


def test_nth_transmit_pdo_is_lost(host: MakeHost) -> None:
    one = host(faults=Faults(drop_tpdo=frozenset({2, 5})))
    identifier = one.map(1, False, [STATUS])
    one.operational()
    assert answers(one, identifier, 6) == [1, 0, 1, 1, 0, 1]


def test_ignored_sync(host: MakeHost) -> None:
    one = host(faults=Faults(ignore_sync=frozenset({3})))
    identifier = one.map(1, False, [STATUS])
    one.operational()
    assert answers(one, identifier, 5) == [1, 1, 0, 1, 1]


def test_late_sync_is_acted_upon_a_tick_later(host: MakeHost) -> None:
    one = host(faults=Faults(late_sync=frozenset({2})))
    identifier = one.map(1, False, [STATUS])
    one.operational()
    times = []
    for _ in range(2):
        one.send(SYNC)
        one.run(0.003)
    while (message := one.bus.recv(0.0)) is not None:
        assert message.arbitration_id == identifier
        times.append(message.timestamp)
    assert times == pytest.approx([0.0, 0.004])


def test_emergency_in_motion(host: MakeHost) -> None:
    one = host(faults=Faults(emergency_at_s=0.1, emergency_code=0x4210))
    one.enable(10)
    one.write(0x6071, 0, 20, "h")
    one.run(0.099)
    assert one.of(0x81) == []
    one.run(0.001)
    assert one.of(0x81) == [bytes.fromhex("1042090000000000")]
    assert one.state() == DriveState.FAULT
    speed = one.plant.velocity_rad_s
    assert speed > 0.1
    one.run(0.1)
    assert one.plant.velocity_rad_s == speed  # it coasts


def test_wrong_rated_torque_reads_wrong_and_drives_right(host: MakeHost) -> None:
    one = host(faults=Faults(rated_torque_nm=0.296))
    assert one.read(0x6076) == 296
    one.enable(10)
    one.write(0x6071, 0, 100, "h")
    one.run(0.005)
    assert one.plant.steps[-1][0] == pytest.approx(0.143)


def test_blocked_axis(host: MakeHost) -> None:
    one = host(faults=Faults(stuck_from_s=0.05))
    one.enable(10)
    one.write(0x6071, 0, 50, "h")
    one.run(0.05)
    position = one.read(0x6064, code="i")
    assert position > 0
    one.run(0.1)
    assert one.read(0x6064, code="i") == position
    assert one.read(0x6077, code="h") == 50


def test_wrong_encoder_sign_runs_away_into_overspeed(host: MakeHost) -> None:
    one = host(faults=Faults(encoder_sign=-1))
    one.gains()
    one.write(0x6080, 0, 300, "I")
    one.enable(3)
    one.write(0x60FF, 0, 1000, "i")
    one.run(2.0)
    assert one.state() == DriveState.FAULT
    assert one.of(0x81)[0][:2] == bytes.fromhex("0084")
    assert one.plant.velocity_rad_s * one.read(0x606C, code="i") < 0


def test_encoder_step(host: MakeHost) -> None:
    one = host(faults=Faults(encoder_step_at_s=0.01, encoder_step_counts=-300))
    one.run(0.009)
    assert one.read(0x6064, code="i") == 0
    one.run(0.02)
    assert one.read(0x6064, code="i") == -300


def test_pulled_cable_leaves_the_last_torque_until_guarding_acts(host: MakeHost) -> None:
    one = host(faults=Faults(silent_from_s=0.1))
    one.gains()
    one.write(0x100C, 0, 50, "H")
    one.write(0x100D, 0, 1, "B")
    one.enable(10)
    one.write(0x6071, 0, 20, "h")
    for _ in range(20):
        one.send(0x701, rtr=True)
        one.run(0.01)
        if one.bus.clock.now() == pytest.approx(0.1):
            one.frames()
    assert one.frames() == []
    assert one.plant.steps[120][0] == pytest.approx(20 * 1.43e-3)  # nobody has told it
    one.run(1.0)
    assert one.state() == DriveState.FAULT
    assert abs(one.plant.velocity_rad_s) < 0.5


def test_refused_mode_shows_in_6061h_only(host: MakeHost) -> None:
    one = host(faults=Faults(refused_modes=frozenset({10})))
    one.write(0x6060, 0, 10, "b")
    assert (one.read(0x6060), one.read(0x6061)) == (10, 1)


@pytest.mark.parametrize(("options", "text"), [({"node_id": 128}, "1 to 127"), ({"setpoint_delay_s": -1e-3}, "0 or more")])
def test_impossible_drives(options: dict[str, float], text: str) -> None:
    bus = LockstepBus()
    with pytest.raises(UsageError, match=text):
        VirtualDrive(bus, RigidPlant(), **options)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="reference, cmmp-as"):
        VirtualDrive(bus, RigidPlant(), "acme")
    bus.shutdown()


def session(host: MakeHost, seed: int) -> tuple[str, list[tuple[int, bytes]]]:
    """A short recording with noise, faults and every kind of frame."""
    one = host(seed=seed, torque_noise_nm=6e-3, faults=Faults(drop_tpdo=frozenset({7})))
    log: FrameHash = FrameHash()
    one.bus.on_frame = log
    sent = one.map(1, True, [0x60400010, TARGET_TORQUE])
    one.map(1, False, [POSITION, TORQUE, STATUS])
    one.map(2, False, [0x606C0020], sync_type=255)
    one.write(0x1017, 0, 25, "H")
    one.enable(10)
    one.operational()
    frames: list[tuple[int, bytes]] = []
    random = np.random.default_rng(1)
    for _ in range(300):
        one.send(SYNC)
        one.send(sent, struct.pack("<Hh", 0x0F, int(random.integers(-100, 100))))
        one.run(0.001)
        frames += one.frames()
    return log.hexdigest(), frames


def test_same_seed_and_frames_give_the_same_bytes(host: MakeHost) -> None:
    first, second, other = session(host, 5), session(host, 5), session(host, 6)
    assert first == second
    assert len(first[1]) > 500
    assert other[0] != first[0]


def test_two_drives_on_one_bus(host: MakeHost) -> None:
    first = host(node_id=1)
    second = host(node_id=2, bus=first.bus)
    first.frames()
    second.write(0x6071, 0, 5, "h")
    assert first.read(0x6071) == 0
    first.write(0x1017, 0, 10, "H")
    second.write(0x1016, 1, 1 << 16 | 30, "I")
    second.enable(10)
    first.run(0.1)
    assert second.state() == DriveState.OPERATION_ENABLED
    first.write(0x1017, 0, 0, "H")
    first.run(1.5)
    assert second.state() == DriveState.FAULT  # it consumed the other drive's heartbeat
