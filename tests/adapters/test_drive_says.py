"""What a drive says of itself beside its samples: stops and remarks with words, and gaps that a recording shows."""

from __future__ import annotations

import numpy as np
import pytest

from adapters.stub_node import StubNode
from adapters.test_record import LIMITS, T, position, torque
from beltcomm.errors import DriveError, SafetyStop

WARNS, LIMITED, FOLLOWS_NOT = 1 << 7, 1 << 11, 1 << 13


def saying(bits: int, after: int = 0) -> StubNode:
    """A node whose statusword has further bits from a SYNC on."""
    node = StubNode()
    status = node._status
    node._status = lambda: status() | (bits if node.proven and node.syncs >= after else 0)  # type: ignore[method-assign]
    return node


def test_a_warning_is_a_remark(opened):
    report = opened(saying(WARNS)).record(torque([0.01] * 50), LIMITS, lambda row: None)
    assert report.rows == 50
    (remark,) = report.remarks
    assert remark.startswith("the drive warns (statusword bit 7 in 51 rows)")


def test_a_following_error_stops_a_motion_in_position_only(opened):
    drive = opened(saying(FOLLOWS_NOT, after=40))
    drive.prove_guarding(LIMITS)
    with pytest.raises(SafetyStop, match=r"following error \(statusword bit 13\)") as stop:
        drive.record(position(np.zeros(100)), LIMITS, lambda row: None)
    assert stop.value.reason == "lag"
    opened(saying(FOLLOWS_NOT)).record(torque([0.01] * 50), LIMITS, lambda row: None)  # another meaning in torque mode


def test_a_torque_that_is_cut_for_long_is_stopped_and_one_at_its_limit_is_not(opened):
    rows: list[tuple[float, ...]] = []
    assert opened(saying(LIMITED)).record(torque([0.01] * 200), LIMITS, rows.append).limited_cycles == 201
    node = saying(LIMITED)
    activate = node._activate

    def cut(number: int, data: bytes, mode: int) -> None:
        activate(number, data, mode)
        node.put(0x6071, 0, min(node.get(0x6071), 5))

    node._activate = cut  # type: ignore[method-assign]
    rows.clear()
    with pytest.raises(SafetyStop, match=r"cuts the torque \(statusword bit 11\): it takes 5 of its units where 10 were asked") as stop:
        opened(node).record(torque([0.01] * 200), LIMITS, rows.append)
    assert stop.value.reason == "limit"
    assert 50 <= len(rows) <= 53


def test_another_mode_than_the_one_that_was_set_is_an_error_before_anything_moves(opened):
    node = StubNode()
    control, rows = node._control, []

    def swapped(word: int) -> None:
        control(word)
        if node.proven and node.state == 0x27:
            node.put(0x6061, 0, 3)

    node._control = swapped  # type: ignore[method-assign]
    with pytest.raises(DriveError, match=r"mode of operation 10 \(6061h shows 3\)"):
        opened(node).record(torque([0.1] * 50), LIMITS, rows.append)
    assert rows == []
    assert node.position_rad == 0.0


def test_a_period_that_was_too_long_is_flagged_and_its_true_time_recorded(opened):
    """The computer stalls for 3.4 ms: no row is invented, none lost, and the stamps show when it was."""
    node, rows = StubNode(), []
    drive = opened(node)

    def stall(row: tuple[float, ...]) -> None:
        rows.append(row)
        if len(rows) == 20:
            drive.clock.sleep_until(drive.clock.now() + 3.4 * T)

    report = drive.record(torque([0.01] * 50), LIMITS, stall)
    steps = np.diff([row[0] for row in rows]) / T
    assert report.irregular == int(np.sum(np.abs(steps - 1.0) > 0.25)) == 1
    assert steps.max() == pytest.approx(report.worst_jitter_s / T + 1.0)
    assert 3.0 < steps.max() < 4.0
    assert "1 periods were off by more than 25 %: their true times are recorded" in report.remarks
