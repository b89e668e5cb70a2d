"""Moves that were driven with a design: error over time, measured and predicted, before and after on one scale."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from beltcomm.errors import BeltcommError
from beltcomm.given import pasted
from beltcomm.pages.gather import Gathered
from beltcomm.quantities import in_mm
from beltcomm.recording import Recording
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.proof import TrackedMove, tracking_figure
from beltcomm.report.style import Caption
from beltcomm.rundata.offline import counts_of
from beltcomm.rundata.store import cascade_from_dict, structure_from_dict
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, predict_move

#: Moves drawn beside each other: the first and the last of a run.
SHOWN = 2


def section(run: Gathered) -> Section:
    """Section on the moves: table of all, picture of the first and the last.

    Parameters
    ----------
    run : Gathered
    """
    title = "Tracking"
    moves = [r for r in run.recordings if f"verify_{r.name}" in run.results and r.reference_position is not None]
    if not moves:
        return Section(
            "tracking", title, missing=f"No move was driven; beltcomm verify --drive DRIVE --run {pasted(run.place)} drives one."
        )
    rows = [_row(r.name, run.verifications[r.name]) for r in moves]
    head = ("move", "result", "following error, motor, mm", "predicted", "range", "settled error, mm", "predicted")
    shown = [moves[0], moves[-1]][-min(SHOWN, len(moves)) :]
    caption = Caption(run.command, f"{run.name}/recordings: {', '.join(r.name for r in shown)}")
    parts: list[Paragraphs | PageTable | Picture] = [
        picture_of(tracking_figure([_tracked(run, r) for r in shown], caption)),
        PageTable(
            head,
            rows,
            "At the motor: the largest while it moves (following error), and from the settling time to 1.5 s after (settled).",
        ),
        Paragraphs(run.verifications[moves[-1].name].get("reasons") or (), listed=True),
    ]
    return Section("tracking", title, parts)


def last(run: Gathered) -> TrackedMove | None:
    """The last move of a run; None where none was driven.

    Parameters
    ----------
    run : Gathered
    """
    moves = [r for r in run.recordings if f"verify_{r.name}" in run.results and r.reference_position is not None]
    return _tracked(run, moves[-1]) if moves else None


def _row(name: str, result: Mapping[str, Any]) -> tuple[str, ...]:
    measured, predicted, spread = result["measured"], result["predicted"], result.get("predicted_range")
    between = "" if not spread else " to ".join(in_mm(end["dynamic_m"]) for end in spread)
    return (
        name,
        "meets its targets" if result["passed"] else "misses its targets",
        in_mm(measured["dynamic_m"]),
        in_mm(predicted["dynamic_m"]),
        between,
        in_mm(measured["static_m"]),
        in_mm(predicted["static_m"]),
    )


def _tracked(run: Gathered, recording: Recording) -> TrackedMove:
    """A move from its recording; the prediction again by today's model and the gains that it was driven with."""
    assert recording.reference_position is not None
    ratio = run.folder.axis.transmission_m_rad
    reference = recording.reference_position * ratio
    error = (recording.reference_position - recording.position) * ratio
    moving = np.flatnonzero(np.abs(np.diff(reference)) > 0.0)
    end = float(recording.t_s[moving[-1] + 1]) if len(moving) else 0.0
    target_m = run.folder.axis.targets.following_m
    return TrackedMove(recording.name, recording.t_s, reference, error, _predicted(run, recording, reference), target_m, end)


def _predicted(run: Gathered, recording: Recording, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    gains = (recording.sidecar.controller or {}).get("gains")
    drive, model = run.results.get("drive"), run.model
    led = (recording.sidecar.controller or {}).get("led_by")
    if gains is None or drive is None or model is None or recording.torque_offset is not None or led:
        return None
    try:
        structure, cascade = structure_from_dict(drive), cascade_from_dict({"parameters": gains})
        loop = Loop(structure, float(run.design.get("dead_time_s") or 0.0), float(drive["peak_torque_nm"]), counts_of(run.folder))
        grid = np.arange(recording.t_s[0], recording.t_s[-1], structure.period_s)
        path = np.interp(grid, recording.t_s, reference)
        speed = np.gradient(path, structure.period_s)
        if recording.reference_velocity is not None:
            speed = np.interp(grid, recording.t_s, recording.reference_velocity) * model["transmission.ratio"]
        trajectory = Trajectory(grid - grid[0], path, speed, np.gradient(speed, structure.period_s))
        return grid, path - predict_move(model, cascade, trajectory, loop).motor_m
    except BeltcommError:
        return None
