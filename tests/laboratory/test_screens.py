"""Answers of compare and diagnose fit on a screen, and the next command follows from what was found."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from beltcomm.axis import load_axis
from beltcomm.jobs import laboratory as job
from beltcomm.laboratory.compare import Comparison, Missing, RecordRatio
from beltcomm.laboratory.figures import PlainError
from beltcomm.model import load_plant
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.laboratory import comparison_details, comparison_screen, diagnosis_screen, record_table

PLAIN = PlainError(0.0114, 0.0047, 0.23, 4.9, "N m", 240.0)


def comparison(ratio: float, held: float | None = None) -> Comparison:
    records = tuple(RecordRatio(f"frf_{n}", n == 9, ratio + 0.01 * n, 1000, PLAIN) for n in range(12))
    missing: Missing = "size" if ratio > 1.1 else "held out" if (held or 0.0) > 1.1 else ""
    return Comparison(ratio, held, missing, records, (), (), PLAIN, PLAIN)


@pytest.mark.parametrize(("ratio", "held", "word"), [(1.01, 1.02, "FITS "), (1.04, 1.2, "FITS IN PART"), (2.3, None, "DOES NOT FIT")])
def test_a_comparison_fits_on_a_screen_and_the_worst_error_makes_its_state(ratio: float, held: float | None, word: str) -> None:
    lines = comparison_screen(comparison(ratio, held), ["0 to 20 Hz: 8.12 times the noise"] * 5, ["belt 35 % softer"] * 6)
    assert lines[0].startswith(f"  {word}")
    assert len(lines) <= 18
    assert max(map(len, lines)) <= 80
    assert any("8 more" in line for line in lines)


def test_columns_that_do_not_divide_are_said_to_be_none() -> None:
    titles, _ = record_table(comparison(1.0))
    assert "x noise" in titles[1]
    assert not any("error/noise" in title for title in titles)
    assert "no quotient" in "\n".join(comparison_details(comparison(1.0), load_plant("g_a").model))


def test_a_search_is_next_only_where_something_is_left_to_be_found(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    assert " diagnose " in job._after_comparison(folder, comparison(1.3), False).command
    assert " diagnose " in job._after_comparison(folder, comparison(1.0, 1.3), False).command
    assert " diagnose " in job._after_comparison(folder, comparison(0.5), True).command
    assert " diagnose " not in job._after_comparison(folder, comparison(1.01, 1.01), False).command


def test_a_diagnosis_fits_on_a_screen_with_number_cause_and_check(monkeypatch: pytest.MonkeyPatch) -> None:
    model = load_plant("g_a").model.with_effect("friction_position", {"amount": 0.05, "place": 0.3, "width": 0.06})
    for module in ("beltcomm.sentences.laboratory", "beltcomm.sentences.ladder"):
        monkeypatch.setattr(f"{module}.with_intervals", lambda _fitted: model)
    base, after = (SimpleNamespace(ratio=ratio, held_out_ratio=ratio, held_out_residuals=(1,), model=model) for ratio in (2.3, 1.01))
    found: Any = SimpleNamespace(
        verdict="explained", added_effects=["friction_position"], published_base=(None, base), final_fit=after, base=base, steps=()
    )
    lines = diagnosis_screen(found, (PLAIN, PLAIN), (PLAIN, PLAIN), ["These data cannot tell it from dirt: look."], ["a", "b"], None)
    text = "\n".join(lines)
    assert lines[0].startswith("  FOUND   friction_position: tight spot on the rail")
    assert "2.30 x noise" in text
    assert "1.01 x noise" in text
    assert "check    rail around the place" in text
    assert len(lines) <= 18
