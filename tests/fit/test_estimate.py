"""How far a fit goes: in parts as at once behind an observer, and no further where it cannot matter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from beltcomm.fit.estimate import AT_A_TIME, Fitted, fit, problem_of, resume_fit
from beltcomm.fit.likelihood.problem import Problem, hopeless
from beltcomm.fit.records import Data, prepare
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory import selection
from beltcomm.laboratory.acceptance import drop_by, most_within
from beltcomm.model import Model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session

Gapped = tuple[Data, Model, Fitted]

#: A response and a slow stroke: enough to see a gap by, and soon fitted.
RECORDS = ("05_frf_p1_a2", "10_slow_p0")


@pytest.fixture(scope="module")
def gapped(tmp_path_factory: pytest.TempPathFactory) -> Gapped:
    """A machine with a gap, a start model, and a few iterations from it."""
    folder = tmp_path_factory.mktemp("fitting") / "run"
    write_session(draw(37, ("backlash",), 1.0, "sheet"), folder, only=RECORDS)
    run = RunFolder.open(folder)
    records = run.recordings()
    model = start_model(run.axis, records).with_effect("backlash")
    data = prepare(records, run.axis, model)
    return data, model, fit(data, model, AT_A_TIME)


@pytest.mark.examination
def test_a_fit_behind_an_observer_that_is_gone_on_with_ends_where_one_at_once_does(gapped: Gapped) -> None:
    data, start, begun = gapped
    assert begun.onward is not None
    at_once = fit(data, start, 4 * AT_A_TIME)
    went_on = resume_fit(data, begun, 3 * AT_A_TIME)
    assert went_on.objective == pytest.approx(at_once.objective, rel=1e-9)
    assert np.allclose(went_on.x, at_once.x, rtol=1e-9)
    assert went_on.objective < begun.objective


@pytest.mark.examination
def test_a_fit_that_is_through_is_not_gone_on_with(gapped: Gapped) -> None:
    data, _, begun = gapped
    through = replace(begun, onward=None)
    assert resume_fit(data, through, 12) is through


@pytest.mark.parametrize(
    ("above", "gain", "left", "given_up"), [(100.0, 10.0, 4, False), (1000.0, 10.0, 4, True), (1.0, 5.0, 0, True), (-1.0, 5.0, 0, False)]
)
def test_a_search_is_hopeless_where_its_goal_is_out_of_reach_at_three_times_its_pace(
    above: float, gain: float, left: int, given_up: bool
) -> None:
    assert hopeless(above, gain, left) is given_up


def test_a_fit_ends_where_its_goal_is_out_of_reach(gapped: Gapped, monkeypatch: pytest.MonkeyPatch) -> None:
    data, _, begun = gapped
    smaller = begun.model.without_effect("backlash")
    steps: list[int] = []
    jacobian = Problem.jacobian

    def counted(problem: Problem, *words: Any) -> Any:
        steps.append(1)
        return jacobian(problem, *words)

    monkeypatch.setattr(Problem, "jacobian", counted)
    freely = fit(data, smaller, 25, offsets=begun.offsets)
    needed = len(steps)
    for goal, iterations in ((freely.objective, needed), (-1e9, 1)):
        steps.clear()
        assert fit(data, smaller, 25, offsets=begun.offsets, goal=goal).objective >= freely.objective
        assert len(steps) == iterations


@pytest.mark.parametrize(("gap_m", "told"), [(1e-4, True), (1e-8, False)])
def test_a_refit_without_an_earlier_effect_is_told_from_where_on_it_matters(
    gapped: Gapped, monkeypatch: pytest.MonkeyPatch, gap_m: float, told: bool
) -> None:
    """Not where nothing is left of that effect: then the refit is what stays."""
    data, _, begun = gapped
    goals: list[float] = []

    def without_it(_problem: Problem, _data: Data, _iterations: int, *, goal: float, **_options: Any) -> Fitted:
        goals.append(goal)
        return begun

    monkeypatch.setattr(selection, "fit_of", without_it)
    smaller = begun.model.without_effect("backlash")
    grown = replace(begun, model=begun.model.with_values({"backlash.gap": gap_m}, "test").with_effect("cogging"))
    selection.drop_superfluous(data, grown, smaller, "cogging")
    assert [goal < np.inf for goal in goals] == [told]


@pytest.mark.parametrize("loss", [0.0, 480.0])
def test_the_level_within_a_loss_is_that_of_the_drop(gapped: Gapped, loss: float) -> None:
    """Also where one of the two is judged behind an observer, whose noise is another."""
    data, _, begun = gapped
    smaller = fit(data, begun.model.without_effect("backlash"), 0)
    limit = most_within(problem_of(data, smaller.model), begun, loss)
    assert drop_by(smaller, begun) == pytest.approx(smaller.objective - limit + loss, rel=1e-9)


def test_no_level_is_told_where_the_noise_depends_on_what_is_fitted(gapped: Gapped) -> None:
    data, _, begun = gapped
    bent = replace(begun, model=begun.model.with_effect("measurement_lag"))
    assert most_within(problem_of(data, begun.model), bent, 100.0) == np.inf
