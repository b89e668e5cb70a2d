"""Models: composition, clashes, values, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from beltcomm.axis import load_axis
from beltcomm.errors import UsageError
from beltcomm.fit.likelihood.free_parameters import free_parameters
from beltcomm.fit.uncertainty.draws import machines_like
from beltcomm.model import Model, build_model, load_model, load_plant, model_from_dict
from beltcomm.model.covariance import Covariance
from beltcomm.runfolder import RunFolder

TWO_MASS = ("belt_stiffness", "belt_damping", "viscous", "cart_friction")


def test_vector_follows_the_listed_order() -> None:
    model = build_model("m", TWO_MASS, {"cart_friction.level": 2.5, "motor.inertia": 7e-5})
    assert list(model.parameters) == [
        "motor.inertia", "cart.mass", "transmission.ratio", "belt_stiffness.stiffness",
        "belt_damping.damping", "viscous.damping", "cart_friction.level",
    ]  # fmt: skip
    assert model.vector()[model.index("cart_friction.level")] == 2.5
    assert model.vector()[0] == model["motor.inertia"] == 7e-5
    assert model.get("tilt.angle", 0.25) == 0.25


def test_bodies_that_effects_bring_come_after_the_base() -> None:
    model = build_model("m", ("belt_sections", "coupling"), {})
    assert [body.name for _, body in model.bodies()] == ["motor", "cart", "end_pulley", "driving_pulley"]


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (("belt_stiffness", "belt_spans"), "both a belt spring"),
        (("belt_stiffness", "belt_sections"), "both a belt spring"),
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


def test_the_form_of_a_law_is_held_until_it_is_set_free() -> None:
    usual = build_model("axis", TWO_MASS, {}).with_effect("friction_position")
    assert "friction_position.flatness" not in free_parameters(usual)
    assert usual.with_values({"friction_position.flatness": 5.0})["friction_position.flatness"] == 5.0, "held elsewhere"
    free = usual.with_forms("friction_position")
    assert set(free_parameters(free)) == {*free_parameters(usual), "friction_position.flatness"}
    again = model_from_dict(free.to_dict())
    assert free_parameters(again) == free_parameters(free)


def test_a_model_from_before_a_law_had_forms_has_the_usual_one() -> None:
    model = build_model("axis", TWO_MASS, {}).with_effect("cable_chain")
    old = model.to_dict()
    del old["parameters"]["cable_chain.bend"], old["parameters"]["cable_chain.twist"]
    assert model_from_dict(old).vector() == pytest.approx(model.vector())


def test_what_completes_an_effect_goes_with_it() -> None:
    model = build_model("axis", TWO_MASS, {}).with_effect("end_pulley").with_effect("viscous_end_pulley")
    assert model.without_effect("end_pulley").effects == build_model("axis", TWO_MASS, {}).effects


def test_a_file_brings_back_the_same_model(tmp_path: Path) -> None:
    model = replace(build_model("m", ("belt_sections", "coupling", "tilt"), {"tilt.angle": 1.0 / 3.0}, origin="test"), source="none")
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(model.to_dict()), encoding="utf-8")
    again = load_model(path)
    assert again == model
    assert np.array_equal(again.vector(), model.vector())


def test_a_model_of_a_run_comes_back_bit_for_bit(tmp_path: Path) -> None:
    """Numbers as a fit returns them, and texts that YAML could take for something else."""
    rng = np.random.default_rng(4)
    model = replace(build_model("1e-6", TWO_MASS, {}, origin="010"), source="no: 2020-01-01")
    fitted = {
        name: replace(item, value=item.low + rng.uniform() * (item.high - item.low), interval=np.float64(np.exp(rng.normal(0.0, 30.0))))
        for name, item in model.parameters.items()
    }
    model = replace(model, parameters=fitted)
    run = RunFolder.create(tmp_path / "R", load_axis("egc-70-600"))
    again = load_model(run.save("models", "final", model.to_dict()))
    assert again == model
    assert again.vector().tobytes() == model.vector().tobytes()


def test_a_plant_file_may_be_written_by_hand(tmp_path: Path) -> None:
    """``1e-6`` is a number, as everywhere in the settings; PyYAML by itself reads it as text."""
    path = tmp_path / "hand.yaml"
    path.write_text(
        "name: hand\neffects: [belt_stiffness]\nparameters:\n  motor.inertia: {value: 7e-5}\n  cart.mass: {value: 3}\n"
        "  transmission.ratio: {value: 12.42e-3}\n  belt_stiffness.stiffness: {value: 2e5, origin: 2020-01-01}\n"
        "drive: {torque_noise_nm: 1e-3}\n"
    )
    plant = load_plant(path)
    assert (plant.model["motor.inertia"], plant.model["belt_stiffness.stiffness"], plant.torque_noise_nm) == (7e-5, 2e5, 1e-3)
    assert plant.model.parameters["belt_stiffness.stiffness"].origin == "2020-01-01"
    assert plant.setpoint_delay_s == 1e-3
    path.write_text(path.read_text().replace("drive: {torque_noise_nm: 1e-3}", "drive: quiet"))
    with pytest.raises(UsageError, match=r"the drive section of .* is unreadable"):
        load_plant(path)


def test_bounds_and_units_left_out_come_from_the_effect() -> None:
    data = build_model("m", TWO_MASS, {}).to_dict()
    data["parameters"] = {name: {"value": item["value"]} for name, item in data["parameters"].items()}
    item = model_from_dict(data).parameters["viscous.damping"]
    assert (item.unit, item.side, item.low, item.high) == ("N m s/rad", "motor", 0.0, 0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.pop("effects"), "not a model file"),
        (lambda data: data["parameters"].pop("cart.mass"), r"is missing cart\.mass"),
        (lambda data: data["parameters"].update({"cart.bogus": {"value": 1.0}}), r"unknown parameter cart\.bogus"),
        (lambda data: data["parameters"]["viscous.damping"].update(unit="N s/m"), "must be in 'N m s/rad'"),
        (lambda data: data["parameters"]["cart.mass"].update(value="heavy"), r"cart\.mass\.value is 'heavy'; give a plain number in kg"),
        (lambda data: data["parameters"].update({"cart.mass": 5.0}), r"cart\.mass is 5\.0; give a mapping"),
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
    with pytest.raises(UsageError, match=r"broken\.yaml is not valid YAML"):
        load_model(broken)
    broken.write_text("- 1\n", encoding="utf-8")
    with pytest.raises(UsageError, match="must hold a mapping"):
        load_model(broken)
    for text, words in (
        ("name: x\nbodies: [motor]\n", "not a model file .*effects"),
        ("name: x\neffects: []\nparameters: {}\n", "is missing"),
    ):
        broken.write_text(text, encoding="utf-8")
        for load in (load_model, load_plant):
            with pytest.raises(UsageError, match=words) as caught:
                load(broken)
            assert str(caught.value).count(str(broken)) == 1


def test_a_number_with_its_unit_in_a_plant_file_is_named(tmp_path: Path) -> None:
    data = load_plant("g_a").model.to_dict()
    data["parameters"]["belt_stiffness.stiffness"]["value"] = "200 kN/m"
    with pytest.raises(UsageError, match=r"belt_stiffness\.stiffness\.value is '200 kN/m'; give a plain number in N/m"):
        model_from_dict(data)
    data["parameters"]["belt_stiffness.stiffness"] = 2e5
    with pytest.raises(UsageError, match=r"belt_stiffness\.stiffness is 200000\.0; give a mapping"):
        model_from_dict(data)


def test_what_is_held_no_fit_moves() -> None:
    model = load_plant("g_a").model
    held = model.with_fixed("cart.mass")
    assert "cart.mass" in free_parameters(model)
    assert "cart.mass" not in free_parameters(held)
    assert held.with_values({"cart.mass": 3.0})["cart.mass"] == 3.0  # another known value is held there
    assert "cart.mass" not in free_parameters(held.with_values({"cart.mass": 3.0}))


FRICTIONS = ("coulomb.level", "cart_friction.level")


def with_a_known_sum(model: Model) -> Model:
    """Two frictions of which only the sum at the shaft is known, to 1 %, and the inertia, to 1 %."""
    ratio, level = model["transmission.ratio"], np.array([model[name] for name in FRICTIONS])
    whole = level[0] + ratio * level[1]
    apart, along = np.array([1.0, -1.0 / ratio]), np.array([1.0, 1.0 / ratio])
    pair = (0.3 * whole) ** 2 * np.outer(apart, apart) + (0.005 * whole) ** 2 * np.outer(along, along)
    matrix = np.zeros((3, 3))
    matrix[:2, :2], matrix[2, 2] = pair, (0.01 * model["motor.inertia"]) ** 2
    names = (*FRICTIONS, "motor.inertia")
    parameters = {
        **model.parameters,
        **{n: replace(model.parameters[n], interval=float(1.96 * matrix[i, i] ** 0.5)) for i, n in enumerate(names)},
    }
    return replace(model, parameters=parameters, covariance=Covariance(names, matrix, 60.0))


def test_machines_like_a_model_keep_a_sum_that_is_known() -> None:
    """Within their bounds; by the intervals alone the sum is known as badly as its parts."""
    model = with_a_known_sum(build_model("m", (*TWO_MASS, "coulomb"), {"coulomb.level": 0.08, "cart_friction.level": 6.0}))

    def sums(of: Model) -> list[float]:
        machines = machines_like(of, 200, seed=4)
        assert all(machine[name] >= 0.0 for machine in machines for name in FRICTIONS)
        return [machine["coulomb.level"] + machine["transmission.ratio"] * machine["cart_friction.level"] for machine in machines]

    joint, apart = sums(model), sums(replace(model, covariance=None))
    assert np.std(joint) / np.mean(joint) == pytest.approx(0.01, rel=0.2)
    assert np.std(apart) > 10.0 * np.std(joint)
    assert {m["motor.inertia"] for m in machines_like(model, 5, seed=4, held=("motor.inertia",))} == {model["motor.inertia"]}


def test_the_covariance_stays_with_what_it_is_of(tmp_path: Path) -> None:
    model = with_a_known_sum(build_model("m", (*TWO_MASS, "coulomb"), {"coulomb.level": 0.08, "cart_friction.level": 6.0}))
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(model.to_dict()), encoding="utf-8")
    again = load_model(path).covariance
    assert model.covariance is not None
    assert again is not None
    assert (again.names, again.freedom) == (model.covariance.names, 60.0)
    np.testing.assert_array_equal(again.matrix, model.covariance.matrix)
    left = model.without_effect("coulomb").covariance
    assert left is not None
    assert left.names == ("cart_friction.level", "motor.inertia")
    np.testing.assert_array_equal(left.matrix, model.covariance.of(left.names))
    changed = model.with_values({"motor.inertia": 2e-4}).covariance
    assert changed is not None
    assert changed.names == FRICTIONS
    assert model.covariance.of(("cart.mass", "motor.inertia"))[0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"names": ["cart.mass"], "rows": [[1.0], [2.0]]}, "rows of 1, 1"),
        ({"names": ["cart.mass"], "rows": [[float("nan")]]}, "no finite number"),
        ({"names": ["cart.mass"], "rows": [[-1.0]]}, "below 0"),
        ({"names": ["coulomb.level"], "rows": [[1.0]]}, "coulomb.level, which it does not have"),
        ({"rows": [[1.0]]}, "names"),
        ([1.0], "not a model file"),
    ],
)
def test_a_damaged_covariance_is_told(wrong: object, told: str) -> None:
    model = build_model("m", TWO_MASS, {})
    with pytest.raises(UsageError, match=told):
        model_from_dict({**model.to_dict(), "covariance": wrong})
