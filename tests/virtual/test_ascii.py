"""The drive's service language, text in and text out, against the examples of the makers' pages; and its port with characters in time."""

from __future__ import annotations

import random

import pytest

from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.service_port import BOOT_TEXT, ERROR, AsciiInterpreter, LineFaults, LockstepPort, ServicePort
from contract.conftest import RigidPlant


@pytest.fixture
def bus():
    with LockstepBus() as bus:
        yield bus


@pytest.fixture
def drive(bus):
    return VirtualDrive(bus, RigidPlant(), "cmmp-as")


@pytest.fixture
def asked(drive):
    return AsciiInterpreter(drive.objects, lambda _bitrate: None, lambda: None)


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("?100000", "=100000:00020192"),
        ("?606100", "=606100:01"),
        ("?651010", "=651010:0000"),
        ("=651010:0002", "=651010:0002"),  # F5 p164
        ("=606000:03", "=606000:03"),
        ("=60FF00:FFFFFC18", "=60FF00:FFFFFC18"),
        ("?555500", "!06020000"),
        ("?101809", "!06090011"),
        ("=606000:0003", "!06070012"),  # two bytes into one
        ("=607A00:03", "!06070013"),
        ("=604100:0000", "!06010002"),
        ("=606000:63", "!06090030"),
        ("?100800", "!06010000"),  # a text
        ("VERSION?", "2300:VERSION:0001.0000"),
        ("SAVE!", "DONE"),
        ("BAUD115200", None),
        ("RESET!", None),
        *((line, ERROR) for line in ("", "?6041", "?6041000", "=604000:001", "=604000", "?604G00", "?6041 00", "BAUD1", "OR:0010", "\xff")),
    ],
)
def test_each_line_has_its_answer(asked, line, answer):
    assert asked.answer(line) == answer


def test_what_is_written_over_the_line_moves_the_same_drive(asked, drive, bus):
    """The sequence of F5 p164: control to the bus, then step by step to Operation Enabled."""
    bus.clock.sleep_until(0.1)
    seen = []
    for line in ("=651010:0002", "=604000:0006", "=604000:0007", "=604000:000F"):
        assert asked.answer(line) == line
        bus.advance()
        answer = asked.answer("?604100")
        assert answer is not None
        seen.append(int(answer[-4:], 16) & 0x6F)
    assert seen == [0x40, 0x21, 0x23, 0x27]
    assert drive.state.name == "OPERATION_ENABLED"
    assert asked.answer("SAVE!") == ERROR  # not with the stage on


def test_no_line_makes_the_interpreter_raise(asked):
    rng = random.Random(11)
    seeds = ["?604100", "=607A00:00001234", "=606000:01", "BAUD115200", "SAVE!", "VERSION?", "=101001:65766173"]
    characters = "".join(map(chr, range(32, 256)))
    for _ in range(8000):
        line = list(rng.choice(seeds))
        for _ in range(rng.randrange(5)):
            if line:
                line[rng.randrange(len(line))] = rng.choice("0123456789ABCDEF:=?!" if rng.random() < 0.7 else characters)
        answer = asked.answer("".join(line[: rng.randrange(1, 20)]))
        assert answer is None or answer.isascii()


def test_characters_take_their_time(bus, drive):
    """A read of 4 bytes: 8 characters there, 17 back, 10 bits each; at 9600 bit/s 26 ms, and half a millisecond of the firmware."""
    port = ServicePort(bus, drive)
    end = LockstepPort(bus, port)
    begun = bus.clock.now()
    end.write(b"?606400\r")
    got = b""
    while not got.endswith(b"\r"):
        got += end.read(1.0)
    assert got == b"=606400:00000000\r"
    assert bus.clock.now() - begun == pytest.approx(25 * 10 / 9600 + 0.5e-3, abs=2e-3)  # ticks of 1 ms


def test_another_bit_rate_garbles_and_a_reset_leads_back(bus, drive):
    port = ServicePort(bus, drive, LineFaults(seed=4))
    end = LockstepPort(bus, port)
    end.write(b"BAUD57600\r")
    assert end.read(0.1) == b""
    end.write(b"?100000\r")
    assert b"=100000" not in end.read(0.2)
    end.bitrate = 57600
    end.write(b"\r")
    while end.read(0.05):
        pass
    end.write(b"RESET!\r")
    assert end.read(0.05) == b""
    end.bitrate = 9600
    text = b""
    while chunk := end.read(0.3):
        text += chunk
    assert text.decode() == BOOT_TEXT


def test_a_closed_port_is_an_error(bus, drive):
    end = LockstepPort(bus, ServicePort(bus, drive))
    end.close()
    with pytest.raises(OSError, match="closed"):
        end.write(b"?100000\r")
