"""The design tab: the run's design with sliders; what is saved there is a design that ``verify`` and ``apply`` take."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from beltcomm.app.view import stamp_of
from beltcomm.arrays import decibels
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.knobs import OutOfReach
from beltcomm.design.margins import margins
from beltcomm.design.measured import measured_loop
from beltcomm.drive.parameters import parameters_to_cascade
from beltcomm.errors import DataError, UsageError
from beltcomm.given import number, pasted
from beltcomm.jobs.design import Basis, basis_of, delivered
from beltcomm.locks import at_work, occupied
from beltcomm.quantities import unit_of
from beltcomm.result import Result, plain
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.conditions import condition_of
from beltcomm.rundata.delays import assume_delay, delay
from beltcomm.rundata.design_proof import plant_responses
from beltcomm.rundata.proof import move_of, same_gains, verified
from beltcomm.rundata.store import cascade_from_dict, saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.sending import Sending
from beltcomm.talk import Silence
from beltcomm.trajectory import Trajectory, plan_trajectory, with_dwell
from beltcomm.tuning.bench import DISTURBANCE_NM, Bench, CascadeView, OpenLoops, Responses, TrackingPrediction
from beltcomm.tuning.changes import TuningChange, changes, error_changes, sentence
from beltcomm.tuning.ground import MOST_PAYLOAD_KG, RANGES, DesignInput, SliderSetting, setting_from
from beltcomm.tuning.presets import KINDS, PACES, preset
from beltcomm.verify import REST_S, Loop

#: T_R to choose from beside the present one, s.
VELOCITY_FILTERS_S = (0.001, 0.002, 0.004, 0.008, 0.016)
#: Units of a belt axis in which the page asks; another kind is asked in its own.
INPUT_UNITS = ("kg", "mm", "m/s", "m/s²", "m/s³")
#: Samples of a move that is predicted at most.
LONGEST_MOVE = 60_000


class DesignTab:
    """The design of a run on the page, made when the tab is first looked at, and anew where the run's model or design has changed.

    Parameters
    ----------
    payload_kg, move, seed
        See :class:`TunedDesign`.
    """

    def __init__(self, run: Path, *, payload_kg: float = 0.0, move: Path | None = None, seed: int = 0) -> None:
        self._run, self._make = run, partial(TunedDesign, run, payload_kg=payload_kg, move=move, seed=seed)
        self._made: tuple[str, TunedDesign] | None = None
        self._making = threading.Lock()
        self.saved: list[Result] = []

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks.   All but ``begin`` raise UsageError before it."""
        names = ("begin", "update", "track", "reach", "preset", "move", "save")
        return {name: lambda asked, name=name: self.present(begins=name == "begin").answers()[name](asked) for name in names} | {
            "stamp": lambda _: {"stale": self._made is not None and self._made[0] != self._stamp()}
        }

    def present(self, *, begins: bool = False) -> TunedDesign:
        """The design that the page shows; a page that ``begins`` has the model as it is now."""
        with self._making:
            stamp = self._stamp()
            if self._made is None or (begins and self._made[0] != stamp):
                made = self._make()
                made.saved = self.saved
                self._made = (stamp, made)
            return self._made[1]

    def _stamp(self) -> str:
        """Changes with the model; what is saved on the page itself changes nothing that it rests on."""
        return stamp_of(self._run)


