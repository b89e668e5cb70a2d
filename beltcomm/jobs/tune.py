"""``beltcomm tune``: the run's design on a page with sliders; what is saved there is a design that ``verify`` and ``apply`` take."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import CascadeStructure
from beltcomm.design.held_knobs import OutOfReach
from beltcomm.design.margins import margins
from beltcomm.errors import UsageError
from beltcomm.experiments import phases
from beltcomm.experiments.options import Options
from beltcomm.given import Place, pasted, place
from beltcomm.jobs.design import Basis, basis_of, delivered
from beltcomm.locks import at_work, occupied
from beltcomm.result import Result, plain
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.delays import assume_delay, delay
from beltcomm.rundata.store import cascade_from_dict, saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence, Talk
from beltcomm.trajectory import Trajectory, held, load_move, plan_trajectory
from beltcomm.tuning.bench import Bench, CascadeView, TrackingPrediction
from beltcomm.tuning.changes import changes, error_changes, sentence
from beltcomm.tuning.curves import DISTURBANCE_NM, OpenLoops, Responses
from beltcomm.tuning.ground import MOST_PAYLOAD_KG, RANGES, DesignInput, SliderSetting, setting_from
from beltcomm.tuning.presets import KINDS, PACES, preset
from beltcomm.verify import DYNAMIC_TARGET_M, MOVE_M, REST_S, STATIC_TARGET_M, Loop

#: T_R to choose from beside the present one, s.
VELOCITY_FILTERS_S = (0.001, 0.002, 0.004, 0.008, 0.016)
#: m/s and m/s² of a move for an axis that states no limits of its own.
GENTLE = (0.5, 2.0)


class Tuning:
    """One run on the page: answers to what the page asks, and the designs it saved.

    move : file with the user's own, None for the standard one.   seed : of the draws of a proof.
    """

    def __init__(self, run: Path, *, payload_kg: float = 0.0, move: Path | None = None, seed: int = 0, talk: Talk | None = None) -> None:
        with occupied(run, talk or Silence()):  # a model that is behind its records is fitted anew
            self._basis = basis_of(run, talk or Silence())
        self._saved_design = saved_design(self._basis.folder)
        self._seed = seed
        self.bench = Bench(ground_of(self._basis, self._saved_design, move))
        self._start = self.bench.start(payload_kg, offline.middle_m(self._basis.folder.axis))
        self._move_words = _move_words(self.bench.ground.move, move)
        self.saved: list[Result] = []
        self._saving = threading.Lock()  # the page is answered by several threads

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        return {
            "begin": lambda _: self.begin(),
            "update": self._with_setting(self.update),
            "track": self._with_setting(self.track),
            "reach": self._with_setting(lambda setting: plain(self.bench.reach(setting))),
            "preset": self._preset,
            "save": self._with_setting(self.save),
        }

    def begin(self) -> dict[str, Any]:
        """What the page needs once: where the controls stand, their ranges and choices."""
        ground, start = self.bench.ground, self._start
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
            "kinds": plain(KINDS),
            "paces": plain(PACES),
            "disturbance_nm": DISTURBANCE_NM,
            "targets": {"dynamic_mm": 1e3 * DYNAMIC_TARGET_M, "static_um": 1e6 * STATIC_TARGET_M},
            "move": self._move_words,
            "compensated": list(self._saved_design.get("compensated") or ()),
        }

    def update(self, setting: SliderSetting) -> dict[str, Any]:
        """Gains, margins and curves of a setting beside the present design; ``refusal`` where it has none."""
        try:
            design, new, present = self.bench.shown(setting)
        except OutOfReach as problem:
            return {"refusal": str(problem), "limit": problem.limit, "present": _curves(self.bench.present(setting))}
        found = changes((present.cascade, present.worst), (new.cascade, new.worst))
        return {
            "new": _curves(new),
            "present": _curves(present),
            "binding": list(design.binding),
            "variants": len(design.plants),
            "changes": [{**plain(one), "same": one.same} for one in found],
            "sentence": sentence(found),
        }

    def track(self, setting: SliderSetting) -> dict[str, Any]:
        """The predicted tracking error of the move; ``refusal`` where the setting has no design."""
        present = self.bench.present_tracked(setting.shown_kg)
        try:
            new = self.bench.tracked(self.bench.design(setting).cascade, setting.shown_kg)
        except OutOfReach as problem:
            return {"refusal": str(problem), "present": _drawn(present)}
        found = error_changes(present.error, new.error)
        return {
            "new": _drawn(new),
            "present": _drawn(present),
            "changes": [{**plain(one), "same": one.same} for one in found],
            "sentence": "" if all(one.same for one in found) else sentence(found),
        }

    def save(self, setting: SliderSetting) -> dict[str, Any]:
        """The design of a setting, with its whole proof, as the run's design; the one before stays as ``designs/replaced_N.yaml``."""
        folder, ground = self._basis.folder, self.bench.ground
        RunFolder.open(folder.path)  # it may have gone since, and is not made anew
        found = self.bench.design(setting)
        loads = [0.0, setting.payload_kg] if setting.payload_kg else [0.0]
        plants = tuple(ground.plants(ground.ends_m, loads))
        proven = replace(found, plants=plants, margins=margins(found.cascade, plants, ground.structure.period_s))
        findings = replace(self._basis.findings, remarks=list(self._basis.findings.remarks))
        findings.design, findings.cascade = proven, ground.with_feedforward(found.cascade)
        with self._saving, occupied(folder.path, Silence(), refusal=lambda holder: at_work(folder.path, holder)):
            replaced = next(name for k in count(1) if (name := f"replaced_{k}") not in folder.names("designs"))
            folder.save_design(replaced, saved_design(folder))
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
            "replaced": f"designs/{replaced}.yaml",
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


