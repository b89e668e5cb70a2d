"""The topic ``estimators`` of ``beltcomm thesis``: the published numbers, and what the table says beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter
from beltcomm.model import load_plant
from beltcomm.result import Result
from beltcomm.thesis import estimator_loop
from beltcomm.thesis.topics import thesis
from beltcomm.trajectory import plan_trajectory
from beltcomm.verify import Loop, predict_move


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return thesis("estimators", pictures=tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def data(shown: Result) -> Any:
    return shown.to_json()


def test_the_published_numbers_come_out(data: Any) -> None:
    assert data["saturation_m_s"] == pytest.approx(250.0)  # (6.15)
    assert data["saturation_read_m_s"] == pytest.approx(250.0)
    crossing = data["crossing"]
    assert crossing["printed_m_s"] == pytest.approx(0.005, rel=2e-5)  # (6.19): about 2 Δξ/T_s
    # Measured: alike up to three increments per period, so the better one changes within 2 to 3 Δξ/T_s and a step of the sweep.
    assert 0.005 <= crossing["better_from_m_s"] <= 0.0075 + 0.1 * 0.0025 + 1e-9
    slow = data["tables"][0]
    assert slow["worst"]["event_counter"][-1] <= 1e-3 * 1.001, "100 Δt/T_s (6.13)"
    assert slow["worst"]["event_counter"][-1] >= 0.4e-3


def test_no_method_breaks_its_bound(data: Any) -> None:
    for table in data["tables"]:
        worst, bounds = table["worst"], table["bounds"]
        held = np.array(table["missing"]) == 0.0
        for method, bound in (("high_pass", "high_pass"), ("gate", "gate"), ("event_counter", "event_counter_worst")):
            rows = held if method == "event_counter" else np.ones(len(held), dtype=bool)
            over = np.array(worst[method])[rows] / np.array(bounds[bound])[rows]
            assert np.all(over <= 1.0 + 1e-6), (method, over)
        # The combination is as good as the better of its parts, but for the blend around the crossing.
        better = np.fmin(np.array(worst["gate"]), np.where(held, np.array(worst["event_counter"]), np.inf))
        assert np.all(np.array(worst["combined"]) <= 1.05 * better)


def test_the_envelope_of_the_source_is_none(data: Any) -> None:
    table = data["tables"][0]
    i = table["speed_m_s"].index(0.01)
    assert table["worst"]["event_counter"][i] > table["bounds"]["event_counter"][i]


def test_debouncing(data: Any) -> None:
    shaking, bouncing = data["shaking"], data["bouncing"]
    # 24 places, 0.05 s at 200 Hz, two passages each.
    assert (shaking["increments_without"], shaking["increments_with"]) == (480, 0)
    assert all(shaking["largest_with"][m] == 0.0 for m in ("event_counter", "gate", "combined"))
    assert shaking["largest_without"]["gate"] > 5.0 * shaking["true_m_s"]
    assert bouncing["increments_with"] == 400, "0.01 m/s for 0.1 s"
    assert bouncing["increments_without"] > bouncing["increments_with"]
    for turn in data["reversals"]:
        # "a sign reversal in the velocity is delayed by one increment"; places of the turning point are uniform over one.
        assert turn["way_without"] == pytest.approx(0.5, abs=0.02)
        assert turn["way_with"] == pytest.approx(1.5, abs=0.02)
        assert turn["count_apart"] == 1


def test_time_out(data: Any) -> None:
    stop = {name: np.array(v) for name, v in data["stop"]["gate_m_s"].items()}
    after = np.array(data["stop"]["t_s"])
    assert np.all(stop["frozen"] == pytest.approx(2.5e-3, rel=1e-4)), "never zero without a time-out"
    # Last increment at 1.5 T_s; (6.17) by hand at 3, 4, 5, 6 T_s; zero from 6.5 T_s on.
    expected = [2.5e-6 / (k - 1.5) / 1e-3 for k in (3, 4, 5, 6)]
    for name in ("printed", "bounded"):
        np.testing.assert_allclose(stop[name][(after > 2.5e-3) & (after < 6.5e-3)], expected, rtol=1e-4)
        assert np.all(stop[name][after > 6.5e-3] == 0.0)
    for speed, errors in zip(data["extension_speeds_m_s"], data["extension"], strict=True):
        assert errors["bounded"]["worst"] < 1e-3
        # Just after T_s it reads Δξ/T_s, except where the increments happen to fall otherwise.
        assert 30.0 < errors["printed"]["worst"] < 100.0 * (2.5e-3 / (0.99 * speed) - 1.0) + 1.0


def test_the_printed_combination_is_wrong_by_its_weight(data: Any) -> None:
    # Where (6.4) has no value the reading lacks δ_sw of the velocity: (1 − sin(π r/2))/2 at r increments per period, r within 1 %.
    for ratio, worst in zip(data["switching_ratios"], data["switching"]["printed"], strict=True):
        if ratio < 2.0:
            low, high = (100.0 * 0.5 * (1.0 - np.sin(0.5 * np.pi * ratio * f)) for f in (0.99, 1.01))
            assert low - 0.05 <= worst <= high + 0.05
    assert max(data["switching"]["guarded"]) < 0.01


def test_the_loop_shows_lag_and_not_noise(data: Any) -> None:
    fast = data["loop"]["0.5 m, T_A"]
    # The sheet's own simulation of the plain cascade on G_A: 1.4 to 1.8 mm; below half of it with the reference behind the filter.
    assert 1.4e-3 <= fast["high_pass"]["error_m"] <= 1.8e-3
    assert fast["high_pass_reference"]["error_m"] < 0.43e-3
    assert fast["combined"]["error_m"] < 0.5 * fast["high_pass"]["error_m"]
    assert all(r["invalid"] == 0 for moves in data["loop"].values() for r in moves.values())


@pytest.mark.parametrize(("variant", "filtered"), [("high_pass", False), ("high_pass_reference", True)])
def test_the_loop_with_the_high_pass_is_the_drives_own(data: Any, variant: str, filtered: bool) -> None:
    """Independent: the prediction of ``verify`` runs the compiled cascade with its own differentiation of counts, without edges."""
    model = load_plant("g_a").model
    length, limits = estimator_loop.MOVES["0.5 m, T_A"]
    move = plan_trajectory(0.05, 0.05 + length, limits, 1e-3)
    ratio = model["transmission.ratio"]
    feedforward = Feedforward(
        inertia_kg_m2=model["motor.inertia"] + ratio**2 * model["cart.mass"],
        viscous_nm_s_rad=model["viscous.damping"],
        coulomb_nm=model["coulomb.level"] + ratio * model["cart_friction.level"],
        advance_s=1.5e-3,
    )
    cascade = Cascade(0.12, 1.39, 6.29, 2e-3, Prefilter("butterworth", 123.24), feedforward, filtered)
    structure = CascadeStructure("own", 1e-3, ("butterworth",), True, True, True)
    predicted = predict_move(model, cascade, move, Loop(structure, 1e-3, 3.1, round(2.0 * np.pi * ratio / 2.5e-6)))
    found = data["loop"]["0.5 m, T_A"][variant]
    # They count from different places between two lines, which is two increments through the gains, and round differently.
    assert found["error_m"] == pytest.approx(np.max(np.abs(move.position_m - predicted.motor_m)), abs=1e-5)
    assert found["cart_error_m"] == pytest.approx(np.max(np.abs(move.position_m - predicted.cart_m)), abs=1e-5)


def test_lines_and_figures(shown: Result, data: Any) -> None:
    text = "\n".join(shown.lines())
    for words in ("(6.19)", "What comes out", "What does not", "Debouncing", "Time-out", "In the loop"):
        assert words in text
    assert max(len(line) for line in shown.lines() if not line.startswith("drawn")) <= 160
    names = [Path(path).name for path in data["pictures"]]
    assert names == [f"figure_{n}.png" for n in (
        "6_1_high_pass", "6_2_resolution", "6_3_states", "6_5_errors", "6_7_time_out", "6_8_signals",
    )]  # fmt: skip
    assert all(Path(path).stat().st_size > 10_000 for path in data["pictures"])


def test_the_topic_is_listed() -> None:
    assert any(line.startswith("estimators") and "6.1" in line for line in thesis().lines())
