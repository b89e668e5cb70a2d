"""What doctor leaves alone: only questions go out, the drive stays as it was; and drives that stop answering or answer nonsense."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from beltcomm import api
from beltcomm.drive import find_adapters
from beltcomm.drive.finding import Finding
from beltcomm.errors import UsageError
from beltcomm.virtual.bus import Frame, LockstepBus
from beltcomm.virtual.faults import Faults
from beltcomm_adapters.examination.can import examine_bus
from doctor.setups import Bench

Start = Callable[[Bench], LockstepBus]

#: Client commands that ask (CiA 301, 7.2.4.3): begin an upload, upload a segment, abort.
QUESTIONS = (2, 3, 4)
#: What is tried and put back: PDOs, limits and ramps.
TRIED = {*range(0x1400, 0x1C00), 0x605A, 0x6065, 0x6066, 0x6072, 0x607D, 0x6080, 0x6083, 0x6084, 0x6085, 0x6087, 0x60C0, 0x60C2}


@pytest.fixture
def start() -> Iterator[Start]:
    """Opens the bus of a bench; it is shut down at the end of the test."""
    opened: list[LockstepBus] = []

    def bus(bench: Bench) -> LockstepBus:
        opened.append(bench.bus("test"))
        return opened[-1]

    yield bus
    for one in opened:
        one.shutdown()


def examined(bus: LockstepBus, **options: Any) -> list[Finding]:
    return list(examine_bus(bus, bus.clock, None, 1_000_000, None, options))


def dump(bus: LockstepBus) -> dict[tuple[int, int], bytes]:
    """Every object that can be changed, read with bare frames; process values that move by themselves are left out."""
    places = [(index, 0) for index in (0x1005, 0x100C, 0x100D, 0x1017, 0x6040, 0x605A, 0x6060, 0x6065, 0x6071, 0x6072, 0x6080, 0x6085)]
    for base in (0x1400, 0x1600, 0x1800, 0x1A00):
        places += [(base + number, part) for number in range(4) for part in range(5)]
    places += [(0x1016, 1), (0x60C2, 1), (0x6094, 1), (0x6094, 2), (0x6510, 0x10), (0x607D, 1), (0x607D, 2)]
    found = {}
    for index, part in places:
        bus.send(can.Message(arbitration_id=0x601, data=struct.pack("<BHBI", 0x40, index, part, 0), is_extended_id=False))
        while (message := bus.recv(0.01)) is not None:
            if message.arbitration_id == 0x581:
                found[index, part] = bytes(message.data)
    return found


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_questions_are_sent_and_what_is_tried_is_put_back(profile: str, start: Start) -> None:
    bus = start(Bench(profile))
    sent: list[Frame] = []
    bus.on_frame = lambda frame: sent.append(frame) if frame[3].startswith("host") else None
    before = dump(bus)
    sent.clear()
    assert len(examined(bus)) > 20
    remote = [frame for frame in sent if frame[3] == "host rtr"]
    assert [frame[1] for frame in remote] == [0x701]  # node guarding, once
    data = [frame for frame in sent if frame[3] == "host"]
    assert {frame[1] & 0x780 for frame in data} == {0x600}
    written = {struct.unpack_from("<H", frame[2], 1)[0] for frame in data if frame[2][0] >> 5 not in QUESTIONS}
    assert written <= TRIED
    assert dump(bus) == before


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
@pytest.mark.parametrize("state", [0x7F, 0x05])
def test_the_sync_test_puts_everything_back(profile: str, state: int, start: Start) -> None:
    bus = start(Bench(profile))
    if state == 0x05:
        bus.send(can.Message(arbitration_id=0, data=b"\x01\x01", is_extended_id=False))
    before = dump(bus)
    (sync,) = [finding for finding in examined(bus, sync_test=True) if finding.area == "timing"]
    assert (sync.state, sync.values["lost"], sync.values["cycles"]) == ("ok", 0, 1000)
    assert dump(bus) == before
    bus.send(can.Message(arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False))
    answers = [message.data[0] & 0x7F for message in iter(lambda: bus.recv(0.01), None) if message.arbitration_id == 0x701]
    assert answers == [state]


def test_life_guarding_that_is_set_is_not_armed(start: Start) -> None:
    """The first remote frame arms it (F1 p43): a drive that then hears no second one would report that its master is lost."""
    bus = start(Bench("cmmp-as", Faults(readings={(0x100C, 0): 50, (0x100D, 0): 1})))
    findings = examined(bus)
    bus.clock.sleep_until(bus.clock.now() + 1.0)
    emergencies = [message for message in iter(lambda: bus.recv(0.0), None) if message.arbitration_id == 0x81]
    assert emergencies == []
    assert next(f for f in findings if (f.area, f.name) == ("watching", "host")).state == "unknown"


def test_a_drive_whose_stage_is_on_hears_no_sync(start: Start) -> None:
    """Somebody has enabled it by hand-made frames; doctor says so and asks on, but sends neither NMT nor SYNC."""
    bus = start(Bench())
    for word in (0x06, 0x07, 0x0F):
        bus.send(can.Message(arbitration_id=0x601, data=struct.pack("<BHBI", 0x2B, 0x6040, 0, word), is_extended_id=False))
        bus.clock.sleep_until(bus.clock.now() + 0.01)
    while bus.recv(0.0) is not None:
        pass
    sent: list[Frame] = []
    bus.on_frame = lambda frame: sent.append(frame) if frame[3] == "host" else None
    findings = {finding.name: finding for finding in examined(bus, sync_test=True)}
    assert findings["state"].text == "the power stage is on, and not by beltcomm: the drive is in Operation Enabled (6041h = 8637h)"
    assert findings["sync"].text == "SYNC was not tried: the power stage is not off"
    assert not {frame[1] for frame in sent} & {0x000, 0x080}


def test_a_cable_pulled_meanwhile_is_one_sentence(start: Start) -> None:
    # booted at 0.3 s, listened to for 0.3 s: some reads later
    findings = examined(start(Bench(faults=Faults(silent_from_s=1.3))))
    last = findings[-1]
    assert last.unreachable
    assert "the drive no longer answers: node 1 gave no valid answer to read of object" in last.text
    assert len([finding for finding in findings if finding.state == "wrong"]) == 1


class Babbling(LockstepBus):
    """A bus whose drive answers every question with 8 given bytes."""

    answer = bytes(8)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if msg.arbitration_id == 0x601:
            self._queue.append((self.tick / 1000, 0x581, self.answer))


@pytest.mark.parametrize(
    "answer", [bytes(8), b"\xff" * 8, b"\x80" + bytes(7), b"\x4f\x00\x10\x00\x05\x00\x00\x00", b"\x43\x41\x60\x00" + bytes(4), b""]
)
def test_nonsense_on_the_wire_never_raises(answer: bytes) -> None:
    bus = Babbling()
    bus.answer = answer
    findings = examined(bus)
    bus.shutdown()
    assert any(finding.state == "wrong" for finding in findings)
    assert all(finding.text for finding in findings)


def test_abort_codes_of_every_object_are_findings_not_errors(start: Start) -> None:
    """A drive that has hardly anything but 1000h, 6041h and its ratings: what it lacks is said, nothing raises."""
    bus = start(Bench())
    keep = {0x1000, 0x6041, 0x6064, 0x6072, 0x6075, 0x6076, 0x608F}
    send = LockstepBus.send

    def poor(msg: can.Message, timeout: float | None = None) -> None:
        index = int.from_bytes(msg.data[1:3], "little") if msg.arbitration_id == 0x601 else 0
        if index and index not in keep:
            abort = struct.pack("<BHBI", 0x80, index, msg.data[3], 0x06020000)
            bus._queue.append((bus.tick / 1000, 0x581, abort))
        else:
            send(bus, msg, timeout)

    bus.send = poor  # type: ignore[method-assign]
    findings = {(finding.area, finding.name): finding for finding in examined(bus, sync_test=True)}
    assert findings["node", "profile"].state == "warning"  # nothing to recognise it by: the generic profile
    assert findings["watching", "host"].text.startswith("the drive watches neither heartbeat (1016h) nor node guarding (100Ch)")
    assert findings["condition", "error history"].text == "the drive keeps no error history (1003h)"
    assert findings["units", "modes"].state == "wrong"
    assert not any(finding.unreachable for finding in findings.values())


def test_the_installed_virtual_drive_is_examined_by_the_public_function() -> None:
    result = api.doctor("virtual", "egc-70-600", options=api.Options(profile="cmmp-as"))
    assert result.exit_code == 0
    assert any("the drive could be enabled (2000h:1 bit 2)" in line for line in result.details)


@pytest.mark.parametrize(
    ("drive", "options", "words"),
    [
        ("nothing:here", api.Options(), "no adapter understands the drive 'nothing:here'"),
        ("virtual", api.Options(node=3), "the virtual drive has no option node"),
        ("virtual", api.Options(profile="none-such"), "none-such"),
        ("virtual:no_such_plant", api.Options(), "no_such_plant"),
        ("can:nonsense", api.Options(), "is no CAN interface"),
        ("can0", api.Options(seed=1), "a CAN drive has no option seed"),
        ("serial:", api.Options(), "say which serial port"),
    ],
)
def test_usage_errors_are_raised(drive: str, options: api.Options, words: str) -> None:
    with pytest.raises(UsageError, match=words.replace("(", r"\(")):
        api.doctor(drive, options=options)


def test_every_adapter_of_this_package_examines() -> None:
    assert [item.entry_point for item in find_adapters() if item.adapter is None or item.adapter.examine is None] == []


@pytest.mark.parametrize("given", [{"axis": "egc-70-600"}, {"try_bitrates": True}, {"sync_test": True}, {"options": api.Options(node=3)}])
def test_options_of_a_drive_need_a_drive(given: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="say which drive"):
        api.doctor(None, **given, found=[])


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ("slcan:/dev/no_such_port", "there is no serial port /dev/no_such_port"),
        ("kvaser:0", "the CAN interface 0 cannot be opened: "),
        ("can:pcan:PCAN_USBBUS1", "the CAN interface PCAN_USBBUS1 cannot be opened: "),
    ],
)
def test_adapters_that_are_not_there_are_sentences(drive: str, words: str) -> None:
    """Their makers' libraries are not installed where these tests run; kvaser's then fails with a NameError."""
    result = api.doctor(drive)
    assert result.exit_code == 5
    assert any(words in line for line in result.text)


class Deaf(LockstepBus):
    """A SocketCAN interface with nobody on the bus, its driver without berr-reporting: one error-passive frame, then a full queue."""

    room = 10

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.room -= 1
        if self.room < 0:
            raise can.CanOperationError("Failed to transmit: No buffer space available", 105)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.room == 9 and not getattr(self, "told", False):
            self.told = True
            return can.Message(arbitration_id=0x004, is_error_frame=True, data=b"\x00\x20" + bytes(6))
        return super().recv(timeout)


@pytest.mark.parametrize("told", [False, True])
def test_missing_acknowledgement_without_error_frames_of_its_own(told: bool) -> None:
    bus = Deaf()
    bus.told = told  # True: not even that frame
    last = examined(bus)[-1]
    bus.shutdown()
    assert last.unreachable
    wanted = "no node answers on beltcomm virtual bus at 1000 kbit/s" if told else "what is sent is acknowledged by nobody (ACK error)"
    assert last.text.startswith(wanted)
