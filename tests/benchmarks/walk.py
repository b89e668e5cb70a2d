"""The walk of a recording through the package: ``python tests/benchmarks/walk.py [RUN]``, without a run a new one of the virtual drive.

Follows ``commission --quick`` and ``diagnose`` and notes each call that is given a recording.  Files: whose functions are given one.
Returns: how often the walk comes back to a package that it had left.  A reader who follows a value through the source goes this way.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.experiments.options import Options
from beltcomm.recording import Recording

#: Values of an argument that are looked at: a recording, or the first of a row of them.
ROW = (list, tuple)


def carries(value: Any) -> bool:
    return isinstance(value, Recording) or (isinstance(value, ROW) and bool(value) and isinstance(value[0], Recording))


class Walk:
    """Files in the order in which they are given a recording."""

    def __init__(self) -> None:
        self.files: list[str] = []

    def __call__(self, frame: FrameType, event: str, _arg: Any) -> None:
        code = frame.f_code
        if event != "call" or code.co_argcount == 0 or "beltcomm" not in code.co_filename or code.co_name.startswith("<"):
            return
        if any(carries(frame.f_locals.get(name)) for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]):
            file = code.co_filename.rpartition("/beltcomm")[2].lstrip("_")
            if not self.files or self.files[-1] != file:
                self.files.append(file)

    def told(self) -> str:
        packages = [file.strip("/").split("/")[0] for file in self.files]
        steps = [package for i, package in enumerate(packages) if i == 0 or packages[i - 1] != package]
        returns = sum(package in steps[:i] for i, package in enumerate(steps))
        return f"{len(set(self.files))} files in {len(set(packages))} packages, {len(steps)} steps, {returns} returns to an earlier package"


def walk(name: str, work: Any) -> None:
    followed = Walk()
    sys.setprofile(followed)
    try:
        work()
    finally:
        sys.setprofile(None)
    print(f"{name}: {followed.told()}")
    if "-v" in sys.argv:
        print("  " + ", ".join(sorted(set(followed.files))))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        run = next((Path(word) for word in sys.argv[1:] if not word.startswith("-")), None)
        if run is None:
            run = Path(folder) / "run"
            walk(
                "commission", lambda: api.commission("virtual", load_axis("egc-70-600"), run, options=Options(yes=True, quick=True, seed=1))
            )
        walk("diagnose", lambda: api.diagnose(run))


if __name__ == "__main__":
    main()
