"""The topic ``discretisation``: every error within its bound, losses of margin as the phases say, and the words and figures."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import pytest

from beltcomm.thesis import discretisation
from beltcomm.thesis.discretisation import Discretisation
from beltcomm.thesis.figures import discretisation as thesis_discretisation
from beltcomm.thesis.topics import thesis


@pytest.fixture(scope="module")
def study() -> Discretisation:
    return discretisation.compare()


def test_every_error_lies_within_its_bound(study: Discretisation) -> None:
    known = [row for row in study.differences if not math.isnan(row.error)]
    assert len(known) == 2 * (2 * 6 + 3) - 1  # at 6.4 ms three at the crossover, less the notch
    for row in known:
        assert row.error <= row.bound + 1e-12
        assert row.omega_rad_s < math.pi / row.period_s
        # Gain and phase are those of the ratio whose distance from 1 is the error.
        value = cmath.rect(10.0 ** (row.gain_db / 20.0), math.radians(row.phase_deg))
        assert abs(value - 1.0) == pytest.approx(row.error, rel=1e-9, abs=1e-12)


def test_the_velocity_filter_at_the_crossover_lags_by_half_a_period(study: Discretisation) -> None:
    """T_R + T/2 in all; 5 % for T 6.4 ms, where θ is 0.27."""
    rows = [row for row in study.differences if row.part.startswith("velocity filter") and row.where == "crossover"]
    assert len(rows) == 6
    for row in rows:
        assert row.phase_deg == pytest.approx(-math.degrees(0.5 * row.omega_rad_s * row.period_s), rel=0.05)


def test_margins_are_lost_as_the_phases_at_the_crossover_say(study: Discretisation) -> None:
    """The crossover falls a little, so somewhat less is lost: between 0.75 and 1 times what is expected."""
    known = [row for row in study.loops if row.sampled is not None]
    assert [(row.prefilter, row.period_s) for row in known] == [
        ("notch", 0.4e-3), ("notch", 1e-3), ("butterworth", 0.4e-3), ("butterworth", 1e-3), ("butterworth", 6.4e-3),
    ]  # fmt: skip
    for row in known:
        assert row.sampled is not None
        lost = row.continuous.phase_margin_deg - row.sampled.phase_margin_deg
        assert 0.75 * row.expected_deg < lost < row.expected_deg
        assert row.sampled.stable


def test_a_notch_beyond_half_the_sampling_frequency_is_said_not_skipped(study: Discretisation) -> None:
    (missing,) = [row for row in study.loops if row.sampled is None]
    assert (missing.prefilter, missing.period_s) == ("notch", 6.4e-3)
    assert "does not fit a loop of 0.0064 s" in missing.refusal


def test_the_topic_tells_everything_and_draws_its_figures(study: Discretisation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discretisation, "compare", lambda: study)
    result = thesis("discretisation", pictures=tmp_path)
    text = "\n".join(result.lines())
    for words in ("not in a loop that slow", "does not fit a loop", "bound", "expected", "folded, at 49 Hz"):
        assert words in text
    assert sorted(path.stem for path in tmp_path.glob("*.png")) == ["discretisation_parts", "discretisation_velocity_loop"]
    assert len(result.to_json()["differences"]) == 36
    assert thesis_discretisation.COLOURS.keys() == set(discretisation.PERIODS_S)
