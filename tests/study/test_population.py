"""What the members of a population have, and what is refused in a study file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from beltcomm import api
from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.study.file import load_study
from beltcomm.study.population import drawn_axis, nominal_of, population_from
from beltcomm.study.summary import _share_of, summary_of

MODEL = load_plant("g_a").model
NOMINAL = nominal_of(MODEL, 1e-3, 0.0)


def drawn(name: str, told: Any, count: int = 2000, **other: Any) -> np.ndarray:
    population = population_from({"population": {name: told}, **other}, MODEL, 5)
    return np.array([population.member(k, NOMINAL)[name] for k in range(count)], dtype=float)


@pytest.mark.parametrize(
    ("name", "told", "expected"),
    [
        ("belt_stiffness.stiffness", {"uniform": ["180 kN/m", "220 kN/m"]}, ("uniform", (180e3, 40e3))),
        ("coulomb.level", {"normal": ["80 mNm", 0.004]}, ("norm", (0.08, 0.004))),
        ("cart.mass", {"tolerance": "5 %"}, ("uniform", (0.95 * 13.44, 0.1 * 13.44))),
        ("belt_damping.damping", {"uniform": ["10 N s/m", 30]}, ("uniform", (10.0, 20.0))),
        ("drive.delay", {"uniform": ["500 us", "1.5 ms"]}, ("uniform", (5e-4, 1e-3))),
    ],
)
def test_draws_have_the_distribution_that_was_asked_for(name: str, told: Any, expected: tuple[str, tuple[float, ...]]) -> None:
    assert kstest(drawn(name, told), *expected).pvalue > 0.01


def test_a_choice_is_even() -> None:
    values, counts = np.unique(drawn("payload", {"choice": ["0 kg", "500 g", 2]}), return_counts=True)
    assert values.tolist() == [0.0, 0.5, 2.0]
    assert np.all(np.abs(counts - 2000 / 3) < 4.0 * np.sqrt(2000 * 2 / 9))


def test_a_member_keeps_its_values_whatever_else_the_study_draws() -> None:
    told = {"population": {"cart.mass": {"tolerance": "5 %"}}}
    more = {
        "population": {"payload": {"uniform": [0, 3]}, **told["population"]},
        "ageing": {"age": {"uniform": [0, 1]}, "when_old": {"coulomb.level": "+10 %"}},
    }
    members = [population_from(data, MODEL, seed).member(17, NOMINAL)["cart.mass"] for data, seed in ((told, 5), (more, 5), (told, 6))]
    assert members[0] == members[1] != members[2]


def test_age_payload_and_a_hidden_effect_make_the_axis() -> None:
    data = {
        "population": {"payload": {"uniform": [0, 3]}, "coulomb.level": {"tolerance": "20 %"}, "drive.delay": {"uniform": [0, 0.002]}},
        "ageing": {"age": {"uniform": [0, 1]}, "when_old": {"coulomb.level": "+40 %", "belt_stiffness.stiffness": "-20 %"}},
        "hidden": {"none": {}, "stribeck": {"amount": {"uniform": [0.04, 0.08]}, "speed_scale": 2.5}},
    }
    population = population_from(data, MODEL, 1)
    healthy, hurt = (population.member(k, NOMINAL) for k in (2, 3))
    assert (healthy["hidden"], hurt["hidden"]) == ("none", "stribeck")
    axis = drawn_axis(population, hurt, MODEL, 1e-3, 0.1)
    age = float(hurt["age"])
    assert axis.model["coulomb.level"] == pytest.approx(float(hurt["coulomb.level"]) * (1.0 + 0.4 * age))
    assert axis.model["belt_stiffness.stiffness"] == pytest.approx(203740.0 * (1.0 - 0.2 * age))
    assert axis.model["cart.mass"] == pytest.approx(13.44 + float(hurt["payload"]))
    assert (axis.delay_s, axis.start_m) == (hurt["drive.delay"], 0.1)
    assert (axis.model["stribeck.amount"], axis.model["stribeck.speed_scale"]) == (hurt["stribeck.amount"], 2.5)
    assert "stribeck" not in drawn_axis(population, healthy, MODEL, 1e-3, 0.1).model.effects


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"population": {"cart.mas": {"tolerance": "2 %"}}}, "population.cart.mas is nothing that this axis has, did you mean cart.mass?"),
        ({"population": {"cart.mass": {"tolerance": 2}}}, "write a change in per cent"),
        ({"population": {"cart.mass": {"uniform": ["2 kg", "1 kg"]}}}, "the first must be below the second"),
        ({"population": {"cart.mass": {"uniform": ["2 mm", "3 kg"]}}}, "'mm' is not a unit of it"),
        ({"population": {"cart.mass": {"normal": [1]}}}, r"write \[MEAN, STANDARD DEVIATION\]"),
        ({"population": {"payload": {"tolerance": "5 %"}}}, "has no nominal value"),
        ({"population": {"move.from": {"tolerance": "5 %"}}}, "its nominal value here is 0, of which every share is 0"),
        ({"ageing": {"age": {"uniform": [0, 1]}}}, "ageing needs both"),
        ({"hidden": {"stribek": {}}}, "did you mean stribeck"),
        ({"population": None, "ageing": None}, "nothing differs between the members"),
        ({"member": 10}, "the study has no entry member, did you mean members?"),
        ({"members": 0}, "a whole number from 1"),
        ({"each": "trak"}, "did you mean track?"),
        ({"base": None}, "base is missing; name a run"),
        ({"base": {"plant": "g_a"}}, "base.axis is missing"),
        ({"base": {"plant": "g_a", "run": "r"}}, "name one of them"),
        ({"base": {"runs": "nowhere/*"}, "each": "diagnose", "population": None, "ageing": None, "members": None}, "no run folder is"),
        ({"each": "commission"}, "gains are for each: track"),
        ({"targets": {"dynamic": "1 kg"}}, "'kg' is not a unit of it"),
    ],
)
def test_what_a_study_cannot_be_is_said_with_file_and_entry(written: Callable[..., Path], other: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words) as problem:
        load_study(written(**other))
    assert str(problem.value).count("small.yaml") == 1


def test_an_axis_that_cannot_be_is_a_result(written: Callable[..., Path], tmp_path: Path) -> None:
    """Every second axis has a friction that no axis has: a sentence and an exit code, and a miss in the share."""
    study = written(members=4, hidden={"none": {}, "stribeck": {"amount": 1e9}})
    result = api.study(study, tmp_path, workers=1, report=False)
    lines = [json.loads(line) for line in (tmp_path / "members.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [line["exit_code"] for line in lines[1::2]] == [2, 2]
    assert "stribeck.amount" in lines[1]["error"]
    assert set(result.data["failed"]) == {"1", "3"}
    assert result.exit_code == 1
    assert (result.data["shares"][0]["key"], result.data["shares"][0]["of"]) == ("passed", 4)
    assert any("2 members have no result, such as member 1" in text for text in result.text)


def test_the_summary_tells_shares_drivers_and_the_worst() -> None:
    random = np.random.default_rng(2)
    lines: list[dict[str, Any]] = []
    for k in range(200):
        mass, friction = float(random.uniform(9.0, 11.0)), float(random.uniform(0.5, 1.5))
        error = abs(friction - 1.0) * 1e-3
        found = {"passed": error < 4e-4, "stable": True, "dynamic_m": error, "phase_margin_deg": mass}
        lines.append({"member": k, "key": "", "values": {"m": mass, "f": friction}, "exit_code": int(error >= 4e-4), "found": found})
    lines[7] = {"member": 7, "key": "", "values": {"m": 10.0, "f": 1.0}, "exit_code": 3, "error": "no data"}
    summary = summary_of(lines[::-1], 300, {"dynamic_m": 4e-4}, {"m": 10.0, "f": 1.0})
    passed = summary.share("passed")
    assert passed is not None
    assert (passed.of, passed.count) == (200, sum(line.get("found", {}).get("passed", False) for line in lines))
    assert (summary.done, summary.planned, summary.failed) == (200, 300, {7: "no data"})
    strongest = next(one for one in summary.drivers if one.key == "dynamic_m")
    assert (strongest.parameter, strongest.excludes_zero) == ("distance from nominal of f", True)
    assert next(one for one in summary.drivers if one.key == "phase_margin_deg").parameter == "m"
    assert not any(one.excludes_zero for one in summary.drivers if one.parameter == "f" and one.key == "phase_margin_deg")
    assert summary.worst[0] == 7
    worst = max((line for line in lines if "found" in line), key=lambda line: line["found"]["dynamic_m"])
    assert summary.worst[1] == worst["member"]


@pytest.mark.parametrize(("count", "of", "low", "high"), [(0, 20, 0.0, 0.1684), (20, 20, 0.8316, 1.0), (5, 50, 0.0333, 0.2181)])
def test_intervals_are_those_of_clopper_and_pearson(count: int, of: int, low: float, high: float) -> None:
    share = _share_of("passed", count, of)
    assert (share.low, share.high) == pytest.approx((low, high), abs=1e-4)