def tune(
    run: Place,
    *,
    token: str,
    port: int = 0,
    move: Place | None = None,
    opened: Callable[[str], object] | None = None,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """The page on 127.0.0.1 until KeyboardInterrupt.   token : secret part of its address.   port : 0 takes a free one.

    opened : called with the address, as a browser would be.   Exit code 1 when the last design saved is not to be used.
    Raises DataError without a design, UsageError for a port that is taken.
    """
    from beltcomm.web.server import PageFiles, serve  # no other command needs a web server

    run, options, talk = place(run), options or Options(), talk or Silence()
    move = None if move is None else place(move, "move")
    talk.say("computing the plants of this run")
    tuning = Tuning(run, payload_kg=options.payload_kg or 0.0, move=move, seed=options.seed or 0, talk=talk)
    with serve(PageFiles("tune"), tuning.answers(), token, port) as served:
        talk.say(f"the tuning page is at {served.address} ; Ctrl-C ends it")
        if opened is not None:
            opened(served.address)
        served.run()
    if not tuning.saved:
        return Result({"run": str(run), "saved": 0}, [f"Nothing was saved; the design of {run} is as it was."])
    last = tuning.saved[-1]
    return Result({**last.data, "saved": len(tuning.saved)}, last.text, last.exit_code)


def ground_of(basis: Basis, saved: Mapping[str, Any], move: Path | None = None) -> DesignInput:
    """What tuning of a run rests on.   saved : its present design.   move : file with the user's own."""
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
        (float(travel.min_m or 0.0), float(travel.max_m or 0.0)),
        held(move_of(folder, structure.period_s, move), REST_S),
        Loop(structure, late_s, peak, offline.counts_of(folder)),
        present,
        tuple(sorted({*(lag for lag in VELOCITY_FILTERS_S if _in_drive(lag, structure)), present.velocity_filter_s})),
    )


def move_of(folder: RunFolder, period_s: float, file: Path | None) -> Trajectory:
    """The user's own move from a file, the one that verified the run, or the standard one of its axis."""
    axis = folder.axis
    if file is not None:
        return load_move(file, period_s, axis)
    top, fastest = axis.limits.speed_m_s or GENTLE[0], axis.limits.acceleration_m_s2 or GENTLE[1]
    gentle = TrajectoryLimits(speed_m_s=min(top, GENTLE[0]), acceleration_m_s2=min(fastest, GENTLE[1]), jerk_m_s3=20.0 * GENTLE[1])
    limits = axis.trajectories.get("T_A") or gentle
    paths = [
        (folder.load("results", name).get("proof") or {}).get("path") for name in folder.names("results") if name.startswith("verify_")
    ]
    if paths and paths[-1]:
        start, end, duration = paths[-1]
        share = plan_trajectory(start, end, limits, period_s).duration_s / duration
        return plan_trajectory(start, end, phases.slower(limits, share), period_s)
    low, high = float(axis.travel.min_m or 0.0), float(axis.travel.max_m or 0.0)
    start = max(low + 0.05 * (high - low), min(0.0, high))
    return plan_trajectory(start, min(start + MOVE_M, high - 0.05 * (high - low)), limits, period_s)


def _hz(omega_rad_s: float) -> float:
    return omega_rad_s / (2.0 * math.pi)


def _in_drive(lag: float, structure: CascadeStructure) -> bool:
    low, high = structure.lowest.get("velocity_filter_s", 0.0), structure.highest.get("velocity_filter_s", math.inf)
    return bool(low <= lag <= high)


def _move_words(move: Trajectory, file: Path | None) -> str:
    start, end = 1e3 * move.position_m[0], 1e3 * move.position_m[-1]
    named, top = f" of {file.name}" if file is not None else "", abs(move.velocity_m_s).max()
    return f"move{named} from {start:.0f} to {end:.0f} mm in {move.duration_s - REST_S:.2f} s, up to {top:.2f} m/s"


def _curves(shown: CascadeView) -> dict[str, Any]:
    return {"worst": plain(shown.worst), "open_loops": _drawn(shown.open_loops), "responses": _drawn(shown.responses)}


def _drawn(curves: OpenLoops | Responses | TrackingPrediction) -> dict[str, Any]:
    """As :func:`plain`, arrays to the four digits that a picture shows: they are most of what the page waits for."""
    values = {field.name: getattr(curves, field.name) for field in fields(curves)}
    return {
        name: [float(f"{x:.4g}") for x in value.tolist()] if isinstance(value, np.ndarray) else plain(value)
        for name, value in values.items()
    }
