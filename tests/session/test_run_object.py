"""A run as an object: what it says where something is not there, what a notebook shows, and that it sees the folder as it is."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import beltcomm
from beltcomm.errors import DataError, UsageError
from beltcomm.model import load_model
from beltcomm.run import OpenedRun

Copy = Callable[..., Path]


@pytest.fixture
def run(copy_of_complete: Copy) -> OpenedRun:
    return beltcomm.open(copy_of_complete("frf_[2-9]", "sweep*", "amplitude*"))


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        (lambda run: beltcomm.open(run.path / "nowhere"), DataError, "does not exist"),
        (lambda run: beltcomm.open(5), UsageError, "which is no path"),
        (lambda run: run["frf1"], DataError, "did you mean frf_1"),
        (lambda run: run["move_1"].frf(), DataError, "those that have one: frf_1"),
        (lambda run: run.model["cart.mas"], UsageError, "did you mean cart.mass"),
        (lambda run: run.model.mas, AttributeError, "did you mean mass"),
        (lambda run: run.model.damping, AttributeError, "belt_damping.damping, .*write model"),
        (lambda run: run.model.to_control("0.25 m"), UsageError, "position is '0.25 m'; give a plain number in m"),
        (lambda run: run.model.linear(0.25, speed=0), UsageError, "give the speed at which the axis moves"),
        (lambda run: run.design(payload_kg="5 kg"), UsageError, "payload_kg is '5 kg'"),
        (lambda run: run.design(payload=5), UsageError, "there is no option payload"),
        (lambda run: run["frf_1"].plot().save(run.path / "axis.yaml"), UsageError, "exists; give another file name"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(
    run: OpenedRun, asked: Callable[[OpenedRun], object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        asked(run)


@pytest.mark.parametrize("module", ["pandas", "control"])
def test_without_an_optional_package_it_says_which(run: OpenedRun, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UsageError, match=f"pip install {module}"):
        run["frf_1"].to_dataframe() if module == "pandas" else run.model.to_control(0.25)


def test_a_notebook_sees_tables(run: OpenedRun) -> None:
    shown: list[Any] = [run, run.records, run["frf_1"], run.model]
    for one in shown:
        assert one._repr_html_().count("<table>") == 1
        assert len(repr(one).splitlines()) > 1
    assert "<b>" not in run._repr_html_()
    assert "cart.mass" in dir(run.model) or "mass" in dir(run.model)


def test_it_sees_the_folder_as_it_is(run: OpenedRun) -> None:
    """What another program writes counts; a folder without a model says what makes one."""
    path = run.path / "models" / "final.yaml"
    assert run.model.mass == load_model(path).parameters["cart.mass"]
    path.unlink()
    with pytest.raises(DataError, match="make it with `beltcomm fit"):
        _ = run.model
    (run.path / "designs" / "final.yaml").unlink()
    with pytest.raises(DataError, match="make it with `beltcomm design"):
        _ = run.gains
