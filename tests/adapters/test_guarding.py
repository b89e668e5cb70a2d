"""The proof that a drive notices when its host dies: once, at standstill, with what holds the axis; refused otherwise."""

from __future__ import annotations

from dataclasses import replace

import pytest

from adapters.stub_node import StubNode
from adapters.test_holding import overheard
from adapters.test_record import DISABLED, LIMITS, READY, T, torque
from beltcomm.drive import Guarding
from beltcomm.errors import DriveError, SafetyStop, UsageError

FAULT = 0x08


def test_the_first_torque_motion_proves_the_guarding_and_the_next_ones_do_not(opened):
    node = StubNode()
    drive = opened(node)
    states: list[int] = []
    control = node._control
    node._control = lambda word: (control(word), states.append(node.state))[0]  # type: ignore[method-assign]
    drive.record(torque([0.1] * 5), LIMITS, lambda row: None)
    assert states.count(FAULT) > 0
    assert node.state == DISABLED
    seen = len(states)
    drive.record(torque([0.1] * 5), LIMITS, lambda row: None)
    assert FAULT not in states[seen:]
    # by a heartbeat that is older than 50 ms, seen at the next SYNC; the stub shows no reaction before its fault
    found = drive.prove_guarding(LIMITS)
    assert found.guard_s == 0.05
    assert 0.05 < found.reaction_s <= 0.05 + 2 * T
    assert not found.brakes


def test_what_holds_the_axis_is_there_throughout_and_nothing_else(opened):
    drive = opened(StubNode())
    sent = overheard(drive)
    unit = drive.capabilities.torque_step_nm
    drive.prove_guarding(replace(LIMITS, brake_s=0.03), 40 * unit)
    assert {value for _, value in sent} == {40}
    assert {word for word, _ in sent} == {0x00, 0x06, 0x07, 0x0F, 0x02}
    # enabled, then silent for 50 ms; a brake that needs 30 ms is not waited for
    assert 45 <= [word for word, _ in sent].count(0x0F) <= 56


def test_a_drive_that_does_not_mind_gets_no_torque(opened):
    node = StubNode(unguarded=True)
    drive = opened(node)
    before = {key: value for key, (_, value) in node.objects.items() if key[0] in (0x1016, 0x6072, 0x6080)}
    with pytest.raises(DriveError, match=r"did not react within 100 ms .* \(guard time 50 ms\).* so it gets none"):
        drive.record(torque([0.1] * 100), LIMITS, lambda row: None)
    assert node.position_rad == 0.0
    assert node.state == DISABLED
    assert before == {key: value for key, (_, value) in node.objects.items() if key in before}
    with pytest.raises(DriveError, match="did not react within 70 ms"):  # and it is asked again the next time
        drive.record(torque([0.1] * 100), replace(LIMITS, guard_s=0.02), lambda row: None)


@pytest.mark.parametrize(("kind", "refuse"), [("leaves", {}), ("stops", {}), ("stops", {(0x1029, 1): 0x06010002})])
def test_a_node_that_leaves_operational_is_asked_by_sdo(opened, kind, refuse):
    """1029h = 0 is CiA 301's default: the TPDOs end with the host's signs of life, and the fault is told by EMCY and by SDO.   With 2 the
    node answers no SDO either, until it is called back."""
    node = StubNode(**{kind: True}, refuse=refuse)
    node.objects[0x1029, 1] = ("<B", 2 if kind == "stops" else 0)
    drive = opened(node)
    found = drive.prove_guarding(LIMITS)
    assert 0.05 < found.reaction_s <= 0.05 + 3 * T
    assert node.state == DISABLED
    assert node.get(0x1029, 1) == (2 if kind == "stops" else 0)
    drive.record(torque([0.1] * 5), LIMITS, lambda row: None)


def test_what_happens_to_the_axis_is_lent_where_nothing_would(opened):
    node = StubNode(leaves=True, keeps_torque=True)
    node.objects[0x6007, 0] = ("<h", 0)
    put, options = node.put, []
    node.put = lambda index, sub, value: (put(index, sub, value), index == 0x6007 and options.append(value))[0]  # type: ignore[method-assign]
    opened(node).prove_guarding(LIMITS)
    assert options == [3, 0]  # lent, and given back


def test_a_drive_that_leaves_operational_under_torque_is_told_from_one_that_stops(opened):
    node = StubNode(leaves=True, keeps_torque=True, refuse={(0x6007, 0): 0x06090030})
    node.objects[0x6007, 0] = ("<h", 0)
    drive = opened(node)
    with pytest.raises(DriveError, match=r"did not react .* nothing happens to the axis \(6007h = 0\)"):
        drive.record(torque([0.1] * 100), LIMITS, lambda row: None)
    assert node.position_rad == 0.0
    assert node.state == DISABLED


def test_another_fault_is_no_proof(opened):
    node = StubNode()
    guard = node._guard

    def other(now_s: float) -> None:
        guard(now_s)
        if node.state == FAULT:
            node.out.clear()
            node.out.append((0x81, b"\x20\x32\x01" + bytes(5)))

    node._guard = other  # type: ignore[method-assign]
    with pytest.raises(DriveError, match="3220h, voltage"):
        opened(node).prove_guarding(LIMITS)
    assert node.state == FAULT


def test_an_axis_that_moves_meanwhile_is_stopped(opened):
    """A torque that does not hold it: 0.3 N m on 1e-3 kg m² pass 0.05 rad after 18 ms."""
    node = StubNode()
    drive = opened(node)
    with pytest.raises(SafetyStop, match="position"):
        drive.prove_guarding(replace(LIMITS, position_min_rad=-0.05, position_max_rad=0.05), 0.3)
    assert node.state == DISABLED
    assert READY not in node.states[-1:]


def test_a_torque_beyond_the_limit_is_refused_before_anything_is_written(opened):
    node = StubNode()
    drive = opened(node)
    node.written.clear()
    with pytest.raises(UsageError, match=r"limit is 0\.5"):
        drive.prove_guarding(LIMITS, 0.6)
    assert node.written == []


def test_a_drive_slower_than_its_guard_time_holds_its_torque_longer():
    assert Guarding(0.05, 0.062, True).held_s(0.02) == pytest.approx(0.032)
    assert Guarding(0.05, 0.048, False).held_s(0.02) == pytest.approx(0.02)
