"""The laboratory tab: records, residual, what explains a segment, what is added and taken out; a worker does what takes long."""

from __future__ import annotations

import base64
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm import isolation
from beltcomm.app.view import ResidualView, shown, stamp_of
from beltcomm.app.worker import work
from beltcomm.arrays import Array, BoolArray, decibels
from beltcomm.axis.terms import Terms
from beltcomm.effects import EFFECTS, effect_named
from beltcomm.errors import UsageError
from beltcomm.given import pasted
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.quantities import read_in
from beltcomm.residuals.candidates import CandidateEffect
from beltcomm.residuals.cells import COORDINATES
from beltcomm.residuals.responses import below, compared
from beltcomm.residuals.spectra import filtered, power
from beltcomm.rundata.headline import EXPLAINED
from beltcomm.rundata.revisions import as_mapping, revisions
from beltcomm.runfolder import RunFolder

#: Candidates told of a segment, and share of its squares above the noise below which one is not.
TOLD, LEAST_SHARE = 6, 0.01
#: Sums in bands that are kept.
MOST_BANDS = 400


class LaboratoryTab:
    """One run seen by its laboratory.

    Parameters
    ----------
    when : callable
        Date and time for a revision, from whoever knows a clock.
    moving : callable
        Whether a session is in the run: nothing is computed beside one, which may need this computer in time. Ends with :meth:`close`.
    """

    def __init__(self, run: Path, when: Callable[[], str] = str, moving: Callable[[], bool] = bool) -> None:
        self._run, self._when, self._moving = run, when, moving
        self._lock = threading.Lock()
        self._view: ResidualView | None = None
        self._before: ResidualView | None = None
        self._candidates: dict[str, CandidateEffect] = {}
        self._evidence: Mapping[str, Any] | None = None
        self._version, self._pending, self._gives_way = 0, 0, False
        self._progress: tuple[str, float | None] = ("", None)
        self._failed, self._searched, self._asked_for = "", False, ""
        self._change: Mapping[str, Any] | None = None
        self._rungs = 0
        self._static: dict[str, dict[str, Any]] = {}
        self._banded: dict[tuple[str, int, tuple[float, float]], float] = {}
        self._above: tuple[str, Array] | None = None
        self._pipe: Connection | None = None
        self._process: BaseProcess | None = None
        self._closed = False

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {
            "state": lambda _: self.state(),
            "residual": lambda _: self.residual(),
            "candidates": lambda _: self.candidates(),
            "segment": self.segment,
            "record": self.record,
            "add": lambda asked: self._start("add", asked),
            "remove": lambda asked: self._start("remove", asked),
            "evidence": lambda asked: self._start("evidence", asked),
            "ladder": lambda _: self.ladder(),
        }

    @property
    def sheets(self) -> Sequence[Mapping[str, Any]]:
        """Data-sheet values that the model contradicts, as soon as it was compared with its records."""
        return () if self._view is None else self._view.sheets

    def state(self) -> dict[str, Any]:
        """Running work, and news since the page's last look; a run that was changed by others is read anew."""
        stamp = stamp_of(self._run)
        with self._lock:
            stale = stamp != (self._view.stamp if self._view is not None else self._asked_for)
            waiting = stale and not self._pending and stamp != self._asked_for
            if waiting and not (moving := self._moving()):
                self._asked_for = stamp
                self._send("look", {})
            words, share = self._progress
            return {
                "version": self._version,
                "candidates": len(self._candidates),
                "searched": self._searched,
                "busy": words if self._pending else SESSION if waiting and moving else "",
                "share": share,
                "failed": self._failed,
                "rungs": self._rungs,
                "evidence": self._evidence,
            }

    def residual(self) -> dict[str, Any]:
        """Records, cells and spectrum of the present model."""
        view, terms = self._shown(), RunFolder.open(self._run).terms
        cells, small = view.cells, terms.shown(view.units.small)
        columns = {name: _packed(getattr(cells, name)) for name in (*COORDINATES, "more", "square", "count", "record")}
        return {
            "version": self._version,
            "effects": [{"name": name, "title": effect_named(name).title, "removable": name in view.removable} for name in view.effects],
            "parameters": _in_own_units(view.parameters, terms),
            **{name: getattr(view, name) for name in ("ratio", "missing", "held_out", "plain", "records")},
            "state": dict(zip(("word", "sentence", "style"), view.state, strict=True)),
            "explained": EXPLAINED,
            "evidence": EVIDENCE,
            "places": list(view.places),
            "landmarks": dict(view.landmarks),
            "units": {
                "force": view.units.force,
                "length": view.units.length,
                "small": small.symbol,
                "factor": view.units.factor * small.factor,
            },
            "names": list(cells.names),
            "responses": [one.record for one in view.responses],
            "cells": columns,
            "edges": shown(view.edges),
            "spectrum": shown(np.sqrt(view.spectrum)),
            "change": self._change,
            "before": None if self._before is None else {"ratio": self._before.ratio, "records": self._before.records},
        }

    def candidates(self) -> dict[str, Any]:
        """Candidates for the rest over all records, best first, each with its law."""
        view = self._shown()
        chosen = np.ones(len(view.cells.count), dtype=np.bool_)
        told = sorted(self._known(), key=lambda one: -one.evidence)
        return {"searched": self._searched, "candidates": [self._told(one, view, chosen, None) for one in told if one.evidence > EVIDENCE]}

    def segment(self, asked: Any) -> dict[str, Any]:
        """Samples in a range of one coordinate, and candidates for their rest.

        Parameters
        ----------
        asked : Any
            Of the page: the coordinate, its ends, and a record or none.

        Raises
        ------
        UsageError
            For what is no range.
        """
        view = self._shown()
        along, low, high, record = _checked(asked, view)
        cells = view.cells
        band: tuple[float, float] | None = None
        if along == "frequency":
            band = (low, high)
            part = filtered(view.rows, view.white, low, high) ** 2
            level = cells.sums(part) / cells.count
            share = (high - low) / float(view.edges[-1])
            chosen = level > 2.0 * max(share, 1e-6)
        else:
            values = getattr(cells, along)
            chosen = (values >= low) & (values <= high)
        if record:
            chosen = chosen & (cells.record == cells.names.index(record))
        samples = chosen[cells.of]
        count = float(cells.count[chosen].sum())
        squares = float((cells.square * cells.count)[chosen].sum())
        noise = count
        if band is not None:  # what lies in the band, of every sample: those marked hold other frequencies, too
            within = cells.record == cells.names.index(record) if record else np.ones(len(chosen), dtype=np.bool_)
            inside = power(view.rows, view.white, np.array([0.0, low, high, math.inf]), within[cells.of])[1]
            noise = share * float(cells.count[within].sum())
            squares = float(np.nan_to_num(inside)) * noise
        whole = float(((cells.square - 1.0) * cells.count).sum())
        by_record = np.bincount(cells.record[chosen], ((cells.square - 1.0) * cells.count)[chosen], minlength=len(cells.names))
        told = sorted((self._told(one, view, chosen, band) for one in self._known()), key=lambda one: -one["share"])
        return {
            "along": along,
            "low": low,
            "high": high,
            "samples": count,
            "ratio": math.sqrt(squares / noise) if count and noise > 0.0 else None,
            "share": (squares - noise) / max(whole, 1.0),
            "force": math.sqrt(float((cells.more**2 * cells.count)[chosen].sum()) / count) if count and band is None else None,
            "mean": []
            if band is not None
            else [_mean(cells.more[side], cells.count[side]) for side in (chosen & (cells.speed > 0.0), chosen & (cells.speed < 0.0))],
            "records": {name: float(by_record[i]) for i, name in enumerate(cells.names) if by_record[i] > 0.0},
            "chosen": base64.b64encode(np.packbits(chosen).tobytes()).decode(),
            "spectrum": shown(np.sqrt(power(view.rows, view.white, view.edges, samples))),
            "candidates": [one for one in told if one["share"] > LEAST_SHARE][:TOLD],
            "searched": self._searched,
        }

    def record(self, asked: Any) -> dict[str, Any]:
        """Torque over time and frequency response of a record, measured and by the model.

        Parameters
        ----------
        asked : Any
            Of the page: the name of a record.

        Raises
        ------
        UsageError
            For none that is here.
        """
        view = self._shown()
        name = _record_of(asked, view)
        trace = next(one for one in view.traces if one.record == name)
        measured, model = compared(trace)
        pair = next((one for one in view.responses if one.record == name), None)
        return {
            "record": name,
            "excited": trace.excited,
            "t_s": _packed(trace.t_s),
            "measured": _packed(measured),
            "model": _packed(model),
            "response": None
            if pair is None
            else {
                "freq_hz": shown(pair.freq_hz),
                "of": "position, dB re 1 m/N" if view.units.force == "N" else f"angle, dB re 1 rad/({view.units.force})",
                "db": [shown(decibels(one)) for one in (pair.measured, pair.model)],
                "deg": [shown(below(one)) for one in (pair.measured, pair.model)],
                "noise_db": None if pair.radius is None else shown(20.0 * np.log10(np.maximum(pair.radius, 1e-12))),
            },
        }

    def ladder(self) -> dict[str, Any]:
        """The staircase of all models."""
        return {"revisions": [as_mapping(rung) for rung in revisions(RunFolder.open(self._run))]}

    def close(self) -> None:
        """The worker ends; what it writes is whole or not there."""
        self._closed = True
        if self._process is not None:
            self._process.terminate()
            self._process.join()

    def _told(self, one: CandidateEffect, view: ResidualView, chosen: BoolArray, band: tuple[float, float] | None) -> dict[str, Any]:
        """A candidate, and the share of the squares above the noise in some cells that it would explain."""
        if one.effect not in self._static:
            self._static[one.effect] = _static(one, view)
        excess = float(self._excess(view)[chosen].sum())
        fall = max((trial.fall(chosen) for trial in one.trials), default=0.0)
        if band is not None and len(one.left):
            was, left = (self._in_band(view, values, band) for values in (view.white[: view.fitted], one.left))
            share_of_noise = (band[1] - band[0]) / float(view.edges[-1])
            fall, excess = was - left, was - share_of_noise * view.fitted
        least = math.sqrt(2.0 * max(float(chosen.sum()), 1.0))
        return {**self._static[one.effect], "share": max(0.0, min(fall / max(excess, least), 1.0))}

    def _in_band(self, view: ResidualView, values: NDArray[Any], band: tuple[float, float]) -> float:
        """Sum of squares in a band; worked out once for the same values."""
        key = (view.stamp, values.ctypes.data, band)
        if key not in self._banded:
            if len(self._banded) > MOST_BANDS:
                self._banded.clear()
            self._banded[key] = float(np.sum(filtered(view.rows, values.astype(np.float64), *band) ** 2))
        return self._banded[key]

    def _excess(self, view: ResidualView) -> Array:
        """Squares of the fitted records above the noise, by cell; worked out once for a view."""
        if self._above is None or self._above[0] != view.stamp:
            fitted = view.white[: view.fitted]
            self._above = (view.stamp, view.cells.sums(fitted**2) - view.cells.sums(np.ones(view.fitted)))
        return self._above[1]

    def _shown(self) -> ResidualView:
        view = self._view
        if view is None:
            raise UsageError(self._failed or "the records are still being read")
        return view

    def _known(self) -> list[CandidateEffect]:
        with self._lock:
            return list(self._candidates.values())

    def _start(self, job: str, asked: Any) -> dict[str, Any]:
        """A job for the worker.   Raises UsageError for one that there is not, or while another one changes the run."""
        effect = asked.get("effect") if isinstance(asked, dict) else None
        if job != "evidence" and effect not in [one.name for one in EFFECTS]:
            raise UsageError(f"there is no effect {effect!r}; `beltcomm effects` lists them")
        if self._moving():
            raise UsageError(SESSION)
        with self._lock:
            if self._pending and not self._gives_way:
                raise UsageError(f"wait for what is running: {self._progress[0]}")
            self._send(job, {"effect": effect, "when": self._when()})
            return {"started": f"beltcomm {job} {effect} {pasted(self._run)}"}

    def _send(self, job: str, given: Mapping[str, Any]) -> None:
        """Under the lock."""
        if self._pipe is None:
            self._process, self._pipe = isolation.beside(work, self._run)
            threading.Thread(target=self._hear, args=(self._pipe,), daemon=True).start()
        self._failed, self._gives_way, self._progress = "", False, (WORDS[job], None)
        self._pending += 1
        self._pipe.send((job, given))

    def _hear(self, pipe: Connection) -> None:
        while True:
            try:
                said = pipe.recv()
            except (EOFError, OSError):
                with self._lock:
                    if not self._closed:
                        self._failed = "the process that fits has ended (out of memory?); reload the page to start another"
                        self._pipe, self._pending, self._asked_for = None, 0, ""
                return
            with self._lock:
                HEARD[said[0]](self, *said[1:])

    def _heard_progress(self, words: str, share: float | None) -> None:
        self._progress = (words, share)

    def _heard_view(self, view: ResidualView) -> None:
        if self._change is not None and self._change.get("fresh"):
            self._before, self._change = self._view, {**self._change, "fresh": False}
        elif self._view is not None and self._view.stamp != view.stamp:
            self._before = self._change = None
        self._view, self._candidates, self._static, self._searched = view, {}, {}, False
        self._version += 1
        self._gives_way = self._pending == 1  # what follows is a search, which ends when something else is asked for

    def _heard_candidate(self, one: CandidateEffect) -> None:
        self._candidates[one.effect] = one

    def _heard_searched(self) -> None:
        self._searched = True

    def _heard_done(self, data: Mapping[str, Any]) -> None:
        if data["job"] == "evidence":
            self._evidence = data
        elif data["job"] in ("add", "remove"):
            self._change, self._evidence = {**data, "fresh": True}, None
        self._rungs += 1

    def _heard_failed(self, sentence: str) -> None:
        self._failed = sentence

    def _heard_free(self) -> None:
        self._pending -= 1


