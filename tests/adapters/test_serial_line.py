"""Objects over RS-232: types, refusals, and what is done about answers that are late, lost, cut, doubled or spoilt.

The expected lines follow the makers' pages (``?XXXXSU``, ``=XXXXSU:...``, ``!FFFFFFFF``); the drive is a stub of the tests' own.
"""

from __future__ import annotations

import random
import struct

import pytest

from adapters.stub_line import StubClock, StubLine
from beltcomm.errors import BeltcommError, BusError, DriveError, ObjectLocked, ObjectRefused
from beltcomm_adapters.serial_line import BITRATES, Abort, ObjectAnswer, SerialLine, Text, _parse
from beltcomm_adapters.serial_objects import SerialObjects


@pytest.fixture
def stub():
    return StubLine(StubClock())


@pytest.fixture
def objects(stub):
    return SerialObjects(SerialLine(stub, stub.clock))


# -- lines --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "line"),
    [
        (b"=606100:08", ObjectAnswer(0x6061, 0, b"\x08")),
        (b"=604100:1234", ObjectAnswer(0x6041, 0, b"\x34\x12")),
        (b"=60F902:FFFFFFFE", ObjectAnswer(0x60F9, 2, b"\xfe\xff\xff\xff")),
        (b"\n=604100:1234", ObjectAnswer(0x6041, 0, b"\x34\x12")),
        (b"!06010002", Abort(0x06010002)),
        (b"ERROR!", Text("ERROR!")),
        (b"=604100:123", Text("=604100:123")),  # cut to three digits: no width of any type
        (b"=60410:1234", Text("=60410:1234")),
        (b"=604100:12345", Text("=604100:12345")),
        (b"=604100:12 34", Text("=604100:12 34")),
        (b"=604100:12g4", Text("=604100:12g4")),
        (b"!0601000", Text("!0601000")),
        (b"", Text("")),
    ],
)
def test_a_line_is_a_value_a_refusal_or_text(raw, line):
    assert _parse(raw) == line


def test_no_bytes_make_the_parser_raise():
    rng = random.Random(1)
    seeds = [b"=606400:00001234", b"!06020000", b"ERROR!", b"2300:VERSION:0001.0000"]
    for _ in range(20_000):
        raw = bytearray(rng.choice(seeds) if rng.random() < 0.7 else rng.randbytes(rng.randrange(30)))
        for _ in range(rng.randrange(4)):
            if raw:
                raw[rng.randrange(len(raw))] = rng.randrange(256)
        line = _parse(bytes(raw))
        if isinstance(line, ObjectAnswer):  # what is taken for a value must be the line itself, in hex of the right width
            assert line.text.encode() == bytes(raw).strip(b" \n\t\0")


# -- values -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "digits", "value", "text"),
    [
        ("int8", 2, -2, "FE"),
        ("uint8", 2, 254, "FE"),
        ("int16", 4, -1000, "FC18"),
        ("uint16", 4, 65535, "FFFF"),
        ("int32", 8, -5, "FFFFFFFB"),
        ("uint32", 8, 0x65766173, "65766173"),
        ("real32", 8, 0.5, "3F000000"),
    ],
)
def test_values_travel_with_their_width_and_in_twos_complement(stub, objects, kind, digits, value, text):
    stub.put("607A00", 0, digits)
    objects.write(0x607A, 0, kind, value)
    assert stub.writes_of("607A00") == [f"=607A00:{text}"]
    assert objects.read(0x607A, 0, kind) == value


def test_a_refusal_has_its_code_and_is_believed_only_when_it_comes_twice(stub, objects):
    with pytest.raises(ObjectRefused, match=r"607Ah.*does not exist.*06020000h") as caught:
        objects.write(0x607A, 0, "int32", 1)
    assert caught.value.abort_code == 0x06020000
    assert objects.read_if_there(0x6502, 0, "uint32") is None
    stub.put("650200", 5, 8)
    spoilt = iter([b"!06020000\r"])
    stub.tamper = lambda _request, answer: next(spoilt, answer.encode() + b"\r")
    assert objects.read_if_there(0x6502, 0, "uint32") == 5


def test_texts_do_not_travel_and_motor_data_is_never_written(stub, objects):
    assert objects.read_text(0x1008) == ""
    with pytest.raises(ObjectLocked, match="never written"):
        objects.write(0x6410, 3, "uint16", 1)
    assert stub.requests == []


# -- what goes wrong ----------------------------------------------------------------------------------------------------


