"""The runs tab: the runs of one axis side by side, and how each quantity went from run to run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError
from beltcomm.pages.gather import results_of
from beltcomm.pages.quantities import quantities_of
from beltcomm.rundata.revisions import current_model, current_revision
from beltcomm.runfolder import RunFolder

#: Runs that are shown at most, the newest.
MOST = 24


class RunsTab:
    """The runs beside one, of the same axis."""

    def __init__(self, run: Path) -> None:
        self._run = run

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {"list": lambda _: self.list()}

    def list(self) -> dict[str, Any]:
        """Every run with its quantities, oldest first; what cannot be read is said."""
        own = RunFolder.open(self._run)
        name = own.axis.name if own.has_axis else ""
        found, left_out = [], []
        for path in sorted(self._run.resolve().parent.iterdir()):
            if not (path / "recordings").is_dir():
                continue
            try:
                if path.resolve() != self._run.resolve() and load_axis(path / "axis.yaml").name != name:
                    continue
                found.append(_row(path, path.resolve() == self._run.resolve()))
            except BeltcommError as problem:
                left_out.append(f"{path.name}: {problem}")
        found.sort(key=lambda row: (row["began_s"], row["name"]))
        return {"axis": name, "runs": found[-MOST:], "left_out": left_out}


def _row(path: Path, own: bool) -> dict[str, Any]:
    folder = RunFolder.open(path)
    results, model = results_of(folder), current_model(folder)
    rung = current_revision(folder) if model is not None else None
    moves = [result for name, result in results.items() if name.startswith("verify_")]
    fit = results.get("fit") or {}
    about = path / "run.yaml"
    began = folder.began_s
    return {
        "name": path.name,
        "own": own,
        "began_s": began if began is not None else about.stat().st_mtime if about.is_file() else 0.0,
        "dated": began is not None,
        "drive": folder.drive.get("serial_number") or folder.drive.get("device_name") or "",
        "effects": list(model.effects) if model is not None else [],
        "ratio": rung.ratio if rung is not None else _ratio(fit.get("misfit")),
        "passed": bool(moves[-1]["passed"]) if moves else None,
        "quantities": {
            key: {
                "words": one.words,
                "unit": one.unit,
                "value": one.scale * one.value,
                "interval": None if one.interval is None else one.scale * one.interval,
            }
            for key, one in quantities_of(model, results).items()
        },
    }


def _ratio(misfit: object) -> float | None:
    """Error over noise from the mean square that a fit keeps."""
    return math.sqrt(misfit) if isinstance(misfit, (int, float)) and misfit >= 0.0 else None
