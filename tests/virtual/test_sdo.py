"""SDO server: byte sequences of CiA 301, 7.2.4.3, and every abort code it gives."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Callable

import pytest

from beltcomm.virtual.dictionary import ObjectDictionary, ObjectRow
from beltcomm.virtual.sdo import SdoServer
from virtual.host import Abort, Host

MakeHost = Callable[..., Host]


def code_of(call: Callable[[], object]) -> int:
    with pytest.raises(Abort) as caught:
        call()
    return int(caught.value.args[0])


def test_expedited_upload_of_each_length(host: MakeHost) -> None:
    one = host()
    assert one.ask(bytes.fromhex("4061600000000000")) == bytes.fromhex("4F61600001000000")  # u8/i8: 6061h = 1
    assert one.ask(bytes.fromhex("405A600000000000")) == bytes.fromhex("4B5A600002000000")  # 605Ah = 2
    assert one.ask(bytes.fromhex("4000100000000000")) == bytes.fromhex("4300100092010200")  # 1000h = 00020192h


def test_expedited_download_of_each_length(host: MakeHost) -> None:
    one = host()
    for request in ("2F60600003000000", "2B71600034120000", "23FF6000FFFFFFFF", "2371600078560000"):
        if request.startswith("2371"):
            assert one.ask(bytes.fromhex(request)) == bytes.fromhex("8071600012000706")  # four bytes into an i16
        else:
            assert one.ask(bytes.fromhex(request)) == bytes.fromhex("60" + request[2:8] + "00000000")
    assert one.read(0x6061, code="b") == 3
    assert one.read(0x6071) == 0x1234
    assert one.read(0x60FF, code="i") == -1


def test_expedited_download_without_a_size_takes_the_object_s_length(host: MakeHost) -> None:
    one = host()
    assert one.ask(bytes.fromhex("2271600022110000")) == bytes.fromhex("6071600000000000")
    assert one.read(0x6071) == 0x1122


def test_segmented_upload_of_a_string(host: MakeHost) -> None:
    one = host()
    assert one.ask(bytes.fromhex("4008100000000000")) == bytes.fromhex("4108100018000000")  # 24 characters follow
    segments = [one.ask(bytes((first, *(0,) * 7))) for first in (0x60, 0x70, 0x60, 0x70)]
    assert [segment[0] for segment in segments] == [0x00, 0x10, 0x00, 0x19]  # toggle; last: 4 bytes unused and c = 1
    assert b"".join(segment[1:] for segment in segments)[:24] == b"beltcomm reference drive"


def test_segmented_download(host: MakeHost) -> None:
    one = host()
    assert one.ask(bytes.fromhex("21FF600004000000")) == bytes.fromhex("60FF600000000000")
    assert one.ask(bytes.fromhex("0778563412000000")) == bytes.fromhex("2000000000000000")  # 3 unused, last
    assert one.read(0x60FF) == 0x12345678


def test_segmented_download_in_two_segments_with_toggle(host: MakeHost) -> None:
    one = host()
    one.ask(bytes.fromhex("20FF600000000000"))  # size not told
    assert one.ask(bytes.fromhex("0A78560000000000"))[0] == 0x20
    assert one.ask(bytes.fromhex("1B34120000000000"))[0] == 0x30
    assert one.read(0x60FF) == 0x12345678


def test_toggle_bit_not_alternated(host: MakeHost) -> None:
    one = host()
    one.ask(bytes.fromhex("4008100000000000"))
    assert one.ask(bytes((0x70, *(0,) * 7))) == bytes.fromhex("8008100000000305")
    assert one.ask(bytes((0x60, *(0,) * 7)))[4:] == bytes.fromhex("01000405")  # the transfer is gone


def test_client_abort_ends_the_transfer_without_an_answer(host: MakeHost) -> None:
    one = host()
    one.ask(bytes.fromhex("4008100000000000"))
    one.send(0x601, bytes.fromhex("8008100000000405"))
    assert one.of(0x581) == []
    assert one.ask(bytes((0x60, *(0,) * 7)))[0] == 0x80


def test_frames_that_are_not_eight_bytes_are_ignored(host: MakeHost) -> None:
    one = host()
    one.send(0x601, bytes.fromhex("40001000"))
    assert one.of(0x581) == []


def test_an_unknown_command_is_refused_for_the_object_it_names(host: MakeHost) -> None:
    assert host().ask(bytes((0xE0, 0x08, 0x10, *(0,) * 5))) == bytes.fromhex("8008100001000405")


def test_block_upload(host: MakeHost) -> None:
    one = host()
    text = b"beltcomm reference drive"
    assert one.ask(bytes.fromhex("A408100005000000")) == bytes.fromhex("C6081000") + struct.pack("<I", len(text))
    one.send(0x601, bytes.fromhex("A300000000000000"))
    segments = one.of(0x581)
    assert [segment[0] for segment in segments] == [1, 2, 3, 0x84]
    assert b"".join(segment[1:] for segment in segments).rstrip(b"\0") == text
    one.send(0x601, bytes.fromhex("A202050000000000"))  # the third was lost
    again = one.of(0x581)
    assert [segment[0] for segment in again] == [1, 0x82]
    assert again[0] == bytes((1, *text[14:21]))
    end = one.ask(bytes.fromhex("A202050000000000"))
    assert end[0] == 0xC1 | 4 << 2
    assert struct.unpack_from("<H", end, 1)[0] == crc_hqx(text, 0)
    one.send(0x601, bytes.fromhex("A100000000000000"))
    assert one.of(0x581) == []


@pytest.mark.parametrize("spoilt", [False, True])
def test_block_download(host: MakeHost, spoilt: bool) -> None:
    one = host()
    value = struct.pack("<I", 4711)
    assert one.ask(bytes.fromhex("C681600004000000"))[:5] == bytes.fromhex("A48160007F")
    assert one.ask(b"\x81" + value + bytes(3)) == bytes.fromhex("A2017F0000000000")
    crc = crc_hqx(value, 0) ^ spoilt
    answer = one.ask(struct.pack("<BH5x", 0xC1 | 3 << 2, crc))
    assert answer == bytes.fromhex("8081600004000405" if spoilt else "A100000000000000")
    assert (one.read(0x6081) == 4711) is not spoilt


def test_abort_codes_of_addressing_and_access(host: MakeHost) -> None:
    one = host()
    assert code_of(lambda: one.read(0x2FFF)) == 0x06020000
    assert code_of(lambda: one.read(0x2100, 16)) == 0x06090011
    assert code_of(lambda: one.write(0x6041, 0, 0, "H")) == 0x06010002
    assert code_of(lambda: one.write(0x1000, 0, 0, "I")) == 0x06010002
    assert one.ask(bytes.fromhex("2108100018000000"))[4:] == bytes.fromhex("02000106")  # segmented into a constant


def test_reading_a_write_only_object() -> None:
    server = SdoServer(ObjectDictionary([ObjectRow(0x2000, 0, "u8", "wo", 0, "key")]))
    assert server.answer(bytes.fromhex("2F00200005000000")) == [bytes.fromhex("6000200000000000")]
    assert server.answer(bytes.fromhex("4000200000000000")) == [bytes.fromhex("8000200001000106")]


def test_abort_codes_of_length(host: MakeHost) -> None:
    one = host()
    assert code_of(lambda: one.write(0x6040, 0, 0, "B")) == 0x06070013
    assert code_of(lambda: one.write(0x6040, 0, 0, "I")) == 0x06070012
    assert one.ask(bytes.fromhex("21FF600008000000"))[4:] == bytes.fromhex("12000706")  # announced too long
    assert one.ask(bytes.fromhex("21FF600002000000"))[4:] == bytes.fromhex("13000706")
    one.ask(bytes.fromhex("20FF600000000000"))
    answers = [one.ask(bytes((toggle, *(1,) * 7)))[0] for toggle in (0x00, 0x10) * 5]
    assert 0x80 in answers  # an endless download is cut


def test_abort_codes_of_values(host: MakeHost) -> None:
    one = host()
    assert code_of(lambda: one.write(0x605D, 0, 3, "h")) == 0x06090031
    assert code_of(lambda: one.write(0x60C2, 1, 0, "B")) == 0x06090032
    assert code_of(lambda: one.write(0x2100, 1, -0.1, "f")) == 0x06090032
    assert code_of(lambda: one.write(0x2100, 1, float("nan"), "f")) == 0x06090030
    assert code_of(lambda: one.write(0x6060, 0, 2, "b")) == 0x06090030  # velocity mode is not offered
    assert code_of(lambda: one.write(0x605A, 0, 4, "h")) == 0x06090030
    assert code_of(lambda: one.write(0x1010, 1, 0x12345678, "I")) == 0x08000020
    assert code_of(lambda: one.write(0x1003, 0, 1, "B")) == 0x06090030
    assert one.read(0x60C2, 1) == 1  # what was refused has changed nothing


def test_writing_in_the_wrong_state(host: MakeHost) -> None:
    one = host()
    one.gains()
    one.enable(3)
    one.write(0x2100, 1, 0.1, "f")  # at standstill
    one.write(0x60FF, 0, COUNTS_PER_S, "i")
    one.run(0.1)
    assert code_of(lambda: one.write(0x2100, 1, 0.3, "f")) == 0x08000022
    assert code_of(lambda: one.write(0x607E, 0, 0x80, "B")) == 0x08000022
    assert code_of(lambda: one.write(0x1011, 1, 0x64616F6C, "I")) == 0x08000022
    assert one.read(0x2100, 1, "f") == pytest.approx(0.1, rel=1e-6)


COUNTS_PER_S = 65536


def test_highest_subindex_and_real32(host: MakeHost) -> None:
    one = host()
    assert one.read(0x2100, 0) == 15
    assert one.read(0x607D, 0) == 2
    one.write(0x2100, 7, 4.6, "f")
    assert one.read_raw(0x2100, 7) == struct.pack("<f", 4.6)


def test_no_answer_in_the_nmt_state_stopped(host: MakeHost) -> None:
    one = host()
    one.send(0x000, b"\x02\x01")
    one.send(0x601, bytes.fromhex("4000100000000000"))
    assert one.of(0x581) == []
