"""One model has one error in plain units: on every rung, and by every command."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.jobs import rungs
from beltcomm.laboratory.figures import PlainError
from beltcomm.recording.signalfile import write_columns
from beltcomm.rundata.revisions import Revision, _in_one_band, band_of_rungs
from foreign.judged import as_run


def error(percent: float, band_hz: float) -> PlainError:
    return PlainError(percent, 0.0, 100.0, percent, "N m", band_hz)


def rung(name: str, *errors: tuple[float, float], held: tuple[tuple[float, float], ...] = ()) -> Revision:
    bands, bands_held = (tuple(error(*one) for one in some) for some in (errors, held))
    return Revision(name, "", "base", (), 1.0, 1.0, True, "", "", {}, bands=bands, bands_held_out=bands_held)


def test_rungs_are_told_in_the_band_that_all_of_them_bear() -> None:
    told = _in_one_band([rung("a", (76.0, 8.0), (75.0, 4.0)), rung("b", (4.5, 15.0), (2.9, 8.0), (2.6, 4.0))])
    assert [(one.plain.percent, one.plain.band_hz) for one in told if one.plain] == [(76.0, 8.0), (2.9, 8.0)]
    assert band_of_rungs([]) == math.inf
    older = Revision("c", "", "base", (), 1.0, 1.0, True, "", "", {}, plain=error(3.0, 60.0))
    assert _in_one_band([older])[0].plain == error(3.0, 60.0), "what an earlier version noted stays"


@pytest.mark.parametrize(("held", "said"), [(4.1, False), (3.7, True)])
def test_an_error_in_another_band_than_the_rung_below_is_held_against_it_in_the_band_of_both(
    monkeypatch: pytest.MonkeyPatch, held: float, said: bool
) -> None:
    below = rung("a", (4.4, 30.0), (4.2, 15.0), held=((4.3, 30.0), (3.8, 15.0)))
    monkeypatch.setattr(rungs, "in_groups_of", lambda data, fitted, _like: (data, fitted))
    monkeypatch.setattr(rungs, "is_confirmed", lambda *_: True)
    doubted = replace(below, name="b", parent="a", confirmed=False)
    monkeypatch.setattr(rungs, "current_revision", lambda _folder: doubted)
    monkeypatch.setattr(rungs, "revisions", lambda _folder: [below, doubted])
    monkeypatch.setattr(rungs, "band_of", lambda *_: 15.0)
    monkeypatch.setattr(rungs, "of_run", lambda _data, _fitted, band: (None, error(held, band)))
    after: Any = SimpleNamespace(model=None, held_out_ratio=0.9)
    folder: Any = None
    data: Any = None
    assert rungs.confirms(folder, (data, after), (data, after)) is said


@pytest.mark.examination
def test_compare_ladder_and_diagnose_tell_the_same_error_of_the_same_model(tmp_path: Path) -> None:
    """A joint that lifts a weight, drawn: its base model is far off and sees less far than what follows."""
    rng, time = np.random.default_rng(5), 0.0125 * np.arange(3600)
    files = {}
    for name in ("train", "held"):
        waves = [(rng.uniform(0.2, 0.9), hz, rng.uniform(0.0, math.tau)) for hz in rng.uniform(0.05, 0.5, 3)]
        angle = sum(size * np.sin(math.tau * hz * time + phase) for size, hz, phase in waves)
        speed, rate = (sum(f(size, math.tau * hz, math.tau * hz * time + phase) for size, hz, phase in waves) for f in (_speed, _rate))
        torque = 0.4 * rate + speed + 0.6 * np.tanh(speed / 0.01) + 4.4 * np.sin(angle) + 0.15 * np.sin(2.0 * angle + 1.0)
        torque = 0.1 * torque * (1.0 + 0.1 * (torque / 6.0) ** 2) + rng.normal(0.0, 0.008, len(time))
        files[name] = tmp_path / f"{name}.csv"
        write_columns(files[name], {"t_s": time, "torque_nm": torque, "position_rad": 1e-4 * np.round(angle / 1e-4)})
    run = as_run(files, tmp_path / "run", 0.04)
    said = {}
    for verb in (["diagnose", "--auto", "--no-cost"], ["compare", "--no-pictures"], ["ladder", "--no-pictures"]):
        outcome = CliRunner().invoke(cli, [verb[0], str(run), *verb[1:], "--json"])
        assert outcome.exit_code == 0, outcome.output
        said[verb[0]] = json.loads(outcome.stdout)
    last = said["ladder"]["revisions"][-1]
    assert len(said["ladder"]["revisions"]) > 1
    assert said["compare"]["plain"]["overall"] == pytest.approx(last["plain"])
    assert said["compare"]["plain"]["held_out"] == pytest.approx(last["plain_held_out"])
    assert len({one["plain"]["band_hz"] for one in said["ladder"]["revisions"]}) == 1
    held = [one["plain_held_out"]["error"] for one in said["ladder"]["revisions"]]
    assert held == sorted(held, reverse=True)
    assert {one["band_hz"] for one in _plains(said["diagnose"])} == {last["plain"]["band_hz"]}


def _plains(said: Any) -> list[Any]:
    """Every error in plain units of an answer."""
    if isinstance(said, dict):
        return [said] if "band_hz" in said else [one for value in said.values() for one in _plains(value)]
    return [one for value in said for one in _plains(value)] if isinstance(said, list) else []


def _speed(size: float, turns: float, phase: np.ndarray) -> np.ndarray:
    return np.asarray(size * turns * np.cos(phase))


def _rate(size: float, turns: float, phase: np.ndarray) -> np.ndarray:
    return np.asarray(-size * turns**2 * np.sin(phase))
