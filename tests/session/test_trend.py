"""Runs of one axis side by side: what changed between two, what drifts over many, and when a limit is reached; no drive, no fit."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.errors import DataError, UsageError
from beltcomm.identify.course import course_of
from beltcomm.pages.changes import _changes_of
from beltcomm.pages.quantities import Quantity, quantities_of
from session.conftest import Complete

DAY_S = 86400.0
Months = Callable[[Mapping[str, Callable[[int], float]], int], list[Path]]


def quantity(value: float, interval: float | None, key: str = "coulomb_total", usual: float = 0.1) -> dict[str, Quantity]:
    return {key: Quantity(key, "friction", "N m", 1.0, value, interval, "friction up", "friction down", usual, "temperature")}


@pytest.mark.parametrize(
    ("now", "interval", "state", "words"),
    [
        (1.30, 0.01, "changed", "friction up by 30.0 ± 1.6 %"),
        (0.70, 0.01, "changed", "friction down by 30.0 ± 1.2 %"),
        (1.05, 0.01, "usual", "no more than by temperature"),
        (1.01, 0.01, "none", "no change that these data show"),
        (1.30, 0.40, "none", "no change that these data show"),
        (1.30, None, "unsure", "cannot tell from chance"),
    ],
)
def test_a_change_is_named_by_what_its_interval_allows(now: float, interval: float | None, state: str, words: str) -> None:
    (change,) = _changes_of(quantity(1.0, 0.01), quantity(now, interval))
    assert change.state == state
    assert words in change.words()


def test_runs_of_one_day_make_no_course(months: Months) -> None:
    found = api.trend(months({"coulomb_total": lambda i: 1.0 + 0.1 * i}, 3), dates=("2025-01-01T08", "2025-01-01T10", "2025-01-01T12"))
    assert found.to_json()["quantities"]["coulomb_total"]["state"] == "unsure"
    assert "1 of 3 days" in found.to_json()["quantities"]["coulomb_total"]["text"]


def test_the_interval_of_a_ratio_covers_it() -> None:
    draws = np.random.default_rng(1).normal([2.0, 3.0], [0.05, 0.06], (4000, 2))
    (change,) = _changes_of(quantity(2.0, 1.96 * 0.05), quantity(3.0, 1.96 * 0.06))
    assert change.interval is not None
    inside = np.abs(draws[:, 1] / draws[:, 0] - 1.0 - change.share) < change.interval
    assert 0.93 < np.mean(inside) < 0.97


def test_a_course_covers_the_slope_and_the_day_of_its_limit_as_often_as_it_says() -> None:
    """Where runs scatter four times as much as their own intervals say."""
    draw = np.random.default_rng(2)
    t_s = DAY_S * np.arange(0.0, 360.0, 60.0)
    slope, held, reached, steady = -1.0 / (DAY_S * 365.0), 0, 0, 0
    day = (9.0 - 10.0) / slope
    for _ in range(400):
        noise = draw.normal(0.0, 0.08, len(t_s))
        course = course_of(t_s, 10.0 + slope * t_s + noise, np.full(len(t_s), 1.96 * 0.02))
        held += abs(course.slope - slope) < course.slope_interval
        found = course.reaches(9.0)
        reached += found is not None and found[0] <= day <= found[2]
        steady += not course_of(t_s, 10.0 + noise, np.full(len(t_s), 1.96 * 0.02), looked_at=10).drifts
    assert 0.92 < held / 400 < 0.98
    assert reached / 400 > 0.91
    assert steady / 400 > 0.98


def test_two_runs_make_no_course() -> None:
    with pytest.raises(DataError, match="3 runs"):
        course_of(np.array([0.0, 1.0]), np.array([1.0, 2.0]), np.array([0.1, 0.1]))


@pytest.fixture
def months(complete: Complete, tmp_path: Path) -> Months:
    """Runs two months apart, whose numbers are the complete run's times a factor: fit results only, no recordings."""

    def make(factors: Mapping[str, Callable[[int], float]], count: int) -> list[Path]:
        made = []
        for i in range(count):
            run = tmp_path / f"run_{i}"
            (run / "recordings").mkdir(parents=True)
            for kind in ("models", "results"):
                shutil.copytree(complete.path / kind, run / kind)
            shutil.copy(complete.path / "axis.yaml", run)
            (run / "run.yaml").write_text(to_yaml({"began_s": 1.7e9 + 60.0 * i * DAY_S}), encoding="utf-8")
            model, fit = read_yaml(run / "models/final.yaml", DataError), read_yaml(run / "results/fit.yaml", DataError)
            for key, factor in factors.items():
                place = model["parameters"] if key in model["parameters"] else fit["characteristics"]
                place[key]["value"] *= factor(i)
            (run / "models/final.yaml").write_text(to_yaml(model), encoding="utf-8")
            (run / "results/fit.yaml").write_text(to_yaml(fit), encoding="utf-8")
            made.append(run)
        return made

    return make


def test_what_drifts_is_named_with_the_day_of_its_limit(months: Months) -> None:
    wobble = (0.001, -0.002, 0.002, -0.001, 0.0)
    runs = months({"belt_stiffness.stiffness": lambda i: 1.0 - 0.03 * i + wobble[i], "coulomb_total": lambda i: 1.0 + wobble[i]}, 5)
    result = api.trend(runs)
    found = result.to_json()["quantities"]
    belt = found["belt_stiffness.stiffness"]
    assert belt["state"] == "drifts"
    assert belt["text"].startswith("belt softer")
    early, by_line, late = belt["reach_s"]
    assert early < 1.7e9 + 60.0 * DAY_S * 0.2 / 0.03 < late
    assert early < by_line < late
    assert found["coulomb_total"]["state"] == "steady"
    assert result.exit_code == 0
    assert "belt softer" in (runs[-1] / "trend.html").read_text(encoding="utf-8")
    assert json.loads((runs[-1] / "trend.json").read_text(encoding="utf-8"))["verdict"] == result.to_json()["verdict"]


def test_limits_can_be_set_and_one_that_is_reached_fails(months: Months) -> None:
    runs = months({"coulomb_total": lambda i: 1.0 + 0.2 * i}, 2)
    unsure = api.trend(runs, dates=("2025-01-01", "2025-06-01"))
    assert unsure.exit_code == 0
    assert "2 of 3 days" in unsure.to_json()["quantities"]["coulomb_total"]["text"]
    result = api.trend(runs, limits=("coulomb_total=+10%",))
    assert result.exit_code == 1
    assert "has reached its limit" in result.to_json()["quantities"]["coulomb_total"]["text"]
    for wrong in ("coulomb=+10%", "coulomb_total:10", "coulomb_total=ten"):
        with pytest.raises(UsageError, match=r"coulomb_total|KEY="):
            api.trend(runs, limits=(wrong,))
    with pytest.raises(UsageError, match="1 dates for 2 runs"):
        api.trend(runs, dates=("2025-01-01",))
    with pytest.raises(UsageError, match="at least two runs"):
        api.trend(runs[:1])


def test_a_run_against_itself_with_a_softer_belt(complete: Complete) -> None:
    folder = complete.folder
    model = complete.final.fit.model
    before = quantities_of(model, {"fit": folder.load("results", "fit")})
    softer = {key: replace(q, value=0.88 * q.value) if key == "belt_stiffness.stiffness" else q for key, q in before.items()}
    changes = {change.now.key: change for change in _changes_of(before, softer)}
    assert changes.pop("belt_stiffness.stiffness").words().startswith("belt softer by 12")
    assert {change.state for change in changes.values()} == {"none"}
