"""The live tab: a session in this folder, seen through the files that it writes.  It looks only."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm import journal
from beltcomm.app.view import shown
from beltcomm.arrays import decibels
from beltcomm.axis import Axis
from beltcomm.drive import COLUMNS
from beltcomm.errors import BeltcommError
from beltcomm.locks import NAME as LOCK
from beltcomm.machine.load import Load
from beltcomm.outside import opened
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.response import FrequencyResponse, estimate_response
from beltcomm.rundata import analyse
from beltcomm.rundata.store import PLAN
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Gauge

#: Bytes at the end of a record that is being made that are looked at, and points of it that are drawn; bytes of one line at most.
TAIL, DRAWN, LONGEST_LINE = 400_000, 400, 4096
#: Bytes of a growing record whose response is estimated.
WHOLE = 4_000_000
#: Rows whose load is shown, and what of a row makes it, in the order in which a drive gives it.
NEWEST, LOADS = 200, COLUMNS[:5]
#: Looks without anything new after which nobody is at work there: a killed session leaves its lock.
STILL = 150
#: Lines of the journal that are shown, and the one in it that begins a phase.
LINES = 12
PHASE = re.compile(r"\bphase (?P<number>\d+) of (?P<count>\d+): (?P<title>.+)\Z")


class LiveTab:
    """Tab of what happens in a run folder now."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._responses: dict[str, dict[str, Any]] = {}
        self._grown: dict[str, Any] = {}
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
        (plan, seconds), lines = self._plan(folder), journal.lines_of(self._run)
        phases = [found for line in lines if (found := PHASE.search(line))]
        return {
            "running": self.running(),
            "phase": phases[-1].groupdict() if phases else None,
            "lines": [line for line in lines if "wrote " not in line and not PHASE.search(line)][-LINES:],
            "done": done,
            "planned_s": seconds,
            "experiments": [{"title": one["title"], "seconds": one["seconds"]} for one in plan],
            "record": self._record(part, axis, folder.load_result("drive") or {}) if part is not None else None,
            "travel_mm": None if axis is None or axis.travel.min_m is None else [1e3 * axis.travel.min_m, 1e3 * (axis.travel.max_m or 0.0)],
            "responses": [*self._seen_responses(folder, done), *([self._growing(part)] if part is not None else [])],
        }

    def _part(self) -> Path | None:
        """The record that is being made: the one written last."""
        parts = [path for path in (self._run / "recordings").glob("*.csv.part") if ".unfinished" not in path.name]
        return max(parts, key=lambda path: path.stat().st_mtime_ns) if parts else None

    def _plan(self, folder: RunFolder) -> tuple[list[Mapping[str, Any]], float]:
        """Experiments of the plan that was agreed to, and the s that it takes at most; nothing where there is none that can be read."""
        try:
            found = folder.load_result(PLAN) or {}
        except BeltcommError:
            found = {}
        return found.get("experiments") or [], found.get("seconds") or 0.0

    def _record(self, part: Path, axis: Axis | None, drive: Mapping[str, Any]) -> dict[str, Any] | None:
        """The end of a record that grows; None where it cannot be read yet."""
        try:
            with opened(part) as stream:
                head = stream.readline(LONGEST_LINE).decode("ascii", "replace").strip().split(",")
                stream.seek(max(len(",".join(head)) + 1, part.stat().st_size - TAIL))
                rows = stream.read(TAIL).decode("ascii", "replace").split("\n")
            whole = [row for row in rows[1:-1] if row.count(",") == len(head) - 1]
            newest = _numbers(whole[-NEWEST:])
            values = np.array(_numbers(whole[:: max(len(whole) // DRAWN, 1)]))
            sidecar = load_sidecar(part.with_name(part.name.removesuffix(".csv.part") + ".yaml"))[0]
            gauges = _gauges(axis, drive, head, newest) if axis is not None else ()
        except (OSError, ValueError, BeltcommError):
            return None
        if values.ndim != 2 or len(values) < 2:
            return None
        column = dict(zip(head, values.T, strict=True))
        ratio = axis.transmission_m_rad if axis is not None and axis.get("pulley.effective_radius_m") is not None else None
        angle, time = column.get("position_rad"), column.get("t_s")
        if angle is None or time is None:
            return None
        return {
            "name": part.name.removesuffix(".csv.part"),
            "experiment": sidecar.experiment,
            "t_s": shown(time),
            "position": shown(1e3 * ratio * angle if ratio is not None else angle),
            "unit": "mm" if ratio is not None else "rad",
            "torque": shown(column.get("torque_nm", np.zeros(len(time)))),
            "gauges": {one.name: {"value": abs(one.value), "limit": one.limit, "unit": one.unit} for one in gauges},
        }

    def _growing(self, part: Path) -> dict[str, Any]:
        """Response of the record that is made, by its periods so far; only its name before the second is whole."""
        name = part.name.removesuffix(".csv.part")
        try:
            note = load_sidecar(part.with_name(f"{name}.yaml"))[0].excitation
            if note is None or not note.period_samples or note.period_starts or part.stat().st_size > WHOLE:
                return {"name": name}
            with opened(part) as stream:
                head, *rows = stream.read(WHOLE).decode("ascii", "replace").split("\n")
            periods = (len(rows) - 1 - note.first_sample) // note.period_samples
            if periods < 2:
                return {"name": name}
            if self._grown.get("periods") != periods or self._grown.get("name") != name:
                values = np.array(_numbers(rows[: note.first_sample + periods * note.period_samples]))
                columns = dict(zip(head.strip().split(","), values.T, strict=True))
                t_s, torque = columns["t_s"], columns["torque_nm"]
                period_s = float(np.median(np.diff(t_s)))
                made = estimate_response(torque, columns["position_rad"], period_s, note.period_samples, note.first_sample, t_s=t_s)
                self._grown = {"name": name, "periods": periods, **_decibels(made)}
        except (OSError, ValueError, KeyError, BeltcommError):
            return {"name": name}
        return self._grown

    def _seen_responses(self, folder: RunFolder, done: list[str]) -> list[dict[str, Any]]:
        """Frequency responses of the records made so far, each estimated once."""
        for name in done:
            if name in self._responses or not name.startswith(("frf", "amplitude")):
                continue
            try:
                response = analyse.responses([folder.recording(name)]).get(name)
            except BeltcommError:
                response = None
            self._responses[name] = {"name": name, **({} if response is None else _decibels(response))}
        return [one for one in self._responses.values() if "db" in one]


def _decibels(response: FrequencyResponse) -> dict[str, Any]:
    return {"freq_hz": shown(response.freq_hz), "db": shown(decibels(response.h))}


def _gauges(axis: Axis, drive: Mapping[str, Any], head: Sequence[str], rows: Sequence[Sequence[float]]) -> tuple[Gauge, ...]:
    """The load of the newest rows against the limits of axis and drive, as the terminal shows it."""
    peak, fastest = (float(drive.get(name) or math.inf) for name in ("peak_torque_nm", "max_speed_rad_s"))
    torque = min(axis.motor.peak_torque_nm or math.inf, peak)
    load = Load(axis, torque, min(axis.limits.speed_m_s or math.inf, fastest * axis.transmission_m_rad))
    order = [head.index(name) if name in head else -1 for name in LOADS]
    for row in rows:
        load.see(tuple(row[k] if k >= 0 else math.nan for k in order))
    return load.gauges()


def _numbers(rows: Sequence[str]) -> list[list[float]]:
    return [[float(cell) if cell else math.nan for cell in row.split(",")] for row in rows]