class TunedDesign:
    """One run on the page: answers to what the page asks, and the designs it saved.

    Parameters
    ----------
    move : Path or None
        File with the user's own, None for the standard one.
    seed : int
        Of the draws of a proof.
    """

    def __init__(self, run: Path, *, payload_kg: float = 0.0, move: Path | None = None, seed: int = 0) -> None:
        self._basis = basis_of(run, Silence())
        self._saved_design = saved_design(self._basis.folder)
        self._seed = seed
        self.bench = Bench(ground_of(self._basis, self._saved_design, move))
        self._start = self.bench.start(payload_kg, self._basis.folder.axis.travel.middle_m)
        self._move_words = _move_words(self.bench.ground.move, move)
        late_s = self.bench.ground.loop.delay_s
        self._responses = {name: (response, delay_s) for name, response, delay_s in plant_responses(self._basis.recordings, late_s)}
        self.saved: list[Result] = []
        self._saving = threading.Lock()  # the page is answered by several threads

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {
            "begin": lambda _: self.begin(),
            "update": self._with_setting(self.update),
            "track": self._with_setting(self._track),
            "reach": self._with_setting(lambda setting: plain(self.bench.reach(setting))),
            "preset": self._preset,
            "move": self.move,
            "save": self._with_setting(self.save),
        }

    def move(self, asked: Any) -> dict[str, Any]:
        """Another move, by its ends, m, and limits: from now on its error is predicted.

        Parameters
        ----------
        asked : Any
            Of the page: ends, m, and limits.

        Returns
        -------
        dict of str to Any
            ``move``: the move in words.

        Raises
        ------
        UsageError
            For a move that cannot be.
        """
        moved = move_between(asked, self.bench.ground)
        self.bench.drive(moved)
        self._move_words = _move_words(moved, None)
        return {"move": self._move_words}

    def begin(self) -> dict[str, Any]:
        """State that the page needs once: positions of the controls, their ranges and choices."""
        ground, start, targets = self.bench.ground, self._start, self._basis.folder.axis.targets
        filters = {one.kind for one in self.bench.prefilters(start.payload_kg).values()}
        return {
            "run": str(self._basis.folder.path),
            "axis": self._basis.folder.axis.name,
            "setting": plain(start),
            "ranges": plain(RANGES),
            "ends_m": list(ground.ends_m),
            "most_payload_kg": MOST_PAYLOAD_KG,
            "mounted_kg": ground.model["cart.mass"],
            "prefilters": {
                key: {"kind": one.kind, "hz": _hz(one.omega_rad_s), "roll_off_hz": _hz(one.roll_off_rad_s)}
                for key, one in self.bench.prefilters(start.payload_kg).items()
            },
            "velocity_filters_s": list(ground.velocity_filters_s),
            "kinds": plain([kind for kind in KINDS if kind.prefilter in filters]),
            "paces": plain(PACES),
            "disturbance_nm": DISTURBANCE_NM,
            "targets": {"dynamic_mm": 1e3 * targets.following_m, "static_mm": 1e3 * targets.settled_m, "places": list(targets.places)},
            "move": self._move_words,
            "editor": _editor(ground.move),
            "units": {one: plain(self._basis.folder.terms.shown(one)) for one in INPUT_UNITS},
            "compensated": list(self._saved_design.get("compensated") or ()),
        }

    def update(self, setting: SliderSetting) -> dict[str, Any]:
        """Gains, margins and curves of a setting beside the present design; ``refusal`` where it has none."""
        try:
            design, new, present = self.bench.shown(setting)
        except OutOfReach as problem:
            return {"refusal": str(problem), "limit": problem.limit, "present": _curves(self.bench.present(setting))}
        same = new.cascade == present.cascade  # what bound it stands in its file, by the margins that were asked for there
        found = self._in_own_units(changes((present.cascade, present.worst), (new.cascade, new.worst)))
        return {
            "new": _curves(new),
            "present": _curves(present),
            "measured": self.measured(setting, new.cascade),
            "binding": list(self._saved_design.get("binding") or () if same else design.binding),
            "variants": len(design.plants),
            "changes": [{**plain(one), "same": one.same} for one in found],
            "sentence": sentence(found),
        }

    def measured(self, setting: SliderSetting, cascade: Cascade) -> dict[str, Any] | None:
        """The open loops on the measured response nearest to the place that is looked at.

        Returns
        -------
        dict of str to Any or None
            Open loops, dB and degrees over Hz, with the record's name; None without a record at standstill.
        """
        ratio = self.bench.ground.model["transmission.ratio"]
        standing = [r for r in self._basis.recordings if r.name in self._responses and not r.sidecar.moving]
        if not standing:
            return None
        near = min(standing, key=lambda r: (round(abs((condition_of(r, ratio).place_m or 0.0) - setting.position_m), 2), -np.ptp(r.torque)))
        response, delay_s = self._responses[near.name]
        try:
            loop = measured_loop(response, cascade, self.bench.ground.structure.period_s, delay_s)
        except DataError:
            return None
        found: dict[str, Any] = {"record": near.name, "place_m": condition_of(near, ratio).place_m, "freq_hz": _digits(loop.freq_hz)}
        for name, values in (("velocity", loop.velocity), ("position", loop.position)):
            found[f"{name}_db"] = _digits(decibels(values))
            found[f"{name}_deg"] = _digits(np.degrees(np.angle(-values)) - 180.0)
        return found

    def _track(self, setting: SliderSetting) -> dict[str, Any]:
        """The predicted tracking error of the move; ``refusal`` where the setting has no design."""
        present = self.bench.present_tracked(setting.shown_kg)
        try:
            new = self.bench.tracked(self.bench.design(setting).cascade, setting.shown_kg)
        except OutOfReach as problem:
            return {"refusal": str(problem), "present": _drawn(present)}
        found = self._in_own_units(error_changes(present.error, new.error))
        return {
            "new": _drawn(new),
            "present": _drawn(present),
            "changes": [{**plain(one), "same": one.same} for one in found],
            "sentence": "" if all(one.same for one in found) else sentence(found),
        }

    def _in_own_units(self, found: Sequence[TuningChange]) -> list[TuningChange]:
        """Numbers in the units of the kind of axis."""
        units = [self._basis.folder.terms.shown(one.unit) for one in found]
        return [
            replace(one, unit=unit.symbol, present=unit.factor * one.present, new=unit.factor * one.new)
            for one, unit in zip(found, units, strict=True)
        ]

    def save(self, setting: SliderSetting) -> dict[str, Any]:
        """The design of a setting, with its whole proof, as the run's design; the one before stays as ``designs/replaced_N.yaml``.

        Returns
        -------
        dict of str to Any
            Lines for the page, and ``failed`` where the proof fails.
        """
        folder, ground = self._basis.folder, self.bench.ground
        RunFolder.open(folder.path)  # it may have gone since, and is not made anew
        found = self.bench.design(setting)
        loads = [0.0, setting.payload_kg] if setting.payload_kg else [0.0]
        plants = tuple(ground.plants(ground.ends_m, loads))
        proven = replace(found, plants=plants, margins=margins(found.cascade, plants, ground.structure.period_s))
        findings = replace(self._basis.findings, remarks=list(self._basis.findings.remarks))
        findings.design, findings.cascade = proven, ground.with_feedforward(found.cascade)
        with self._saving, occupied(folder.path, Silence(), refusal=lambda holder: at_work(folder.path, holder)):
            result = delivered(
                replace(self._basis, findings=findings),
                self._saved_design.get("compensated") or (),
                setting.payload_kg or None,
                seed=self._seed,
                noted={"tuned": plain(setting)},
            )
        self.saved.append(result)
        return {
            "lines": list(result.text),
            "failed": bool(result.exit_code),
            "doubts": list(result.data["proof"]["doubts"]),
            "replaced": result.data["replaced"],
            "next": [
                f"beltcomm verify --drive DRIVE --run {pasted(folder.path)}",
                f"beltcomm apply --drive DRIVE --run {pasted(folder.path)}",
            ],
        }

    def _preset(self, data: Any) -> dict[str, Any]:
        if not isinstance(data, dict) or set(data) != {"setting", "kind", "pace"}:
            raise UsageError("a preset is asked for by setting, kind and pace")
        if data["kind"] not in [one.key for one in KINDS] or data["pace"] not in [one.key for one in PACES]:
            raise UsageError(f"there is no preset {data['kind']!r}, {data['pace']!r}")
        found: dict[str, Any] = plain(preset(self.bench, setting_from(data["setting"], self.bench.ground), data["kind"], data["pace"]))
        return found

    def _with_setting(self, answer: Callable[[SliderSetting], dict[str, Any]]) -> Callable[[Any], dict[str, Any]]:
        return lambda data: answer(setting_from(data, self.bench.ground))


