"""A fleet of run folders that changes between calls: a member is its run, not its number."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.configfiles import find_config
from beltcomm.errors import UsageError
from beltcomm.result import Result
from beltcomm.talk import Silence

Compute = Callable[..., list[str]]


class Told(Silence):
    def __init__(self) -> None:
        self.said = list[str]()

    def say(self, *lines: str) -> None:
        self.said.extend(lines)


def make(folder: Path, *names: str) -> None:
    """Run folders that hold no records."""
    for name in names:
        (folder / "runs" / name).mkdir(parents=True)
        axis = find_config("axes", "egc-70-600").read_text(encoding="utf-8")
        (folder / "runs" / name / "axis.yaml").write_text(axis, encoding="utf-8")


def change(run: Path) -> None:
    (run / "recordings").mkdir()
    (run / "recordings" / "new.csv").touch()


def members(out: Path) -> list[tuple[int, str]]:
    lines = [json.loads(text) for text in (out / "members.jsonl").read_text(encoding="utf-8").splitlines()]
    return [(line["member"], Path(line["values"]["run"]).name) for line in lines]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    study = tmp_path / "fleet.yaml"
    study.write_text("{each: compare, base: {runs: [runs/*]}}", encoding="utf-8")
    make(tmp_path, "b", "d")
    return study


@pytest.fixture
def compute(fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Compute:
    """One call into the same folder: the names of the runs that were compared in it."""
    compared: list[str] = []

    def compare_run(run: Path, *, pictures: bool) -> Result:
        compared.append(run.name)
        return Result({"ratio": {"overall": float(ord(run.name[0])), "held_out": None}, "worst": []}, [])

    monkeypatch.setattr("beltcomm.jobs.laboratory.compare_run", compare_run)

    def call(**options: Any) -> list[str]:
        compared.clear()
        api.study(fleet, tmp_path / "out", workers=1, report=False, **options)
        return list(compared)

    return call


def test_what_is_new_or_changed_is_computed_and_all_else_kept(compute: Compute, fleet: Path, tmp_path: Path) -> None:
    out, runs = tmp_path / "out", tmp_path / "runs"
    assert compute() == ["b", "d"]
    make(tmp_path, "a", "c")
    talk = Told()
    assert compute(talk=talk) == ["a", "c"], "a folder in front shifts all numbers and no result"
    assert members(out) == [(0, "a"), (1, "b"), (2, "c"), (3, "d")]
    assert talk.said[0].startswith("2 members to compute (2 are done)")
    change(runs / "d")
    shutil.move(runs / "a", tmp_path / "a")
    talk = Told()
    assert compute(talk=talk) == ["d"]
    assert talk.said[0] == (
        "runs since the last time: 1 changed and computed again, 1 gone and counted no more (their results stay in members-gone.jsonl)"
    )
    assert members(out) == [(0, "b"), (1, "c"), (2, "d")]
    assert api.study(fleet, out, limit=0, report=False).data["planned"] == 3
    shutil.move(tmp_path / "a", runs / "a")
    talk = Told()
    assert compute(talk=talk) == [], "as it was before it went"
    assert talk.said == ["runs since the last time: 1 back as they were"]
    assert members(out) == [(0, "a"), (1, "b"), (2, "c"), (3, "d")]
    assert (out / "members-gone.jsonl").read_text(encoding="utf-8") == ""
    api.study(fleet, tmp_path / "fresh", workers=1, report=False)
    for name in ("members.jsonl", "summary.json"):
        assert (out / name).read_bytes() == (tmp_path / "fresh" / name).read_bytes()


def test_a_fleet_that_changes_while_a_study_is_stopped(compute: Compute, tmp_path: Path) -> None:
    make(tmp_path, "c")
    assert compute(limit=2) == ["b", "c"]
    shutil.rmtree(tmp_path / "runs" / "b")
    make(tmp_path, "a")
    assert compute(limit=1) == ["a"]
    assert members(tmp_path / "out") == [(0, "a"), (1, "c")]
    assert compute() == ["d"]


def test_no_result_is_lost_when_it_is_killed_after_a_run_came_back(compute: Compute, tmp_path: Path) -> None:
    compute()
    shutil.move(tmp_path / "runs" / "b", tmp_path / "b")
    assert compute() == []
    shutil.move(tmp_path / "b", tmp_path / "runs" / "b")
    make(tmp_path, "c")

    class Killed(Silence):
        def phase(self, index: int, count: int, title: str) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compute(talk=Killed())
    assert compute() == ["c"]


def test_what_another_program_found_of_a_run_that_comes_back_is_not_taken(compute: Compute, tmp_path: Path) -> None:
    compute()
    shutil.move(tmp_path / "runs" / "b", tmp_path / "b")
    compute()
    gone = tmp_path / "out" / "members-gone.jsonl"
    line = json.loads(gone.read_text(encoding="utf-8"))
    gone.write_text(json.dumps({**line, "program": "another"}) + "\n", encoding="utf-8")
    shutil.move(tmp_path / "b", tmp_path / "runs" / "b")
    assert compute() == ["b"]


def test_a_folder_of_another_kind_of_study_is_left_alone(
    compute: Compute, fleet: Path, written: Callable[..., Path], tmp_path: Path
) -> None:
    compute()
    before = (tmp_path / "out" / "members.jsonl").read_bytes()
    fleet.write_text("{each: diagnose, base: {runs: [runs/*]}}", encoding="utf-8")
    with pytest.raises(UsageError, match="member 0 is no run that diagnose was done with"):
        compute()
    with pytest.raises(UsageError, match="results of another study: member 0 had run"):
        api.study(written(), tmp_path / "out", workers=1)
    assert (tmp_path / "out" / "members.jsonl").read_bytes() == before
    api.study(written(members=1), tmp_path / "axes", workers=1, report=False)
    with pytest.raises(UsageError, match="results of another study"):
        api.study(fleet, tmp_path / "axes", workers=1)


@pytest.mark.examination
def test_a_fleet_that_grew_is_the_same_on_a_cluster(fleet: Path, tmp_path: Path) -> None:
    """Of runs without records, each of which is refused in words."""
    from distributed import LocalCluster

    api.study(fleet, tmp_path / "out", workers=2, report=False)
    make(tmp_path, "a", "c", "e")
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as cluster:
        api.study(fleet, tmp_path / "out", scheduler=cluster.scheduler_address, report=False)
    api.study(fleet, tmp_path / "fresh", workers=2, report=False)
    for name in ("members.jsonl", "summary.json"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "fresh" / name).read_bytes()
