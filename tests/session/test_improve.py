"""``beltcomm improve``: what stands before and after, and by what it is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.errors import Declined
from beltcomm.improve import _errors, _nothing, _ratios, improve
from beltcomm.result import Result
from beltcomm.rundata.revisions import Revision, as_mapping
from beltcomm.talk import Silence

COST = {name: {"dynamic_m": value} for name, value in (("unaware", 6e-4), ("aware", 4e-5), ("unaware_cart", 7e-4), ("aware_cart", 5e-5))}


def verified(motor_m: float, carriage_m: float, *, carriage_measured: bool = False) -> dict[str, Any]:
    return {
        "motor": {"following_m": motor_m, "measured": True},
        "carriage": {"following_m": carriage_m, "measured": carriage_measured},
    }


def test_a_carriage_that_nobody_measured_is_predicted_by_the_model_that_knows() -> None:
    """The model before, which lacks the effect, predicted 48 µm; that is no error that the axis had."""
    found = _errors(verified(4.25e-4, 4.8e-5), verified(4.8e-5, 4.7e-5), COST)
    assert {place: (round(1e6 * one["before_m"]), round(1e6 * one["after_m"]), one["how"]) for place, one in found.items()} == {
        "motor": (425, 48, "measured"),
        "carriage": (700, 50, "predicted"),
    }
    measured = _errors(verified(4e-4, 3e-4, carriage_measured=True), verified(5e-5, 6e-5, carriage_measured=True), COST)
    assert [round(1e6 * one["before_m"]) for one in measured.values()] == [400, 300]


def test_the_error_before_is_that_of_the_model_it_stands_on() -> None:
    """The base is among what was made on a run that had no ladder; later the first one stands on an earlier rung."""
    rungs = [
        Revision(f"revision_{k}", parent, change, (), ratio, None, None, "", "", {})
        for k, parent, change, ratio in ((1, "", "base", 1.96), (2, "revision_1", "+cogging", 1.4), (3, "revision_2", "+stribeck", 1.0))
    ]
    made = [as_mapping(rung) for rung in rungs]
    assert _ratios(made, rungs) == (1.96, 1.0)
    assert _ratios(made[1:], rungs) == (1.96, 1.0)
    assert _ratios(made[2:], rungs) == (1.4, 1.0)


@pytest.mark.parametrize(
    ("verdict", "gain", "said", "command"),
    [
        ("explained", None, "no held-out record confirms it", "beltcomm add stribeck run"),
        ("explained", -3.0, "held-out records do not confirm it", "beltcomm add stribeck run"),
        ("cannot tell", 5.0, "these records cannot tell it from another effect", "beltcomm compare run"),
    ],
)
def test_what_is_named_and_not_added_has_its_reason_and_a_next_step(verdict: str, gain: float | None, said: str, command: str) -> None:
    """A screen that says no more than "not sure enough" leaves a person where he was: diagnosis says FOUND on the same records."""
    data = {"verdict": verdict, "ranking": [{"effect": "stribeck", "held_out_gain": gain}, {"effect": "cogging", "held_out_gain": 1.0}]}
    result = _nothing(Path("run"), data, Result({}, []), ["stribeck"])
    lines = [str(line) for line in result.text]
    assert [line.split(":")[1].strip() for line in lines if "NOT ADDED" in line] == [said]
    assert lines[-1].strip() == command, "alone on its line"
    assert ("would judge it" in "".join(lines)) == (gain is None)
    assert max(map(len, lines)) <= 80
    assert result.exit_code == 1


def test_without_a_move_afterwards_both_are_predicted() -> None:
    found = _errors(verified(4e-4, 3e-4, carriage_measured=True), None, COST)
    assert [one["how"] for one in found.values()] == ["predicted"] * 2
    assert _errors(None, None, None) == {}
    assert list(_errors(verified(4e-4, 3e-4), verified(5e-5, 6e-5), None)) == ["motor"]


def test_what_was_added_is_told_where_no_move_follows(copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody says no to the move: effect and gains are in the run by then."""

    heard: list[str] = []

    class Hearing(Silence):
        def say(self, *lines: str) -> None:
            heard.extend(map(str, lines))

    def declined(*args: object, **given: object) -> Result:
        raise Declined("nothing was moved, as you said")

    made = {"name": "revision_2", "parent": "", "ratio": 1.0}
    monkeypatch.setattr(api, "diagnose", lambda *a, **k: Result({"steps": [{"added": "cogging"}], "revisions": [made]}, []))
    monkeypatch.setattr(api, "design", lambda *a, **k: Result({}, []))
    monkeypatch.setattr(api, "verify", declined)
    with pytest.raises(Declined):
        improve(copy_of_complete(), "virtual", talk=Hearing())
    assert any("IMPROVED   cogging named and added" in line for line in heard)
    assert any("beltcomm verify --drive virtual" in line or "beltcomm open" in line for line in heard)
