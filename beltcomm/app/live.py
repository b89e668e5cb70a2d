"""The live tab: a session in this folder, seen through the files that it writes.  It looks only."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm import journal
from beltcomm.axis import Axis
from beltcomm.errors import BeltcommError
from beltcomm.locks import NAME as LOCK
from beltcomm.outside import opened
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.rundata import analyse
from beltcomm.rundata.store import PLAN
from beltcomm.runfolder import RunFolder

#: Bytes at the end of a record that is being made that are looked at, and points of it that are drawn; bytes of one line at most.
TAIL, DRAWN, LONGEST_LINE = 400_000, 400, 4096
#: Looks without anything new after which nobody is at work there: a killed session leaves its lock.
STILL = 150
#: Lines of the journal that are shown.
LINES = 12


class LiveTab:
    """Tab of what happens in a run folder now."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._responses: dict[str, dict[str, Any]] = {}
        self._seen, self._still = (0, 0), STILL

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {"state": lambda _: self.state()}

    def running(self) -> bool:
        """True if a session is in the folder: its lock stands there, and what it writes has grown since one of the last looks."""
        part, told = self._part(), self._run / journal.TEXT
        seen = tuple(file.stat().st_size if file is not None and file.is_file() else 0 for file in (part, told))
        self._still = 0 if seen != self._seen else self._still + 1
        self._seen = (seen[0], seen[1])
        return (self._run / LOCK).exists() and self._still < STILL

    def state(self) -> dict[str, Any]:
        """Position of the carriage, load of the motor against its limits, steps done and to come."""
        folder = RunFolder.open(self._run)
        axis = folder.axis if folder.has_axis else None
        part = self._part()
        done = [path.stem for path in sorted(folder.recordings_folder.glob("*.csv"), key=lambda path: path.stat().st_mtime_ns)]
        plan = self._plan(folder)
        return {
            "running": self.running(),
            "lines": [line for line in journal.lines_of(self._run) if "wrote " not in line][-LINES:],
            "done": done,
            "experiments": [{"title": str(one.get("title")), "seconds": float(one.get("seconds") or 0.0)} for one in plan],
            "record": self._record(part, axis) if part is not None else None,
            "limits": _limits(axis),
            "responses": self._seen_responses(folder, done),
        }

    def _part(self) -> Path | None:
        """The record that is being made: the one written last."""
        parts = [path for path in (self._run / "recordings").glob("*.csv.part") if ".unfinished" not in path.name]
        return max(parts, key=lambda path: path.stat().st_mtime_ns) if parts else None

    def _plan(self, folder: RunFolder) -> list[Mapping[str, Any]]:
        try:
            found = (folder.load_result(PLAN) or {}).get("experiments") or []
        except BeltcommError:
            return []
        return [one for one in found if isinstance(one, Mapping)]

    def _record(self, part: Path, axis: Axis | None) -> dict[str, Any] | None:
        """The end of a record that grows; None where it cannot be read yet."""
        try:
            with opened(part) as stream:
                head = stream.readline(LONGEST_LINE).decode("ascii", "replace").strip().split(",")
                stream.seek(max(len(",".join(head)) + 1, part.stat().st_size - TAIL))
                rows = stream.read(TAIL).decode("ascii", "replace").split("\n")
            rows = [row for row in rows[1:-1] if row.count(",") == len(head) - 1]
            values = np.array([[float(cell) for cell in row.split(",")] for row in rows[:: max(len(rows) // DRAWN, 1)]])
            sidecar = load_sidecar(part.with_name(part.name.removesuffix(".csv.part") + ".yaml"))[0]
        except (OSError, ValueError, BeltcommError):
            return None
        if values.ndim != 2 or len(values) < 2:
            return None
        column = dict(zip(head, values.T, strict=True))
        ratio = axis.transmission_m_rad if axis is not None and axis.get("pulley.effective_radius_m") is not None else None
        angle, time = column.get("position_rad"), column.get("t_s")
        if angle is None or time is None:
            return None
        place = None if ratio is None else ratio * angle
        speed = np.gradient(angle, time) * (ratio or 1.0) if len(time) > 2 else np.zeros(len(time))
        return {
            "name": part.name.removesuffix(".csv.part"),
            "experiment": sidecar.experiment,
            "t_s": _short(time),
            "position": _short(place if place is not None else angle),
            "unit": "m" if ratio is not None else "rad",
            "torque": _short(column.get("torque_nm", np.zeros(len(time)))),
            "speed": _short(speed),
            "ratio": ratio,
        }

    def _seen_responses(self, folder: RunFolder, done: list[str]) -> list[dict[str, Any]]:
        """Frequency responses of the records made so far, each estimated once."""
        for name in done:
            if name in self._responses or not name.startswith(("frf", "amplitude")):
                continue
            try:
                response = analyse.responses([folder.recording(name)]).get(name)
            except BeltcommError:
                response = None
            found = {} if response is None else {"freq_hz": _short(response.freq_hz), "db": _short(20.0 * np.log10(np.abs(response.h)))}
            self._responses[name] = {"name": name, **found}
        return [one for one in self._responses.values() if "db" in one]


def _limits(axis: Axis | None) -> dict[str, float | None]:
    """Of the axis: travel m, speed m/s, torque N m."""
    if axis is None:
        return {}
    values = {
        "low_m": axis.travel.min_m,
        "high_m": axis.travel.max_m,
        "speed_m_s": axis.limits.speed_m_s,
        "torque_nm": axis.motor.peak_torque_nm,
        "force_n": axis.limits.feed_force_n,
    }
    return {name: None if value is None or not math.isfinite(value) else float(value) for name, value in values.items()}


def _short(values: np.ndarray) -> list[float | None]:
    return [float(f"{x:.5g}") if math.isfinite(x) else None for x in values.tolist()]
