"""Models: composition, clashes, values, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from beltcomm.errors import UsageError
from beltcomm.model import build_model, load_model, model_from_dict

TWO_MASS = ("belt_stiffness", "belt_damping", "viscous_motor", "coulomb_cart")


def test_vector_follows_the_listed_order() -> None:
    model = build_model("m", TWO_MASS, {"coulomb_cart.level": 2.5, "motor.inertia": 7e-5})
    assert list(model.parameters) == [
        "motor.inertia", "cart.mass", "transmission.ratio", "belt_stiffness.stiffness",
        "belt_damping.damping", "viscous_motor.damping", "coulomb_cart.level",
    ]  # fmt: skip
    assert model.vector()[model.index("coulomb_cart.level")] == 2.5
    assert model.vector()[0] == model["motor.inertia"] == 7e-5
    assert model.get("tilt.angle", 0.25) == 0.25


def test_bodies_that_effects_bring_come_after_the_base() -> None:
    model = build_model("m", ("end_pulley", "coupling"), {})
    assert [body.name for _, body in model.bodies()] == ["motor", "cart", "end_pulley", "driving_pulley"]


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (("belt_stiffness", "belt_stiffness_position"), "both a belt spring"),
        (("belt_stiffness", "end_pulley"), "both a belt spring"),
        (("belt_stiffness", "belt_damping", "belt_damping"), "a second time"),
        (("belt_stiffness", "coulomb_end_pulley"), "acts on end_pulley"),
        (("belt_stifness",), "did you mean belt_stiffness"),
    ],
)
def test_clashes_name_the_effects(effects: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        build_model("m", effects, {})


def test_an_element_needs_both_its_bodies() -> None:
    with pytest.raises(UsageError, match="belt_damping acts on cart"):
        build_model("m", ("belt_damping",), {}, base_bodies=("motor",))


def test_values_are_checked() -> None:
    with pytest.raises(UsageError, match=r"cart\.mass .* outside"):
        build_model("m", TWO_MASS, {"cart.mass": -1.0})
    with pytest.raises(UsageError, match="outside"):
        build_model("m", TWO_MASS, {"cart.mass": float("nan")})
    with pytest.raises(UsageError, match=r"no parameter cart\.inertia"):
        build_model("m", TWO_MASS, {"cart.inertia": 1.0})
    with pytest.raises(UsageError, match=r"no parameter tilt\.angle"):
        build_model("m", TWO_MASS, {}).with_values({"tilt.angle": 0.1})


def test_changed_values_lose_their_interval() -> None:
    data = build_model("m", TWO_MASS, {}).to_dict()
    data["parameters"]["cart.mass"]["interval"] = 0.1
    data["parameters"]["motor.inertia"]["interval"] = 1e-7
    changed = model_from_dict(data).with_values({"cart.mass": 5.0}, origin="fit")
    assert changed["cart.mass"] == 5.0
    assert changed.parameters["cart.mass"].interval is None
    assert changed.parameters["cart.mass"].origin == "fit"
    assert changed.parameters["motor.inertia"].interval == 1e-7


def test_effects_can_be_added_and_taken_away() -> None:
    model = build_model("m", TWO_MASS, {"cart.mass": 3.0})
    tilted = model.with_effect("tilt", {"angle": 0.2})
    assert tilted.effects == (*TWO_MASS, "tilt")
    assert tilted["tilt.angle"] == 0.2
    assert tilted.without_effect("tilt").to_dict() == model.to_dict()
    with pytest.raises(UsageError, match="a second time"):
        tilted.with_effect("tilt")


def test_a_file_brings_back_the_same_model(tmp_path: Path) -> None:
    model = build_model("m", ("end_pulley", "coupling", "tilt"), {"tilt.angle": 1.0 / 3.0}, origin="test", source="none")
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(model.to_dict()), encoding="utf-8")
    again = load_model(path)
    assert again == model
    assert np.array_equal(again.vector(), model.vector())


def test_bounds_and_units_left_out_come_from_the_effect() -> None:
    data = build_model("m", TWO_MASS, {}).to_dict()
    data["parameters"] = {name: {"value": item["value"]} for name, item in data["parameters"].items()}
    item = model_from_dict(data).parameters["viscous_motor.damping"]
    assert (item.unit, item.side, item.low, item.high) == ("N m s/rad", "motor", 0.0, 0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.pop("effects"), "not a model file"),
        (lambda data: data["parameters"].pop("cart.mass"), r"is missing cart\.mass"),
        (lambda data: data["parameters"].update({"cart.bogus": {"value": 1.0}}), r"unknown parameter cart\.bogus"),
        (lambda data: data["parameters"]["viscous_motor.damping"].update(unit="N s/m"), "must be in 'N m s/rad'"),
        (lambda data: data["parameters"]["cart.mass"].update(value="heavy"), "not a model file"),
        (lambda data: data.update(bodies=["motor", "wagon"]), "not a model file"),
    ],
)
def test_a_broken_file_is_named(change, message: str) -> None:
    data = build_model("m", TWO_MASS, {}).to_dict()
    change(data)
    with pytest.raises(UsageError, match=message):
        model_from_dict(data)


def test_an_unreadable_file_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("name: [1, 2", encoding="utf-8")
    with pytest.raises(UsageError, match=r"broken\.yaml cannot be read"):
        load_model(broken)
    broken.write_text("- 1\n", encoding="utf-8")
    with pytest.raises(UsageError, match="does not hold a mapping"):
        load_model(broken)
