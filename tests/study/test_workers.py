"""The same results bit for bit, whoever computes them and whoever is killed on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.caches import source_hash
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.study.members import line_of
from beltcomm.study.workers import _unfit, answers
from beltcomm.talk import Silence
from study.conftest import MEMBERS, MORE_THREADS
from study.dying import dying, dying_once

RESULTS = ("members.jsonl", "summary.json")


def same(one: Path, other: Path) -> bool:
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in RESULTS)


class Told(Silence):
    """Remembers what is said; kills a worker as soon as there are results, where there is one to kill."""

    def __init__(self, victims: Callable[[], list[int]] | None = None) -> None:
        self.victims, self.killed, self.said, self.shares = victims, 0, list[str](), list[float]()

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        self.shares.append(fraction)
        if self.victims is not None and not self.killed:
            self.killed = self.victims()[0]
            os.kill(self.killed, signal.SIGKILL)

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as made:
        yield made


def test_a_process_that_dies(tmp_path: Path) -> None:
    """It dies once; what it had in hand is computed by another."""
    talk = Told()
    found = answers(partial(dying_once, tmp_path / "died"), list(range(12)), workers=2, scheduler=None, talk=talk)
    assert sorted(found) == [k * k for k in range(12)]
    assert (tmp_path / "died").exists()
    assert any("a worker died" in text for text in talk.said)


def test_processes_that_die_every_time_are_given_up(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="workers died 3 times in a row"):
        list(answers(dying, [1, 2], workers=2, scheduler=None, talk=Told()))


@pytest.mark.examination
def test_a_dask_cluster_and_a_worker_that_dies(small: Path, alone: Path, cluster: Any, tmp_path: Path) -> None:
    talk = Told(lambda: [worker.pid for worker in cluster.workers.values()])
    api.study(small, tmp_path / "killed", scheduler=cluster.scheduler_address, report=False, talk=talk)
    assert talk.killed
    assert same(alone, tmp_path / "killed")


@pytest.mark.examination
def test_a_killed_study_goes_on_in_other_processes(small: Path, alone: Path, tmp_path: Path) -> None:
    members = tmp_path / "members.jsonl"
    words = [sys.executable, "-m", "beltcomm", "study", str(small), "--out", str(tmp_path), "--workers", "1", "--no-report"]
    with subprocess.Popen(words, env=os.environ | MORE_THREADS, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until = time.monotonic() + 60.0
        while not (members.is_file() and members.read_bytes().count(b"\n")) and process.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        process.kill()
    before = members.read_bytes().splitlines()
    assert 1 <= len(before) < MEMBERS
    with open(members, "ab") as file:
        file.write(b'{"member": 19, "key')  # what a write that was cut off leaves behind
    said = Told()
    api.study(small, tmp_path, workers=2, report=False, talk=said)
    assert f"{MEMBERS - len(before)} members to compute ({len(before)} are done)" in said.said[0]
    left = MEMBERS - len(before)
    assert said.shares[0] == pytest.approx(max(1, left // 8) / left), "the pace is that of what is still to come"
    assert said.shares[-1] == 1.0
    assert set(before) <= set(members.read_bytes().splitlines())
    assert same(alone, tmp_path)


def test_a_limit_and_more_members_change_no_result(written: Callable[..., Path], alone: Path, tmp_path: Path) -> None:
    first = api.study(written(members=6), tmp_path, workers=1, limit=2, report=False)
    assert (first.exit_code, first.data["done"], first.data["planned"]) == (1, 2, 6)
    with open(tmp_path / "members.jsonl", "ab") as file:
        file.write(b'{"member": 2, "key')  # as another process writes it just now
    members = (tmp_path / "members.jsonl").read_bytes()
    assert api.study(written(members=6), tmp_path, limit=0).data["done"] == 2
    assert (tmp_path / "members.jsonl").read_bytes() == members
    assert api.study(written(members=6), tmp_path / "new", limit=0).data["done"] == 0
    api.study(written(members=8), tmp_path, workers=1, report=False)
    lines = (tmp_path / "members.jsonl").read_bytes().splitlines()
    assert lines == (alone / "members.jsonl").read_bytes().splitlines()[:8]


def test_a_folder_of_another_study_is_left_alone(written: Callable[..., Path], small: Path, alone: Path) -> None:
    before = (alone / "members.jsonl").read_bytes()
    with pytest.raises(UsageError, match=r"member 0 had cart\.mass .* now it has"):
        api.study(written(seed=4), alone)
    with pytest.raises(UsageError, match="base, design, move or targets differ"):
        api.study(written(targets={"dynamic": "2 mm"}), alone)
    with pytest.raises(UsageError, match="this study has 10"):
        api.study(written(members=10), alone)
    assert (alone / "members.jsonl").read_bytes() == before


def test_results_of_another_program_are_read_and_not_gone_on_with(written: Callable[..., Path], alone: Path, tmp_path: Path) -> None:
    lines = [json.loads(text) for text in (alone / "members.jsonl").read_text(encoding="utf-8").splitlines()]
    text = "".join(json.dumps({**line, "program": "another"}) + "\n" for line in lines[:3])
    (tmp_path / "members.jsonl").write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="results of another beltcomm"):
        api.study(written(), tmp_path, workers=1)
    assert (tmp_path / "members.jsonl").read_text(encoding="utf-8") == text
    assert api.study(written(), tmp_path, limit=0).data["done"] == 3


def test_what_a_worker_with_another_program_found_is_not_kept(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It joined later, and nobody had looked at it yet."""

    def joined(function: Callable[[Any], Any], given: Any, **_: Any) -> Iterator[Any]:
        for k, one in enumerate(given):
            yield [{**line, "program": "another"} if k else line for line in function(one)]

    monkeypatch.setattr("beltcomm.study.job.answers", joined)
    with pytest.raises(Refused, match=r"a worker has another beltcomm .* What is done is kept"):
        api.study(small, tmp_path, workers=4)
    programs = {json.loads(text)["program"] for text in (tmp_path / "members.jsonl").read_text(encoding="utf-8").splitlines()}
    assert programs == {source_hash()}


