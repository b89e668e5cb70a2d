"""Where a gap is looked for from the start values: the model that the search begins with, and where it is not asked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from beltcomm.effects import effect_named
from beltcomm.laboratory.coupled_bodies import _by_sections, _stiffness_at, _with_pulleys
from beltcomm.laboratory.gaps import FAR_OFF, _as_started, _with_gap, gap_from_start
from beltcomm.model import Model, load_plant

#: A fit of a screw with a gap, astray: a load and a spring that are not there, and the torque late.
ASTRAY = {"motor.inertia": 6e-5, "cart.mass": 144.0, "belt_stiffness.stiffness": 6.7e6, "belt_damping.damping": 26000.0}


def screw() -> Model:
    return load_plant("ball_screw").model


def test_the_search_begins_with_masses_and_spring_of_the_start_and_all_friction_of_the_fit() -> None:
    truth = screw()
    astray = truth.with_effect("dead_time").with_values({**ASTRAY, "dead_time.time": 0.001})
    begun = _as_started(astray, truth)
    for name in ("motor.inertia", "cart.mass", "belt_stiffness.stiffness"):
        assert begun[name] == truth[name]
    assert begun["dead_time.time"] == 0.0
    ratio = truth["transmission.ratio"]
    assert begun["coulomb.level"] + ratio * begun["cart_friction.level"] == pytest.approx(
        astray["coulomb.level"] + ratio * astray["cart_friction.level"]
    )
    assert 500.0 < begun["belt_damping.damping"] < 3000.0  # 2 % of the critical one, where the fit had made 26 000 of it


def test_a_gap_has_its_width_and_its_contact() -> None:
    found = _with_gap(screw(), effect_named("backlash"), 2e-5, 0.03)
    assert (found["backlash.gap"], found["backlash.rounding"]) == (2e-5, 0.03)


@pytest.mark.parametrize("without", [(), ("belt_stiffness", "belt_damping")])
def test_it_is_not_asked_near_the_noise_nor_without_a_spring(without: tuple[str, ...]) -> None:
    model = screw()
    for name in without:
        model = model.without_effect(name)
    near = SimpleNamespace(model=model, ratio=0.9 * FAR_OFF if not without else 2.0 * FAR_OFF)
    assert gap_from_start(cast(Any, None), cast(Any, near), screw()) is None


def test_sections_take_the_place_of_spans_with_their_geometry_which_no_fit_moves() -> None:
    rig = load_plant("egc_70").model
    values = {f"belt_spans.{name}": rig[f"belt_sections.{name}"] for name in ("specific_stiffness", "pulley_distance", "offset")}
    spans = rig.without_effect("belt_sections").with_effect("belt_spans").with_effect("belt_damping").with_values(values)
    grown = _by_sections(spans, _stiffness_at(spans, 0.25))
    assert grown is not None
    assert not {"belt_spans", "belt_damping"} & set(grown.effects)
    distance = grown.parameters["belt_sections.pulley_distance"]
    assert distance.low == distance.value == distance.high == rig["belt_sections.pulley_distance"]
    assert grown["belt_sections.offset"] == rig["belt_sections.offset"]
    begun = list(_with_pulleys(grown, 11.57, _stiffness_at(spans, 0.25)))  # beside sections that are there already
    assert begun
    assert all(one.effects == grown.effects and one["end_pulley.mass"] != grown["end_pulley.mass"] for one in begun)