SESSION = "a session is at work in this run; it is read when that is over"
WORDS = {
    "look": "reading the records",
    "add": "adding an effect, everything is fitted again",
    "remove": "taking an effect out, everything is fitted again",
    "evidence": "refitting the best effects with everything free",
}
HEARD: Mapping[str, Callable[..., None]] = {
    "progress": LaboratoryTab._heard_progress,
    "view": LaboratoryTab._heard_view,
    "candidate": LaboratoryTab._heard_candidate,
    "searched": LaboratoryTab._heard_searched,
    "done": LaboratoryTab._heard_done,
    "failed": LaboratoryTab._heard_failed,
    "free": LaboratoryTab._heard_free,
}


def _static(one: CandidateEffect, view: ResidualView) -> dict[str, Any]:
    """Part of a candidate that does not depend on what is chosen."""
    cells, effect, after = view.cells, effect_named(one.effect), {}
    if len(one.left):
        squares, count = cells.sums(one.left.astype(np.float64) ** 2), cells.sums(np.ones(view.fitted))
        by_record = [np.bincount(cells.record, values, minlength=len(cells.names)) for values in (squares, count)]
        after = {name: math.sqrt(float(s / n)) for name, s, n in zip(cells.names, *by_record, strict=True) if n > 0.0}
    law = None
    if one.law is not None and one.law.along != "frequency":
        law = {name: shown(value) if isinstance(value, np.ndarray) else value for name, value in vars(one.law).items()}
    return {
        "effect": one.effect,
        "title": one.title,
        "seen": effect.seen,
        "check": effect.check,
        "evidence": one.evidence,
        "likely": one.evidence > EVIDENCE,
        "values": {name: [factor * value, unit] for name, value in one.values.items() for factor, unit in [_read_in(one.effect, name)]},
        "after": after,
        "ratio": math.sqrt(float(np.mean(one.left.astype(np.float64) ** 2))) if len(one.left) else None,
        "law": law,
        "along": one.law.along if one.law is not None else "",
    }