def ground_of(basis: Basis, saved: Mapping[str, Any], move: Path | None = None) -> DesignInput:
    """Basis of the tuning of one run.

    Parameters
    ----------
    basis : Basis
        Trusted model of the run, its drive and delay.
    saved : dict of str to Any
        Its present design.
    move : Path or None
        File with the user's own.
    """
    folder, model, structure = basis.folder, basis.model, basis.structure
    assume_delay(basis.findings, structure)
    late_s, apparent = delay(basis.findings), analyse.apparent_damping(basis.findings.thesis)
    present, mounted, travel = cascade_from_dict(saved), model["cart.mass"], folder.axis.travel
    drive = folder.load_result("drive") or {}
    peak = float(drive.get("peak_torque_nm") or folder.axis.motor.peak_torque_nm or math.inf)
    return DesignInput(
        model,
        structure,
        lambda places, loads: analyse.design_plants(model, places, [mounted + load for load in loads], late_s, apparent),
        lambda cascade: replace(cascade, feedforward=present.feedforward, filter_reference=present.filter_reference),
        travel.ends_m,
        with_dwell(move_of(folder, structure.period_s, move), REST_S),
        Loop(structure, late_s, peak, offline.counts_of(folder)),
        present,
        tuple(sorted({*(lag for lag in VELOCITY_FILTERS_S if _in_drive(lag, structure)), present.velocity_filter_s})),
        folder.axis.targets,
        *_driven(folder, saved, structure),
    )


