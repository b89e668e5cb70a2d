"""What foreign numbers betray: counters that wrap, wrong signs, impossible speeds, periods that do not repeat."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.foreign.checks import check
from beltcomm.recording import ExcitationNote, Recording, Sidecar, common_side
from beltcomm.recording.checks import opposite_signs
from foreign.samples import CONSTANT_NM_A, COUNTS, swing

T, CURRENT, ENCODER = swing(3000)
TORQUE, ANGLE = CONSTANT_NM_A * CURRENT, math.tau / COUNTS * ENCODER


def recording(**changes: Any) -> Recording:
    return Recording(**({"name": "a", "t_s": T, "torque": TORQUE, "position": ANGLE} | changes))


def test_a_good_record_has_nothing_odd() -> None:
    assert check(recording()) == ()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"torque": -TORQUE}, r"positive torque_nm drives to negative position_rad .*--map torque_nm=-NAME"),
        ({"position": -ANGLE}, "positive torque_nm drives to negative position_rad"),
        ({"position": (ENCODER % COUNTS) * math.tau / COUNTS}, r"position_rad jumps by .* starts anew.*--unwrap SPAN \(1rev\)"),
        ({"position": ENCODER}, r"position_rad moves at .* it looks like degrees or encoder counts"),
        ({"position": 1e3 * ANGLE, "side": "load"}, "position_m moves at .* it looks like mm"),
        ({"position": 20.0 * ANGLE, "t_s": 100.0 * T, "side": "load"}, "position_m covers 571"),
    ],
)
def test_records_that_contradict_themselves(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(DataError, match=sentence):
        check(recording(**changes))


def test_friction_alone_shows_a_wrong_sign_and_one_direction_shows_nothing() -> None:
    steady = 5.0 * np.abs((T % 2.0) - 1.0)
    friction = 0.2 * np.sign(np.gradient(steady)) + np.random.default_rng(2).normal(0.0, 0.01, len(T))
    assert opposite_signs(T, -friction, steady)
    assert not opposite_signs(T, friction, steady)
    assert not opposite_signs(T, -0.2 + np.random.default_rng(2).normal(0.0, 0.01, len(T)), 5.0 * T)


def test_above_the_antiresonance_torque_and_acceleration_may_oppose() -> None:
    rng = np.random.default_rng(3)
    lines = 2.0 * math.pi * np.arange(20.0, 60.0)
    swings = np.cos(np.outer(T, lines) + rng.uniform(0.0, math.tau, len(lines)))
    acceleration_part = swings @ (1.0 / lines**2)
    assert not opposite_signs(T, swings.sum(axis=1), acceleration_part)  # as between antiresonance and resonance


def test_a_reference_in_another_unit() -> None:
    for reference, words in ((np.degrees(ANGLE), "reference has degrees"), (-ANGLE, "reference has the opposite sign")):
        with pytest.raises(DataError, match=rf"position_rad and reference_position_rad contradict each other: the {words}"):
            recording(reference_position=reference)
    with pytest.raises(DataError, match="torque_nm and torque_setpoint_nm contradict each other: the signal has thousandths"):
        recording(torque=1e3 * TORQUE, torque_setpoint=TORQUE)
    recording(reference_position=ANGLE + 0.01)


def test_an_excitation_that_does_not_repeat_as_said() -> None:
    period = np.random.default_rng(4).normal(0.0, 0.3, 500)
    torque = np.concatenate((np.zeros(100), np.tile(period, 5), np.zeros(400)))
    for samples, note in ((500, ()), (400, ("does not repeat every 400 samples",)), (2000, ("holds 1.4 periods of 2000 samples",))):
        sidecar = Sidecar("frf", excitation=ExcitationNote("multisine", None, samples, 100))
        turned = np.cumsum(np.cumsum(torque - torque.mean())) * 1e-6 / 1e-3
        found = check(recording(torque=torque, position=turned, sidecar=sidecar))
        assert len(found) == len(note)
        assert all(part in sentence for part, sentence in zip(note, found, strict=True))


def test_a_coarse_position_is_said() -> None:
    (note,) = check(recording(position=np.round(ANGLE)))
    assert "position_rad has only 30 levels, 1 rad apart" in note


def test_records_of_two_axes_do_not_go_together() -> None:
    motor, load, ampere = recording(), recording(name="b", side="load"), recording(name="c", side="ampere")
    assert common_side([motor, motor]) == "motor"
    with pytest.raises(
        DataError, match=r"not of one axis \(a in N m and rad, b in N and m\); keep those of each axis in a run of its own$"
    ):
        common_side([motor, load])
    with pytest.raises(DataError, match=r"or state motor\.torque_constant_nm_a"):
        common_side([motor, ampere])
    assert [item.inertia_unit for item in (motor, load, ampere)] == ["kg m²", "kg", "A s²/rad"]


def test_a_gap_is_no_reason_to_doubt_the_period() -> None:
    kept = np.delete(np.arange(len(T)), np.arange(1000, 1203))
    note = ExcitationNote("prbs", None, 500, 0)
    cut = recording(t_s=T[kept], torque=TORQUE[kept], position=ANGLE[kept], sidecar=Sidecar("frf", excitation=note))
    (said,) = [line for line in check(cut) if "repeat" in line]
    assert "rows are missing" in said
    assert "check --period-samples" not in said
