"""What is said of effects that data tell apart badly, and of what no diagnosis looks for or no motion separates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.effects import effect_named
from beltcomm.errors import Refused
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.jobs import change, laboratory
from beltcomm.jobs.laboratory import _find_confounded
from beltcomm.model import load_plant
from beltcomm.schedule.next_plan import by_hand_of
from beltcomm.sentences.ladder import _effect_lines

BASE = load_plant("g_a").model


def fitted(values: dict[str, float]) -> Any:
    model = BASE
    for name in dict.fromkeys(key.split(".")[0] for key in values):
        model = model if name in model.effects else model.with_effect(name)
    return SimpleNamespace(model=model.with_values(values, "test"), problem=SimpleNamespace(free=tuple(values)))


def test_of_two_delays_the_sum_is_known_and_a_short_dead_time_may_be_a_second_pole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(laboratory, "parameter_spread", lambda _: SimpleNamespace(half_width=lambda c: 4e-6 if len(c) == 2 else 9e-6))
    (found,) = _find_confounded(fitted({"dead_time.time": 4.3e-5, "current_lag.time": 7.588e-4}), ["current_lag", "dead_time"])
    assert found.value == pytest.approx(8.018e-4)
    assert (found.interval, found.unit) == (4e-6, "s")
    assert "802 ± 4 us" in found.text
    assert "second pole of the current_lag" in found.text
    (long,) = _find_confounded(fitted({"dead_time.time": 6e-4, "current_lag.time": 7e-4}), ["dead_time"])
    assert "second pole" not in long.text
    assert _find_confounded(fitted({"dead_time.time": 6e-4}), ["dead_time"]) == []
    assert _find_confounded(fitted({"dead_time.time": 6e-4, "current_lag.time": 7e-4}), ["stribeck"]) == [], "both were known before"


@pytest.mark.parametrize(("order", "size", "part"), [(25.0, 2e-3, True), (27.0, 2e-3, True), (24.0, 2e-3, False), (25.0, 3e-2, False)])
def test_a_line_beside_the_teeth_may_be_theirs(order: float, size: float, part: bool) -> None:
    values = {"tooth_ripple.teeth": 26.0, "tooth_ripple.sine": 2e-2, "cogging.order": order, "cogging.sine": size}
    assert bool(_find_confounded(fitted(values), ["tooth_ripple", "cogging"])) is part


def test_a_constant_torque_is_told_with_its_tilt_and_what_is_done_by_hand() -> None:
    text = "\n".join(_effect_lines(effect_named("constant_offset"), fitted({"constant_offset.torque": 0.02}).model))
    mass, ratio = BASE["cart.mass"], BASE["transmission.ratio"]
    angle = 57.2958 * 0.02 / (ratio * mass * 9.80665)
    assert f"All of it by tilt would be {angle:.2g}°" in text
    for word in ("spirit level", "spring balance", "take the belt off", "RUN_AFTER"):
        assert word in text
    assert {entry["cause"] for entry in by_hand_of("constant_offset")} == {"tilt", "coulomb_asymmetry", "current_offset"}
    assert by_hand_of("stribeck") == []


@pytest.mark.parametrize(
    ("left", "interval", "said"), [(0.0, None, "nothing of it is seen at"), (0.01, 0.09, "nothing of it is seen at"), (0.2, 0.01, "and at")]
)
def test_on_which_body_a_tight_spot_acts_is_said(left: float, interval: float | None, said: str) -> None:
    model = fitted({"friction_position.amount": left, "friction_position_cart.amount": 14.0}).model
    own = replace(model.parameters["friction_position.amount"], interval=interval)
    model = replace(model, parameters={**model.parameters, "friction_position.amount": own})
    text = "\n".join(_effect_lines(effect_named("friction_position"), model))
    assert "It acts on the carriage" in text
    assert f"{said} the motor: friction_position_cart." in text
    assert not any("acts on" in line for line in _effect_lines(effect_named("stribeck"), fitted({"stribeck.amount": 0.1}).model))


def test_where_a_diagnosis_looks_for_a_coupling_is_said() -> None:
    said = CliRunner().invoke(cli, ["effects", "coupling"]).stdout
    assert "A diagnosis looks for it where nothing else explains what is left" in said


def test_an_effect_with_which_the_error_only_grows_is_not_saved(
    copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit that ends far from the data, as one with the values of another machine does."""
    run = copy_of_complete()

    def astray(data: Data, base: Fitted, *_: object) -> Fitted:
        worse = base.model.with_effect("cogging").with_values({"cart.mass": 3.0 * base.model["cart.mass"]}, "test")
        return fit(data, worse, 0, fixed=tuple(worse.parameters))

    monkeypatch.setattr(change, "with_effect", astray)
    monkeypatch.setattr(change, "refit_with_rebuilt_motion", lambda data, fitted, _: (data, fitted))
    monkeypatch.setattr(change, "final_refit", lambda data, fitted: (data, fitted))
    before = sorted(path.name for path in (run / "models").iterdir())
    with pytest.raises(Refused, match="nothing was saved"):
        api.add("cogging", run, pictures=False, cost=False)
    assert sorted(path.name for path in (run / "models").iterdir()) == before
