"""The torque that holds an axis around a record, and motions that end by letting go."""

from __future__ import annotations

from dataclasses import replace

import pytest

from adapters.stub_node import StubNode
from adapters.test_record import LIMITS, torque
from beltcomm.drive import Drive, Row
from beltcomm.errors import SafetyStop


def overheard(drive: Drive) -> list[tuple[int, int]]:
    """Controlword and torque, in units of the drive, of every setpoint frame from now on."""
    sent: list[tuple[int, int]] = []
    bus = drive._link.bus
    original = bus.send

    def send(message, *args, **kwargs):
        if message.arbitration_id == 0x200 + 1 and len(message.data) == 4:
            sent.append((int.from_bytes(message.data[:2], "little"), int.from_bytes(message.data[2:], "little", signed=True)))
        return original(message, *args, **kwargs)

    bus.send = send
    return sent


def test_the_torque_that_holds_is_there_before_the_drive_is_enabled_and_until_it_is_stopped(opened):
    """Every frame from the first with Enable Operation on carries it; `brake_s` more of them come before the motion."""
    rows: list[Row] = []
    drive = opened(StubNode())
    drive.prove_guarding(LIMITS)
    sent = overheard(drive)
    unit = drive.capabilities.torque_step_nm
    rest, motion = 40 * unit, torque([45 * unit] * 5)
    drive.record(replace(motion, rest_nm=rest), replace(LIMITS, brake_s=0.03), rows.append)
    enabled = [value * unit for word, value in sent if word == 0x0F]
    assert len(rows) == 5
    assert rows[0][2] == pytest.approx(45 * unit)
    assert enabled[:30] == pytest.approx([rest] * 30)
    assert enabled.count(pytest.approx(45 * unit)) == 5
    assert all(value == 40 for _, value in sent if value != 45)
    released = [word for word, _ in sent]
    assert 0x02 in released  # a motion that ends well ends with a quick stop


def test_what_is_released_has_no_quick_stop(opened):
    drive = opened(StubNode())
    drive.prove_guarding(LIMITS)
    sent = overheard(drive)

    def enough(_row: Row) -> None:
        raise SafetyStop("enough", "enough")

    with pytest.raises(SafetyStop):
        drive.record(torque([0.01] * 20), replace(LIMITS, release=True), enough)
    words = [word for word, _ in sent]
    assert 0x0F in words
    assert 0x02 not in words
    assert words[-1] == 0x00
