"""Somebody else's CANopen master on our drive: the stock python-canopen client with its own CiA 402 class, in real time.

The drive is served as ``beltcomm serve --realtime`` does it, on a channel of python-can's virtual interface; python-canopen's Notifier
thread receives.  No object dictionary file: what the client knows of the drive is written down here from docs/reference-drive.md.
Times are long because the machine that runs this may be busy; what is asked is what happens, not how fast.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator

import can
import canopen
import pytest
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402
from canopen.sdo.exceptions import SdoAbortedError

from wire.decoder import lockstep
from wire.rig import ServedDrive
from wire.rules import Judge

WAIT_S = 10.0
SYNC_S = 0.01
COUNTS = 65536
KINDS = {
    "u8": datatypes.UNSIGNED8,
    "u16": datatypes.UNSIGNED16,
    "u32": datatypes.UNSIGNED32,
    "i8": datatypes.INTEGER8,
    "i16": datatypes.INTEGER16,
    "i32": datatypes.INTEGER32,
    "f32": datatypes.REAL32,
    "str": datatypes.VISIBLE_STRING,
}
VARIABLES = {
    0x1000: "u32", 0x1001: "u8", 0x1008: "str", 0x1009: "str", 0x100A: "str", 0x100C: "u16", 0x100D: "u8", 0x1017: "u16",
    0x603F: "u16", 0x6040: "u16", 0x6041: "u16", 0x605A: "i16", 0x6060: "i8", 0x6061: "i8", 0x6064: "i32", 0x606C: "i32",
    0x6072: "u16", 0x607A: "i32", 0x6081: "u32", 0x6083: "u32", 0x6084: "u32", 0x6085: "u32", 0x60FF: "i32", 0x6502: "u32",
}  # fmt: skip
RECORDS = {
    0x1003: ("u32", 4), 0x1010: ("u32", 1), 0x1011: ("u32", 1), 0x1016: ("u32", 1), 0x1018: ("u32", 4), 0x607D: ("i32", 2),
    0x2100: ("f32", 15),
}  # fmt: skip


class Node(BaseNode402):
    """The stock class, with time for a busy machine."""

    TIMEOUT_RESET_FAULT = 0.1  # it waits for nothing, issue 261 of python-canopen
    TIMEOUT_SWITCH_OP_MODE = TIMEOUT_SWITCH_STATE_FINAL = TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_CHECK_TPDO = WAIT_S


def dictionary() -> canopen.ObjectDictionary:
    """What the client knows of the drive."""
    made = canopen.ObjectDictionary()

    def variable(index: int, part: int, kind: str) -> ODVariable:
        found = ODVariable(f"{index:04X}_{part}", index, part)
        found.data_type = KINDS[kind]
        return found

    for index, kind in VARIABLES.items():
        made.add_object(variable(index, 0, kind))
    for index, (kind, count) in RECORDS.items():
        record = ODArray(f"{index:04X}", index)
        for part in range(count + 1):
            record.add_member(variable(index, part, "u8" if part == 0 else kind))
        made.add_object(record)
    for base in (0x1400, 0x1800, 0x1600, 0x1A00):
        for index in range(base, base + 4):
            pdo = ODRecord(f"{index:04X}", index)
            parts = dict(enumerate(["u8", "u32", "u8", "u16"])) | {5: "u16"} if base in (0x1400, 0x1800) else {0: "u8"}
            parts |= dict.fromkeys(range(1, 9), "u32") if base in (0x1600, 0x1A00) else {}
            for part, kind in parts.items():
                pdo.add_member(variable(index, part, kind))
            made.add_object(pdo)
    return made


class Rig(ServedDrive):
    """The served drive and the other's master."""

    def __init__(self, channel: str) -> None:
        super().__init__(channel, by_sync=False)
        self.network = canopen.Network(can.Bus(interface="virtual", channel=channel))
        self.node = Node(1, dictionary())
        self.node.sdo.RESPONSE_TIMEOUT = WAIT_S
        self.boots = 0
        self.node.nmt.add_heartbeat_callback(self._on_state)
        self.network.add_node(self.node)
        self.network.connect()

    def _on_state(self, state: int) -> None:
        self.boots += state == 0

    def reset(self, how: str = "RESET") -> None:
        """Reset the node and await its boot-up message (the client's own wait misses one that comes before it)."""
        boots = self.boots
        self.node.nmt.state = how
        self.await_(lambda: self.boots > boots)

    def close(self) -> None:
        self.network.sync.stop()
        self.node.nmt.stop_node_guarding()
        super().close()
        self.network.disconnect()

    def await_(self, done: Callable[[], bool]) -> None:
        """Raises AssertionError when it does not come true in time."""
        end_s = time.monotonic() + WAIT_S
        while not done():
            assert time.monotonic() < end_s
            time.sleep(0.005)

    def ready(self) -> None:
        """Gains for the rigid machine, PDOs remapped, operational, SYNC every 10 ms: the way into every motion here."""
        node = self.node
        for part, value in ((1, 0.2), (2, 2.0), (3, 20.0)):
            node.sdo[0x2100][part].raw = value
        for index in (0x6083, 0x6084, 0x6085):
            node.sdo[index].raw = 40 * COUNTS
        node.tpdo.read()
        node.rpdo.read()
        node.rpdo[1].clear()
        node.rpdo[1].add_variable(0x6040)
        node.rpdo[1].add_variable(0x6060)
        node.rpdo[1].trans_type, node.rpdo[1].enabled = 255, True
        node.tpdo[1].clear()
        for index in (0x6041, 0x6061, 0x6064):
            node.tpdo[1].add_variable(index)
        node.tpdo[1].trans_type, node.tpdo[1].enabled = 1, True
        node.tpdo.save()
        node.rpdo.save()
        node.nmt.state = "OPERATIONAL"
        self.network.sync.start(SYNC_S)
        node.setup_402_state_machine(read_pdos=False)
        self.await_(lambda: node.tpdo[1].is_received)


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    made = Rig(request.node.name)
    yield made
    made.close()


