"""Which forms of a law are taken, told by the objective that each model would reach; a whole diagnosis with a form: ``test_draws``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from beltcomm.effects import effect_named
from beltcomm.fit.estimate import fit
from beltcomm.fit.likelihood.free_parameters import free_parameters
from beltcomm.fit.records import prepare
from beltcomm.fit.residual.whitened import evaluate
from beltcomm.fit.start.model import start_model
from beltcomm.jobs.rungs import change_of
from beltcomm.laboratory import law_shape
from beltcomm.laboratory.acceptance import exceeds_bounds
from beltcomm.model import Model, build_model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session

BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "coulomb"), {})
SAMPLES = 1000
EXPONENT = "torque_saturation.exponent"
#: Where friction shows on which body it acts: a fast sweep, a response and slow strokes; the whole session takes half a minute.
RECORDS = ("01_sweep_fast_1", "05_frf_p1_a2", "09_sweep_slow")


class Axis:
    """An axis whose law is known: ``reached`` says what a model's fit ends with, nats.   promised : by a part at the carriage."""

    promised = 1e9

    def __init__(self, monkeypatch: pytest.MonkeyPatch, reached: Any, held_out: float = 0.0) -> None:
        self.reached, self.held_out = reached, held_out
        monkeypatch.setattr(law_shape, "fit", lambda data, model, iterations, offsets: self.fitted(model))
        monkeypatch.setattr(law_shape, "drop_by", lambda before, after: before.objective - after.objective)
        monkeypatch.setattr(law_shape, "_promise_at_carriage", lambda *_: self.promised)

    def fitted(self, model: Model) -> Any:
        free = set(free_parameters(model))
        held = self.held_out if EXPONENT in free else 0.0
        return SimpleNamespace(
            model=model,
            objective=self.reached(set(model.effects), free),
            held_out_objective=held,
            held_out_share=0.5,
            offsets=None,
            problem=SimpleNamespace(free=tuple(free), samples=SAMPLES),
        )

    def formed(self, *effects: str) -> Any:
        model = BASE
        for name in effects:
            model = model.with_effect(name)
        return law_shape.fit_law_shapes(None, self.fitted(model), BASE)  # type: ignore[arg-type]


def test_a_form_that_explains_enough_is_taken_and_a_small_one_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for gain, wanted in ((100.0, (EXPONENT,)), (12.0, ())):  # one number costs ln 1000 = 6.9
        axis = Axis(monkeypatch, lambda effects, free, gain=gain: 1000.0 - gain * (EXPONENT in free))
        assert axis.formed("torque_saturation").new == wanted


def test_a_form_that_held_out_records_contradict_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 100.0 * (EXPONENT in free), held_out=50.0)
    assert axis.formed("torque_saturation").new == ()


@pytest.mark.parametrize("stands_on", [("cart_friction", "presliding_cart"), ("elastic_shaft", "viscous_load")])
def test_an_effect_that_another_stands_on_is_left_where_it_is(monkeypatch: pytest.MonkeyPatch, stands_on: tuple[str, str]) -> None:
    """It has no model without it; forms of the others are asked for all the same."""
    axis = Axis(monkeypatch, lambda effects, free: (1000.0 if set(stands_on) <= effects else 3000.0) - 100.0 * (EXPONENT in free))
    found = axis.formed("torque_saturation", *stands_on)
    assert (found.new, found.removed) == ((EXPONENT,), ())
    assert set(stands_on) <= set(found.fitted.model.effects)


def test_a_form_takes_the_place_of_an_effect_that_stood_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 900.0 if EXPONENT in free else 1000.0 if "load_friction" in effects else 3000.0)
    found = axis.formed("torque_saturation", "load_friction")
    assert (found.new, found.removed) == ((EXPONENT,), ("load_friction",))
    assert found.fitted.model.effects == (*BASE.effects, "torque_saturation")


def test_an_effect_that_is_really_there_stays_beside_a_form(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 100.0 * (EXPONENT in free) + 2000.0 * ("load_friction" not in effects))
    found = axis.formed("torque_saturation", "load_friction")
    assert (found.new, found.removed) == ((EXPONENT,), ())


