"""A search whose base has a gap already: an observer forgives, and far from the truth the score test hardly sees what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm.effects import Effect, Ground, effect_named
from beltcomm.laboratory.data import prepare
from beltcomm.laboratory.fitting import fit
from beltcomm.laboratory.score import Scored, Scorer, ground_of
from beltcomm.laboratory.stage import search
from beltcomm.laboratory.start import start_model
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session

#: A fast sweep and one response: the whole session takes half a minute.
RECORDS = ("01_sweep_fast_1", "05_frf_p1_a2")


def test_friction_of_the_carriage_is_refitted_behind_a_gap_whatever_the_score_promises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So an end pulley was named on an axis that had a gap of 0.2 mm and friction at the carriage: of that the score promised 50 nats of
    23 000.  Here it is made to promise less than a refit is worth."""
    machine = draw(33, ("backlash", "cart_friction"), 1.0, "sheet")
    write_session(machine, tmp_path / "run", plan="thorough")
    run = RunFolder.open(tmp_path / "run")
    records = [recording for recording in run.recordings() if recording.name in RECORDS]
    model = start_model(run.axis, records).with_effect("backlash")
    data = prepare(records, run.axis, model)
    base = fit(data, model, 12)
    score = Scorer.score

    def blind(scorer: Scorer, effect: Effect, ground: Ground) -> Sequence[Scored]:
        return [replace(way, drop=min(way.drop, 15.0)) for way in score(scorer, effect, ground)]

    monkeypatch.setattr(Scorer, "score", blind)
    effects = [effect_named("cart_friction"), effect_named("stiffness_position")]
    first, second = search(data, Scorer(base), ground_of(base, data.fitted, run.axis), effects)
    assert first.effect.name == "cart_friction"
    assert first.accepted
    assert second.fitted is None, "nothing promised, and not what a gap hides"
