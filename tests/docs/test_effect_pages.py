"""docs/effects: its pages and the numbers behind its pictures are what the catalogue gives today (``python docs/make.py`` writes them)."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from beltcomm.effects import EFFECTS, Effect

DOCS = Path(__file__).parents[2] / "docs"
#: One of each kind of experiment: linear response, by place, strokes, sweep, move, reversal, session, a scale at the carriage.
DRAWN = ("coupling", "stiffness_position", "cogging", "stribeck", "measurement_lag", "presliding", "warmup", "feed_constant")
#: What a diagnosis says of itself beside the names of the catalogue.
FAMILY = {"coulomb_asymmetry", "current_offset"}


def module(name: str) -> ModuleType:
    """A script of docs/, which is no package."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
        assert spec
        assert spec.loader
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@pytest.fixture(scope="module")
def make() -> Any:
    module("experiments")
    module("symptoms")
    return module("make")


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_tells_a_technician_what_to_do(effect: Effect) -> None:
    assert effect.causes
    assert effect.remedy
    assert bool(effect.twins) <= bool(effect.separate)
    assert set(effect.alike) | set(effect.twins) <= {e.name for e in EFFECTS} | FAMILY
    assert effect.name not in {*effect.alike, *effect.twins}


def test_the_pages_are_what_the_catalogue_says(make: Any) -> None:
    experiment = make.experiments()
    written = {path.stem: path.read_text(encoding="utf-8") for path in (DOCS / "effects").glob("*.md")}
    assert written == {e.name: make.page(e, experiment[e.name]) for e in make.pages()}, "run python docs/make.py --pages"
    text = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert text == make.with_index(text)
    assert {make.page_of(e) for e in EFFECTS} == set(written)


def test_every_page_has_a_picture_that_is_small(make: Any) -> None:
    sizes = {path.stem: path.stat().st_size for path in (DOCS / "effects" / "pictures").glob("*.svg")}
    assert set(sizes) == {e.name for e in make.pages()} == set(make.SYMPTOMS)
    assert max(sizes.values()) < 40_000


@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_shows_what_the_laws_give(make: Any, name: str) -> None:
    drawn = (DOCS / "effects" / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
    shown = json.loads(re.search(r"<dc:description>(.*?)</dc:description>", drawn, re.DOTALL)[1])
    symptom = make.SYMPTOMS[name]()
    assert make.experiments()[name] == symptom.experiment
    for one, other in zip(make.digest(symptom), shown, strict=True):
        assert one == pytest.approx(other, rel=1e-3, abs=1e-3 * max(map(abs, other[6:])))
    without, having = ([line.y for panel in symptom.panels for line in panel.lines if line.effect is effect] for effect in (False, True))
    assert not any(len(a) == len(b) and np.allclose(a, b) for a, b in zip(without[:1], having[:1], strict=True)), "the effect must show"


def test_equal_runs_draw_equal_bytes(make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make, "FOLDER", tmp_path)
    found = []
    for _ in range(2):
        make.write_picture("feed_constant", make.SYMPTOMS["feed_constant"]())
        found.append((tmp_path / "pictures" / "feed_constant.svg").read_bytes())
    assert found[0] == found[1]