def _driven(folder: RunFolder, saved: Mapping[str, Any], structure: CascadeStructure) -> tuple[Cascade | None, Sending, float]:
    """The present design as the move that verified it last drove it, what was sent along, and the session's clock at its start."""
    result = verified(folder)
    driven = result.get("driven")
    if driven and same_gains((result.get("proof") or {}).get("gains"), saved.get("parameters")) and driven["sending"] in get_args(Sending):
        return parameters_to_cascade(driven["gains"]), driven["sending"], float(driven["time_s"])
    return None, "rigid" if saved.get("compensated") and structure.torque_feedforward else "nothing", 0.0


def move_between(asked: Any, ground: DesignInput) -> Trajectory:
    """A jerk-limited move with its rest, by what the page asks for.

    Parameters
    ----------
    asked : Any
        ``start_m``, ``end_m``, ``speed_m_s``, ``acceleration_m_s2``, ``jerk_m_s3``, and no others.
    ground : DesignInput
        Ends of the travel and the sampling period of the drive.

    Returns
    -------
    Trajectory (n,)
        Of the carriage.

    Raises
    ------
    UsageError
        For other entries, a way outside the travel or shorter than 0.1 mm, a limit that is not above zero, or more samples than the page
        plays.
    """
    names = ("start_m", "end_m", "speed_m_s", "acceleration_m_s2", "jerk_m_s3")
    if not isinstance(asked, dict) or set(asked) != set(names):
        raise UsageError(f"a move is {', '.join(names)}; give these and no others")
    start, end, speed, acceleration, jerk = (number(asked[name], name, unit_of(name)) for name in names)
    low, high = ground.ends_m
    if not (low <= min(start, end) and max(start, end) <= high and abs(end - start) > 1e-4):
        raise UsageError(f"the move goes from {1e3 * start:g} to {1e3 * end:g} mm; it must lie within {1e3 * low:g} and {1e3 * high:g} mm")
    if not min(speed, acceleration, jerk) > 0.0:
        raise UsageError("speed, acceleration and jerk must be above zero")
    limits = TrajectoryLimits(speed_m_s=speed, acceleration_m_s2=acceleration, jerk_m_s3=jerk)
    moved = with_dwell(plan_trajectory(start, end, limits, ground.structure.period_s), REST_S)
    if len(moved.position_m) > LONGEST_MOVE:
        raise UsageError("this move takes more than a minute; choose a faster or a shorter one")
    return moved


def _hz(omega_rad_s: float) -> float:
    return omega_rad_s / (2.0 * math.pi)


def _in_drive(lag: float, structure: CascadeStructure) -> bool:
    low, high = structure.lowest.get("velocity_filter_s", 0.0), structure.highest.get("velocity_filter_s", math.inf)
    return bool(low <= lag <= high)


def _move_words(move: Trajectory, file: Path | None) -> str:
    start, end = 1e3 * move.position_m[0], 1e3 * move.position_m[-1]
    named, top = f" of {file.name}" if file is not None else "", abs(move.velocity_m_s).max()
    return f"move{named} from {start:.0f} to {end:.0f} mm in {move.duration_s - REST_S:.2f} s, up to {top:.2f} m/s"


def _editor(move: Trajectory) -> dict[str, float]:
    """The present move as the page's fields have it: mm, and what it reaches."""
    acceleration = abs(move.acceleration_m_s2)
    jerk = abs(np.diff(move.acceleration_m_s2)) / np.diff(move.t_s)
    return {
        "start_m": 1e3 * float(move.position_m[0]),
        "end_m": 1e3 * float(move.position_m[-1]),
        "speed_m_s": float(abs(move.velocity_m_s).max()),
        "acceleration_m_s2": float(acceleration.max()),
        "jerk_m_s3": float(jerk.max()),
    }


def _curves(shown: CascadeView) -> dict[str, Any]:
    return {"worst": plain(shown.worst), "open_loops": _drawn(shown.open_loops), "responses": _drawn(shown.responses)}


def _drawn(curves: OpenLoops | Responses | TrackingPrediction) -> dict[str, Any]:
    """As :func:`plain`, arrays to the four digits that a picture shows: they are most of what the page waits for."""
    values = {field.name: getattr(curves, field.name) for field in fields(curves)}
    return {name: _digits(value) if isinstance(value, np.ndarray) else plain(value) for name, value in values.items()}


def _digits(values: np.ndarray) -> list[float]:
    return [float(f"{x:.4g}") for x in values.tolist()]
