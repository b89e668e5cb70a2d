"""PDOs: remapping rules, transmission types, timing against SYNC (CiA 301, 7.2.2, 7.5.2.35 to 38)."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from itertools import pairwise

import pytest

from virtual.host import COUNTS, Abort, Host

MakeHost = Callable[..., Host]

STATUS, POSITION, VELOCITY, TORQUE = 0x60410010, 0x60640020, 0x606C0020, 0x60770010
CONTROL, TARGET_TORQUE, TARGET_POSITION = 0x60400010, 0x60710010, 0x607A0020
SYNC = 0x80


def refused(one: Host, index: int, subindex: int, value: int, code: str) -> int:
    with pytest.raises(Abort) as caught:
        one.write(index, subindex, value, code)
    return int(caught.value.args[0])


def test_all_are_disabled_at_boot_with_the_predefined_identifiers(host: MakeHost) -> None:
    one = host(node_id=5)
    for number in range(4):
        assert one.read(0x1400 + number, 1) == 0xC0000205 + 0x100 * number
        assert one.read(0x1800 + number, 1) == 0xC0000185 + 0x100 * number
        assert one.read(0x1800 + number, 2) == 255
    one.operational()
    one.send(SYNC)
    one.run(0.01)
    assert one.frames() == []


def test_remapped_sync_pdo_carries_the_objects_in_order(host: MakeHost) -> None:
    one = host()
    one.plant.position_rad = 1.0
    identifier = one.map(1, False, [POSITION, TORQUE, STATUS])
    one.operational()
    one.run(0.001)
    one.send(SYNC)
    (data,) = one.of(identifier)
    assert identifier == 0x181
    assert data == struct.pack("<ihH", int(65536 / 6.283185307179586), 0, one.status)


@pytest.mark.parametrize("direction", [True, False])
def test_a_pdo_is_written_only_while_it_is_invalid(host: MakeHost, direction: bool) -> None:
    one = host()
    one.map(2, direction, [CONTROL if direction else STATUS])
    communication, mapping = (0x1401, 0x1601) if direction else (0x1801, 0x1A01)
    assert refused(one, communication, 2, 5, "B") == 0x08000022
    assert refused(one, communication, 3, 10, "H") == 0x08000022
    assert refused(one, mapping, 0, 0, "B") == 0x08000022
    assert refused(one, mapping, 1, 0, "I") == 0x08000022
    assert refused(one, communication, 1, 0x2A5, "I") == 0x08000022  # another identifier without bit 31
    if not direction:
        assert refused(one, communication, 5, 10, "H") == 0x08000022
    one.write(communication, 1, 0x800002A5, "I")
    one.write(communication, 2, 5, "B")
    one.write(communication, 1, 0x2A5, "I")
    assert one.read(communication, 1) == (0x400002A5 if direction else 0x2A5)  # bit 30: no remote frames


def test_mapping_rules(host: MakeHost) -> None:
    one = host()
    assert refused(one, 0x1A00, 1, POSITION, "I") == 0x06010000  # number of entries is not 0
    one.write(0x1A00, 0, 0, "B")
    assert refused(one, 0x1A00, 1, 0x2FFF0010, "I") == 0x06020000
    assert refused(one, 0x1A00, 1, 0x60640120, "I") == 0x06090011
    assert refused(one, 0x1A00, 1, 0x10180120, "I") == 0x06040041
    assert refused(one, 0x1A00, 1, CONTROL, "I") == 0x06040041  # mappable the other way only
    assert refused(one, 0x1A00, 1, 0x60640010, "I") == 0x06040041  # in part
    one.write(0x1600, 0, 0, "B")
    assert refused(one, 0x1600, 1, STATUS, "I") == 0x06040041
    for i, entry in enumerate((POSITION, VELOCITY, STATUS)):
        one.write(0x1A00, i + 1, entry, "I")
    assert refused(one, 0x1A00, 0, 3, "B") == 0x06040042  # 80 bits
    assert refused(one, 0x1A00, 0, 9, "B") == 0x06090031
    one.write(0x1A00, 3, 0, "I")
    assert refused(one, 0x1A00, 0, 3, "B") == 0x06040041  # a hole
    one.write(0x1A00, 0, 2, "B")


@pytest.mark.parametrize(("communication", "sync_type"), [(0x1800, 241), (0x1800, 251), (0x1400, 252), (0x1400, 253)])
def test_transmission_types_not_offered(host: MakeHost, communication: int, sync_type: int) -> None:
    assert refused(host(), communication, 2, sync_type, "B") == 0x06090030


def test_type_0_is_sent_with_a_sync_after_a_change(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, False, [POSITION], sync_type=0)
    one.operational()
    sent = []
    for place in (0.0, 0.0, 1.0, 1.0):
        one.plant.position_rad = place
        one.run(0.002)
        assert one.of(identifier) == []
        one.send(SYNC)
        sent.append(len(one.of(identifier)))
    assert sent == [1, 0, 1, 0]


@pytest.mark.parametrize(("sync_type", "place_rad"), [(252, 1.0), (253, 2.0)])
def test_remote_frames_are_answered_with_the_sample_of_the_sync_or_with_what_is_there(
    host: MakeHost, sync_type: int, place_rad: float
) -> None:
    one = host()
    identifier = one.map(1, False, [POSITION], sync_type=sync_type)
    one.operational()
    for place in (1.0, 2.0):
        one.plant.position_rad = place
        one.run(0.002)
        if place == 1.0:
            one.send(SYNC)
    assert one.of(identifier) == []
    one.send(identifier, rtr=True)
    assert one.of(identifier) == [struct.pack("<i", int(place_rad * COUNTS / math.tau + 0.5))]


def test_a_gap_in_a_receive_pdo(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, True, [0x00050008, CONTROL, 0x00070020], sync_type=255)
    one.operational()
    one.send(identifier, b"\xaa\x06\x00" + bytes(4))
    assert one.read(0x6040) == 6
    one.write(0x1A00, 0, 0, "B")
    assert refused(one, 0x1A00, 1, 0x00050008, "I") == 0x06020000  # nothing to send


@pytest.mark.parametrize("cob_id", [0x000, 0x080, 0x101, 0x581, 0x601, 0x701, 0x20000181])
def test_restricted_identifiers(host: MakeHost, cob_id: int) -> None:
    assert refused(host(), 0x1800, 1, cob_id, "I") == 0x06090030


def test_type_n_is_sent_with_every_nth_sync(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, False, [STATUS], sync_type=3)
    one.operational()
    sent = []
    for _ in range(9):
        one.send(SYNC)
        sent.append(len(one.of(identifier)))
    assert sent == [0, 0, 1] * 3


def test_sync_receive_pdo_becomes_active_at_the_next_sync(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, True, [TARGET_TORQUE, TARGET_POSITION])
    one.operational()
    one.send(SYNC)
    one.send(identifier, struct.pack("<hi", 100, -7))
    one.run(0.005)
    assert (one.read(0x6071, code="h"), one.read(0x607A, code="i")) == (0, 0)
    one.send(SYNC)
    assert (one.read(0x6071, code="h"), one.read(0x607A, code="i")) == (100, -7)


@pytest.mark.parametrize("sync_type", [254, 255])
def test_event_driven_receive_pdo_is_active_at_once(host: MakeHost, sync_type: int) -> None:
    one = host()
    identifier = one.map(1, True, [TARGET_TORQUE], sync_type=sync_type)
    one.operational()
    one.send(identifier, struct.pack("<h", -5))
    assert one.read(0x6071, code="h") == -5


def test_controlword_and_target_of_one_pdo_take_effect_together(host: MakeHost) -> None:
    one = host()
    one.gains()
    identifier = one.map(1, True, [CONTROL, TARGET_POSITION])  # the edge of bit 4 stands before its target
    one.operational()
    one.enable(1)
    one.send(identifier, struct.pack("<Hi", 0x1F, 6554))
    one.send(SYNC)
    one.run(1.0)
    assert one.read(0x6064, code="i") == pytest.approx(6554, abs=100)


def test_nothing_moves_outside_of_operational(host: MakeHost) -> None:
    one = host()
    sent, received = one.map(1, False, [STATUS]), one.map(1, True, [TARGET_TORQUE], sync_type=255)
    one.send(SYNC)
    one.send(received, struct.pack("<h", 3))
    assert one.of(sent) == []
    assert one.read(0x6071) == 0
    one.operational()
    one.send(0x000, b"\x80\x00")  # all nodes to pre-operational
    one.send(SYNC)
    assert one.of(sent) == []


def test_on_change_with_inhibit_time(host: MakeHost) -> None:
    one = host()
    one.write(0x1800, 3, 50, "H")  # 5 ms
    identifier = one.map(1, False, [POSITION], sync_type=255)
    one.operational()
    times = []
    one.plant.velocity_rad_s = 1.0
    for _ in range(20):
        one.run(0.001)
        times += [one.bus.clock.now()] * len(one.of(identifier))
    assert [round(1000 * (b - a)) for a, b in pairwise(times)] == [5, 5, 5]


def test_on_change_is_silent_without_a_change_and_event_timer_speaks(host: MakeHost) -> None:
    one = host()
    quiet = one.map(1, False, [POSITION], sync_type=255)
    one.write(0x1801, 5, 4, "H")
    timed = one.map(2, False, [POSITION], sync_type=254)
    one.operational()
    one.run(0.0205)
    found = [identifier for identifier, _ in one.frames()]
    assert found.count(quiet) == 1  # the first value
    assert found.count(timed) == 6  # at 1, 5, 9, 13, 17, 21 ms


def test_cmmp_type_254_is_cyclic_with_the_inhibit_time(host: MakeHost) -> None:
    one = host(profile="cmmp-as")
    one.write(0x1800, 3, 30, "H")
    identifier = one.map(1, False, [POSITION], sync_type=254)
    one.operational()
    one.run(0.013)
    assert len(one.of(identifier)) == 5  # at 1, 4, 7, 10, 13 ms


def test_receive_pdo_of_wrong_length(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, True, [TARGET_TORQUE], sync_type=255)
    one.operational()
    one.send(identifier, b"\x05")
    assert one.of(0x81) == [bytes.fromhex("1082110000000000")]  # 8210h: not processed
    assert one.read(0x6071) == 0
    one.send(identifier, b"\x05\x00\x00")
    assert one.of(0x81) == [bytes.fromhex("2082110000000000")]  # 8220h: too long, the first bytes count
    assert one.read(0x6071) == 5
    assert one.read(0x1001) == 0  # no fault


def test_receive_pdo_cannot_set_what_an_sdo_could_not(host: MakeHost) -> None:
    one = host()
    identifier = one.map(1, True, [0x60600008], sync_type=255)
    one.operational()
    one.send(identifier, b"\x02")
    assert one.read(0x6060) == 1
    one.send(identifier, b"\x0a")
    assert one.read(0x6061) == 10


def test_four_and_four_run_side_by_side(host: MakeHost) -> None:
    one = host()
    sent = [one.map(n, False, [STATUS]) for n in (1, 2, 3, 4)]
    received = [one.map(n, True, [entry]) for n, entry in enumerate((TARGET_TORQUE, TARGET_POSITION, 0x60FF0020, 0x60B20010), 1)]
    one.operational()
    for n, identifier in enumerate(received):
        one.send(identifier, struct.pack("<i", n + 1)[: 4 if n in (1, 2) else 2])
    one.send(SYNC)
    assert [identifier for identifier, _ in one.frames()] == sent == [0x181, 0x281, 0x381, 0x481]
    assert [one.read(index) for index in (0x6071, 0x607A, 0x60FF, 0x60B2)] == [1, 2, 3, 4]