def _in_own_units(parameters: Mapping[str, Any], terms: Terms) -> dict[str, Any]:
    """Parameters as ``compare --json`` has them, in the units of the axis: on the page a value stands apart from its unit."""
    found = {}
    for name, one in parameters.items():
        factor, symbol = read_in(one["unit"], _bound(*name.split(".", 1)))
        unit, interval = terms.shown(symbol), one["interval"]
        factor *= unit.factor
        values = {"value": factor * one["value"], "interval": None if interval is None else factor * interval}
        found[name] = {**one, **values, "unit": unit.symbol}
    return found


def _bound(part: str, name: str) -> float:
    """Highest possible value of a parameter of an effect; 0 of any other part of a model."""
    return next((p.high for effect in EFFECTS if effect.name == part for p in effect.parameters if p.name == name), 0.0)


def _read_in(effect: str, name: str) -> tuple[float, str]:
    """Factor and unit of a value of an effect."""
    own = {p.name: p for p in effect_named(effect).parameters}
    own |= {f"{b.name}.{b.inertia.name}": b.inertia for b in effect_named(effect).bodies}
    return read_in(own[name].unit, own[name].high) if name in own else (1.0, "")


def _mean(values: Array, count: Array) -> float | None:
    return float((values * count).sum() / count.sum()) if count.sum() else None