def test_what_belongs_to_an_effect_is_tried_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 500.0 * ("viscous_end_pulley" in effects))
    found = axis.formed("end_pulley")
    assert found.new == ("viscous_end_pulley",)
    assert [e.name for e in law_shape.additions(found.fitted.model, BASE)] == ["end_pulley"]


@pytest.mark.parametrize(("gain", "wanted"), [(500.0, ("friction_position_cart",)), (12.0, ())])
def test_it_is_asked_on_which_body_a_tight_spot_acts(monkeypatch: pytest.MonkeyPatch, gain: float, wanted: tuple[str, ...]) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - gain * ("friction_position_cart" in effects))
    found = axis.formed("friction_position")
    assert (found.new, found.removed) == (wanted, ())
    assert [e.name for e in law_shape.additions(found.fitted.model, BASE)] == ["friction_position"]


@pytest.mark.parametrize(("promised", "fits"), [(63.0, [0, 2]), (64.0, [2, 2]), (8.0, [0, 0]), (9.0, [0, 2])])
def test_nothing_is_fitted_for_a_part_at_the_carriage_that_promises_too_little(
    monkeypatch: pytest.MonkeyPatch, promised: float, fits: list[int]
) -> None:
    """Half of what it must explain, with the price of one number, as soon as it is named and at the end: 127 and 17 nats here."""
    axis = Axis(monkeypatch, lambda effects, free: 1000.0)
    axis.promised = promised
    fitted, effect = axis.fitted(BASE.with_effect("stribeck").with_forms("stribeck")), effect_named("stribeck")
    count = 0

    def counted(_data: Any, model: Model, _iterations: int, offsets: Any) -> Any:
        nonlocal count
        count += 1
        return axis.fitted(model)

    monkeypatch.setattr(law_shape, "fit", counted)
    law_shape.assign_body(None, fitted, effect)  # type: ignore[arg-type]
    named = count
    law_shape.fit_law_shapes(None, fitted, BASE)  # type: ignore[arg-type]
    assert [named, count - named] == fits


@pytest.mark.examination
@pytest.mark.parametrize("name", ["stribeck", "friction_position"])
def test_a_part_at_the_carriage_promises_much_where_it_is_and_nothing_where_it_is_not(tmp_path: Path, name: str) -> None:
    """The same records twice, the second time with the torque that a motor with this friction at the carriage would need.

    The tight spot is where the response was measured, half way: at other places nothing would tell.
    """
    write_session(draw(893131, (name,), 0.5, "sheet"), tmp_path / "run", only=RECORDS)
    run = RunFolder.open(tmp_path / "run")
    records = run.recordings()
    model = start_model(run.axis, records).with_effect(name, {"place": 0.5} if name == "friction_position" else {})
    data, effect, one = prepare(records, run.axis, model), effect_named(name), f"{name}_cart"
    at_motor = fit(data, model, 12)
    behind = law_shape._at_carriage(at_motor.model, effect, one)
    assert behind is not None
    pieces = []
    for piece in data.fitted:
        needed = [evaluate(piece, m, m.vector(), 0.0) for m in (at_motor.model, behind)]
        pieces.append(replace(piece, torque=piece.torque + needed[1] - needed[0]))
    at_cart = fit(replace(data, fitted=tuple(pieces)), at_motor.model, 12)
    asked = 120.0 + math.log(at_motor.problem.samples)
    assert law_shape._promise_at_carriage(at_motor, effect, one) < 0.2 * asked
    assert law_shape._promise_at_carriage(at_cart, effect, one) > 5.0 * asked


def test_what_completes_an_effect_comes_beside_its_form(monkeypatch: pytest.MonkeyPatch) -> None:
    flatness = "friction_position.flatness"
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 400.0 * ("friction_position_cart" in effects) - 100.0 * (flatness in free))
    found = axis.formed("friction_position")
    assert found.new == (flatness, "friction_position_cart")
    assert {"friction_position_cart.amount", flatness} <= set(found.fitted.problem.free)


