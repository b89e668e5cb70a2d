"""Typed object access: aborts in words, lost answers, objects never written, values given back."""

from __future__ import annotations

import struct

import can
import pytest

from adapters.stub_node import StubBus, StubNode
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.link import Link, find_nodes
from beltcomm_adapters.sdo import RECOVERY_S, SdoObjects


@pytest.fixture
def node():
    return StubNode()


@pytest.fixture
def bus(node):
    with StubBus(node) as bus:
        yield bus


@pytest.fixture
def objects(bus):
    return SdoObjects(Link(bus, bus.clock, 1))


def test_values_have_their_types(node, objects):
    node.put(0x6064, 0, -5)
    node.put(0x6072, 0, 65535)
    assert objects.read(0x6064, 0, "int32") == -5
    assert objects.read(0x6072, 0, "uint16") == 65535


def test_an_abort_is_an_exception_with_object_code_and_text(node, objects):
    node.refuse[0x6072, 0] = 0x06090031
    with pytest.raises(ObjectRefused, match=r"6072h.*too high.*06090031h") as caught:
        objects.write(0x6072, 0, "uint16", 5000)
    assert (caught.value.abort_code, caught.value.index, caught.value.subindex) == (0x06090031, 0x6072, 0)


def test_a_missing_object_is_told_apart_from_a_refused_one(objects):
    assert objects.read_if_there(0x5555, 0, "uint8") is None
    assert objects.read_text(0x1008) == ""
    with pytest.raises(ObjectRefused, match="does not exist"):
        objects.read(0x5555, 0, "uint8")


@pytest.mark.parametrize(("times", "code"), [(5, 0x05030000), (9, 0x05040001), (10, 0x05030000)])
def test_a_transfer_out_of_step_is_begun_anew(node, objects, times, code):
    """A doubled segment: the drive aborts because the toggle bit did not alternate, which says nothing of the object."""
    receive, left = node.receive, [times]

    def out_of_step(frame, now_s):
        if frame.arbitration_id == 0x601 and frame.data[0] != 0x80 and left[0]:
            left[0] -= 1
            node._abort(bytes(frame.data[1:4]), code)
        else:
            receive(frame, now_s)

    node.receive = out_of_step
    node.put(0x6072, 0, 700)
    if times < 10:
        assert objects.read(0x6072, 0, "uint16") == 700
    else:
        with pytest.raises(ObjectRefused, match="05030000h"):
            objects.read(0x6072, 0, "uint16")


def test_a_lost_answer_is_asked_for_again(node, bus, objects):
    receive, calls = node.receive, []

    def lossy(frame, now_s):
        calls.append(frame.arbitration_id)
        if len([cob for cob in calls if cob == 0x601]) != 1:
            receive(frame, now_s)

    node.receive = lossy
    assert objects.read(0x6076, 0, "uint32") == 1000
    assert 0.29 < bus.clock.now() < 0.4


def test_silence_names_the_node_after_three_attempts(node, bus, objects):
    node.silent_from = 0
    with pytest.raises(BusError, match="node 1 gave no valid answer"):
        objects.read(0x6076, 0, "uint32")
    assert bus.clock.now() == pytest.approx(0.3 * (1 + 2 + 4), abs=0.05)  # more patience each time


def test_an_interface_that_is_gone_is_a_bus_error(bus, objects):
    bus.dead = True
    with pytest.raises(BusError, match="stub bus does not send or receive"):
        objects.read(0x6076, 0, "uint32")


def test_saving_waits_longer_than_any_other_answer(node, bus, objects):
    node.objects[0x1010, 1] = ("<I", 0)
    sdo, late = node._sdo, []
    node._sdo = lambda data: late.append(data)
    recv = bus.recv

    def recv_after_ten_seconds(timeout=None):
        if late and bus.clock.now() + (timeout or 0.0) >= 10.0:
            bus.clock.now_s = max(bus.clock.now_s, 10.0)
            sdo(late.pop())
        return recv(timeout)

    bus.recv = recv_after_ten_seconds
    objects.save()
    assert bus.clock.now() == 10.0
    assert node.written == [(0x1010, 1, int.from_bytes(b"save", "little"))]


def test_a_value_without_room_is_named(objects):
    with pytest.raises(DriveError, match="70000 does not fit into object 6072h"):
        objects.write(0x6072, 0, "uint16", 70000)


def test_lent_objects_come_back_last_first(node, objects):
    with objects.lend() as lending:
        lending.set(0x607D, 1, "int32", -7)
        lending.set(0x607D, 2, "int32", 7)
        lending.set(0x607D, 2, "int32", 9)
        lending.set(0x6072, 0, "uint16", 3000)  # already so: not touched
    assert node.written == [(0x607D, 1, -7), (0x607D, 2, 7), (0x607D, 2, 9), (0x607D, 2, 7), (0x607D, 2, 0), (0x607D, 1, 0)]


def test_what_cannot_be_given_back_is_said(node, objects):
    def keep(error: Exception | None) -> None:
        with objects.lend() as lending:
            lending.set(0x6072, 0, "uint16", 100)
            node.refuse[0x6072, 0] = 0x08000022
            if error is not None:
                raise error

    with pytest.raises(DriveError, match=r"6072h could not be set back to 3000.*switch the drive off"):
        keep(None)
    node.refuse.clear()
    node.put(0x6072, 0, 3000)
    with pytest.raises(ZeroDivisionError) as caught:
        keep(ZeroDivisionError())
    assert "6072h could not be set back to 3000" in caught.value.__notes__[0]


def test_a_silent_drive_is_not_asked_for_ever_to_take_things_back(node, bus, objects):
    lending = objects.lend()
    for sub in (1, 2):
        lending.set(0x607D, sub, "int32", 5)
    lending.set(0x6072, 0, "uint16", 5)
    node.silent_from = 0
    before_s = bus.clock.now()
    (failure,) = lending.give_back()
    assert failure.startswith("the objects 6072h, 607Dh:2, 607Dh:1 could not be set back")
    assert RECOVERY_S <= bus.clock.now() - before_s < RECOVERY_S + 2.5  # not so long for each object


def test_a_bus_that_comes_back_gets_everything_back(node, bus, objects):
    lending = objects.lend()
    before = objects.read(0x6072, 0, "uint16")
    lending.set(0x6072, 0, "uint16", 5)
    send, back_s = bus.send, bus.clock.now() + 1.0

    def off_for_a_second(message, timeout=None):
        if bus.clock.now() < back_s:
            raise can.CanOperationError("bus-off")
        send(message, timeout)

    bus.send = off_for_a_second
    assert lending.give_back() == []
    assert objects.read(0x6072, 0, "uint16") == before
    assert back_s <= bus.clock.now() < back_s + 0.5


def test_nodes_are_found_by_their_answers():
    class Second(StubNode):
        def receive(self, frame, now_s):
            if frame.arbitration_id == 0x605:
                self.out.append((0x585, b"\x80\x00\x10\x00" + struct.pack("<I", 0x08000000)))

    with StubBus(StubNode(), Second()) as bus:
        assert find_nodes(bus, bus.clock) == [1, 5]
    with StubBus() as bus:
        assert find_nodes(bus, bus.clock) == []
