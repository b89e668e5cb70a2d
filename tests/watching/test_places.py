"""Friction at places of the travel: a tight spot that only some moves cross is noticed, and chance at many places is not."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.sentences.watch import untold_sentence
from beltcomm.watching.estimates import MoveEstimate, Standing
from beltcomm.watching.limits import LIMITS
from beltcomm.watching.places import BASE, PLACE, PlaceDrift, untold_by
from beltcomm.watching.store import places_told

FRICTION, NOISE, WIDTH_M = 0.1, 0.004, 0.02
TIGHT, PLACES = 12, 30


def driven(growth: list[float], seed: int = 0, crossed: int = 3) -> list[Standing]:
    """Moves of which one in ``crossed`` goes over the tight spot, whose friction is more by these shares."""
    random, drift = np.random.default_rng(seed), PlaceDrift(MoveEstimate(FRICTION, 0.001), LIMITS[PLACE], WIDTH_M)
    standings = []
    for number, more in enumerate(growth):
        places = range(PLACES) if number % crossed == 0 else range(TIGHT - 2)
        told = {one: 0.003 * one + random.normal(0.0, NOISE) + (FRICTION * more if one == TIGHT else 0.0) for one in places}
        standings.append(drift.add({one: MoveEstimate(value, 1.96 * NOISE) for one, value in told.items()}))
    return standings


@pytest.mark.parametrize("seed", range(3))
def test_chance_at_thirty_places_is_no_tight_spot(seed: int) -> None:
    """Friction that has hung on the place from the first move on is none either."""
    assert {one.state for one in driven([0.0] * 400, seed)} == {"few", "steady"}


@pytest.mark.parametrize("seed", range(3))
def test_a_tight_spot_is_noticed_where_it_is_and_alarms_beyond_its_limit(seed: int) -> None:
    growth = [0.0] * (3 * BASE + 30) + np.linspace(0.0, 1.5, 400).tolist()
    standings = driven(growth, seed)
    states = [one.state for one in standings]
    noticed, alarm = states.index("changed"), states.index("alarm")
    assert 0.2 < growth[noticed] < 0.5
    assert 0.5 < growth[alarm] < 0.8
    for one in (standings[noticed], standings[alarm], standings[-1]):
        assert one.place_m == pytest.approx((TIGHT + 0.5) * WIDTH_M)
    assert set(states[alarm:]) == {"alarm"}
    assert standings[-1].change == pytest.approx(1.45, abs=0.1)  # over its last ten crossings


def test_where_no_move_that_tells_crosses_the_travel_that_is_said() -> None:
    """All moves go from 0 to 0.7 m, those that tell something at most to 0.6 m; a spot is named from a fifth of the friction on."""
    last = driven([0.0] * 100)[-1]
    assert last.followed_m == ((0.0, pytest.approx(0.6)),)
    assert last.noticed_from == 0.2  # what friction changes by itself: these crossings would tell less
    untold = untold_by([last], (0.0, 0.7))
    assert untold.stretches_m == ((pytest.approx(0.6), 0.7),)
    assert "a tight spot at 600 mm to 700 mm" in untold_sentence(untold)
    assert untold_sentence(untold_by([last], (0.0, 0.61))) == ""
    few = driven([0.0] * (3 * BASE))[-1]  # of the long moves by now no more than the base
    assert untold_by([few], (0.1, 0.3)).stretches_m == ((pytest.approx((TIGHT - 2) * WIDTH_M), 0.3),)
    none = driven([0.0])[-1]
    assert untold_by([none], (0.1, 0.3)).stretches_m == ((0.1, 0.3),)


def test_what_a_file_says_of_places_is_read_or_left_out() -> None:
    kept = {"12": [0.01, 0.002], "-3": [-0.02, 0.001], "x": [1.0, 1.0], "4": [0.1], "5": ["a", 1.0], "6": [0.1, -1.0], "9" * 9: [0.1, 0.1]}
    assert places_told({"places": kept}) == {12: MoveEstimate(0.01, 0.002), -3: MoveEstimate(-0.02, 0.001)}
    assert places_told({"places": [1]}) == places_told({}) == {}
