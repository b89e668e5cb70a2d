"""A slow bus is a slower plan and a wider interval, and no failure in the last phase."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.errors import UsageError
from beltcomm.experiments.plan import commission_plan
from beltcomm.model import load_plant
from beltcomm.schedule.sequences import FEWEST_ROWS, shapes_at, short_seconds, short_sequence


@pytest.mark.examination
def test_an_axis_is_commissioned_at_a_sync_of_10_ms(tmp_path: Path) -> None:
    truth = load_plant("g_a").model
    result = api.commission(
        "virtual", load_axis("egc-70-600"), tmp_path / "run", options=api.Options(yes=True, quick=True, seed=5, sample_period_s=10e-3)
    )
    found = result.to_json()
    assert result.exit_code == 0
    for name in ("cart.mass", "belt_stiffness.stiffness"):
        item = found["model"]["parameters"][name]
        assert abs(item["value"] - truth[name]) < 1.5 * item["interval"]
        assert item["interval"] < 0.02 * truth[name]
    verdict = found["verdict"]
    assert verdict["passed"]
    assert verdict["measured"]["dynamic_m"] == pytest.approx(verdict["predicted"]["dynamic_m"], rel=0.4)


@pytest.mark.parametrize("period_s", [0.5e-3, 1e-3, 6.4e-3])
def test_the_exchange_runs_at_the_period_asked_for_and_the_plan_says_what_it_shows(period_s: float) -> None:
    axis = load_axis("egc-70-600")
    with open_drive("virtual", {"sample_period": period_s}) as drive:
        assert drive.capabilities.sample_period_s == pytest.approx(period_s)
        assert drive.capabilities.structure.period_s <= 1e-3
        plan = commission_plan(axis, drive.capabilities, "quick")
    said = " ".join(map(str, plan.lines()))
    assert f"A SYNC every {1e3 * period_s:g} ms: resonances up to {0.35 / period_s:.0f} Hz can be measured" in said
    assert ("So seldom, the carriage is shaken slowly" in said) is (period_s > 2e-3)


def test_a_period_that_no_loop_has_is_refused_with_what_there_is() -> None:
    with pytest.raises(UsageError, match=r"a sample period of 0\.05 ms is asked for, this drive has none below"):
        open_drive("virtual", {"sample_period": 5e-5})


@pytest.mark.parametrize("period_s", [0.25e-3, 0.5e-3, 1e-3, 2e-3, 3.2e-3, 4e-3, 6.4e-3, 10e-3, 20e-3])
def test_short_sequences_last_about_as_long_at_every_period(period_s: float) -> None:
    for order, clock in shapes_at(period_s):
        made = short_sequence(order, clock, 0.1, period_s)
        assert (made.repeats + 1) * made.period_samples >= FEWEST_ROWS
    order, clock = shapes_at(period_s)[0]
    assert 0.5 < (2**order - 1) * clock * period_s < 1.6
    assert short_sequence(order, clock, 0.1, period_s).duration_s < 1.2 * short_seconds(period_s)
