"""What the design source compares, on a run: its equalities hold where they are solved, its slow integrator says what friction lets it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm.axis.written import commented
from beltcomm.errors import UsageError
from beltcomm.jobs.own_thesis import OWN, own_thesis
from beltcomm.rundata.proof import move_of
from beltcomm.runfolder import RunFolder
from session.conftest import Complete


@pytest.mark.parametrize("topic", list(OWN))
def test_each_topic_fits_a_screen(complete: Complete, topic: str) -> None:
    found = own_thesis(topic, complete.path)
    assert len(list(found.lines())) <= 24


def test_the_integrator_ends_within_friction_and_half_sums_do_not(complete: Complete) -> None:
    found = own_thesis("gravity", complete.path).to_json()
    low, high = found["integrator_nm"]
    truth = complete.bench.plant.truth
    held_nm = complete.bench.plant.ratio * truth["mass_kg"] * 9.81 * math.sin(math.radians(found["tilt_deg"]))
    assert found["gravity_nm"] == pytest.approx(held_nm, rel=0.03)
    assert found["friction_nm"] == pytest.approx(truth["coulomb_total_nm"], rel=0.05)
    assert found["gravity_nm"] - found["friction_nm"] == pytest.approx(low, abs=2e-3)
    assert found["gravity_nm"] + found["friction_nm"] == pytest.approx(high, abs=2e-3)
    assert found["half_sum_nm"] == pytest.approx(found["gravity_nm"])


@pytest.mark.examination
def test_the_ways_on_the_own_model_find_its_mass(complete: Complete, tmp_path: Path) -> None:
    """Indirect with the controller as it runs is right, with one that is 20 % off it is not (3.4), on any axis."""
    found = own_thesis("identification", complete.path, pictures=tmp_path).to_json()
    by = {way["name"]: way for way in found["ways"]}
    assert by["indirect, C as it runs"]["mass_kg"] == pytest.approx(complete.bench.plant.truth["mass_kg"], rel=0.02)
    assert abs(by["strong loop, indirect"]["low_db"]) < 0.3 < 1.0 < by["strong, C 20 % off"]["low_db"]
    assert len(found["pictures"]) == len(list(tmp_path.glob("*.png"))) == 3


def test_the_move_of_an_axis_that_states_none_is_the_one_that_verified_it(copy_of_complete: Callable[..., Path]) -> None:
    """Figures 5.1 to 5.4 and a watched virtual production: ``init`` asks for no limits of a reference motion."""
    run = copy_of_complete()
    stated = own_thesis("closed-loop", run).to_json()
    axis = RunFolder.open(run).axis
    (run / "axis.yaml").write_text(commented(replace(axis, trajectories={})), encoding="utf-8")
    folder = RunFolder.open(run)
    assert folder.axis.trajectories == {}
    found = own_thesis("closed-loop", run).to_json()
    assert len(found["moves"]) == len(stated["moves"])
    start, end, duration_s = next(
        path
        for name in reversed(folder.names("results"))
        if name.startswith("verify_") and (path := (folder.load("results", name).get("proof") or {}).get("path"))
    )
    move = move_of(folder, 1e-3, None)
    assert (move.position_m[0], move.position_m[-1]) == pytest.approx((start, end), abs=1e-6)
    assert move.duration_s == pytest.approx(duration_s, rel=0.02)


def test_what_draws_nothing_says_what_does(complete: Complete, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="beltcomm report"):
        own_thesis("designs", complete.path, pictures=tmp_path)


def test_a_topic_of_no_axis_is_refused(complete: Complete) -> None:
    with pytest.raises(UsageError, match="not compared on a run"):
        own_thesis("friction", complete.path)
