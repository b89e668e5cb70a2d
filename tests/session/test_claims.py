"""What records can claim at a drive's sampling period, and whether its unit of torque is right, in words."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.errors import DataError
from beltcomm.experiments import commission
from beltcomm.experiments.plan import commission_plan, identify_plan
from beltcomm.experiments.sampling_limits import (
    _claimed_hz,
    _expected_hz,
    _remark_after,
    _torque_remark,
    coarse_words,
    note_after,
    notes_before,
)
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


def read_by(counts: int, amplitude_nm: float) -> tuple[Any, Any]:
    """A drive at 1 kHz with such an encoder, and a response with such an amplitude."""
    return SimpleNamespace(counts_per_rev=counts, sample_period_s=1e-3), SimpleNamespace(
        name="frf_1", torque=amplitude_nm * np.array([1.0, -1.0, 1.0])
    )


@pytest.mark.parametrize(("counts", "coarse"), [(2000, True), (65536, False)])
def test_an_encoder_too_coarse_for_its_rows_is_named_with_rows_that_suit_it(counts: int, coarse: bool) -> None:
    """Commissioned with the rows that it names, two axes of 2000 counts came out right (430 and 942 of the drawn ones, 4 ms)."""
    words = coarse_words(AXIS, *read_by(counts, 0.3))
    assert bool(words) is coarse
    if coarse:
        suits = re.search(r"--sample-period (\d+)ms", words)
        assert suits is not None
        longer_s = 1e-3 * int(suits[1])
        jumps = AXIS.motor_side_inertia_kg_m2 * np.diff([0.0, 0.0, math.tau / counts, math.tau / counts], 2) / longer_s**2
        assert np.abs(jumps).max() < 0.2 * 0.3 < np.abs(jumps).max() * (longer_s / (longer_s - 1e-3)) ** 2


def test_no_loop_is_closed_on_a_fit_that_a_coarse_encoder_left_hardly_a_value(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, response = read_by(2000, 0.3)
    machine: Any = SimpleNamespace(
        axis=AXIS, drive=SimpleNamespace(capabilities=drive), folder=SimpleNamespace(recording=lambda _: response)
    )
    findings: Any = SimpleNamespace(final=SimpleNamespace(fit=SimpleNamespace(samples=6, free=("a", "b"))))
    with pytest.raises(DataError, match=r"frf_1 has 6 values that count for 2 .*2000 counts per turn are coarse"):
        commission.first_cascade(machine, findings, true_model(nominal("g_a")), 0.25)

    def few(*_: Any) -> Any:
        raise DataError("only 347 moving samples")

    monkeypatch.setattr(commission, "final_model", few)
    with pytest.raises(DataError, match=r"only 347 moving samples\. 2000 counts per turn are coarse"):
        commission._begun_anew(machine, [response])


@pytest.mark.parametrize(("stops", "tries"), [(0, 2), (3, 1)])
def test_a_first_response_that_does_not_do_gets_another_beside_it(monkeypatch: pytest.MonkeyPatch, stops: int, tries: int) -> None:
    """Made shorter and quieter after a stop it may not do; after too many stops nothing is excited any more."""
    made: list[str] = []

    def model(*_: Any) -> str:
        if len(made) < 2:
            raise DataError("only 347 moving samples")
        return "model"

    machine: Any = SimpleNamespace(
        begin=lambda _: None, found=lambda *_: None, wanderings=stops, cascade=None, ratio=1.0,
        axis=SimpleNamespace(mounting=SimpleNamespace(tilted=False), has_transmission=False, kind="belt"),
        folder=SimpleNamespace(recording=lambda name: name),
    )  # fmt: skip
    breakaway = SimpleNamespace(holding_nm=0.0, coulomb_nm=0.1)
    monkeypatch.setattr(commission, "unknown_masses_kg", lambda _: ())
    monkeypatch.setattr(commission.phases, "sign_and_scale", lambda _: breakaway)
    monkeypatch.setattr(commission.sameness, "check_breakaway", lambda *_: None)
    monkeypatch.setattr(commission.sameness, "repeat_first_excitation", lambda *_: None)
    monkeypatch.setattr(commission.gain_steps, "ensure", lambda *_: 0.0)
    monkeypatch.setattr(commission.raising, "raise_amplitude", lambda *_, **__: SimpleNamespace(model=None, path=None))
    monkeypatch.setattr(commission, "_first_response", lambda _machine, _findings, name, _seconds: made.append(name))
    monkeypatch.setattr(commission, "_first_model", model)
    monkeypatch.setattr(commission.scale, "check_fitted", lambda *_: None)
    monkeypatch.setattr(commission, "acting_recording", lambda *_: None)
    findings = commission.Findings()
    if tries == 1:
        with pytest.raises(DataError):
            commission.identify_here(machine, findings)
    else:
        assert commission.identify_here(machine, findings) == "model"  # type: ignore[comparison-overlap]
        assert "another response is made beside it: only 347" in findings.remarks[0]
    assert made == ["frf_1", "frf_1_more"][:tries]
