"""The runs tab: the runs of one axis side by side, their curves laid over each other, and how each quantity went from run to run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.app.view import base_effects, shown
from beltcomm.arrays import decibels
from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.pages.gather import results_of
from beltcomm.pages.quantities import quantities_of
from beltcomm.rundata import analyse
from beltcomm.rundata.headline import MEANINGS, headline_of
from beltcomm.rundata.revisions import current_model, current_revision
from beltcomm.runfolder import RunFolder

#: Runs that are shown at most, the newest; runs whose curves are laid over each other, and points of a curve over time.
MOST, OVERLAID, DRAWN = 24, 6, 600


class RunsTab:
    """The runs beside one, of the same axis."""

    def __init__(self, run: Path) -> None:
        self._run = run

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {"list": lambda _: self.list(), "curves": self.curves}

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

    def curves(self, asked: Any) -> dict[str, Any]:
        """Measured response and error of the last move of some runs, by name.

        Parameters
        ----------
        asked : Any
            ``names`` of runs beside this one, at most :data:`OVERLAID`.

        Raises
        ------
        UsageError
            For more, or none that is beside this one.
        """
        names = asked.get("names") if isinstance(asked, dict) else None
        if not isinstance(names, list) or len(names) > OVERLAID:
            raise UsageError(f"curves are asked for by the names of at most {OVERLAID} runs")
        return {"runs": [{"name": name, **_curves(RunFolder.open(beside(self._run, name)))} for name in names]}


def beside(run: Path, name: object) -> Path:
    """The folder of a name beside a run, the run itself among them.

    Parameters
    ----------
    run : Path
    name : object
        As the page gave it.

    Raises
    ------
    UsageError
        For what names no folder there.
    """
    own = run.resolve()
    if not isinstance(name, str) or name not in {one.name for one in own.parent.iterdir() if one.is_dir()}:
        raise UsageError(f"there is no run {name!r} beside {own.name}; the page lists those that there are under Runs")
    return own.parent / name


def _curves(folder: RunFolder) -> dict[str, Any]:
    """The strongest response of a run that stands still, and the error of its last move; None where there is none."""
    files = {path.stem for path in folder.recordings_folder.glob("*.csv")}
    standing = [one for one in map(folder.recording, sorted(name for name in files if name.startswith("frf"))) if not one.sidecar.moving]
    found = analyse.responses(sorted(standing, key=lambda one: -float(np.ptp(one.torque)))[:1])
    moved = [name.removeprefix("verify_") for name in results_of(folder) if name.startswith("verify_")]
    move = next((folder.recording(name) for name in reversed(moved) if name in files), None)
    curves: dict[str, Any] = {"response": None, "move": None}
    for name, response in found.items():
        curves["response"] = {"record": name, "freq_hz": shown(response.freq_hz), "db": shown(decibels(response.h))}
    if move is not None and move.reference_position is not None and folder.has_axis:
        step = max(len(move.t_s) // DRAWN, 1)
        error_mm = 1e3 * folder.axis.transmission_m_rad * (move.reference_position - move.position)
        curves["move"] = {"record": move.name, "t_s": shown(move.t_s[::step]), "error_mm": shown(error_mm[::step])}
    return curves


def _row(path: Path, own: bool) -> dict[str, Any]:
    folder = RunFolder.open(path)
    results, model = results_of(folder), current_model(folder)
    rung = current_revision(folder) if model is not None else None
    fit = results.get("fit") or {}
    about = path / "run.yaml"
    began = folder.began_s
    return {
        "name": path.name,
        "own": own,
        "began_s": began if began is not None else about.stat().st_mtime if about.is_file() else 0.0,
        "dated": began is not None,
        "drive": _drive(folder.drive),
        "added": [name for name in model.effects if name not in base_effects(folder)] if model is not None else [],
        "ratio": rung.ratio if rung is not None else _ratio(fit.get("misfit")),
        "result": _result(folder),
        "quantities": {
            key: {
                "words": one.words,
                "unit": one.unit,
                "value": one.scale * one.value,
                "interval": None if one.interval is None else one.scale * one.interval,
            }
            for key, one in quantities_of(model, results, folder.terms).items()
        },
    }


def _result(folder: RunFolder) -> dict[str, str]:
    """Word of the headline, and what it means."""
    try:
        found = headline_of(folder)
    except BeltcommError:  # one damaged result hides no run
        return {"word": "", "means": ""}
    return {"word": found.word, "means": MEANINGS[found.state]}


def _drive(known: Mapping[str, Any]) -> str:
    """A drive in a few words."""
    if str(known.get("hardware", "")).startswith("virtual"):
        return "virtual"
    serial = known.get("serial_number")
    return f"no. {serial}" if serial else str(known.get("device_name") or "")


def _ratio(misfit: float | None) -> float | None:
    """Error over noise from the mean square that a fit keeps."""
    return math.sqrt(misfit) if misfit is not None and misfit >= 0.0 else None
