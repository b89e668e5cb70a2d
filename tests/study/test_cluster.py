"""A Dask cluster whose workers go, and come back."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from beltcomm.errors import Refused
from beltcomm.study import workers as study_workers
from beltcomm.study.workers import answers
from beltcomm.talk import Silence
from study.dying import waiting

Start = Callable[..., "subprocess.Popen[bytes]"]


class Told(Silence):
    """Remembers what is said; ``heard`` once it was of a cluster without workers."""

    def __init__(self) -> None:
        self.said, self.heard = list[str](), threading.Event()

    def say(self, *lines: str) -> None:
        self.said.extend(lines)
        if any("no worker any more" in line for line in lines):
            self.heard.set()


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, processes=True, dashboard_address=":0", silence_logs=50) as made:
        yield made.scheduler_address


@pytest.fixture
def start(scheduler: str) -> Iterator[Start]:
    """Starts a worker as a user does; none is left at the end."""
    started = []

    def one(threads: int = 1) -> subprocess.Popen[bytes]:
        tests = str(Path(__file__).parents[1])
        words = [
            sys.executable, "-m", "distributed.cli.dask_worker", scheduler, "--nthreads", str(threads), "--no-nanny", "--no-dashboard",
            "--local-directory", "/tmp",
        ]  # fmt: skip
        code = f"import sys; sys.path.insert(0, {tests!r}); sys.argv = {words[2:]!r}; from distributed.cli.dask_worker import main; main()"
        started.append(subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return started[-1]

    yield one
    for process in started:
        process.kill()
        process.wait()


def begun(found: Iterator[int], worker: Any) -> list[int]:
    """The first answer, and then no worker."""
    first = [next(found)]
    worker.kill()
    worker.wait()
    return first


def test_a_cluster_that_loses_its_workers_says_so_and_goes_on_with_new_ones(
    scheduler: str, start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_workers, "LOOK_S", 0.1)
    monkeypatch.setattr(study_workers, "SAID_S", 0.3)
    talk, mark = Told(), tmp_path / "go"
    given = [(str(mark), number) for number in range(4)]
    found = answers(waiting, given, workers=None, scheduler=scheduler, talk=talk, alone_s=30.0)
    first = begun(found, start())

    def come_back() -> None:
        assert talk.heard.wait(20.0)
        mark.touch()
        start()

    back = threading.Thread(target=come_back)
    back.start()
    assert sorted([*first, *found]) == [0, 1, 2, 3]
    back.join()
    assert [text.split(";")[0] for text in talk.said] == ["the cluster has no worker any more", "the cluster has workers again"]
    assert f"`dask worker {scheduler} --nthreads 1`" in talk.said[0]


def test_a_cluster_without_workers_is_given_up_and_what_is_done_is_kept(scheduler: str, start: Start, tmp_path: Path) -> None:
    talk = Told()
    given = [(str(tmp_path / "never"), number) for number in range(4)]
    found = answers(waiting, given, workers=None, scheduler=scheduler, talk=talk, alone_s=1.0)
    assert begun(found, start()) == [0]
    with pytest.raises(Refused, match=r"has had no worker for 1 s; what is done is kept\. Start some .* and the same command goes on"):
        list(found)
    assert talk.heard.is_set()


def test_an_answer_that_went_with_its_worker_is_waited_for_no_longer_than_others(scheduler: str, start: Start, tmp_path: Path) -> None:
    """Told as done and not fetched yet: whoever asks for it waits for a worker too."""
    mark = tmp_path / "go"
    mark.touch()
    found = answers(waiting, [(str(mark), number) for number in range(2)], workers=None, scheduler=scheduler, talk=Told(), alone_s=1.0)
    worker = start()
    first = next(found)
    until = time.monotonic() + 5.0
    while not os.path.exists(f"{mark}.1") and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(0.2)  # until the scheduler has heard of it
    worker.kill()
    worker.wait()
    assert first == 0
    with pytest.raises(Refused, match="has had no worker for 1 s"):
        list(found)


def test_a_scheduler_that_goes_away_is_told(tmp_path: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as cluster:
        given = [(str(tmp_path / "never"), number) for number in range(3)]
        found = answers(waiting, given, workers=None, scheduler=cluster.scheduler_address, talk=Told(), alone_s=20.0)
        assert next(found) == 0
    with pytest.raises(Refused, match=r"went away .* what is done is kept, the same command goes on"):
        list(found)


def test_a_worker_that_comes_later_must_fit_too(scheduler: str, start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_workers, "LOOK_S", 0.1)
    given = [(str(tmp_path / "never"), number) for number in range(4)]
    found = answers(waiting, given, workers=None, scheduler=scheduler, talk=Told(), alone_s=30.0)
    assert begun(found, start()) == [0]
    start(threads=2)
    with pytest.raises(Refused, match=r"computes in 2 threads; start it with .* What is done is kept"):
        list(found)
