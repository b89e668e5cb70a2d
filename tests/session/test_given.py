"""What a program gives the public functions wrongly is said before anything is opened, moved or computed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.errors import BeltcommError, DataError, UsageError

AXIS = "egc-70-600"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"apply": "foo"}, "apply is 'foo'; choose one of keep, restore, save"),
        ({"apply": "sav"}, "did you mean 'save'?"),
        ({"excitation": "sweepy"}, "choose one of prbs"),
        ({"prefilter": "foo"}, "prefilter"),
        ({"feedforward": "foo"}, "feedforward"),
        ({"loop": "foo"}, "loop"),
        ({"order": "VII"}, "order"),
        ({"payload_kg": "5kg"}, "payload_kg is '5kg'; give a plain number in kg"),
        ({"payload_kg": float("nan")}, "payload_kg is nan"),
        ({"payload_kg": -3}, "0 or more"),
        ({"position_m": "10mm"}, "in m"),
        ({"window_m": 0.1}, "two numbers"),
        ({"window_m": ("a", 0.1)}, "window_m is 'a'"),
        ({"yes": "no"}, "yes is 'no'; give True or False"),
        ({"seed": 1.5}, "whole number"),
        ({"drive": "bitrate"}, "mapping"),
    ],
)
def test_an_option_that_there_is_not_is_refused_before_anything_is_opened(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError) as told:
        api.Options(**wrong)
    assert said in str(told.value)


FUNCTIONS: dict[str, Callable[[Any], object]] = {
    "compare": api.compare,
    "diagnose": api.diagnose,
    "fit": api.fit,
    "design": api.design,
    "ladder": api.ladder,
    "report": api.report,
    "export": lambda run: api.export(run, "yaml"),
    "add": lambda run: api.add("backlash", run),
    "remove": lambda run: api.remove("backlash", run),
    "backups": api.backups,
    "check_imports": api.check_imports,
    "convert": api.convert,
    "friction": lambda run: api.friction("virtual", run),
    "friction_compare": api.friction_compare,
    "bundle": lambda run: api.bundle(run, Path("b.zip")),
    "rollback": lambda run: api.rollback("virtual", run),
    "verify": lambda run: api.verify("virtual", run),
    "apply": lambda run: api.apply("virtual", run),
    "trend": lambda run: api.trend([run, run]),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_path_may_be_text_or_path_and_nothing_else(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sentences = set()
    for run in ("no-run", Path("no-run")):
        with pytest.raises((DataError, UsageError)) as told:
            FUNCTIONS[name](run)
        sentences.add(str(told.value))
    (said,) = sentences
    assert "no-run" in said
    for wrong in (5, "", None if name != "convert" else 5):
        with pytest.raises(UsageError):
            FUNCTIONS[name](wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: api.add(Path("run"), "backlash"),  # type: ignore[arg-type]
        lambda: api.move("virtual", AXIS, "5mm"),  # type: ignore[arg-type]
        lambda: api.move("virtual", AXIS, float("nan")),
        lambda: api.commission("virtual", None, "run"),  # type: ignore[arg-type]
        lambda: api.commission(5, AXIS, "run"),  # type: ignore[arg-type]
        lambda: api.commission("virtual", AXIS, "run", options={"yes": True}),  # type: ignore[arg-type]
        lambda: api.design("run", options="quick"),  # type: ignore[arg-type]
        lambda: api.trajectory("t.csv", "0", 0.5, speed_m_s=1.0, acceleration_m_s2=10.0, jerk_m_s3=200.0),  # type: ignore[arg-type]
    ],
)
def test_what_is_given_wrongly_is_said_as_usage(wrong: Callable[[], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError):
        wrong()
    assert not list(tmp_path.iterdir())


def test_one_file_to_import_may_be_given_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(BeltcommError, match=r"nofile\.csv"):
        api.import_recordings("nofile.csv", tmp_path / "run", api.Reading())


def test_all_commands_are_offered_to_programs() -> None:
    assert {"compare", "diagnose", "add", "remove", "ladder", "report", "trend", "study", "fit", "design"} <= set(api.__all__)
    assert all(hasattr(api, name) for name in api.__all__)
