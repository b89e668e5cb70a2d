"""What is said of a quantity by its last moves: chance, change, limit."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from beltcomm.errors import UsageError
from beltcomm.sentences.watch import untold_sentence
from beltcomm.watching import store
from beltcomm.watching.drift import BASE, AxisDrift
from beltcomm.watching.estimates import ERROR, FEWEST, MoveEstimate, Standing, excess_of
from beltcomm.watching.limits import LIMITS, Limit, limits_given
from beltcomm.watching.places import untold_by

KEY = "coulomb_total"


def followed(values: list[float], interval: float = 0.02, key: str = KEY, limits: dict[str, Limit] | None = None) -> list[Standing]:
    drift = AxisDrift({key: MoveEstimate(1.0, 0.005)}, limits if limits is not None else dict(LIMITS))
    return [drift.add_told({key: MoveEstimate(value, interval)})[0] for value in values]


@pytest.mark.parametrize("seed", range(3))
def test_chance_is_no_change(seed: int) -> None:
    values = np.random.default_rng(seed).normal(1.0, 0.01, 400).tolist()
    assert {one.state for one in followed(values)} == {"few", "steady"}


def test_ten_moves_that_scatter_little_by_chance_are_no_change() -> None:
    """Each says that it knows its quantity 2.5 times better than it does, as of some belts: what all of them scatter counts."""
    before = np.random.default_rng(9).normal(1.0, 0.12, 60).tolist()
    interval = 1.96 * 0.12 / 2.5
    assert followed([*before, *[1.2] * 10], interval, limits={})[-1].state == "steady"
    assert followed([*before, *[1.5] * 10], interval, limits={})[-1].state == "changed"
    knocked = [MoveEstimate(value, interval) for value in [*before, 9.0, *before]]
    assert excess_of(KEY, knocked[:60]) == pytest.approx(2.5, rel=0.25)
    assert excess_of(ERROR, knocked) == pytest.approx(2.5, rel=0.25)  # a knock against the axis is one move


def test_a_law_that_is_not_quite_the_machine_s_is_no_change() -> None:
    """Moves whose parameter is beside the run's from the first one on."""
    values = np.random.default_rng(1).normal(1.25, 0.01, 200).tolist()
    assert {one.state for one in followed(values)} == {"few", "steady"}


def test_what_grows_is_noticed_before_its_limit_and_alarms_beyond_it() -> None:
    random, growth = np.random.default_rng(2), np.linspace(0.0, 0.7, 300)
    standings = followed([*random.normal(1.0, 0.01, BASE), *(random.normal(1.0, 0.01, 300) + growth)])
    states = [one.state for one in standings]
    noticed, alarm = states.index("changed") - BASE, states.index("alarm") - BASE
    assert 0.10 < growth[noticed] < 0.16  # beyond what friction changes by itself
    assert 0.50 < growth[alarm] < 0.56
    assert states[:FEWEST] == ["few"] * (FEWEST - 1) + ["steady"]


def test_an_axis_that_is_far_from_its_run_from_the_first_move_on_alarms_at_once() -> None:
    states = [one.state for one in followed([1.8] * FEWEST)]
    assert states[-1] == "alarm"


def test_an_axis_that_stays_as_bad_is_not_back() -> None:
    """Twenty moves beyond the limits of the run are no base; when it was mended, it is steady again."""
    states = [one.state for one in followed([*[1.8] * (BASE + 10), *[1.0] * (BASE + 10)])]
    assert set(states[FEWEST - 1 : BASE + 10]) == {"alarm"}
    assert states[-1] == "steady"


@pytest.mark.parametrize(("interval", "least"), [(0.01, 0.1), (0.2, None)])
def test_a_change_is_noticed_from_where_it_is_said_to_be(interval: float, least: float | None) -> None:
    """By what friction changes by itself where the moves tell it well, else by what they tell."""
    told = followed([1.0] * (BASE + 10), interval)[-1].noticed_from
    assert told == pytest.approx(least) if least is not None else told > 0.15
    for share, state in ((0.9, "steady"), (1.1, "changed")):
        values = [*[1.0] * (BASE + 10), *[1.0 + share * told] * 10]
        assert followed(values, interval, limits={})[-1].state == state


def test_what_no_move_tells_is_named() -> None:
    drift = AxisDrift({KEY: MoveEstimate(1.0, 0.005), "belt_stiffness.stiffness": MoveEstimate(2e5, 1e3)}, LIMITS)
    for _ in range(FEWEST):
        standings = drift.add_told({KEY: MoveEstimate(1.0, 0.02)})
    assert untold_by(standings, None).keys == ("belt_stiffness.stiffness",)
    assert "cannot show a change of the belt stiffness" in untold_sentence(untold_by(standings, None))


def test_one_knock_is_not_the_axis() -> None:
    values = [1.0] * 40
    values[30] = 4.0
    assert {one.state for one in followed(values, 0.06, key=ERROR)} == {"few", "steady"}


def test_the_trace_of_a_day_says_what_the_watch_said(tmp_path: Path) -> None:
    """The error over the noise by its median, in the day as in the pool: a knock is one move there, too."""
    values = [*np.random.default_rng(4).normal(1.0, 0.01, BASE).tolist(), 1.0, 4.0, 1.01, 0.99, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    watched = {key: followed(values, 0.06, key=key)[-1] for key in (ERROR, KEY)}
    for number, value in enumerate(values):
        quantities = {KEY: {"value": value, "interval": 0.06}}
        date_s = store.DAY_S * (0.5 if number < BASE else 1.5)
        store.append(tmp_path, {"date_s": date_s, "quantities": quantities, "error_over_noise": value, "error_interval": 0.06})
    _, told = store.by_day(tmp_path)[-1]
    for key, one in watched.items():
        assert one.base is not None
        assert told[key] == pytest.approx((one.value / one.base.value, one.interval / one.base.value))
    assert told[ERROR][0] < 1.02 < told[KEY][0]
    alone = tmp_path / "alone"
    alone.mkdir()
    store.append(alone, {"date_s": 1.0, "quantities": {KEY: {"value": 2.0, "interval": 0.1}}})
    assert store.by_day(alone) == [(1.0, {KEY: (1.0, 0.05)})]


def test_scatter_beyond_the_intervals_widens_them() -> None:
    rough = followed(np.random.default_rng(3).normal(1.0, 0.2, 12).tolist())[-1]
    assert rough.interval > 5.0 * 0.02 / math.sqrt(10.0)


def test_after_a_maintenance_the_base_is_another() -> None:
    drift = AxisDrift({KEY: MoveEstimate(1.0, 0.005)}, LIMITS)
    for _ in range(BASE):
        drift.add_told({KEY: MoveEstimate(1.0, 0.02)})
    drift.begin_anew()
    last = [drift.add_told({KEY: MoveEstimate(1.3, 0.02)})[0].state for _ in range(BASE + 5)]
    assert last[-1] == "steady"


def test_limits_are_given_in_per_cent_in_si_or_not_at_all() -> None:
    limits = limits_given(["coulomb_total=+30%", "cart.mass=none"])
    assert limits["coulomb_total"].values(2.0) == (None, pytest.approx(2.6))
    assert limits["cart.mass"].values(2.0) == (None, None)
    assert followed([1.4] * FEWEST, limits=limits)[-1].state == "alarm"


def test_a_limit_beyond_any_number_is_refused() -> None:
    with pytest.raises(UsageError, match="none is no limit"):
        limits_given(["coulomb_total=1e400"])
