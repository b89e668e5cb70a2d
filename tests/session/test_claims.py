"""What records can claim at a drive's sampling period, and whether its unit of torque is right, in words."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.experiments.plan import commission_plan, identify_plan
from beltcomm.experiments.sampling_limits import _claimed_hz, _expected_hz, _remark_after, _torque_remark, note_after, notes_before
from identify.records import true_model
from truth.rigs import nominal

AXIS = load_axis("egc-70-600")


def test_the_limit_is_0_35_of_the_sampling_rate() -> None:
    assert _claimed_hz(1e-3) == pytest.approx(350.0)
    assert _claimed_hz(6.4e-3) == pytest.approx(54.7, abs=0.1)


def test_the_expected_resonance_holds_the_known_one() -> None:
    """By hand: ω² = k (1/m + r²/J).  The rigs' belts are 8 % softer than their data sheet says (A.4 and 106.25 kN), so 10 % are left."""
    low, high = _expected_hz(AXIS) or (0.0, 0.0)
    for rig in ("g_a", "g_b"):
        truth = nominal(rig).truth
        r, j, m, k = 0.01242, truth["inertia_kg_m2"], truth["mass_kg"], truth["stiffness_n_m"]
        assert 0.9 * low < math.sqrt(k * (1.0 / m + r * r / j)) / math.tau < 1.1 * high
    assert _expected_hz(replace(AXIS, belt=None)) is None


@pytest.mark.parametrize(("options", "seen"), [({}, True), ({"bitrate": 125_000}, False), ({"sample_period": 0.008}, False)])
def test_the_plan_says_what_can_be_seen(options: dict[str, object], seen: bool) -> None:
    with open_drive("virtual:g_a", options) as drive:
        notes = notes_before(AXIS, drive.capabilities)
        for plan in (commission_plan(AXIS, drive.capabilities), identify_plan(AXIS, drive.capabilities)):
            assert set(notes) <= set(plan.lines())
    period_ms = 1 if seen else 8
    assert notes[0].startswith(f"A SYNC every {period_ms} ms")
    assert f"resonances up to {350 / period_ms:.0f} Hz can be measured" in notes[0]
    warned = " ".join(notes[1:])
    assert ("no response shows" in warned) is not seen
    if "bitrate" in options:
        assert "higher bit rate" in warned


def test_the_resonance_found_is_held_against_it() -> None:
    with open_drive("virtual:g_a", {"sample_period": 0.008}) as drive:
        slow = drive.capabilities
    remark = _remark_after(103.0, slow)
    assert remark is not None
    assert "the resonance at 103 Hz is above 44 Hz, the most that this rate of sampling can measure" in remark
    assert _remark_after(40.0, slow) is None
    remarks = ["another", remark]
    note_after(remarks, true_model(nominal("g_a")), AXIS, slow, 0.25)
    assert remarks[0] == "another"
    assert len(remarks) == 2  # the new one took the place of the old one
    note_after(remarks, true_model(nominal("g_a")), AXIS, replace(slow, sample_period_s=1e-3), 0.25)
    assert remarks == ["another"]


@pytest.mark.parametrize(
    ("factor", "doubt", "said"), [(1.02, "", None), (1.02, "in doubt", "is right to that"), (2.0, "", "2.00 times too large")]
)
def test_the_unit_of_torque_is_judged_by_the_inertia(factor: float, doubt: str, said: str | None) -> None:
    model = true_model(nominal("g_a"))
    with open_drive("virtual:g_a", {}) as drive:
        capabilities = replace(drive.capabilities, torque_scale=doubt)
    value = AXIS.motor_side_inertia_kg_m2 * factor
    item = replace(model.parameters["motor.inertia"], value=value, interval=0.01 * value)
    found = _torque_remark(replace(model, parameters={**model.parameters, "motor.inertia": item}), AXIS, capabilities)
    assert (found is None) if said is None else (found is not None and said in found)
