"""The table of excitations: limits kept, equal time, and what each kind is known to be like."""

from __future__ import annotations

import math

import pytest

from beltcomm.comparisons import excitations
from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.report.style import Caption
from beltcomm.report.thesis_excitations import figures
from beltcomm.session.thesis import TOPICS, thesis


@pytest.fixture(scope="module")
def study() -> excitations.Study:
    """One axis, two seeds: the whole table takes half a minute."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(excitations, "PLANTS", ("g_b",))
        patch.setattr(excitations, "SEEDS", (1, 2))
        return excitations.compare()


def test_all_keep_the_same_limits_and_time(study: excitations.Study) -> None:
    assert [row.kind for row in study.rows] == ["prbs", "gprbs", "chirp", "multisine"]
    for row in study.rows:
        assert row.seconds <= excitations.SECONDS
        assert row.seconds > 0.9 * excitations.SECONDS
        assert row.belt_force_n <= excitations.LIMITS.belt_force_n * 1.001
        assert row.travel_m <= excitations.LIMITS.travel_m * 1.01
        # One of them is reached: a louder record would have broken it.
        assert max(row.belt_force_n / excitations.LIMITS.belt_force_n, row.travel_m / excitations.LIMITS.travel_m) > 0.9


def test_each_kind_is_what_it_is_known_for(study: excitations.Study) -> None:
    """Binary signals have crest factor 1, a chirp √2 beside its fade; only the multisine tells odd from even, and friction is odd."""
    rows = {row.kind: row for row in study.rows}
    assert rows["prbs"].crest_factor == pytest.approx(1.0, abs=0.01)
    assert rows["gprbs"].crest_factor == pytest.approx(1.0, abs=0.1)
    assert math.sqrt(2.0) < rows["chirp"].crest_factor < 1.6
    assert rows["multisine"].odd > 10.0 * rows["multisine"].even
    assert all(math.isnan(rows[kind].odd) for kind in ("prbs", "gprbs", "chirp"))


def test_every_fit_finds_the_axis(study: excitations.Study) -> None:
    """Within 1 % of mass, stiffness and inertia, from start values 15 to 20 % off."""
    for row in study.rows:
        assert max(row.error.values()) < 0.01, row.kind


def test_words_and_figure(study: excitations.Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(excitations, "PLANTS", ("g_b",))
    text = excitations.lines(study)
    assert sum(line.startswith(("prbs", "gprbs", "chirp", "multisine")) for line in text) == 4
    best = min(study.rows, key=excitations.score).kind
    assert any(line.startswith(f"g_b: {best} gives the smallest errors") for line in text)
    monkeypatch.setattr("beltcomm.report.thesis_excitations.PLANTS", ("g_b",))
    assert list(figures(study, Caption("test", "none"))) == ["excitations_g_b"]


def test_topics_are_listed_and_a_wrong_one_is_said() -> None:
    assert "excitations" in TOPICS
    assert any(line.startswith("excitations") for line in thesis().lines())
    with pytest.raises(UsageError, match="did you mean excitations"):
        thesis("excitation")


def test_the_truth_behind_the_table_is_the_shipped_plant() -> None:
    assert load_plant("g_b").model["cart.mass"] == pytest.approx(0.96)
