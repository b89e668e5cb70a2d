"""Jobs whose process is killed before each of its steps on files in turn, and which are then done again.

python -m places.dying JOB FOLDER     (in tests; prints one JSON object)
"""

from __future__ import annotations

import builtins
import io
import json
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError
from beltcomm.foreign.convert import Reading
from beltcomm.locks import changes_run
from beltcomm.model import build_model
from beltcomm.recording import Sidecar, recording_from_columns
from beltcomm.rundata.revisions import current_revision, new_revision, revisions
from beltcomm.runfolder import RunFolder

#: Calls that change files; opening counts where it is for writing.
CALLS = ("replace", "mkdir", "unlink", "rmdir")


def columns(seed: int) -> dict[str, Any]:
    draw, t_s = np.random.default_rng(seed), 1e-3 * np.arange(400)
    torque = 0.4 * np.sin(2 * np.pi * (3 + seed) * t_s) + draw.normal(0.0, 1e-3, t_s.size)
    return {"t_s": t_s, "torque_nm": torque, "position_rad": np.cumsum(np.cumsum(torque)) * 5e-4}


def logs(folder: Path) -> None:
    """Two foreign files."""
    for seed in (1, 2):
        rows = np.column_stack(list(columns(seed).values()))
        np.savetxt(folder / f"log_{seed}.csv", rows, delimiter=",", header=",".join(columns(0)), comments="")


def importing(folder: Path) -> None:
    """Both into a new run."""
    api.import_recordings([folder / "log_1.csv", folder / "log_2.csv"], folder / "run", Reading(), axis="egc-70-600")


def fitted(folder: Path) -> None:
    """A run with a record and a model."""
    made = RunFolder.create(folder / "run", load_axis("egc-70-600"))
    made.add_recording(recording_from_columns("a", columns(1), Sidecar()))
    made.save("models", "final", build_model("m", (), {}).to_dict())


@changes_run()
def growing(run: Path) -> None:
    """One more revision of a model, as ``add`` writes it."""
    here, told = RunFolder.open(run), {"ratio": 1.5, "held_out": None, "confirmed": None, "command": "beltcomm add", "when": "today"}
    if current_revision(here) is None:
        new_revision(here, build_model("m", (), {}), "base", **told)  # type: ignore[arg-type]
    new_revision(here, build_model("m", ("belt_stiffness",), {}), "+belt_stiffness", **told)  # type: ignore[arg-type]


def grown(folder: Path) -> bool:
    """Each rung once, its file there, and the last one counts."""
    run = RunFolder.open(folder / "run")
    rungs, now = revisions(run), current_revision(run)
    changes = [rung.change for rung in rungs]
    return changes == ["base", "+belt_stiffness"] and now == rungs[-1] and {rung.name for rung in rungs} <= set(run.names("models"))


@dataclass(frozen=True)
class Job:
    """ready : makes what there is before.   does : the job.   done : whether it is complete."""

    ready: Callable[[Path], None]
    does: Callable[[Path], None]
    done: Callable[[Path], bool]

    def complete(self, folder: Path) -> bool:
        try:
            return self.done(folder)
        except BeltcommError:
            return False


JOBS = {
    "import": Job(logs, importing, lambda folder: len(RunFolder.open(folder / "run").recordings()) == 2),
    "add": Job(fitted, lambda folder: growing(folder / "run"), grown),
}


def in_a_process(job: Callable[[Path], None], folder: Path, dies_before: int = 0) -> int:
    """How it ended, negative for a signal.   dies_before : the step; 0 for none."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    steps = 0

    def counted(call: Callable[..., Any], counts: Callable[..., bool] = lambda *_, **__: True) -> Callable[..., Any]:
        def before(*given: Any, **more: Any) -> Any:
            nonlocal steps
            if counts(*given, **more):
                steps += 1
                if steps == dies_before:
                    os.kill(os.getpid(), signal.SIGKILL)
            return call(*given, **more)

        return before

    io.open = builtins.open = counted(open, lambda *given, **more: set(str([*given, more.get("mode", "r")][1])) & set("wax+") != set())
    for name in CALLS:
        setattr(os, name, counted(getattr(os, name)))
    os.fsync = counted(lambda _: None)  # a process that dies takes no disk along
    try:
        job(folder)
    except BaseException as error:
        sys.stderr.write(f"{error!r}\n")
        os._exit(99)
    os._exit(0)


def main() -> None:
    """Die before step 1, 2 and so on, until the job comes to its end; each time it is done again."""
    job, place, wrong = JOBS[sys.argv[1]], Path(sys.argv[2]), {}
    for step in range(1, 1000):
        folder = place / f"step-{step}"
        folder.mkdir()
        job.ready(folder)
        if in_a_process(job.does, folder, step) == 0:
            break
        if job.complete(folder):  # there was nothing left to do
            continue
        code, left = in_a_process(job.does, folder), [path.name for path in folder.rglob("*") if path.name.startswith(".")]
        if code or left or not job.complete(folder):
            wrong[step] = f"exit code {code}, left {left}"
    sys.stdout.write(json.dumps({"steps": step - 1, "wrong": wrong}))


if __name__ == "__main__":
    main()
