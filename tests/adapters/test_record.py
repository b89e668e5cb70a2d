"""A recording against the hand-written node: rows, alignment, losses, and every way it can end."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from adapters.stub_node import COUNTS_PER_RAD, INERTIA_KG_M2, StubNode
from beltcomm.drive import Limits, Motion, Row
from beltcomm.errors import BusError, DriveError, DriveFault, SafetyStop, UsageError
from beltcomm_adapters.motion import Report

LIMITS = Limits(-10.0, 10.0, 50.0, 0.5)
T = 1e-3
DISABLED, READY, ON, ENABLED, QUICK = 0x40, 0x21, 0x23, 0x27, 0x07


def torque(values: list[float]) -> Motion:
    zero = np.zeros(len(values))
    return Motion("torque", T, zero, zero, np.array(values))


def position(path: np.ndarray) -> Motion:
    return Motion("position", T, path, np.gradient(path, T), np.zeros(len(path)))


def unchanged(node: StubNode) -> dict[tuple[int, int], float]:
    """Everything a recording has no business to leave behind."""
    live = {0x6040, 0x6041, 0x6060, 0x6061, 0x6064, 0x606C, 0x6071, 0x6074, 0x6077, 0x607A, 0x60B1, 0x60B2}
    return {key: value for key, (_, value) in node.objects.items() if key[0] not in live}


def test_torque_of_a_row_is_what_accelerates_until_the_next_row(opened):
    node, rows = StubNode(), []
    motion = torque([0.0, 0.1, 0.1, -0.2, 0.0, 0.0])
    report = opened(node).record(motion, LIMITS, rows.append)
    table = np.array(rows)
    assert isinstance(report, Report)
    assert (report.rows, report.lost_cycles) == (6, 0)
    assert table[:, 0] == pytest.approx(np.arange(6) * T)
    assert table[:, 1] == pytest.approx(motion.torque_nm)
    assert table[:, 2] == pytest.approx(motion.torque_nm)
    # Newton: dv = torque dt / J, to the resolution of one count per second
    gained = np.diff(table[:, 4]) * INERTIA_KG_M2 / T
    assert gained == pytest.approx(table[:-1, 1], abs=INERTIA_KG_M2 / T / COUNTS_PER_RAD)
    assert np.isnan(table[:, 5:]).all()


def test_position_reference_of_a_row_is_the_setpoint_active_at_its_time(opened):
    node, rows = StubNode(), []
    path = 0.01 * np.sin(np.linspace(0, math.pi, 50)) ** 2
    opened(node).record(position(path), LIMITS, rows.append)
    table = np.array(rows)
    assert table[:, 5] == pytest.approx(path, abs=1 / COUNTS_PER_RAD)
    assert table[:, 3] == pytest.approx(table[:, 5], abs=1e-12)  # the stub follows at once
    assert table[:, 6] == pytest.approx(np.gradient(path, T), abs=1 / COUNTS_PER_RAD)


@pytest.mark.parametrize("along_nm", [0.0, 0.1])
def test_a_speed_loop_gets_a_torque_only_where_one_is_added(opened, along_nm):
    """60B2h in a PDO of its own, row by row as it was sent; a drive that cannot map it there runs plain speeds all the same."""
    node, rows = StubNode(), []
    sent: list[float] = []
    activate = node._activate

    def spy(number: int, data: bytes, mode: int) -> None:
        activate(number, data, mode)
        if number == 1:
            sent.append(node.get(0x60B2))

    node._activate = spy
    added = np.array([0.0, along_nm, -along_nm, 0.0])
    opened(node).record(Motion("velocity", T, np.zeros(4), np.zeros(4), added), LIMITS, rows.append)
    table = np.array(rows)
    assert np.isnan(table[:, 5]).all()
    if along_nm:
        assert table[:, 7] == pytest.approx(added)
        assert [value for value in sent if value] == [sent[np.flatnonzero(sent)[0]], -sent[np.flatnonzero(sent)[0]]]
        assert sent[-1] == 0
    else:
        assert np.isnan(table[:, 7]).all()
        assert sent == []


def test_every_state_is_passed_and_the_axis_ends_disabled(opened):
    node = StubNode()
    opened(node).record(torque([0.1] * 20), LIMITS, lambda row: None)
    assert node.states == [DISABLED, READY, ON, ENABLED, QUICK, DISABLED]


def test_torque_is_zero_before_the_drive_is_enabled(opened):
    node = StubNode()
    node.put(0x6071, 0, 700)
    seen: list[float] = []
    control = node._control

    def watched(word: int) -> None:
        before = node.state
        control(word)
        if node.state == ENABLED and before != ENABLED:
            seen.append(node.get(0x6071))

    node._control = watched  # type: ignore[method-assign]
    opened(node).record(torque([0.1] * 5), LIMITS, lambda row: None)
    assert seen == [0, 0]  # once for the proof of its guarding, once for the record


def test_one_lost_answer_is_a_gap_and_nothing_else(opened):
    rows: list[Row] = []
    clean: list[Row] = []
    values = [0.01 * (k % 7) for k in range(60)]
    opened(StubNode()).record(torque(values), LIMITS, clean.append)
    report = opened(StubNode(drop={40, 45})).record(torque(values), LIMITS, rows.append)
    assert (report.rows, report.lost_cycles) == (56, 2)
    gaps = np.flatnonzero(np.diff([row[0] for row in rows]) > 1.5 * T)
    assert np.diff([row[0] for row in rows])[gaps] == pytest.approx([3 * T, 3 * T])
    by_time = {round(row[0] / T): row for row in clean}
    for row in rows:
        assert row == pytest.approx(by_time[round(row[0] / T)], nan_ok=True)


def test_four_lost_answers_in_a_row_stop_the_axis(opened):
    node = StubNode(drop=set(range(40, 44)))
    with pytest.raises(BusError, match="4 SYNCs in a row"):
        opened(node).record(torque([0.01] * 100), LIMITS, lambda row: None)
    assert node.states[-2:] == [QUICK, DISABLED]
    three = StubNode(drop=set(range(40, 43)))
    assert opened(three).record(torque([0.01] * 100), LIMITS, lambda row: None).lost_cycles == 3


def _raise(error: BaseException, after: int) -> Callable[[Row], None]:
    seen: list[Row] = []

    def sink(row: Row) -> None:
        seen.append(row)
        if len(seen) == after:
            raise error

    return sink


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_whatever_the_sink_raises_comes_out_and_the_axis_is_stopped_first(opened, error):
    node = StubNode()
    drive, before = opened(node), unchanged(node)
    with pytest.raises(type(error)) as caught:
        drive.record(torque([0.1] * 100), LIMITS, _raise(error, 10))
    assert caught.value is error
    assert node.states[-2:] == [QUICK, DISABLED]
    assert unchanged(node) == before


def test_ctrl_c_while_stopping_is_answered_after_the_stop(opened):
    node = StubNode()
    drive = opened(node)
    control = node._control

    def interrupting(word: int) -> None:
        control(word)
        if node.state == QUICK and len(node.states) and node.states[-1] == QUICK and not node.written_interrupt:
            node.written_interrupt = True
            os.kill(os.getpid(), signal.SIGINT)

    node.written_interrupt = False  # type: ignore[attr-defined]
    node._control = interrupting  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        drive.record(torque([0.1] * 20), LIMITS, lambda row: None)
    assert node.states[-1] == DISABLED


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (Limits(-0.05, 0.05, 50.0, 0.5), "position"),
        (Limits(-10.0, 10.0, 5.0, 0.5), "speed"),
    ],
)
def test_a_breached_limit_stops_the_axis_within_two_cycles(opened, limits, reason):
    node, rows = StubNode(), []
    with pytest.raises(SafetyStop) as caught:
        opened(node).record(torque([0.2] * 2000), limits, rows.append)
    assert caught.value.reason == reason
    assert node.states[-2:] == [QUICK, DISABLED]
    # 200 rad/s²: position and speed two periods after the breach at most, by v²/2a = x
    speed = math.sqrt(2 * 200 * 0.05) if reason == "position" else 5.0
    assert node.position_rad <= (speed + 2 * T * 200) ** 2 / (2 * 200) + T * (speed + 1)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits(-0.1, 0.1, 50.0, 0.5, ratio_m_rad=0.01, zero_rad=-0.1), r"carriage at 2\.\d mm is outside its window of 0\.0 to 2\.0 mm"),
        (Limits(-10.0, 10.0, 5.0, 0.5, ratio_m_rad=0.01), r"the carriage's speed of 0\.05\d* m/s is beyond the limit of 0\.05 m/s"),
    ],
)
def test_a_breach_is_told_in_terms_of_the_carriage(opened, limits, words):
    with pytest.raises(SafetyStop, match=words):
        opened(StubNode()).record(torque([0.2] * 2000), limits, lambda row: None)


def test_a_torque_the_drive_should_have_clamped_is_a_breach(opened):
    node = StubNode()
    node.put(0x6072, 0, 10)  # a limit that this stub does not obey
    drive = opened(node)
    node.put(0x6072, 0, 3000)
    original = node._activate

    def doubled(number: int, data: bytes, mode: int) -> None:
        original(number, data, mode)
        node.put(0x6071, 0, 4 * node.get(0x6071))

    node._activate = doubled  # type: ignore[method-assign]
    with pytest.raises(SafetyStop, match="torque") as caught:
        drive.record(torque([0.1] * 50), Limits(-10, 10, 50, 0.1), lambda row: None)
    assert caught.value.reason == "torque"


def test_a_motion_that_falls_behind_its_reference_is_stopped_by_the_host_and_watched_by_the_drive(opened):
    """The drive stands still while its reference goes off at 1 rad/s: 0.02 rad are reached after 20 ms."""
    node, rows = StubNode(jammed=True), []
    node.objects[0x6065, 0] = ("<I", 65536)
    with pytest.raises(SafetyStop, match=r"lag 0\.02\d* rad at the motor is beyond the limit of 0\.02 rad") as caught:
        opened(node).record(position(np.linspace(0.0, 0.2, 201)), replace(LIMITS, lag_rad=0.02), rows.append)
    assert caught.value.reason == "lag"
    assert node.states[-2:] == [QUICK, DISABLED]
    assert 19 <= len(rows) <= 22
    window = math.ceil(0.02 * COUNTS_PER_RAD)
    assert [value for index, _, value in node.written if index == 0x6065] == [window, 65536]


@pytest.mark.parametrize("pattern", [0x08, 0x0F])
def test_bit_3_alone_is_a_fault_and_nothing_enables_the_axis_again(opened, pattern):
    node = StubNode(fault_at=40, fault_pattern=pattern)
    drive = opened(node)
    with pytest.raises(DriveFault, match="no error code"):
        drive.record(torque([0.1] * 100), LIMITS, lambda row: None)
    assert node.state == pattern
    assert drive.read(["state"])["state"] in (6, 7)


def test_an_emergency_tells_code_and_meaning(opened):
    with pytest.raises(DriveFault, match="8611h, following error") as caught:
        opened(StubNode(emergency_at=40)).record(torque([0.1] * 100), LIMITS, lambda row: None)
    assert caught.value.code == 0x8611


def test_a_fault_from_before_is_acknowledged_without_enabling(opened):
    node = StubNode()
    drive = opened(node)
    drive.prove_guarding(LIMITS)
    node.state = 0x08
    node.put(0x6041, 0, 0x08)
    node.states.clear()
    drive.record(torque([0.0] * 5), LIMITS, lambda row: None)
    assert node.states == [0x08, DISABLED, READY, ON, ENABLED, QUICK, DISABLED]


def test_an_ignored_target_is_an_error(opened):
    node = StubNode(ignores_target=True)
    with pytest.raises(DriveError, match="ignores its target"):
        opened(node).record(torque([0.1] * 100), LIMITS, lambda row: None)
    assert node.states[-1] == DISABLED


def test_the_host_shows_life_until_the_stage_is_off(opened):
    node = StubNode()
    off_s: list[float] = []
    drive = opened(node)
    bus = drive._link.bus
    control = node._control

    def watched(word: int) -> None:
        before = node.state
        control(word)
        if before == QUICK and node.state == DISABLED:
            off_s.append(bus.clock.now())

    node._control = watched  # type: ignore[method-assign]
    drive.record(torque([0.05] * 200), LIMITS, lambda row: None)
    consumer = [value for index, _, value in node.written if index == 0x1016]
    assert consumer == [127 << 16 | 50, 0]
    assert np.diff(node.life_s).max() < 0.025
    assert off_s[0] - node.life_s[-1] < 0.025


def test_a_drive_that_cannot_watch_its_host_is_not_moved(opened):
    node = StubNode()
    del node.objects[0x1016, 1]
    with pytest.raises(DriveError, match="does not move it"):
        opened(node).record(torque([0.1] * 10), LIMITS, lambda row: None)
    assert ENABLED not in node.states


def test_a_dead_bus_while_moving_ends_the_signs_of_life(opened):
    node = StubNode(silent_from=60)
    drive = opened(node)
    bus = drive._link.bus
    with pytest.raises(BusError) as caught:
        drive.record(torque([0.01] * 1000), LIMITS, lambda row: None)
    assert any("its guarding stops the axis" in note for note in caught.value.__notes__)
    last_life_s = max(t for t, cob, _, _ in bus.sent if cob == 0x77F)
    lost_s = next(t for t, cob, _, _ in bus.sent if cob == 0x80) + 59 * T
    assert last_life_s - lost_s < 0.3


def test_drive_side_limits_are_tightened_meanwhile_and_never_widened(opened):
    node = StubNode()
    node.put(0x607D, 1, -5000)
    node.put(0x607D, 2, 50000)
    node.put(0x6072, 0, 300)
    node.objects[0x6085, 0] = ("<I", round(1000 * COUNTS_PER_RAD))
    drive = opened(node)
    drive.record(position(np.zeros(5)), Limits(-10.0, 0.1, 20.0, 0.5), lambda row: None)
    written = [(index, sub, value) for index, sub, value in node.written if index in (0x607D, 0x6072, 0x6080)]
    high = math.ceil((0.1 + 5 * T * 20.0 + 20.0**2 / (2 * 1000)) * COUNTS_PER_RAD)
    rpm = math.ceil(1.2 * 20.0 * 60 / (2 * math.pi))
    assert written == [(0x6080, 0, rpm), (0x607D, 2, high), (0x607D, 2, 50000), (0x6080, 0, 6000)]
    node.written.clear()
    drive.record(torque([0.01] * 5), Limits(-10.0, 0.1, 20.0, 0.2), lambda row: None)
    assert [entry for entry in node.written if entry[0] == 0x607D] == []  # where no position is controlled it is a fault's cause
    assert [entry for entry in node.written if entry[0] == 0x6072] == [(0x6072, 0, 200), (0x6072, 0, 300)]


@pytest.mark.parametrize(
    ("motion", "limits", "words"),
    [
        (torque([0.6]), LIMITS, "limit is 0.5"),
        (torque([math.nan]), LIMITS, "no numbers"),
        (torque([0.0]), Limits(1.0, 2.0, 5.0, 0.5), "outside the window"),
        (torque([0.0]), Limits(1.0, -1.0, 5.0, 0.5), "no room"),
        (Motion("torque", 1.5e-3, np.zeros(1), np.zeros(1), np.zeros(1)), LIMITS, "whole multiple"),
        (Motion("torque", 0.05, np.zeros(1), np.zeros(1), np.zeros(1)), LIMITS, "20 ms"),
        (position(np.array([0.0, 11.0])), Limits(-10, 10, 1e6, 1), "window"),
        (position(np.array([0.0, 0.1])), LIMITS, "100 rad/s"),
        (position(np.array([1.0, 1.0])), LIMITS, "start it where the axis is"),
        (Motion("velocity", T, np.zeros(2), np.array([0.0, 60.0]), np.zeros(2)), LIMITS, "60 rad/s"),
        (Motion("velocity", T, np.zeros(2), np.zeros(2), np.array([0.0, 0.6])), LIMITS, "limit is 0.5"),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_is_written(opened, motion, limits, words):
    node = StubNode()
    drive = opened(node)
    node.written.clear()
    with pytest.raises(UsageError, match=words):
        drive.record(motion, limits, lambda row: None)
    assert node.written == []


def test_a_mode_the_drive_never_shows_is_an_error(opened):
    node = StubNode(stuck_objects={(0x6061, 0)})
    with pytest.raises(DriveError, match="mode of operation 10"):
        opened(node).record(torque([0.0]), LIMITS, lambda row: None)
    assert ENABLED not in node.states


def test_close_is_idempotent_and_stops_an_enabled_axis(opened):
    node = StubNode()
    drive = opened(node)
    for word in (0x06, 0x07, 0x0F):
        node._control(word)
    drive.close()
    drive.close()
    assert node.states[-2:] == [QUICK, DISABLED]
    drive.stop()
