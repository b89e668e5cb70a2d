"""The examination's own bookkeeping: a line keeps every record, and the table counts them; lines from before hold none."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import hidden_effects
import hidden_table


def test_a_line_keeps_every_record() -> None:
    """Two stretches of one record are one; the model before counts another number of samples."""
    pieces = [SimpleNamespace(record=name) for name in ("a", "a", "b")]

    def fitted(sizes: tuple[int, ...], level: float) -> Any:
        ends = np.cumsum([0, *sizes])
        levels = np.repeat([level, level, 2.0 * level], sizes)
        return SimpleNamespace(
            problem=SimpleNamespace(pieces=pieces, ends=ends), residual=levels, held_out_residuals=(np.full(4, 3.0 * level),)
        )

    found: Any = SimpleNamespace(
        base=fitted((5, 5, 2), 3.0), final_fit=fitted((4, 6, 3), 1.0), data=SimpleNamespace(held_out=[SimpleNamespace(record="c")])
    )
    assert hidden_effects.records_of(found) == [("a", False, 3.0, 1.0), ("b", False, 6.0, 2.0), ("c", True, 9.0, 3.0)]


def test_the_table_counts_single_records(capsys: pytest.CaptureFixture[str]) -> None:
    lines: list[dict[str, Any]] = [
        {"records": [["a", False, 3.0, 1.049], ["b", False, 3.0, 0.94], ["c", True, 3.0, 1.0]]},
        {"records": [["a", False, 1.0, 2.0]]},
        {},
    ]
    hidden_table.print_records(lines)
    shown = capsys.readouterr().out.splitlines()
    assert "fitted, within 1.00 ± 0.05: 1 of 3," in shown[0]
    assert "held out, within 1.00 ± 0.05: 1 of 1," in shown[1]
    hidden_table.print_records([{}])
    assert not capsys.readouterr().out