def test_a_late_answer_never_passes_for_that_to_a_later_request(stub, objects):
    """The drive counts its reads of one object; each read must return the count of its own request, however late answers come."""
    stub.put("606400", 0, 8)
    rng, count = random.Random(5), [0]

    def counted(request: str, answer: str) -> bytes:
        if request == "?606400":
            count[0] += 1
            return f"=606400:{count[0]:08X}\r".encode()
        return answer.encode() + b"\r"

    stub.tamper = counted
    stub.delay_s = lambda _request: rng.choice([0.002, 0.15, 0.25, 0.4])  # asked are 0.2 s and 17 ms of characters
    late = 0
    for _ in range(200):
        before = count[0]
        try:
            value = objects.read(0x6064, 0, "int32")
        except BusError:
            late += 1
            continue
        assert before < value <= count[0]
    assert late > 5


def test_a_write_whose_echo_is_lost_is_not_sent_again_when_the_drive_has_it(stub, objects):
    stub.put("604000", 0, 4)
    stub.tamper = lambda request, answer: None if request.startswith("=") else answer.encode() + b"\r"
    objects.write(0x6040, 0, "uint16", 0x1F)
    assert stub.writes_of("604000") == ["=604000:001F"]


def test_a_write_that_was_lost_is_sent_again(stub, objects):
    stub.put("604000", 0x0F, 4)
    lost = iter([True])

    class Deaf:
        def __call__(self, request: str, answer: str) -> bytes | None:
            if request.startswith("=") and next(lost, False):
                stub.put("604000", 0x0F, 4)  # as if it had not been heard
                return None
            return answer.encode() + b"\r"

    stub.tamper = Deaf()
    objects.write(0x6040, 0, "uint16", 0x1F)
    assert stub.writes_of("604000") == ["=604000:001F", "=604000:001F"]
    assert stub.objects["604000"] == (0x1F, 4)


def test_a_write_that_arrived_as_another_value_is_seen_and_mended(stub, objects):
    stub.put("607A00", 0, 8)
    spoil = iter([True])

    def spoilt(request: str, answer: str) -> bytes:
        if request.startswith("=") and next(spoil, False):
            stub.put("607A00", 0x9000, 8)
            return b"=607A00:00009000\r"
        return answer.encode() + b"\r"

    stub.tamper = spoilt
    objects.write(0x607A, 0, "int32", 0x1000)
    assert stub.objects["607A00"] == (0x1000, 8)


def test_a_drive_that_keeps_another_value_ends_in_words(stub, objects):
    stub.put("607A00", 7, 8)

    def stubborn(_request: str, answer: str) -> bytes:
        stub.put("607A00", 7, 8)
        return b"=607A00:00000007\r" if answer.startswith("=607A00") else answer.encode() + b"\r"

    stub.tamper = stubborn
    with pytest.raises(BusError, match=r"write 1 of object 607Ah.*it was not taken"):
        objects.write(0x607A, 0, "int32", 1)
    assert len(stub.writes_of("607A00")) == 2


def test_cut_and_spoilt_answers_are_asked_for_again_once(stub, objects):
    stub.put("606400", -5, 8)
    for broken in (b"=606400:FFFF\r", b"=6064", b"=606400:FFFFF#FB\r", b"=606C00:00000001\r", b"\r", b"ERROR!\r", b"x" * 500):
        first = iter([broken])
        stub.tamper = lambda _request, answer, first=first: next(first, answer.encode() + b"\r")
        assert objects.read(0x6064, 0, "int32") == -5
    stub.requests.clear()
    stub.tamper = lambda _request, _answer: b"=606400:FFFF\r"
    with pytest.raises(DriveError, match="6064h has 2 bytes, expected is int32"):
        objects.read(0x6064, 0, "int32")
    assert stub.requests == ["?606400"] * 2


def test_content_of_unknown_length_is_believed_when_two_answers_agree(stub, objects):
    stub.put("608000", 6000, 8)
    first = iter([b"=608000:1770\r"])
    stub.tamper = lambda _request, answer: next(first, answer.encode() + b"\r")
    assert objects.read_bytes(0x6080) == struct.pack("<I", 6000)


def test_an_interrupted_request_leaves_nothing_behind(stub, objects):
    stub.put("604100", 0x1234, 4)
    objects.read(0x6041, 0, "uint16")
    armed = iter([True])

    def then_interrupt(_request: str, answer: str) -> bytes:
        if next(armed, False):
            stub.interrupt = KeyboardInterrupt()
            return b"=604100:9999\r"
        return answer.encode() + b"\r"

    stub.tamper = then_interrupt
    with pytest.raises(KeyboardInterrupt):
        objects.read(0x6041, 0, "uint16")
    assert objects.read(0x6041, 0, "uint16") == 0x1234


