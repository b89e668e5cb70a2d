"""A gap and a torque that acts late hide each other: only together do they lead out of a base that made up for both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from beltcomm.fit.start.model import start_model
from beltcomm.laboratory import diagnosis
from beltcomm.laboratory.diagnosis import _as_searched, fit_base_of
from beltcomm.laboratory.gaps import gap_with_delay
from beltcomm.laboratory.selection import Candidate, fit_with_sheet_values
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.diagnosis_data import _ranked
from beltcomm.sentences.ladder import trial_line
from truth.hidden import draw, write_session

#: Few and loud, so that it does not take half a minute.
RECORDS = ("01_sweep_fast_1", "03_frf_p0_a2", "05_frf_p1_a2")


def found_in(folder: Path, effects: tuple[str, ...], seed: int) -> tuple[Candidate | None, float]:
    """The gap beside a delay on a machine with these effects at full strength, and the error of its base."""
    write_session(draw(seed, effects, 1.0, "sheet"), folder / "run", only=RECORDS)
    run = RunFolder.open(folder / "run")
    records = run.recordings()
    start = start_model(run.axis, records)
    data, base = _as_searched(*fit_base_of(records, run.axis, start))
    return gap_with_delay(data, base, fit_with_sheet_values(data, base, start)), base.ratio


@pytest.mark.examination
@pytest.mark.parametrize(("delay", "seed"), [("dead_time", 41), ("current_lag", 42)])
def test_a_gap_is_found_behind_a_late_torque(tmp_path: Path, delay: str, seed: int) -> None:
    """Alone it explained 11 %, the lag no axis could have, and the verdict was that nothing known explains the rest."""
    found, before = found_in(tmp_path, ("backlash", delay), seed)
    assert found is not None
    assert found.effect.name == "backlash"
    assert found.beside in ("dead_time", "current_lag"), "which of the two the next stage asks"
    assert found.explained > 0.9
    assert found.accepted
    assert found.stands
    assert found.fitted is not None
    assert not {"dead_time", "current_lag"} & set(found.fitted.model.effects), "the next stage has to find it"
    assert found.fitted.ratio < before
    assert _ranked(found)["beside"] == found.beside
    assert f"together with {found.beside}" in trial_line(found)
    assert "together" not in trial_line(replace(found, beside=""))


@pytest.mark.examination
@pytest.mark.parametrize(("effects", "seed"), [(("payload_mode",), 44), (("dead_time",), 45)])
def test_a_machine_without_both_has_no_gap_behind_a_delay(tmp_path: Path, effects: tuple[str, ...], seed: int) -> None:
    assert found_in(tmp_path, effects, seed)[0] is None


@pytest.mark.parametrize(("alone", "asked"), [(0.6, False), (0.4, True)])
def test_both_are_tried_only_where_nothing_explains_most(monkeypatch: pytest.MonkeyPatch, alone: float, asked: bool) -> None:
    first, behind = (
        Candidate(effect, 1.0, 1e4, share, 0.0, None, True) for effect, share in zip(diagnosis.EFFECTS, (alone, 0.9), strict=False)
    )
    tries: list[Any] = []
    monkeypatch.setattr(diagnosis, "search", lambda *_, **_options: [first])
    monkeypatch.setattr(diagnosis, "left_start_values", lambda *_: True)
    for name in ("ground_of", "fit_with_sheet_values", "Scorer", "gap_from_start"):
        monkeypatch.setattr(diagnosis, name, lambda *_: None)
    monkeypatch.setattr(diagnosis, "gap_with_delay", lambda *words: tries.append(words) or behind)
    anything: Any = type("Anything", (), {"fitted": ()})()
    found = diagnosis._find_candidates(anything, anything, anything, anything, anything, 1.04, lambda _fraction: None)
    assert bool(tries) is asked
    assert (behind in found) is asked