@pytest.fixture
def running(rig: Rig) -> Rig:
    rig.start()
    rig.await_(lambda: rig.boots == 1)
    return rig


def refused(code: int) -> object:
    return pytest.raises(SdoAbortedError, match=f"0x{code:08X}")


def test_boot_up_scan_and_reset(running):
    node = running.node
    assert node.nmt.state == "PRE-OPERATIONAL"
    running.network.scanner.search()
    running.await_(lambda: running.network.scanner.nodes == [1])
    for reset in ("RESET", "RESET COMMUNICATION"):
        running.reset(reset)
        assert node.nmt.state == "PRE-OPERATIONAL"
    node.nmt.state = "STOPPED"  # no SDO there, CiA 301 7.3.2.2.4
    node.sdo.RESPONSE_TIMEOUT = 0.2
    with pytest.raises(canopen.SdoCommunicationError):
        _ = node.sdo[0x1000].raw
    node.nmt.state = "PRE-OPERATIONAL"
    node.sdo.RESPONSE_TIMEOUT = WAIT_S
    assert node.sdo[0x1000].raw == 0x20192


def test_sdo_up_and_down_expedited_and_segmented(running):
    sdo = running.node.sdo
    assert sdo[0x1008].raw == "beltcomm reference drive"  # 24 bytes: four segments
    assert len(sdo.upload(0x100A, 0)) == 3
    assert [sdo[0x1018][part].raw for part in (1, 2)] == [0, 1]
    sdo[0x6081].raw = 12345
    assert sdo[0x6081].raw == 12345
    sdo.download(0x6081, 0, (54321).to_bytes(4, "little"), force_segment=True)
    assert sdo[0x6081].raw == 54321
    sdo[0x2100][1].raw = 0.125
    assert sdo[0x2100][1].raw == 0.125
    with sdo[0x1008].open("r", encoding="ascii") as text:
        assert text.read() == "beltcomm reference drive"


def test_sdo_is_refused_by_the_standards_codes(running):
    sdo = running.node.sdo
    with refused(0x06020000):
        sdo.upload(0x5FFF, 0)
    with refused(0x06090011):
        sdo.upload(0x1018, 9)
    with refused(0x06010002):
        sdo.download(0x6041, 0, b"\0\0")
    with refused(0x06010002):
        sdo.download(0x1008, 0, b"another name", force_segment=True)
    with refused(0x06070012):
        sdo.download(0x6040, 0, b"\0\0\0\0")
    with refused(0x06070013):
        sdo.download(0x6081, 0, b"\0")
    with refused(0x06090030):
        sdo[0x6060].raw = 99
    with sdo[0x1008].open("rb", block_transfer=True) as text:
        assert text.read() == b"beltcomm reference drive"
    assert sdo[0x1008].raw == "beltcomm reference drive"


def test_store_and_restore(running):
    node = running.node
    node.sdo[0x6081].raw = 777
    node.store()
    running.reset()
    assert node.sdo[0x6081].raw == 777
    node.restore()
    running.reset()
    assert node.sdo[0x6081].raw != 777


def test_remapped_pdos_follow_sync_and_stop_without_it(running):
    running.ready()
    node, tpdo = running.node, running.node.tpdo[1]
    assert tpdo.wait_for_reception(WAIT_S) is not None
    assert (tpdo[0x6064].raw, tpdo[0x6061].raw) == (0, 1)
    running.network.sync.stop()
    time.sleep(0.1)
    before = tpdo.timestamp
    time.sleep(0.1)
    assert tpdo.timestamp == before
    node.tpdo[1].trans_type = 255  # now on change: the statusword answers the controlword
    node.tpdo.save()
    node.tpdo[1].is_received = False
    node.sdo[0x6040].raw = 0x06
    running.await_(lambda: node.tpdo[1].is_received and node.tpdo[1][0x6041].raw & 0x6F == 0x21)
    with refused(0x08000022):  # a mapping is changed while it is not valid only
        node.sdo[0x1A00][0].raw = 1


