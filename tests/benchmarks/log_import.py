"""A whole identification and what candump would have logged of it: are the imported recordings the tool's own, and is the model the same?

    python tests/benchmarks/log_import.py FOLDER [commission]

Prints, per recording, the largest difference of each column to the tool's own, then the parameters of both fits side by side, and
runs compare and diagnose on the imported run.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm import api
from beltcomm.drive import Drive, open_drive
from beltcomm.model import load_model
from beltcomm.recording.sidecar import Sidecar
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.bus import Frame
from foreign.buslog import candump

RAD = 2.0 * np.pi / 65536


def main(folder: Path, verb: str) -> None:
    frames: list[Frame] = []

    def opened(name: str, options: Any = None) -> Drive:
        return open_drive(name, {**(options or {}), "log": frames.append})

    api.open_drive = opened  # type: ignore[attr-defined]
    own, imported = folder / "own", folder / "imported"
    getattr(api, verb)("virtual:g_a", "egc-70-600", own, options=api.Options(yes=True, seed=1))
    log = candump(frames, folder / "bus.log")
    print(f"{len(frames)} frames")
    api.import_recordings([log], imported, api.Reading(), axis="egc-70-600", sidecar=Sidecar(start_position_m=0.25))
    found = RunFolder.open(imported).recordings()
    for record in RunFolder.open(own).recordings():
        columns, rows = record.columns(), len(record.position)
        for other in found:
            theirs = other.columns()
            at = [
                k for k in range(len(other.position) - rows + 1) if np.abs(other.position[k : k + rows] - record.position).max() < RAD / 2
            ]
            for k in at:
                worst = {n: float(np.abs(theirs[n][k : k + rows] - c).max()) for n, c in columns.items() if n != "t_s"}
                print(record.name, "is", other.name, "from row", k, {name: f"{value:.2g}" for name, value in worst.items()})
    for run in (own, imported):
        api.fit(run)
    models = [load_model(RunFolder.open(run).file("models", "final")) for run in (own, imported)]
    for name, parameter in models[0].parameters.items():
        print(f"{name:40} {parameter.value:12.6g} {models[1].parameters[name].value:12.6g}")
    for result in (api.compare(imported, pictures=False), api.diagnose(imported)):
        print("\n".join(result.lines()))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "identify")
