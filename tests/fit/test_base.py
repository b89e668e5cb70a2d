"""The steps from start values to the published fit: a motion rebuilt by a model is taken only where it is sound."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.fit import base
from beltcomm.fit.residual.segment import Segment
from beltcomm.model import build_model

BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {})


@pytest.mark.parametrize(("objective", "kept"), [(float("nan"), "before"), (float("inf"), "before"), (5.0, "after")])
def test_a_model_that_flies_off_on_the_motion_that_it_rebuilds_is_not_taken(
    monkeypatch: pytest.MonkeyPatch, objective: float, kept: str
) -> None:
    rebuilt, found = SimpleNamespace(fitted=(kept_samples(10),)), alike(objective, 1.0)
    data, fitted = seen_by_base(10)
    monkeypatch.setattr(base, "remade", lambda *_: rebuilt)
    monkeypatch.setattr(base, "fit", lambda *_, **_options: found)
    assert base.refit_with_rebuilt_motion(data, fitted, 3) == {"before": (data, fitted), "after": (rebuilt, found)}[kept]


@pytest.mark.parametrize(("left", "kept"), [(40, "before"), (60, "after")])
def test_a_motion_by_which_the_motor_hardly_moves_is_not_taken(monkeypatch: pytest.MonkeyPatch, left: int, kept: str) -> None:
    """Of samples, however many of them make one value: four neighbours do in a search, and one where numbers are published."""
    rebuilt: Any = SimpleNamespace(fitted=(kept_samples(left, group=4),))
    found = alike(5.0, 1.0)
    data, fitted = seen_by_base(100)
    monkeypatch.setattr(base, "remade", lambda *_: rebuilt)
    monkeypatch.setattr(base, "fit", lambda *_, **_options: found)
    assert base.refit_with_rebuilt_motion(data, fitted, 3) == {"before": (data, fitted), "after": (rebuilt, found)}[kept]


def test_noise_of_other_frequencies_is_no_worse_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that changes its sign from sample to sample is seen sample by sample only: in fours it was no more than the noise."""
    rebuilt, found = SimpleNamespace(fitted=(kept_samples(100),)), alike(5.0, 0.0)
    found.residual = np.where(np.arange(100) % 2, 3.0, -3.0) + np.resize([1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0], 100)
    data, fitted = seen_by_base(100, group=4)
    monkeypatch.setattr(base, "remade", lambda *_: rebuilt)
    monkeypatch.setattr(base, "fit", lambda *_, **_options: found)
    assert base.refit_with_rebuilt_motion(data, fitted, 3) == (rebuilt, found)
    monkeypatch.setattr(found, "residual", np.full(100, 3.0))
    assert base.refit_with_rebuilt_motion(data, fitted, 3) == (data, fitted), "and one that does not is seen in fours too"


def alike(objective: float, left: float, number: int = 100, group: int = 1) -> Any:
    """A fit that leaves the same in each value of a stretch."""
    ends = np.array([0, number // group])
    problem = SimpleNamespace(pieces=[kept_samples(number, group)], ends=ends)
    return SimpleNamespace(objective=objective, residual=np.full(ends[1], left), problem=problem)


def seen_by_base(number: int, group: int = 1) -> tuple[Any, Any]:
    """Records of one stretch, and the base fitted to them."""
    fitted = SimpleNamespace(model=BASE, offsets=np.zeros(1), **vars(alike(5.0, 1.0, number, group)))
    return SimpleNamespace(fitted=(kept_samples(number, group),), held_out=(), noise_nm=1e-3), fitted


def kept_samples(number: int, group: int = 1) -> Any:
    """A stretch with so many samples that count, so many of which make one value."""
    keep = np.append(np.ones(number, dtype=np.bool_), np.zeros(5, dtype=np.bool_))
    motion: Any = SimpleNamespace(forget=lambda: None)
    return Segment("one", False, np.zeros(len(keep)), np.zeros(len(keep)), motion, keep, 1e-3, 1e-4, 0.0, group=group)
