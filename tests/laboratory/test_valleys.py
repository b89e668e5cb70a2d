"""A fit that ends in a wrong valley: far from the truth every block is bad, and one weight for each of them keeps it there."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory import diagnosis
from beltcomm.laboratory.diagnosis import _escape_if_far_off, fit_base_of
from beltcomm.model import build_model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session

#: A fast sweep and one response: the whole session takes half a minute.
RECORDS = ("01_sweep_fast_1", "05_frf_p1_a2")


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> tuple[Data, Fitted]:
    """A machine with an end pulley of 0.68 kg, of which one diagnosis ended in a wrong valley, and the model without it."""
    folder = tmp_path_factory.mktemp("valley") / "run"
    machine = draw(874070, ("end_pulley",), 1.0, "sheet")
    write_session(machine, folder, only=RECORDS)
    run = RunFolder.open(folder)
    records = run.recordings()
    return fit_base_of(records, run.axis, start_model(run.axis, records))


@pytest.mark.examination
@pytest.mark.parametrize(("mass", "share", "inertia"), [(0.4, 0.6, 8.5e-5)])
def test_with_one_weight_a_stretch_the_fit_leaves_a_wrong_valley(
    base: tuple[Data, Fitted], mass: float, share: float, inertia: float
) -> None:
    data, without = base
    values = {"end_pulley.mass": mass, "end_pulley.share": share, "end_pulley.split": 0.6, "motor.inertia": inertia}
    stuck = fit(data, without.model.with_effect("end_pulley").with_values(values, "trial"), 100, offsets=without.offsets)
    assert stuck.ratio > 20.0, "however long the fit goes on"
    found = _escape_if_far_off(data, stuck)
    assert found is not None
    assert found.ratio < 1.5
    assert found.model["motor.inertia"] == pytest.approx(7.43e-5, rel=0.01), "as the machine has it"
    assert _escape_if_far_off(data, found) is None, "there is no better one"


@pytest.mark.parametrize(
    ("level", "fall", "held_fall", "taken"),
    [(2.5, 5000.0, 500.0, True), (1.2, 5000.0, 500.0, False), (2.5, 100.0, 10.0, False), (2.5, 5000.0, -800.0, False)],
)
def test_only_a_bad_end_is_looked_at_again_and_only_a_better_one_is_taken(
    monkeypatch: pytest.MonkeyPatch, level: float, fall: float, held_fall: float, taken: bool
) -> None:
    model = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {}).with_effect("end_pulley")

    def fitted(objective: float, held: float) -> Any:
        return SimpleNamespace(
            model=model,
            objective=objective,
            held_out_objective=held,
            held_out_share=0.5,
            problem=SimpleNamespace(model=model, samples=10_000),
            x=np.zeros(0),
        )

    asked = []

    def other(_data: Data, before: Any, _iterations: int) -> Any:
        asked.append(before)
        return fitted(before.objective - fall, before.held_out_objective - held_fall)

    monkeypatch.setattr(diagnosis, "escape_local_minimum", other)
    data: Any = SimpleNamespace()
    assert (_escape_if_far_off(data, fitted(level * 10_000, 2000.0)) is not None) is taken
    assert len(asked) == (level > 1.3), "a machine that is found right loses no time"


def test_the_search_goes_on_from_the_better_valley(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was added stays added, with the values of the better valley; asked once there, and never where nothing was added."""
    asked = []

    def beyond_of(_data: Data, fitted: Any) -> Any:
        asked.append(fitted.name)
        return None if "better" in fitted.name else model("better")

    def model(name: str) -> Any:
        size = {"objective": 1.0, "problem": SimpleNamespace(samples=1, forget=lambda: None), "ratio": 2.0, "held_out_ratio": None}
        return SimpleNamespace(name=name, model=SimpleNamespace(effects=()), **size)

    named = SimpleNamespace(
        effect=SimpleNamespace(name="end_pulley", twins=(), rattles=False), accepted=True, stands=True, beside="", fitted=model("valley")
    )
    found = [[named], [], []]
    monkeypatch.setattr(diagnosis, "search", lambda *_, **_options: found.pop(0))
    monkeypatch.setattr(diagnosis, "_escape_if_far_off", beyond_of)
    monkeypatch.setattr(diagnosis, "refit_with_rebuilt_motion", lambda data, fitted, *_: (data, model(fitted.name + ", again")))
    for name in ("final_refit", "_as_searched"):
        monkeypatch.setattr(diagnosis, name, lambda data, fitted: (data, fitted))
    monkeypatch.setattr(diagnosis, "drop_superfluous", lambda _data, fitted, *_: (fitted, ()))
    monkeypatch.setattr(diagnosis, "fit_law_shapes", lambda _data, fitted, _base: SimpleNamespace(fitted=fitted, new=(), removed=()))
    monkeypatch.setattr(diagnosis, "assign_body", lambda *_: SimpleNamespace(new=()))
    for name in ("Scorer", "ground_of", "left_start_values", "_remaining_structure", "_verdict_of"):
        monkeypatch.setattr(diagnosis, name, lambda *_: None)
    monkeypatch.setattr(diagnosis, "lowers", lambda *_: True)
    monkeypatch.setattr(diagnosis, "least_plain_error", lambda _data, last, *_: last)
    begun: Any = SimpleNamespace(fitted=(), held_out=(), substeps=4, path=SimpleNamespace(rivals=())), model("base")
    nothing: Any = SimpleNamespace()
    after = diagnosis.diagnose([], nothing, nothing, begun=begun)
    assert [(step.added, step.after.name) for step in after.steps] == [("end_pulley", "better, again"), ("", "better, again")]
    assert asked == ["valley, again", "better, again"]

    asked.clear()
    found.append([])
    assert [step.added for step in diagnosis.diagnose([], nothing, nothing, begun=begun).steps] == [""]
    assert asked == []