def test_a_worker_of_several_threads_or_of_another_program_is_refused() -> None:
    here = source_hash()
    assert _unfit({"a": here, "b": here}, {"a": 1, "b": 1}, "tcp://x:1") == ""
    assert "the worker b has another beltcomm" in _unfit({"a": here, "b": "0.1.0"}, {"a": 1, "b": 1}, "tcp://x:1")
    said = _unfit({"a": here, "b": here}, {"a": 1, "b": 4}, "tcp://x:1")
    assert "the worker b computes in 4 threads; start it with `dask worker tcp://x:1 --nthreads 1`" in said


@pytest.mark.parametrize("error", [KeyError("no such body"), AssertionError("never"), RuntimeError("odd")])
def test_an_error_nobody_thought_of_is_the_result_of_its_member(error: Exception) -> None:
    class Work:
        def found(self, *_: Any) -> dict[str, Any]:
            raise error

    work: Any = Work()
    line = line_of(work, 3, "key", {})
    assert (line["member"], line["exit_code"]) == (3, 1)
    assert f"an unexpected {type(error).__name__}: {error}" in line["error"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), MemoryError()])
def test_what_is_the_computers_fault_is_no_result(error: Exception) -> None:
    class Work:
        def found(self, *_: Any) -> dict[str, Any]:
            raise error

    work: Any = Work()
    with pytest.raises(Refused, match=f"member 3 cannot be computed here .*{type(error).__name__}"):
        line_of(work, 3, "key", {})


def test_a_run_that_nobody_may_read_is_the_result_of_that_run() -> None:
    class Work:
        def found(self, *_: Any) -> dict[str, Any]:
            raise PermissionError(13, "Permission denied", "/fleet/a/recordings/frf_1.csv")

    work: Any = Work()
    line = line_of(work, 3, "key", {"run": "/fleet/a"})
    assert (line["exit_code"], line["error"]) == (
        3,
        "its files cannot be read: [Errno 13] Permission denied: '/fleet/a/recordings/frf_1.csv'",
    )
    with pytest.raises(Refused, match="member 3 cannot be computed here"):
        line_of(work, 3, "key", {"run": "/fleet/b"})


def test_a_damaged_line_is_named(small: Path, tmp_path: Path) -> None:
    (tmp_path / "members.jsonl").write_text('{"member": 0}\n', encoding="utf-8")
    with pytest.raises(DataError, match="damaged in line 1"):
        api.study(small, tmp_path)


def test_a_scheduler_that_is_none(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("beltcomm.study.workers.SCHEDULER_S", 0.2)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        api.study(small, tmp_path, scheduler="tcp://127.0.0.1:9")
    with pytest.raises(UsageError, match="choose one"):
        api.study(small, tmp_path, scheduler="tcp://127.0.0.1:9", workers=2)


def test_a_member_again_is_the_same(small: Path, alone: Path, tmp_path: Path) -> None:
    again = api.study_member(small, 7, out=tmp_path)
    line = json.loads((alone / "members.jsonl").read_text(encoding="utf-8").splitlines()[7])
    assert {key: again.data[key] for key in line} == line
    assert (tmp_path / "plant.yaml").is_file()
    with pytest.raises(UsageError, match="members 0 to 19"):
        api.study_member(small, MEMBERS)