def test_heartbeat_and_node_guarding(running):
    node = running.node
    node.sdo[0x1017].raw = 20
    assert [node.nmt.wait_for_heartbeat(WAIT_S) for _ in range(3)] == ["PRE-OPERATIONAL"] * 3
    node.sdo[0x1017].raw = 0
    node.nmt.state = "OPERATIONAL"
    node.nmt.start_node_guarding(0.02)
    assert node.nmt.wait_for_heartbeat(WAIT_S) == "OPERATIONAL"
    running.await_(lambda: sum(i == 0x701 and data in (b"\x05", b"\x85") for _, i, data, _ in running.seen) >= 4)
    answers = [data for _, i, data, who in running.seen if i == 0x701 and data and data[0] & 0x7F == 5 and who == "node"]
    assert all(a != b for a, b in itertools.pairwise(answers))  # the toggle bit, CiA 301 7.2.8.3.2.1


@pytest.mark.parametrize("kind", ["guarding", "heartbeat"])
def test_a_master_that_falls_silent_is_found_out(running, kind):
    running.ready()
    node = running.node
    if kind == "guarding":
        node.sdo[0x100C].raw, node.sdo[0x100D].raw = 100, 5
        node.nmt.start_node_guarding(0.05)
        stop = node.nmt.stop_node_guarding
    else:
        node.sdo[0x1016][1].raw = 127 << 16 | 500
        stop = running.network.send_periodic(0x77F, b"\x05", 0.05).stop
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    node.sdo[0x60FF].raw = COUNTS
    assert not node.emcy.active
    running.await_(lambda: running.plant.velocity_rad_s > 1.0)
    stop()
    running.await_(lambda: [error.code for error in node.emcy.active] == [0x8130])
    running.await_(lambda: node.state == "FAULT" and abs(running.plant.velocity_rad_s) < 0.5)


def test_moves_in_three_modes_then_a_fault_and_its_reset(running):
    """The state machine through BaseNode402: profile position, profile velocity, cyclic synchronous position, fault, reset."""
    running.ready()
    node, tpdo = running.node, running.node.tpdo[1]
    node.sdo[0x100C].raw, node.sdo[0x100D].raw = 200, 10
    node.nmt.start_node_guarding(0.1)
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.sdo[0x6081].raw = 2 * COUNTS
    node.sdo[0x607A].raw = COUNTS // 2
    node.controlword = 0x1F  # new setpoint
    running.await_(lambda: node.statusword & 0x1400 == 0x1400)  # acknowledged, reached
    assert tpdo[0x6064].raw == pytest.approx(COUNTS // 2, abs=COUNTS // 100)
    node.controlword = 0x0F

    node.op_mode = "PROFILED VELOCITY"
    assert node.op_mode == "PROFILED VELOCITY"
    node.sdo[0x60FF].raw = -COUNTS
    running.await_(lambda: running.plant.velocity_rad_s == pytest.approx(-6.283, rel=0.05))
    node.sdo[0x60FF].raw = 0
    running.await_(lambda: abs(running.plant.velocity_rad_s) < 0.05)
    node.state = "SWITCHED ON"

    here = tpdo[0x6064].raw
    node.sdo[0x607A].raw = here
    node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    node.state = "OPERATION ENABLED"
    for step in range(1, 41):  # in small steps, as a cyclic master does
        node.sdo[0x607A].raw = here + 100 * step
    running.await_(lambda: abs(tpdo[0x6064].raw - here - 4000) < 200)

    node.sdo[0x607D][2].raw = here + 5000
    node.sdo[0x607D][1].raw = -COUNTS * 100
    node.op_mode = "PROFILED VELOCITY"
    node.sdo[0x60FF].raw = 2 * COUNTS
    running.await_(lambda: bool(node.emcy.active))
    assert [error.code for error in node.emcy.active] == [0x8612]
    running.await_(lambda: node.state == "FAULT")
    assert node.sdo[0x603F].raw == node.sdo[0x1003][1].raw & 0xFFFF == 0x8612
    assert node.sdo[0x1001].raw & 1
    node.sdo[0x60FF].raw = 0
    node.reset_from_fault()
    assert node.state == "OPERATION ENABLED"
    running.await_(lambda: not node.emcy.active)
    node.sdo[0x607D][2].raw = node.sdo[0x607D][1].raw  # no software limits
    node.sdo[0x6085].raw = 2 * COUNTS  # a ramp of a second: at standstill the state would be over before a busy client has seen it
    node.sdo[0x60FF].raw = 2 * COUNTS
    running.await_(lambda: running.plant.velocity_rad_s == pytest.approx(12.566, rel=0.05))
    node.state = "QUICK STOP ACTIVE"
    running.await_(lambda: node.state == "SWITCH ON DISABLED")  # 605Ah = 2: brakes, then takes the stage off by itself
    report = Judge(faults=True).of(lockstep(running.seen))
    assert report.rules == {"restored"}  # this test leaves its settings behind
