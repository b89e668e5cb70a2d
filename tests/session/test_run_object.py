"""A run as an object: what it says where something is not there, what a notebook shows, and that it sees the folder as it is."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import beltcomm
from beltcomm import api
from beltcomm.errors import DataError, UsageError
from beltcomm.model import load_model
from beltcomm.model.value import Value
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
        (lambda run: run.design(payload=5), UsageError, "there is no option payload, did you mean payload_kg"),
        (
            lambda run: run.model.to_control(position=250),
            UsageError,
            "position is 250 m, outside the travel .*; give the carriage's place in m",
        ),
        (lambda run: run.model.linear(-0.4), UsageError, "outside the travel"),
        (lambda run: run.model_named("fnal"), DataError, "did you mean final"),
        (lambda run: run.copy(run.path), UsageError, "exists; give another name"),
        (lambda run: run.copy(run.path / "inner"), UsageError, "inside .*; a run cannot hold a copy of itself"),
        (lambda run: run.predict_move(0.1, 0.3), UsageError, "a move is start_m, end_m, speed_m_s"),
        (lambda run: run.predict_move(payload_kg="2 kg"), UsageError, "payload_kg is '2 kg'; give a plain number in kg"),
        (lambda run: run.predict_move(0.1, 0.3, speed_m_s="1 m/s", acceleration_m_s2=1, jerk_m_s3=9), UsageError, "plain number in m/s"),
        (lambda run: run.predict_move(100, 300, speed_m_s=1, acceleration_m_s2=1, jerk_m_s3=9), UsageError, "it must lie within"),
        (lambda run: run.report(run.path / "axis.yaml"), UsageError, "HTML; give a name that ends in .html"),
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
    assert str(run.headline) in str(run).splitlines()
    assert str(run.gains).startswith(f"Kp {run.gains.kp_nm_s_rad:.3g} N m s/rad, ")
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


def test_a_page_replaces_nothing_but_a_page(run: OpenedRun) -> None:
    for name, beside in (("mine.html", "other.json"), ("other.html", "mine.json")):
        (run.path / name).write_text("<p>notes</p>")
        (run.path / beside).write_text("{}")
        with pytest.raises(UsageError, match=r"(mine.html|mine.json) exists and is no page"):
            run.report(run.path / "mine.html")
        assert (run.path / name).read_text() == "<p>notes</p>"
        (run.path / name).unlink()
        (run.path / beside).unlink()


def test_a_copy_is_a_run_of_its_own(run: OpenedRun) -> None:
    copy = run.copy(run.path.parent / "tried" / "out")
    assert dict(copy.model) == dict(run.model)
    assert list(copy.records) == list(run.records)
    (copy.path / "models" / "final.yaml").unlink()
    assert run.model.mass.value > 0.0
    assert [item.name for item in copy.path.parent.iterdir()] == ["out"]


def test_tables_for_pandas(run: OpenedRun) -> None:
    mass, ratio = run.model.mass, run.model.ratio
    table = run.model.to_dataframe()
    assert table.loc["cart.mass", "value"] == mass.value
    assert (table.loc["cart.mass", "low_95"], table.loc["cart.mass", "high_95"]) == mass.interval_95
    assert ratio.interval_95 is None
    assert str(mass) == f"{mass.value:.4g} ± {mass.interval:.2g} kg"
    response = run["frf_1"].frf()
    lines = response.to_dataframe()
    assert lines.index.name == "freq_hz"
    assert lines["magnitude"].to_numpy() == pytest.approx(abs(response.h))


def test_a_move_is_predicted_without_a_machine(run: OpenedRun) -> None:
    limits = {"speed_m_s": 0.3, "acceleration_m_s2": 2.0, "jerk_m_s3": 40.0}
    payload_kg = run.model.mass.value
    light, heavy = (run.predict_move(0.1, 0.3, payload_kg=one_kg, **limits) for one_kg in (0.0, payload_kg))
    frame = light.to_dataframe()
    assert frame["reference_m"].iloc[-1] == pytest.approx(0.3)
    assert light.error.dynamic_m == pytest.approx(abs(frame["reference_m"] - frame["motor_m"]).max(), rel=0.05)
    assert heavy.path.belt_force_n > light.path.belt_force_n + 0.5 * payload_kg * limits["acceleration_m_s2"]
    assert "100 to 300 mm" in repr(light)
    assert light.plot()._repr_png_().startswith(b"\x89PNG")


def test_a_parameter_is_its_number_in_arithmetic_and_in_text() -> None:
    mass = Value(13.4, "kg", "cart", 0.0, 100.0, 0.1)
    assert (float(mass), f"{mass:.2f}", f"{mass}") == (13.4, "13.40", "13.4 ± 0.1 kg")
    assert (2 * mass, mass * 2, mass + 1, 1 - mass, mass / 2, 26.8 / mass, mass + mass, -mass, abs(mass)) == pytest.approx(
        (26.8, 26.8, 14.4, -12.4, 6.7, 2.0, 26.8, -13.4, 13.4)
    )
    assert isinstance(mass * 2, float)
    assert math.sqrt(mass**2) == pytest.approx(13.4)


def test_an_option_that_there_is_not_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="there is no option paylod, did you mean payload_kg"):
        api.Options(paylod=1)  # type: ignore[call-arg]
    assert replace(api.Options(payload_kg=1.0), yes=True).payload_kg == 1.0


def test_a_response_without_landmarks_has_no_empty_panel(run: OpenedRun) -> None:
    assert all(axes.get_lines() for axes in run["frf_1"].frf().plot().figure.get_axes())
