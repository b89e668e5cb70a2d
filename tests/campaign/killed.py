"""A real SIGKILL at a random instant, in a process of its own: what is left in the run folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from beltcomm.errors import BeltcommError
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence

WORDS = ("identify", "--drive", "virtual", "--yes", "--realtime", "--run")


def killed_folder(seed: int, place: Path) -> list[str]:
    """Kill an identification up to 12 s after its first record began; returns what is wrong with its folder."""
    run, draw = place / f"killed-{seed}", np.random.default_rng(seed)
    command = [sys.executable, "-c", "from beltcomm.cli.main import main; main()", *WORDS, str(run)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=place) as process:
        give_up = time.monotonic() + 120.0
        while not any((run / "recordings").glob("*.csv.part")):
            if process.poll() is not None or time.monotonic() > give_up:
                return ["it ended before it could be killed"]
            time.sleep(0.02)
        time.sleep(float(draw.uniform(0.0, 12.0)))
        os.kill(process.pid, signal.SIGKILL)
        process.wait(30.0)
    return damages(run)


def damages(run: Path) -> list[str]:
    """Each record is complete and can be read, or is marked as unfinished with whole rows but the last; backup and lock are right."""
    wrong = []
    try:
        folder = RunFolder.open(run)
        for name in folder.finished_names():
            folder.recording(name)
        if not {"drive", "parameters", "objects"} <= set(folder.load("results", "backup")):
            wrong.append("the backup is not whole")
        folder.occupy(Silence()).close()  # the lock went with the process
    except BeltcommError as error:
        return [str(error)]
    for part in folder.recordings_folder.glob("*.csv.part"):
        lines = part.read_text(encoding="utf-8").splitlines()
        if any(len(line.split(",")) != len(lines[0].split(",")) for line in lines[:-1]):
            wrong.append(f"{part.name} is torn inside")
        if "finished: false" not in part.with_name(part.name.replace(".csv.part", ".yaml")).read_text(encoding="utf-8"):
            wrong.append(f"{part.name} is not marked as unfinished")
    return wrong