def test_without_a_carriage_behind_a_belt_friction_acts_on_the_motor(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 500.0 * ("stribeck_cart" in effects))
    model = build_model("axis", ("viscous", "coulomb"), {}, base_bodies=("motor",))
    assert law_shape.fit_law_shapes(None, axis.fitted(model.with_effect("stribeck")), model).new == ()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "beside", "gain", "wanted"),
    [
        ("stribeck", (), 500.0, ("stribeck_cart",)),
        ("stribeck", (), 100.0, ()),  # is asked again at the end
        ("stribeck", ("backlash",), 500.0, ()),  # an observer forgives it
        ("end_pulley", (), 500.0, ()),  # its bearing is another law, which misleads nobody
    ],
)
def test_the_body_is_asked_for_as_soon_as_friction_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, beside: tuple[str, ...], gain: float, wanted: tuple[str, ...]
) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - gain * bool({"stribeck_cart", "viscous_end_pulley"} & effects))
    model = BASE.with_effect(name)
    for other in beside:
        model = model.with_effect(other)
    assert law_shape.assign_body(None, axis.fitted(model), effect_named(name)).new == wanted  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("new", "removed", "words"),
    [
        (("end_pulley", "viscous_end_pulley"), (), "+end_pulley +viscous_end_pulley"),
        (("friction_position", "friction_position.flatness"), (), "+friction_position with its form"),
        (("presliding", "stribeck.exponent"), ("presliding", "quadratic_drag"), "-quadratic_drag form of stribeck"),
        (("cogging",), ("tilt",), "+cogging -tilt"),
    ],
)
def test_a_revision_says_what_it_changes(new: tuple[str, ...], removed: tuple[str, ...], words: str) -> None:
    assert change_of(new, removed) == words


AMOUNT, PART = "stribeck.amount", "stribeck_cart.amount"


@pytest.mark.parametrize(("gain", "at_motor"), [(100.0, False), (200.0, True)])
@pytest.mark.parametrize("known", [False, True])
def test_a_part_at_the_motor_must_explain_something_beside_the_carriages(
    monkeypatch: pytest.MonkeyPatch, known: bool, gain: float, at_motor: bool
) -> None:
    """It is an effect of its own, and needs that evidence: beside a part that is none the carriage's was 11.6 ± 0.7 N of 14 N."""
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 - 500.0 * ("stribeck_cart" in effects) - gain * ({AMOUNT, PART} <= free))
    model = BASE.with_effect("stribeck")
    model = model.with_effect("stribeck_cart", {PART: 3.0}) if known else model
    found = law_shape.fit_law_shapes(None, axis.fitted(model), BASE)  # type: ignore[arg-type]
    assert found.new == (() if known else ("stribeck_cart",))
    after = found.fitted.model
    assert (AMOUNT in found.fitted.problem.free) is at_motor
    if not at_motor:
        assert after[AMOUNT] == 0.0
        assert after[PART] == pytest.approx(3.0 + 0.02 / after["transmission.ratio"]), "all of it"
        assert not exceeds_bounds(after, effect_named("stribeck")), "held, not run away"


def test_a_law_that_acts_at_the_motor_stays_there(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = Axis(monkeypatch, lambda effects, free: 1000.0 + 500.0 * (AMOUNT not in free) - 12.0 * ({AMOUNT, PART} <= free))
    found = axis.formed("stribeck")
    assert found.new == ()
    assert found.fitted.model.effects == (*BASE.effects, "stribeck")


def test_a_law_can_act_at_the_motor_again_when_its_part_at_the_carriage_is_taken_out() -> None:
    model = law_shape._at_carriage(BASE.with_effect("stribeck"), effect_named("stribeck"), "stribeck_cart")
    assert model is not None
    assert AMOUNT not in free_parameters(model)
    again = model.without_effect("stribeck_cart")
    assert again == BASE.with_effect("stribeck")
    assert AMOUNT in free_parameters(again)