def test_a_port_that_is_gone_and_a_line_that_never_falls_silent_are_told(stub, objects):
    stub.broken = True
    with pytest.raises(BusError, match="stub port does not send or receive"):
        objects.read(0x6041, 0, "uint16")
    stub.broken = False
    stub.read = lambda _timeout_s: (stub.clock.sleep_until(stub.clock.now() + 0.01), b"\x55")[1]
    with pytest.raises(BusError, match="talks on stub port without being asked"):
        objects.read(0x6041, 0, "uint16")


# -- commands -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bitrate", BITRATES)
def test_a_drive_is_found_at_any_bit_rate_behind_its_boot_text(stub, objects, bitrate):
    stub.drive_bitrate = bitrate
    stub.say(b"\r\nBOOT 2.1\r\nCRC OK\r\n=100000:12\r\n", 0.05)
    objects.find()
    assert stub.bitrate == bitrate
    objects.change_bitrate(115200)
    assert (stub.bitrate, stub.drive_bitrate) == (115200, 115200)
    objects.change_bitrate(9600)
    assert (stub.bitrate, stub.drive_bitrate) == (9600, 9600)


def test_a_silent_port_is_told_with_its_bit_rates(stub, objects):
    stub.drive_bitrate = 300
    with pytest.raises(BusError, match="no drive answers on stub port at 9600, 19200, 38400, 57600, 115200 bit/s"):
        objects.find()


def test_a_drive_that_keeps_its_bit_rate_is_followed(stub, objects):
    stub.locked = True
    objects.find()
    objects.change_bitrate(115200)
    assert stub.bitrate == stub.drive_bitrate == 9600
    assert objects.read(0x1000, 0, "uint32") == 0x00020192


def test_a_save_is_asked_for_once(stub, objects):
    objects.save()
    stub.delay_s = lambda _request: 8.0  # a save takes seconds
    objects.save()
    stub.tamper = lambda _request, _answer: b"ERROR!\r"
    with pytest.raises(DriveError, match="did not save"):
        objects.save()
    stub.tamper = lambda _request, _answer: None
    with pytest.raises(BusError, match="did not say within 15 s"):
        objects.save()
    assert stub.requests.count("SAVE!") == 4


def test_a_reset_leads_back_to_9600_and_its_boot_text_is_no_answer(stub, objects):
    objects.find()
    objects.change_bitrate(115200)
    objects.reset()
    assert stub.bitrate == 9600
    assert objects.version() == "0001.0007"


# -- anything at all ----------------------------------------------------------------------------------------------------


def test_whatever_the_wire_says_only_our_own_errors_come_out(stub, objects):
    """Answers mutated, cut, doubled, swapped and mixed with noise: each call returns what a drive could have or raises BeltcommError."""
    rng = random.Random(7)
    stub.put("606400", -123456, 8)
    stub.put("604100", 0x0637, 4)

    def mangled(_request: str, answer: str) -> bytes | None:
        raw = bytearray(answer.encode() + b"\r")
        what = rng.randrange(8)
        if what == 0:
            return None
        if what == 1:
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        elif what == 2:
            del raw[rng.randrange(len(raw)) :]
        elif what == 3:
            raw *= 2
        elif what == 4:
            raw = bytearray(rng.randbytes(rng.randrange(40)))
        elif what == 5:
            raw[rng.randrange(len(raw)) : 0] = rng.randbytes(rng.randrange(6))
        return bytes(raw)

    stub.tamper = mangled
    stub.delay_s = lambda _request: rng.choice([0.001, 0.01, 0.3])
    calls = (
        lambda: objects.read(0x6064, 0, "int32"),
        lambda: objects.read(0x6041, 0, "uint16"),
        lambda: objects.read_bytes(0x6064),
        lambda: objects.read_if_there(0x6502, 0, "uint32"),
        lambda: objects.write(0x6064, 0, "int32", -123456),
        lambda: objects.poll(0x6064, "int32"),
        objects.version,
        objects.save,
        objects.find,
        lambda: objects.change_bitrate(rng.choice(BITRATES)),
    )
    ended = {"well": 0, "in words": 0}
    for _ in range(1500):
        try:
            rng.choice(calls)()
            ended["well"] += 1
        except BeltcommError as error:
            ended["in words"] += bool(str(error))
    assert sum(ended.values()) == 1500
    assert min(ended.values()) > 100