def _packed(values: NDArray[Any]) -> str:
    """Numbers of 32 bits in base64, which a page reads without parsing."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def _checked(asked: Any, view: ResidualView) -> tuple[str, float, float, str]:
    """Raises UsageError."""
    if not isinstance(asked, dict) or not {"along", "low", "high"} <= set(asked) <= {"along", "low", "high", "record"}:
        raise UsageError("a segment is asked for by along, low, high and, if it is of one record, record")
    along, low, high = asked["along"], asked["low"], asked["high"]
    if along not in (*COORDINATES, "frequency"):
        raise UsageError(f"along is {along!r}; it is one of {', '.join((*COORDINATES, 'frequency'))}")
    if any(isinstance(x, bool) or not isinstance(x, (int, float)) or not math.isfinite(x) for x in (low, high)) or low > high:
        raise UsageError(f"low {low!r} and high {high!r} must be numbers, the first not above the second")
    return along, float(low), float(high), _record_of(asked, view) if asked.get("record") else ""


def _record_of(asked: Any, view: ResidualView) -> str:
    """Raises UsageError."""
    record = asked.get("record") if isinstance(asked, dict) else None
    if record not in view.cells.names:
        raise UsageError(f"there is no record {record!r}; there are {', '.join(view.cells.names)}")
    return str(record)
