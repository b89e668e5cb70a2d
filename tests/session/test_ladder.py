"""The ladder: where each revision comes from in the text, and what a missing effect costs there and on the report's page."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from beltcomm.axis import load_axis
from beltcomm.jobs import rungs
from beltcomm.jobs.change import _named_beside
from beltcomm.jobs.laboratory import _climb
from beltcomm.laboratory import acceptance
from beltcomm.laboratory.figures import PlainError
from beltcomm.model import load_plant
from beltcomm.pages import diagnosed
from beltcomm.report.page import PageTable
from beltcomm.result import plain
from beltcomm.rundata import cost as costs
from beltcomm.rundata.cost import Cost
from beltcomm.rundata.revisions import Revision, as_mapping, keep_cost, new_revision, revisions
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.ladder import ladder_lines
from beltcomm.verify import TrackingError

MOVE = "0.00 to 0.50 m at up to 1.5 m/s"
COST = Cost(MOVE, *(TrackingError(1e-6 * d, 1e-6 * s) for d, s in ((411, 97), (205, 31), (512, 98), (306, 33))))
RANGED = replace(
    COST,
    unaware_range=(TrackingError(4e-4, 9e-5), TrackingError(4.2e-4, 1e-4)),
    aware_range=(TrackingError(2e-4, 3e-5), TrackingError(2.1e-4, 4e-5)),
)
BASE = Revision("revision_1", "", "base", (), 3.2, 3.3, None, "beltcomm fit RUN", "2026-03-31T09:12:44", {"a": "12", "b": "34"})
ADDED = Revision(
    "revision_2", "revision_1", "+backlash", ("backlash",), 1.02, 1.05, True, "beltcomm add backlash RUN", "2026-03-31T09:20:00",
    {"a": "12", "b": "56"}, {"of": "backlash", **plain(RANGED)},
    *(PlainError(0.02, 0.019, 0.8, percent, "N m", 120.0) for percent in (2.54, 12.6)),
)  # fmt: skip


def test_text_names_time_data_and_command_of_every_revision_within_80_columns() -> None:
    lines = ladder_lines([BASE, ADDED], ())
    text = "\n".join(lines)
    for rung in (BASE, ADDED):
        assert f"{rung.name}  {rung.when}, 2 recordings, data {rung.data_hash}" in text
        assert f"    {rung.command}\n" in f"{text}\n"
    assert BASE.data_hash != ADDED.data_hash
    assert BASE.data_hash == replace(ADDED, data=dict(reversed(BASE.data.items()))).data_hash
    assert "0.411 (0.4 to 0.42) → 0.205 (0.2 to 0.21)" in text
    assert "carriage, static  0.098 → 0.033" in text
    assert re.search(r" 1\.05 +2\.54 / 12\.6 ", text)
    assert max(map(len, lines)) <= 80


def test_a_cost_is_kept_with_its_revision_and_ladders_from_before_load(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    model = load_plant("g_a").model
    for change in ("base", "+backlash"):
        new_revision(folder, model, change, ratio=1.0, held_out=None, confirmed=None, command="", when="")
    saved = folder.load_result("ladder")
    assert saved is not None
    folder.save(
        "results",
        "ladder",
        {"revisions": [{k: v for k, v in rung.items() if k not in ("cost", "plain", "plain_held_out")} for rung in saved["revisions"]]},
    )
    assert [rung.cost for rung in revisions(folder)] == [None, None]
    assert [rung.plain for rung in revisions(folder)] == [None, None]
    keep_cost(folder, "revision_2", {"of": "backlash", **plain(COST)})
    kept = [as_mapping(rung)["cost"] for rung in revisions(folder)]
    assert kept[0] is None
    assert kept[1]["unaware"]["dynamic_m"] == COST.unaware.dynamic_m


def test_a_new_rung_takes_no_other_model_s_name(tmp_path: Path) -> None:
    """Not where the ladder was deleted, as a damaged one is; one cut off before its rung was noted is taken up again."""
    folder, model = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), load_plant("g_a").model
    grown = {"base": model, "+backlash": model.with_effect("backlash"), "+cogging": model.with_effect("cogging")}

    def made(change: str) -> str:
        return new_revision(folder, grown[change], change, ratio=1.0, held_out=None, confirmed=None, command="", when="").name

    assert [made("base"), made("+backlash")] == ["revision_1", "revision_2"]
    before = {name: folder.load("models", name) for name in ("revision_1", "revision_2")}
    (folder.path / "results" / "ladder.yaml").unlink()
    assert [made("+cogging"), made("+backlash")] == ["revision_3", "revision_2"]
    assert {name: folder.load("models", name) for name in before} == before


@pytest.mark.parametrize(
    ("cost", "row"),
    [(RANGED, ("motor, dynamic", "0.411", "0.4 to 0.42", "0.205", "0.2 to 0.21")), (COST, ("motor, dynamic", "0.411", "0.205"))],
)
def test_report_shows_errors_without_and_with(cost: Cost, row: tuple[str, ...]) -> None:
    unknown = replace(ADDED, name="revision_3", change="+cogging", cost=None)
    run: Any = SimpleNamespace(rungs=[BASE, replace(ADDED, cost={"of": "backlash", **plain(cost)}), unknown], place="RUN")
    made = diagnosed.cost_section(run)
    (table,) = (part for part in made.parts if isinstance(part, PageTable))
    assert table.rows[0] == row
    assert len({len(table.head), *map(len, table.rows)}) == 1
    words = " ".join(line for part in made.parts if not isinstance(part, PageTable) for line in part.lines)
    assert MOVE in words
    assert "Not known of revision_3 (+cogging)" in words
    run.rungs = [BASE]
    assert "beltcomm diagnose RUN" in diagnosed.cost_section(run).missing


@pytest.mark.parametrize(("named", "computed"), [(("backlash",), 0), (("backlash", "warmup"), 1)])
def test_a_climb_keeps_the_cost_of_what_it_added(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, named: tuple[str, ...], computed: int
) -> None:
    """With the last revision: what the diagnosis computed where all was added, else anew for what was."""
    folder, model = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), load_plant("g_a").model
    for grown, change in ((model, "base"), (model.with_effect("backlash"), "+backlash")):
        new_revision(folder, grown, change, ratio=1.0, held_out=None, confirmed=None, command="", when="")
    asked: list[Any] = []
    known = {name: {"dynamic_m": 1e-4, "static_m": 1e-5} for name in ("unaware", "aware", "unaware_cart", "aware_cart")}

    def cost(_folder: RunFolder, before: Any, after: Any, _name: str) -> tuple[dict[str, Any], list[str]]:
        asked.append((before, after))
        return {**known, "move": "anew"}, []

    monkeypatch.setattr(costs, "cost_and_words", cost)
    found: Any = SimpleNamespace(base=SimpleNamespace(model=model), added_effects=named)
    made = costs.with_costs(folder, found, revisions(folder), {**known, "move": "whole"})
    assert [rung.cost for rung in made] == [None, {"of": "backlash", **known, "move": "anew" if computed else "whole"}]
    assert revisions(folder) == made
    assert [after.effects[-1] for _, after in asked] == ["backlash"] * computed


def test_a_climb_without_a_step_leaves_the_run_as_it_is(tmp_path: Path) -> None:
    """A run that has a model and lacks nothing keeps it, and the move that proved its gains stays their proof."""
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    folder.save("models", "final", load_plant("g_a").model.to_dict())
    found: Any = SimpleNamespace(published_base=(None, None), steps=(SimpleNamespace(added="", removed=(), forms=()),))
    assert _climb(folder, found, True, "", "") == []
    assert folder.names("models") == ["final"]


@pytest.mark.parametrize(("held", "confirmed"), [(1.9, True), (2.1, False)])
def test_what_stands_on_a_rung_that_is_not_confirmed_is_held_against_the_one_below(tmp_path: Path, held: float, confirmed: bool) -> None:
    folder, model = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), load_plant("g_a").model
    new_revision(folder, model, "base", ratio=2.0, held_out=2.0, confirmed=None, command="", when="")
    new_revision(folder, model, "+cogging", ratio=1.5, held_out=3.0, confirmed=False, command="", when="")
    nothing: Any = SimpleNamespace(fitted=(), held_out=())
    before: Any = SimpleNamespace(model=model, held_out_ratio=3.0, held_out_level=9.0)
    after: Any = SimpleNamespace(model=model, ratio=1.0, held_out_ratio=held, held_out_level=2.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rungs, "with_intervals", lambda fitted: fitted.model)
        patch.setattr(rungs, "of_run", lambda *_: (None, None))
        patch.setattr(rungs, "band_of", lambda *_: 60.0)
        patch.setattr(rungs, "keep_fit", lambda *_: None)
        patch.setattr(acceptance, "changes", lambda *_: ((-1.0, 0.0), (-1.0, 0.0)))
        assert rungs.revision_of(folder, (nothing, after), (nothing, before), "+warmup", "", "").confirmed is confirmed


@pytest.mark.parametrize(
    ("kept", "beside"),
    [({"named": ["cogging", "stribeck", "stribeck_cart"]}, ["stribeck"]), ({}, []), ({"named": ["unheard"]}, [])],
)
def test_effects_that_a_diagnosis_names_beside_one_that_was_added(tmp_path: Path, kept: dict[str, Any], beside: list[str]) -> None:
    folder, model = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), load_plant("g_a").model
    folder.save("results", "diagnosis", kept)
    assert _named_beside(folder, model.with_effect("cogging")) == beside
